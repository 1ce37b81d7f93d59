"""A scene on the real panels of this machine: a window for every quilt, on the screen that the quilt is named after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from limen.display.display import Display
from limen.errors import InputError
from limen.frame.renderer import Chosen
from limen.frame.report import FrameReport
from limen.gpu.device import Device, open_device
from limen.show.show import Show, Tour, summary
from limen.show.window import Surface, open_canvas, run_together, screen_names
from limen.viewing.viewer import Viewer

__all__ = ["LiveOutputs", "run_live_outputs"]

_HELP = "o overlay   space pause   q close"


class LiveOutputs:
    """The state of all windows, changed by events and drawn quilt by quilt: all show what was chosen for one frame.

    Raises
    ------
    InputError
        If the display says nothing of quilts.
    """

    def __init__(
        self, device: Device, show: Show, display: Display, tour: Tour | Viewer, *, overlay: bool = False
    ) -> None:
        show.check_one_picture()
        if not display.quilts:
            raise InputError(
                f"display '{display.name}' does not say which panels lie where on which output: add [[quilt]] to its "
                "file, or save a packing with `limen display NAME --quilt --to-toml FILE`"
            )
        self._show, self._tour, self._overlay = show, tour, overlay
        self._renderer = show.renderer(device, display)
        self._chosen: Chosen | None = None
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False
        self.last: FrameReport | None = None

    def draw(self, number: int, surface: Surface) -> str:
        """Draw one quilt; returns its window's title.

        Raises
        ------
        InputError
            If the window has not exactly the quilt's pixels: nothing would be where it ought to.
        """
        quilt = self._renderer.quilts[number]
        if surface.size_px != quilt.size_px:
            raise InputError(
                f"output '{quilt.output or number}' has {surface.size_px[0]} x {surface.size_px[1]} pixels and its "
                f"quilt {quilt.size_px[0]} x {quilt.size_px[1]}: change the screen's resolution, or size_px in the file"
            )
        if number == 0:  # one clock for all: what several screens show belongs together
            self._clock_s += 0.0 if self._paused else surface.time_s - self._last_s
            self._last_s = surface.time_s
            self._chosen = None
        if self._chosen is None:
            frame = self._show.frame(
                self._renderer.display, self._clock_s, self._viewers(), overlay=self._overlay, paused=self._paused
            )
            self._chosen = self._renderer.choose(frame, now_s=surface.time_s)
        drawn = self._renderer.draw(self._chosen, number, target=surface.target, target_format=surface.target_format)
        self.last = self._renderer.report(self._chosen, [drawn])
        return f"{quilt.output or number}   {summary(self.last)}   {_HELP}"

    def _viewers(self) -> Sequence[Viewer]:
        if isinstance(self._tour, Viewer):
            return [replace(self._tour, time_s=self._clock_s)]
        return self._tour(self._clock_s)

    def handle(self, event: dict[str, Any]) -> None:
        if event["event_type"] != "key_down":
            return
        match event["key"]:
            case "o":
                self._overlay, self._chosen = not self._overlay, None
            case " ":
                self._paused = not self._paused
            case "q" | "Escape":
                self.closed = True

    def close(self) -> None:
        self._renderer.close()


def run_live_outputs(
    show: Show, display: Display, tour: Tour | Viewer, say: Callable[[str], None], *,
    overlay: bool = False, seconds: float | None = None,
) -> FrameReport | None:  # fmt: skip
    """Show every quilt of a display on its screen until a window is closed; returns the last frame's report.

    A quilt whose ``output`` is a screen's name, or its number from 1, fills that screen; others get a window of their
    size. ``say`` is told which is where.
    """
    with open_device() as device:
        live = LiveOutputs(device, show, display, tour, overlay=overlay)
        canvases = []
        for number, quilt in enumerate(display.quilts):
            screen = _screen_of(quilt.output, screen_names())
            canvases.append(open_canvas(device.wgpu, quilt.size_px, quilt.output or f"quilt {number}", screen=screen))
            place = "a window" if screen is None else f"screen {screen + 1}"
            say(f"{quilt.output or f'quilt {number}'}: {quilt.size_px[0]} x {quilt.size_px[1]} pixels in {place}")
        say(f"keys: {_HELP}")
        draws = [partial(live.draw, number) for number in range(len(canvases))]
        run_together(canvases, draws, live, seconds=seconds)
        return live.last


def _screen_of(output: str, names: list[str]) -> int | None:
    """The screen that an output means: by its name where just one has it, or by its number from 1."""
    if names.count(output) == 1:
        return names.index(output)
    return int(output) - 1 if output.isdigit() and 1 <= int(output) <= len(names) else None
