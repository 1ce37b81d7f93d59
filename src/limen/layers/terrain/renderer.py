"""One frame of a terrain: demand -> select -> stream -> draw -> present.

`TerrainRenderer` shows one terrain on all panels of a display: each at the level of detail that nobody in the room can
tell from the original, whoever stands where, and all from one eye, the first viewer's or a fixed one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pieces
from limen.geometry import Vec3
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.layers.common.known_contrast import KnownContrast
from limen.layers.common.simulator import DisplaySimulator
from limen.layers.terrain.draw.drawer import Rims, TerrainOverlay
from limen.layers.terrain.look import TerrainLook, panel_tints
from limen.layers.terrain.resources import GPU_BYTES, Draped, TerrainStock, Wishes
from limen.layers.terrain.selector import Choice, Scenery, TerrainSelector, TerrainSettings, merged
from limen.viewing.camera import Camera
from limen.viewing.panel_demands import PanelDemands
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.projection import check_quilt_sizes
from limen.viewing.viewer import Pointer, Viewer

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain

__all__ = ["BACKGROUND", "TerrainRenderer", "TerrainReport"]

BACKGROUND = (0.006, 0.007, 0.01)
"""Linear light where there is no terrain, as of empty scenes."""

_QUILT_PX = 1 << 26
"""Pixels of one offscreen quilt: 268 MB, and as much for depth."""


@dataclass(frozen=True, slots=True)
class TerrainReport:
    """What one frame took, and what it could not have."""

    time_s: float
    policy: str
    panels_active: int
    triangles: int
    patches: int
    pages: int
    missing: int
    min_allowed_px: float
    max_allowed_px: float
    """Smallest and largest error that active panels may have, pixels: 0 where none is active."""
    max_error_px: float
    """The largest error reached; more than allowed while patches are missing."""
    select_ms: float
    stream_ms: float
    draw_ms: float
    scale: float = 1.0
    """Panels were drawn with so many times their true pixels along each side."""

    @property
    def drawn(self) -> str:
        return f"{self.triangles:,} triangles"

    @classmethod
    def of(cls, quilts: Sequence[TerrainReport]) -> TerrainReport:
        """One report for all quilts of a frame."""
        first, active = quilts[0], [report for report in quilts if report.panels_active]
        sums = ("panels_active", "triangles", "patches", "pages", "missing", "select_ms", "stream_ms", "draw_ms")
        return replace(
            first,
            min_allowed_px=min((report.min_allowed_px for report in active), default=0.0),
            max_allowed_px=max((report.max_allowed_px for report in active), default=0.0),
            max_error_px=max((report.max_error_px for report in active), default=0.0),
            **{part: sum(getattr(report, part) for report in quilts) for part in sums},
        )


class _Asked(NamedTuple):
    """What a frame is drawn for, whatever the quilt."""

    viewers: Sequence[Viewer]
    policy: Policy
    demands: PanelDemands
    overlay: TerrainOverlay | None


class TerrainRenderer:
    """One terrain on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, terrain
        What is shown, and on what.
    look
        Colours, light and contour lines.
    settings
        From where it is looked at, and how its detail is chosen.
    reference_m
        The reference eye; see `limen.layers.terrain.look_at`.
    whole
        The installation that ``display`` is a part of, which says where the terrain stands.
    draped
        A picture that lies on the terrain.
    background
        Linear light (red, green, blue) where there is no terrain.
    gpu_bytes
        Memory for patches and pages on the GPU.
    threads
        Reading threads for patches, and as many for every kind of page.
    max_quilt_px
        Most pixels drawn at once.

    Raises
    ------
    InputError
        If the terrain's coarsest patches do not fit into ``gpu_bytes``.
    DeviceLimitError, DisplayError
        If the adapter cannot hold what is asked for or draw a panel.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        terrain: Terrain,
        *,
        look: TerrainLook | None = None,
        settings: TerrainSettings | None = None,
        reference_m: Vec3,
        whole: Display | None = None,
        draped: Draped | None = None,
        background: tuple[float, float, float] = BACKGROUND,
        gpu_bytes: int = GPU_BYTES,
        threads: int | None = None,
        max_quilt_px: int = _QUILT_PX,
    ) -> None:
        self.display, self.terrain = display, terrain
        self._device, self._look = device, look or TerrainLook()
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self.quilts: Sequence[Quilt] = display.quilts or pack_outlines(
            display, max_size_px=device.max_texture_px, max_px=max(max_quilt_px, 2 * widest)
        )
        check_quilt_sizes(self.quilts, device.max_texture_px)
        scenery = Scenery(terrain.size_posts, terrain.spacing_m, terrain.nodes, terrain.patches, terrain.relief.pyramid)
        self._contrast = KnownContrast(draped.image) if draped else None
        if draped and self._contrast:
            detail = partial(self._contrast.detail, display)
            scenery = scenery.draped(draped.image.pyramid, draped.texel_from_post, detail)
        self._sight = TerrainSelector(
            scenery, display, self.quilts, settings or TerrainSettings(), whole=whole or display,
            reference_m=reference_m,
        )  # fmt: skip
        self.guard_px = self._sight.guard_px
        self._stock = TerrainStock(device, terrain, draped, background=background, gpu_bytes=gpu_bytes, threads=threads)
        self._drawn_patches = np.zeros(0, np.int64)
        self._reader = TextureReader(device)

    @property
    def range_m(self) -> float:
        """From how far all of the terrain is seen, metres."""
        return self._sight.range_m

    def pose(self, time_s: float, look_at: LookAt | None = None) -> None:
        """Put the terrain where the flight has it at a time, looked at as in the settings or from elsewhere."""
        self._sight.pose(time_s, look_at)

    # ------------------------------------------------------------------ live

    def frame(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        pointers: Sequence[Pointer] = (),
        quilt: Quilt | None = None,
        overlay: TerrainOverlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        now_s: float | None = None,
    ) -> TerrainReport:
        """Draw what is there, ask for what is missing, and return at once.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface); with ``target``, a
        texture view of its size, they are drawn there. ``now_s`` is the time of the show that pages fade in by; without
        it they fade in by the computer's clock.
        """
        asked = self._asked(viewers, policy, pointers, overlay, live=True)
        wanted = [self._sight.choose(each, viewers, asked.demands) for each in ([quilt] if quilt else self.quilts)]
        begin = time.perf_counter()
        missing = self._stock.update(self._wishes(wanted), now_s=begin if now_s is None else now_s)
        streamed_s = time.perf_counter() - begin
        reports = []
        for each in wanted:
            _, report = self._draw(each, asked, missing, target, target_format)
            reports.append(replace(report, stream_ms=streamed_s * 1e3 / len(wanted)))
        return TerrainReport.of(reports)

    # ------------------------------------------------------------------ complete

    def pictures(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        pointers: Sequence[Pointer] = (),
        overlay: TerrainOverlay | None = None,
    ) -> Iterator[tuple[str, NDArray[np.uint8], TerrainReport]]:
        """Every panel's finished picture, quilt by quilt: (name, uint8 (h, w, 4) sRGB, the quilt's report).

        Waits for patches and pages; an array is only valid until the next is asked for. Panels that nobody sees are
        dark.
        """
        asked = self._asked(viewers, policy, pointers, overlay)
        for quilt in self.quilts:
            texture, report = self._complete(quilt, asked)
            image = self._reader.read(texture)
            for name, picture in pieces(self.display, quilt, image).items():
                yield name, picture, report

    def seen(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        cameras: Sequence[Camera],
        *,
        pointers: Sequence[Pointer] = (),
        overlay: TerrainOverlay | None = None,
    ) -> list[NDArray[np.uint8]]:
        """What cameras in the room see of the lit display: uint8 (H, W, 4), sRGB, each."""
        asked = self._asked(viewers, policy, pointers, overlay)
        textures = [self._complete(quilt, asked, slot=slot)[0] for slot, quilt in enumerate(self.quilts)]
        lit = DisplaySimulator(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def textures(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        pointers: Sequence[Pointer] = (),
        overlay: TerrainOverlay | None = None,
        now_s: float | None = None,
    ) -> tuple[list[Any], TerrainReport]:
        """The textures of all quilts as they are lit live; ``now_s`` as in `frame`; valid until the next frame."""
        asked = self._asked(viewers, policy, pointers, overlay, live=True)
        wanted = [self._sight.choose(quilt, asked.viewers, asked.demands) for quilt in self.quilts]
        missing = self._stock.update(self._wishes(wanted), now_s=time.perf_counter() if now_s is None else now_s)
        drawn = [self._draw(each, asked, missing, slot=slot) for slot, each in enumerate(wanted)]
        return [texture for texture, _ in drawn], TerrainReport.of([report for _, report in drawn])

    def close(self) -> None:
        """Stop reading and free the GPU memory; the device, the terrain and its drape stay open."""
        if self._contrast is not None:
            self._contrast.close()
        self._stock.close()
        self._reader.destroy()

    def __enter__(self) -> TerrainRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of a frame

    def _asked(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        pointers: Sequence[Pointer],
        overlay: TerrainOverlay | None,
        *,
        live: bool = False,
    ) -> _Asked:
        if self._contrast is not None and policy.name == "contrast" and not live:
            self._contrast.complete()
        demands = self._sight.demands(viewers, policy, pointers, live=live)
        return _Asked(viewers, policy, demands, overlay)

    def _complete(self, quilt: Quilt, asked: _Asked, slot: int = 0) -> tuple[Any, TerrainReport]:
        """One quilt with all that it wants."""
        wanted = self._sight.choose(quilt, asked.viewers, asked.demands)
        begin = time.perf_counter()
        missing = self._stock.fetch(self._wishes([wanted]))
        streamed_s = time.perf_counter() - begin
        texture, report = self._draw(wanted, asked, missing, slot=slot)
        return texture, replace(report, stream_ms=streamed_s * 1e3)

    def _wishes(self, wanted: Sequence[Choice]) -> Wishes:
        """What quilts want together; what was drawn until now is drawn no longer."""
        drawn, self._drawn_patches = self._drawn_patches, self._drawn_patches[:0]
        return Wishes(
            merged([(each.cut.patches, each.cut.importance) for each in wanted]),
            drawn,
            merged([(each.pages.pages, each.pages.importance) for each in wanted]),
            merged([(each.drape_pages.pages, each.drape_pages.importance) for each in wanted]),
        )

    def _draw(
        self,
        wanted: Choice,
        asked: _Asked,
        missing: int,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        slot: int = 0,
    ) -> tuple[Any, TerrainReport]:
        begin = time.perf_counter()
        quilt, places, cut = wanted.quilt, self._stock.places, wanted.cut
        if not places.resident[cut.pair_patch].all():
            cut = self._sight.select(quilt, wanted.views, wanted.allowed_px, places.resident)
        panels = len(quilt.panels)
        fans = self._stock.rims.fans(cut.pair_panel, cut.pair_patch, panels)
        seen = asked.demands.seen[list(quilt.panels)]
        texture = self._stock.layer.draw(
            wanted.windows, wanted.views.eye_m, self._sight.room_from_posts, cut, places,
            Rims(fans.triangles.reshape(-1), fans.panel_first * 3), pages=self._stock.tables,
            allowed_px=wanted.allowed_px, look=self._look, overlay=asked.overlay,
            tints=panel_tints(seen, cut.panel_error_px), target=target, target_format=target_format, slot=slot,
        )  # fmt: skip
        self._drawn_patches = np.union1d(self._drawn_patches, cut.pair_patch)
        active = wanted.views.facing & np.isfinite(wanted.allowed_px)
        allowed = wanted.allowed_px[active]
        report = TerrainReport(
            time_s=asked.viewers[0].time_s if asked.viewers else 0.0,
            policy=asked.policy.label,
            panels_active=int(active.sum()),
            triangles=int(places.core_indices[cut.pair_patch].sum()) // 3 + len(fans.triangles),
            patches=len(cut),
            pages=len(wanted.pages.pages) + len(wanted.drape_pages.pages),
            missing=missing,
            min_allowed_px=float(allowed.min(initial=np.inf)) if len(allowed) else 0.0,
            max_allowed_px=float(allowed.max(initial=0.0)),
            max_error_px=float(cut.panel_error_px.max(initial=0.0)),
            select_ms=wanted.select_s * 1e3,
            stream_ms=0.0,
            draw_ms=(time.perf_counter() - begin) * 1e3,
            scale=self.display.scale,
        )
        return texture, report
