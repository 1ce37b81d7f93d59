"""Four ways to look at a show: the window as a display, a display unrolled, as an eye sees it, and on real outputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Protocol, TypeAlias

import numpy as np

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.frame.renderer import Chosen, Renderer
from limen.frame.report import FrameReport
from limen.frame.simulator import DisplaySimulator
from limen.gpu.device import Device
from limen.show.canvas import Surface
from limen.show.show import Show
from limen.show.sources import FrameSource
from limen.viewing.eye_camera import eye_camera

__all__ = ["VIEWS", "EyeView", "OutputsView", "View", "ViewName", "WindowView", "unrolled_quilt"]

ViewName: TypeAlias = Literal["unrolled", "eye", "outputs"]

_LIT_PX = 1 << 23
"""Pixels of a simulated display in all: more are not seen in a window."""


class View(Protocol):
    """What is drawn of a show into one canvas or several."""

    def draw(self, number: int, surface: Surface, source: FrameSource) -> FrameReport:
        """Draw one frame of a canvas, by its number."""
        ...

    def changed(self) -> None:
        """What was chosen for the frame that is being drawn is no longer what is wanted."""
        ...

    def close(self) -> None: ...


class WindowView:
    """A display that is as large as the window: the window itself, or a display that is unrolled in it."""

    def __init__(self, device: Device, show: Show, display: Display | None) -> None:
        self._device, self._show, self._display = device, show, display
        self._renderer: Renderer | None = None
        self._size_px = (0, 0)

    def draw(self, number: int, surface: Surface, source: FrameSource) -> FrameReport:
        renderer = self._sized(surface.size_px)
        frame = source.next(surface, renderer.display)
        return renderer.frame(frame, target=surface.target, target_format=surface.target_format, now_s=surface.time_s)

    def changed(self) -> None:
        """Every frame is chosen anew."""

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None

    def _sized(self, size_px: tuple[int, int]) -> Renderer:
        """The renderer of a window of this size."""
        if self._renderer is None or size_px != self._size_px:
            self.close()
            self._size_px = size_px
            if self._display is None:
                shown, quilt = Display.window(size_px), Quilt(size_px, (0,), ((0, 0),))
            else:
                shown, quilt = unrolled_quilt(self._display, size_px)
            self._renderer = self._show.renderer(self._device, shown, [quilt], quick=True)
        return self._renderer


class EyeView:
    """A simulated display, seen by the first viewer, whom it is lit for."""

    def __init__(self, device: Device, show: Show, display: Display) -> None:
        self._device = device
        self._display = display.scaled(min(1.0, math.sqrt(_LIT_PX / display.total_px)))
        self._renderer = show.renderer(device, self._display)
        quilts, guard_px = self._renderer.quilts, self._renderer.guard_px
        self._lit = DisplaySimulator(device, self._display, quilts, guard_px=guard_px)

    def draw(self, number: int, surface: Surface, source: FrameSource) -> FrameReport:
        frame = source.next(surface, self._display)
        textures, report = self._renderer.textures(frame, now_s=surface.time_s)
        viewer = frame.viewers[0]
        camera = eye_camera(self._display, np.array(viewer.position_m), surface.size_px, viewer.direction)
        framed = source.framed_from(viewer)
        if framed.position_m != viewer.position_m:  # or whoever comes nearer would be shown less
            fitted = eye_camera(self._display, np.array(framed.position_m), surface.size_px, viewer.direction)
            camera = replace(camera, fov_deg=fitted.fov_deg)
        samples = 1 if self._device.is_software else 2
        self._lit.draw(textures, camera, samples=samples, target=surface.target, target_format=surface.target_format)
        return report

    def changed(self) -> None:
        """Every frame is chosen anew."""

    def close(self) -> None:
        self._renderer.close()
        self._lit.destroy()


class OutputsView:
    """A canvas for every quilt of a display: all show what was chosen for one frame.

    Raises
    ------
    InputError
        If the display says nothing of quilts.
    """

    def __init__(self, device: Device, show: Show, display: Display) -> None:
        if not display.quilts:
            raise InputError(
                f"display '{display.name}' does not say which panels lie where on which output: add [[quilt]] to its "
                "file, or save a packing with `limen display NAME --quilt --to-toml FILE`"
            )
        self._renderer = show.renderer(device, display)
        self._chosen: Chosen | None = None
        self._last: Surface | None = None

    def draw(self, number: int, surface: Surface, source: FrameSource) -> FrameReport:
        """Raises InputError if the canvas has not exactly the quilt's pixels: nothing would be where it ought to."""
        quilt = self._renderer.quilts[number]
        if surface.size_px != quilt.size_px:
            raise InputError(
                f"output '{quilt.output or number}' has {surface.size_px[0]} x {surface.size_px[1]} pixels and its "
                f"quilt {quilt.size_px[0]} x {quilt.size_px[1]}: change the screen's resolution, or size_px in the file"
            )
        if number == 0 or self._last is None:  # one moment for all: what several screens show belongs together
            self._last, self._chosen = surface, None
        if self._chosen is None:
            frame = source.next(self._last, self._renderer.display)
            self._chosen = self._renderer.choose(frame, now_s=self._last.time_s)
        drawn = self._renderer.draw(self._chosen, number, target=surface.target, target_format=surface.target_format)
        return self._renderer.report(self._chosen, [drawn])

    def changed(self) -> None:
        self._chosen = None

    def close(self) -> None:
        self._renderer.close()


VIEWS: dict[ViewName, Callable[[Device, Show, Display], View]] = {
    "unrolled": WindowView,
    "eye": EyeView,
    "outputs": OutputsView,
}
"""Of shows on displays. Without one, the window is the display."""


def unrolled_quilt(display: Display, size_px: tuple[int, int]) -> tuple[Display, Quilt]:
    """A display scaled to a window, and a quilt with its panels where they lie on the unrolled surface."""
    surface = display.surface
    pitch = display.panels[0].pitch_m[0]
    px_per_m = min(size_px[0] / surface.width, size_px[1] / surface.height)
    shown = display.scaled(min(1.0, px_per_m * pitch))
    arrays = shown.arrays
    corner = (arrays.surface_m - [surface.left, surface.top]) * px_per_m
    margin = (np.array(size_px) - np.array([surface.width, surface.height]) * px_per_m) / 2
    offsets = np.maximum(np.round(corner + margin), 0).astype(int)
    offsets = np.minimum(offsets, np.maximum(np.array(size_px) - arrays.size_px, 0))
    return shown, Quilt(size_px, tuple(range(len(shown.panels))), tuple((int(x), int(y)) for x, y in offsets))
