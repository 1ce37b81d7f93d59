"""One frame of an image: tolerance -> select -> stream -> draw -> present.

`Renderer` shows one image on one display. A live `Renderer.frame` never waits: what has not come yet is drawn
from coarser pages. `Renderer.pictures` is for files and tests: it waits until every pixel has its own level.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.image.file import Image
from limen.display.display import Display
from limen.display.quilt import Quilt, pack, pieces, quilt_names
from limen.gpu.device import Device
from limen.gpu.pool import PagePool
from limen.layers.common.known_contrast import KnownContrast
from limen.layers.common.page_detail import Detail
from limen.layers.image.cut import Cut
from limen.layers.image.draw.drawer import ImageLayer, Overlay, PlacedPages, Sampling, drawable_of
from limen.layers.image.draw.lens_mesh import Triangles
from limen.layers.image.select import ImageOnDisplay, select, view_of
from limen.stream.chunks import completed
from limen.stream.pages import PageStream
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface, Placement, carried_lenses
from limen.viewing.policy import Policy
from limen.viewing.projection import check_quilt_sizes, guard_of
from limen.viewing.tolerance import Tolerance, tolerance_of
from limen.viewing.viewer import Pointer, Viewer, nobody_points

__all__ = [
    "GPU_BYTES",
    "LOOKAHEAD_S",
    "Chosen",
    "FrameReport",
    "LensMoves",
    "Renderer",
    "active_panels",
    "select_ahead",
]

GPU_BYTES = 512 << 20
"""Memory for pages on the GPU, unless told otherwise: 1,800 pages."""

LOOKAHEAD_S = 0.4
"""How far ahead pages are fetched. Levels change in bursts, when a ring of distance sweeps over many pages at once;
fetching early spreads a burst over the frames before it."""

_QUILT_PX = 1 << 25
"""Pixels of one offscreen quilt: nine panels of 2560 x 1440, 134 MB."""


@dataclass(frozen=True, slots=True)
class FrameReport:
    """What one frame took, and what it could not have."""

    time_s: float
    policy: str
    panels_active: int
    pages: int
    missing: int
    uploads: int
    max_error_px: float
    bias: int
    select_ms: float
    stream_ms: float
    draw_ms: float
    triangles: int = 0
    """That lenses were drawn in; of live frames, nobody waits to count them."""
    scale: float = 1.0
    """Panels were drawn with so many times their true pixels along each side; all that is told is of these."""


class Chosen(NamedTuple):
    """What a live frame shows on all panels, before it is drawn."""

    cut: Cut
    pages: PlacedPages
    tolerance: Tolerance
    eye_m: tuple[float, float, float] | None
    report: FrameReport


class Renderer:
    """One image on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, image
        What is shown, and on what.
    placement
        How the image lies on the display.
    gpu_bytes
        Memory for pages on the GPU.
    uploads_per_frame
        Most pages copied to the GPU by one live frame.
    threads
        Decoding threads; ``None`` for one a core, two at least.
    sampling
        See `limen.layers.image.draw.drawer.ImageLayer`.
    max_quilt_px
        Most pixels drawn at once.

    Raises
    ------
    DeviceLimitError, DisplayError
        If the adapter cannot hold the pool or draw a panel.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        image: Image,
        placement: Placement | None = None,
        *,
        gpu_bytes: int = GPU_BYTES,
        uploads_per_frame: int = 64,
        threads: int | None = None,
        sampling: Sampling = "sharp",
        max_quilt_px: int = _QUILT_PX,
    ) -> None:
        self.view: ImageOnDisplay = view_of(display, image.pyramid, placement or OnSurface())
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self._pack = partial(pack, display, max_size_px=device.max_texture_px, max_px=max(max_quilt_px, widest))
        self.quilts: Sequence[Quilt] = display.quilts or self._pack()
        # Panels that limen packs touch; where hardware says how they lie, what is beside them may be seen.
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts) if display.quilts else 0.0
        check_quilt_sizes(self.quilts, device.max_texture_px)
        self._pool = PagePool(device, gpu_bytes)
        self._layer = ImageLayer(device, self.view, self._pool, sampling=sampling, guard_px=self.guard_px)
        self._stream = PageStream(
            image,
            self._pool.slots,
            per_frame=uploads_per_frame,
            threads=threads or max(2, os.cpu_count() or 2),
        )
        self._parts: dict[Quilt, ImageOnDisplay] = {}
        self._contrast = KnownContrast(image)
        self._earlier: tuple[Viewer, ...] = ()

    # ------------------------------------------------------------------ live

    def frame(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        quilt: Quilt | None = None,
        overlay: Overlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        now_s: float | None = None,
    ) -> FrameReport:
        """Draw what is there, ask for what is missing, and return at once.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface);
        with ``target``, a texture view of its size, they are drawn there. ``now_s`` is the time of the show that pages
        fade in by; without it they fade in by the computer's clock.
        """
        chosen = self.choose(viewers, policy, now_s=now_s)
        begin = time.perf_counter()
        for each in [quilt] if quilt else self.quilts:
            self.draw(chosen, each, overlay=overlay, target=target, target_format=target_format)
        return replace(chosen.report, draw_ms=chosen.report.draw_ms + (time.perf_counter() - begin) * 1e3)

    def choose(self, viewers: Sequence[Viewer], policy: Policy, *, now_s: float | None = None) -> Chosen:
        """The first half of a frame: what it shows on all panels, of what is there; what is missing is asked for."""
        begin = time.perf_counter()
        tolerance, eye_m = tolerance_of(viewers, policy), _first_eye(viewers)
        view = self._seen_by(policy)
        cut = select(view, tolerance, budget=self._pool.slots - 1, eye_m=eye_m)
        selected = time.perf_counter()
        soon = select_ahead(view, policy, viewers, self._earlier, LOOKAHEAD_S)
        self._earlier = tuple(viewers)
        update = self._stream.update(cut.pages, soon=soon, now_s=begin if now_s is None else now_s)
        pages = drawable_of(self._stream, self.view, cut)
        streamed = time.perf_counter()
        self._pool.write(update.arrived)
        clock = (begin, selected, streamed, time.perf_counter())
        report = self._report(viewers, policy, cut, update.statistics.missing, len(update.arrived), clock)
        return Chosen(cut, pages, tolerance, eye_m, report)

    def draw(
        self,
        chosen: Chosen,
        quilt: Quilt,
        *,
        overlay: Overlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
    ) -> None:
        """The second half: one quilt of it."""
        self._layer.draw(
            chosen.cut, chosen.pages, chosen.tolerance, quilt, eye_m=chosen.eye_m, overlay=overlay, target=target,
            target_format=target_format,
        )  # fmt: skip

    # ------------------------------------------------------------------ complete

    def pictures(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        overlay: Overlay | None = None,
        panels: Sequence[int] | None = None,
    ) -> Iterator[tuple[str, NDArray[np.uint8], FrameReport]]:
        """Every panel's finished picture, quilt by quilt: (name, uint8 (h, w, 4) sRGB, the quilt's report).

        Waits for pages; an array is only valid until the next is asked for. ``panels``: only those of these indices.
        """
        # A part of the display has no quilts of its own that its owner would know.
        quilts = self.quilts if panels is None else self._pack(panels=panels)
        for quilt, image, report in self._finished(viewers, policy, overlay, quilts):
            for name, picture in pieces(self.view.display, quilt, image).items():
                yield name, picture, report

    def quilt_pictures(
        self, viewers: Sequence[Viewer], policy: Policy, *, overlay: Overlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], FrameReport]]:
        """Every quilt as it is drawn, named by its output or its number: (name, uint8 (H, W, 4) sRGB, report).

        An array is only valid until the next is asked for.
        """
        drawn = self._finished(viewers, policy, overlay, self.quilts)
        for name, (_, image, report) in zip(quilt_names(self.quilts), drawn, strict=True):
            yield name, image, report

    def _finished(
        self, viewers: Sequence[Viewer], policy: Policy, overlay: Overlay | None, quilts: Sequence[Quilt]
    ) -> Iterator[tuple[Quilt, NDArray[np.uint8], FrameReport]]:
        """Quilts with all pages there that they want and that can be read."""
        tolerance, eye_m = tolerance_of(viewers, policy), _first_eye(viewers)
        if policy.name == "contrast":
            self._contrast.complete()
        detail = self._seen_by(policy).detail
        for quilt in quilts:
            begin = time.perf_counter()
            cut = self._select_part(quilt, detail, tolerance, eye_m)
            selected = time.perf_counter()
            missing, uploads = self._fetch(cut)
            drawable = drawable_of(self._stream, self.view, cut)
            streamed = time.perf_counter()
            texture = self._layer.draw(cut, drawable, tolerance, quilt, eye_m=eye_m, overlay=overlay)
            image = self._layer.read(texture)
            clock = (begin, selected, streamed, time.perf_counter())
            report = self._report(viewers, policy, cut, missing, uploads, clock)
            active = active_panels(cut, self.view, quilt)
            yield quilt, image, replace(report, panels_active=active, triangles=self._layer.triangle_count)

    def wanted(self, viewers: Sequence[Viewer], policy: Policy, display: Display) -> Cut:
        """What a frame of the same image asks for on other panels than are drawn: the true ones of a preview.

        Waits for the image's contrast to be known where the policy goes by it.
        """
        view = view_of(display, self.view.pyramid, self.view.placement)
        if policy.name == "contrast":
            self._contrast.complete()
            view = view._replace(detail=self._contrast.detail(display))
        return select(view, tolerance_of(viewers, policy), eye_m=_first_eye(viewers))

    def place(self, placement: OnSurface, carried: Sequence[Lens] = (), pointers: Sequence[Pointer] = ()) -> None:
        """Move an image that lies on the surface, or its lenses; its resident pages stay.

        ``carried`` are lenses that each pointer carries to where it points, wherever they say that they are.
        """
        display, pyramid = self.view.display, self.view.pyramid
        if carried and pointers:
            maps = placement.panel_maps(display, pyramid.size_px)
            lenses = carried_lenses(display, maps, pointers, carried)
            placement = replace(placement, lenses=placement.lenses + lenses)
        self.view = view_of(display, pyramid, placement, self.view.detail)
        self._layer.place(self.view)
        self._parts.clear()

    def lens_triangles(self) -> Triangles:
        """What the last quilt's lenses were drawn by; waits for the GPU."""
        return self._layer.lens_mesh.read()

    def close(self) -> None:
        """Stop decoding and free the GPU memory; the device and the image stay open."""
        self._contrast.close()
        self._stream.close()
        self._layer.destroy()
        self._pool.destroy()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _report(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        cut: Cut,
        missing: int,
        uploads: int,
        clock_s: tuple[float, float, float, float],
    ) -> FrameReport:
        """``clock_s``: when the frame began, and when selecting, streaming and drawing were done."""
        begin, selected, streamed, drawn = clock_s
        return FrameReport(
            time_s=viewers[0].time_s if viewers else 0.0,
            policy=policy.label,
            panels_active=active_panels(cut, self.view),
            pages=len(cut),
            missing=missing,
            uploads=uploads,
            max_error_px=cut.error_px,
            bias=cut.bias,
            select_ms=(selected - begin) * 1e3,
            stream_ms=(streamed - selected) * 1e3,
            draw_ms=(drawn - streamed) * 1e3,
            scale=self.view.display.scale,
        )

    def _seen_by(self, policy: Policy) -> ImageOnDisplay:
        """The image on the display, with what faintness hides where the policy makes use of it."""
        if policy.name != "contrast":
            return self.view
        return self.view._replace(detail=self._contrast.detail(self.view.display))

    def _select_part(
        self, quilt: Quilt, detail: Detail, tolerance: Tolerance, eye_m: tuple[float, float, float] | None
    ) -> Cut:
        """The cut of one quilt's panels, numbered as in the whole display."""
        if quilt not in self._parts:
            part = self.view.display.part(quilt.panels)
            self._parts[quilt] = view_of(part, self.view.pyramid, self.view.placement, detail)
        cut = select(self._parts[quilt]._replace(detail=detail), tolerance, budget=self._pool.slots - 1, eye_m=eye_m)
        return replace(cut, pair_panel=np.array(quilt.panels, dtype=np.int64)[cut.pair_panel])

    def _fetch(self, cut: Cut) -> tuple[int, int]:
        """Wait until all pages of a cut are resident or have failed: (failed, uploaded)."""
        missing = uploaded = 0
        for _, update in completed([(self._stream, cut.pages)]):
            self._pool.write(update.arrived)
            missing, uploaded = update.statistics.missing, uploaded + len(update.arrived)
        return missing, uploaded


