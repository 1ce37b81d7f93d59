"""One frame of a terrain: demand -> select -> stream -> draw -> present.

`TerrainRenderer` shows one terrain on all panels of a display: each at the level of detail that nobody in the room can
tell from the original, whoever stands where, and all from one eye, the first viewer's or a fixed one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limen.camera import Camera
from limen.data.terrain import Nodes
from limen.data.terrain_file import Terrain
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pieces
from limen.draw.lit import LitDisplay
from limen.draw.terrain import Rims, TerrainOverlay
from limen.draw.terrain_look import TerrainLook, panel_tints
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.look_at import Flight, LookAt, fitted_range_m, in_flight, room_from_posts
from limen.select.terrain import Mode, TerrainCut, select_terrain
from limen.select.terrain_pages import TerrainPages, pages_for_terrain
from limen.select.visibility import PanelDemands, Rule, panel_demands
from limen.terrain_stock import GPU_BYTES, Draped, TerrainStock, Wishes
from limen.tolerance import Policy
from limen.view import PanelViews, Windows, guard_of
from limen.viewer import Pointer, Viewer

__all__ = ["BACKGROUND", "CAMERAS", "CameraKind", "TerrainRenderer", "TerrainReport", "TerrainSettings"]

CameraKind: TypeAlias = Literal["window", "fixed"]
CAMERAS: tuple[CameraKind, ...] = get_args(CameraKind)

BACKGROUND = (0.006, 0.007, 0.01)
"""Linear light where there is no terrain, as of empty scenes."""

_QUILT_PX = 1 << 26
"""Pixels of one offscreen quilt: 268 MB, and as much for depth."""


@dataclass(frozen=True, slots=True)
class TerrainSettings:
    """How a terrain is shown.

    Parameters
    ----------
    look
        Colours, light and contour lines.
    look_at, flight
        From where it is looked at, and how that changes over time.
    camera
        ``window``: the panels are windows, seen through by the first viewer. ``fixed``: one picture for the whole
        display, that of the reference eye, whoever stands where; viewers decide about its detail alone.
    cut
        See `limen.select.terrain.select_terrain`.
    rule, field_deg
        See `limen.select.visibility.panel_demands`.
    most_triangles
        Budget of every quilt: where more would be wanted, all errors allowed grow.
    """

    look: TerrainLook = field(default_factory=TerrainLook)
    look_at: LookAt = field(default_factory=LookAt)
    flight: Flight = "none"
    camera: CameraKind = "window"
    cut: Mode = "adaptive"
    rule: Rule = "exact"
    field_deg: float | None = None
    most_triangles: int | None = None

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(f"no camera is named '{self.camera}': there are {', '.join(CAMERAS)}")


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


class _Wanted(NamedTuple):
    """One quilt, and what its panels want."""

    quilt: Quilt
    windows: Windows
    views: PanelViews
    allowed_px: Floats
    cut: TerrainCut
    pages: TerrainPages
    drape_pages: TerrainPages
    select_s: float


class TerrainRenderer:
    """One terrain on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, terrain
        What is shown, and on what.
    settings
        How it is shown.
    reference_m
        The reference eye; see `limen.look_at`.
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
        settings: TerrainSettings | None = None,
        reference_m: Vec3,
        whole: Display | None = None,
        draped: Draped | None = None,
        background: tuple[float, float, float] = BACKGROUND,
        gpu_bytes: int = GPU_BYTES,
        threads: int | None = None,
        max_quilt_px: int = _QUILT_PX,
    ) -> None:
        self.display, self.terrain, self.settings = display, terrain, settings or TerrainSettings()
        self._whole, self._reference_m = whole or display, reference_m
        self._device = device
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self.quilts: Sequence[Quilt] = display.quilts or pack_outlines(
            display, max_size_px=device.max_texture_px, max_px=max(max_quilt_px, 2 * widest)
        )
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts)
        self._windows = {quilt: Windows(display, quilt, 1, self.guard_px) for quilt in self.quilts}
        self._draped = draped
        self._stock = TerrainStock(device, terrain, draped, background=background, gpu_bytes=gpu_bytes, threads=threads)
        self._drawn_patches = np.zeros(0, np.int64)
        self._earlier: PanelDemands | None = None
        self._reader = TextureReader(device)
        self.pose(0.0)

    @property
    def range_m(self) -> float:
        """From how far all of the terrain is seen, metres."""
        return fitted_range_m(self.terrain, self._whole, self._reference_m, self.settings.look_at)

    def pose(self, time_s: float, look_at: LookAt | None = None) -> None:
        """Put the terrain where the flight has it at a time, looked at as in the settings or from elsewhere."""
        look = in_flight(look_at or self.settings.look_at, self.settings.flight, self.terrain, time_s)
        self.room_from_posts = room_from_posts(self.terrain, self._whole, self._reference_m, look)

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
    ) -> TerrainReport:
        """Draw what is there, ask for what is missing, and return at once.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface); with ``target``, a
        texture view of its size, they are drawn there.
        """
        asked = self._asked(viewers, policy, pointers, overlay, live=True)
        wanted = [self._wanted(each, asked) for each in ([quilt] if quilt else self.quilts)]
        begin = time.perf_counter()
        missing = self._stock.update(self._wishes(wanted), now_s=begin)
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
        lit = LitDisplay(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def lit_for(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        pointers: Sequence[Pointer] = (),
        overlay: TerrainOverlay | None = None,
    ) -> tuple[list[Any], TerrainReport]:
        """The textures of all quilts as they are lit live; valid until the next frame."""
        asked = self._asked(viewers, policy, pointers, overlay, live=True)
        wanted = [self._wanted(quilt, asked) for quilt in self.quilts]
        missing = self._stock.update(self._wishes(wanted), now_s=time.perf_counter())
        drawn = [self._draw(each, asked, missing, slot=slot) for slot, each in enumerate(wanted)]
        return [texture for texture, _ in drawn], TerrainReport.of([report for _, report in drawn])

    def close(self) -> None:
        """Stop reading and free the GPU memory; the device, the terrain and its drape stay open."""
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
        """``live``: what was demanded a frame ago is held on to, so that panels do not flicker."""
        demands = panel_demands(
            self.display, viewers, policy, rule=self.settings.rule, field_deg=self.settings.field_deg,
            pointers=pointers, earlier=self._earlier if live else None,
        )  # fmt: skip
        if live:
            self._earlier = demands
        return _Asked(viewers, policy, demands, overlay)

    def _wanted(self, quilt: Quilt, asked: _Asked) -> _Wanted:
        begin = time.perf_counter()
        windows = self._windows.get(quilt)
        if windows is None:
            windows = self._windows[quilt] = Windows(self.display, quilt, 1, guard_of(self.display, quilt))
        views = windows.seen_from(self._eye(asked.viewers))
        allowed_px = asked.demands.allowed_px[list(quilt.panels)]
        cut = self._select(quilt, views, allowed_px)
        pages = self._pages(cut, quilt, views, allowed_px)
        return _Wanted(quilt, windows, views, allowed_px, cut, *pages, time.perf_counter() - begin)

    def _eye(self, viewers: Sequence[Viewer]) -> Floats:
        """The eye that the picture is drawn for."""
        fixed = self.settings.camera == "fixed" or not viewers
        return np.array(self._reference_m if fixed else viewers[0].position_m)

    def _select(
        self, quilt: Quilt, views: PanelViews, allowed_px: Floats, available: NDArray[np.bool_] | None = None
    ) -> TerrainCut:
        terrain = self.terrain
        return select_terrain(
            terrain.nodes, terrain.patches, views, quilt.size_px, self.room_from_posts, allowed_px,
            mode=self.settings.cut, available=available, most_triangles=self.settings.most_triangles,
        )  # fmt: skip

    def _pages(
        self, cut: TerrainCut, quilt: Quilt, views: PanelViews, allowed_px: Floats
    ) -> tuple[TerrainPages, TerrainPages]:
        """Pages of relief and heights, and of the drape."""
        nodes, patches, place = self.terrain.nodes, self.terrain.patches, self.room_from_posts
        pyramid = self.terrain.relief.pyramid
        pages = pages_for_terrain(cut, nodes, patches, pyramid, views, quilt.size_px, place, allowed_px)
        if self._draped is None:
            return pages, TerrainPages(pages.pages[:0], pages.importance[:0])
        texels, room_from_texels = _in_texels(nodes, self._draped.texel_from_post, place)
        pyramid = self._draped.image.pyramid
        draped = pages_for_terrain(cut, texels, patches, pyramid, views, quilt.size_px, room_from_texels, allowed_px)
        return pages, draped

    def _complete(self, quilt: Quilt, asked: _Asked, slot: int = 0) -> tuple[Any, TerrainReport]:
        """One quilt with all that it wants."""
        wanted = self._wanted(quilt, asked)
        begin = time.perf_counter()
        missing = self._stock.fetch(self._wishes([wanted]))
        streamed_s = time.perf_counter() - begin
        texture, report = self._draw(wanted, asked, missing, slot=slot)
        return texture, replace(report, stream_ms=streamed_s * 1e3)

    def _wishes(self, wanted: Sequence[_Wanted]) -> Wishes:
        """What quilts want together; what was drawn until now is drawn no longer."""
        drawn, self._drawn_patches = self._drawn_patches, self._drawn_patches[:0]
        return Wishes(
            _merged([(each.cut.patches, each.cut.importance) for each in wanted]),
            drawn,
            _merged([(each.pages.pages, each.pages.importance) for each in wanted]),
            _merged([(each.drape_pages.pages, each.drape_pages.importance) for each in wanted]),
        )

    def _draw(
        self,
        wanted: _Wanted,
        asked: _Asked,
        missing: int,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        slot: int = 0,
    ) -> tuple[Any, TerrainReport]:
        begin = time.perf_counter()
        quilt, places, cut = wanted.quilt, self._stock.places, wanted.cut
        if not places.resident[cut.pair_patch].all():
            cut = self._select(quilt, wanted.views, wanted.allowed_px, places.resident)
        panels = len(quilt.panels)
        fans = self._stock.rims.fans(cut.pair_panel, cut.pair_patch, panels)
        seen = asked.demands.seen[list(quilt.panels)]
        texture = self._stock.layer.draw(
            wanted.windows, wanted.views.eye_m, self.room_from_posts, cut, places,
            Rims(fans.triangles.reshape(-1), fans.panel_first * 3), pages=self._stock.tables,
            allowed_px=wanted.allowed_px, look=self.settings.look, overlay=asked.overlay,
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
        )
        return texture, report


def _merged(parts: Sequence[tuple[NDArray[np.int64], Floats]]) -> NDArray[np.int64]:
    """Distinct numbers of several lists, the most important first."""
    numbers, importance = (np.concatenate([part[which] for part in parts]) for which in (0, 1))
    ordered = numbers[np.argsort(-importance, kind="stable")].astype(np.int64)
    _, first = np.unique(ordered, return_index=True)
    return np.asarray(ordered[np.sort(first)])


def _in_texels(nodes: Nodes, texel_from_post: Floats, room_from_posts: Floats) -> tuple[Nodes, Floats]:
    """The nodes' rectangles in texels of a drape, rounded outward, and the room from those."""
    corners = nodes.rect[:, [0, 1, 2, 1, 0, 3, 2, 3]].reshape(-1, 4, 2)
    texels = corners @ texel_from_post[:, :2].T + texel_from_post[:, 2]
    rect = np.concatenate([np.floor(texels.min(axis=1)), np.ceil(texels.max(axis=1))], axis=1).astype(np.int32)
    matrix = np.eye(4)
    matrix[:2, :2], matrix[:2, 3] = texel_from_post[:, :2], texel_from_post[:, 2]
    return nodes._replace(rect=rect), np.asarray(room_from_posts @ np.linalg.inv(matrix))