def _no_lenses(_time_s: float) -> tuple[Lens, ...]:
    return ()


class LensMoves(NamedTuple):
    """Lenses that are elsewhere, or others, from frame to frame; times are the viewers'."""

    moving: Callable[[float], tuple[Lens, ...]] = _no_lenses
    carried: tuple[Lens, ...] = ()
    """Each pointer carries them to where it points, wherever they say that they are."""
    pointers: Callable[[float], Sequence[Pointer]] = nobody_points

    @property
    def any(self) -> bool:
        return bool(self.carried) or self.moving is not _no_lenses

    def place(self, renderer: Renderer, placement: OnSurface, time_s: float) -> None:
        """Put a renderer's lenses where they are at a time, over those of a placement."""
        moved = replace(placement, lenses=placement.lenses + self.moving(time_s))
        renderer.place(moved, self.carried, self.pointers(time_s) if self.carried else ())


def select_ahead(
    view: ImageOnDisplay, policy: Policy, viewers: Sequence[Viewer], earlier: Sequence[Viewer], seconds: float
) -> NDArray[np.int64] | None:
    """Pages for where the viewers will be if they walk on as since the frame before; ``None`` if nobody moves."""
    if seconds <= 0 or len(viewers) != len(earlier):
        return None
    moved = [viewer.extrapolated(before, seconds) for viewer, before in zip(viewers, earlier, strict=True)]
    if moved == list(viewers):
        return None
    return select(view, tolerance_of(moved, policy), eye_m=_first_eye(moved)).pages


def _first_eye(viewers: Sequence[Viewer]) -> tuple[float, float, float] | None:
    return viewers[0].position_m if viewers else None


def active_panels(cut: Cut, view: ImageOnDisplay, quilt: Quilt | None = None) -> int:
    """Panels (of a quilt) that show something of the image; of one on a shape, all may."""
    panels = np.arange(len(view.display.panels))
    if view.maps is not None:
        through_lenses = cut.pair_panel[:0] if view.cells is None else view.cells.panel
        panels = np.unique(np.concatenate([cut.pair_panel, through_lenses]))
    return len(panels if quilt is None else np.intersect1d(panels, quilt.panels))
