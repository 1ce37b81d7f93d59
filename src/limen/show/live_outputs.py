"""A scene on the real panels of this machine: a window for every quilt, on the screen that the quilt is named after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from limen.display.display import Display
from limen.errors import InputError
from limen.gpu.device import Device, open_device
from limen.show.live import Tour
from limen.show.stage import Exhibit, Shown
from limen.show.window import Surface, open_canvas, run_together, screen_names
from limen.viewing.viewer import Viewer

__all__ = ["LiveOutputs", "run_live_outputs"]

_HELP = "o overlay   space pause   q close"


class LiveOutputs:
    """The state of all windows, changed by events and drawn quilt by quilt.

    Raises
    ------
    InputError
        If the display says nothing of quilts.
    """

    def __init__(
        self, device: Device, exhibit: Exhibit, display: Display, tour: Tour | Viewer, *, overlay: bool = False
    ) -> None:
        if not display.quilts:
            raise InputError(
                f"display '{display.name}' does not say which panels lie where on which output: add [[quilt]] to its "
                "file, or save a packing with `limen display NAME --quilt --to-toml FILE`"
            )
        self._tour, self._overlay = tour, overlay
        self._stage = exhibit.on(device, display)
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False
        self.last: list[Shown | None] = [None] * len(display.quilts)

    def draw(self, number: int, surface: Surface) -> str:
        """Draw one quilt; returns its window's title.

        Raises
        ------
        InputError
            If the window has not exactly the quilt's pixels: nothing would be where it ought to.
        """
        quilt = self._stage.quilts[number]
        if surface.size_px != quilt.size_px:
            raise InputError(
                f"output '{quilt.output or number}' has {surface.size_px[0]} x {surface.size_px[1]} pixels and its "
                f"quilt {quilt.size_px[0]} x {quilt.size_px[1]}: change the screen's resolution, or size_px in the file"
            )
        if number == 0:  # one clock for all: what several screens show belongs together
            self._clock_s += 0.0 if self._paused else surface.time_s - self._last_s
            self._last_s = surface.time_s
            self._stage.pose(self._clock_s, paused=self._paused)
        if isinstance(self._tour, Viewer):
            viewers: Sequence[Viewer] = [replace(self._tour, time_s=self._clock_s)]
        else:
            viewers = self._tour(self._clock_s)
            viewers = [viewer.at_rest for viewer in viewers] if self._paused else viewers
        report = self._stage.frame(
            viewers, quilt=quilt, overlay=self._overlay,
            target=surface.target, target_format=surface.target_format,
        )  # fmt: skip
        self.last[number] = report
        return f"{quilt.output or number}   {report.panels_active} panels, {report.drawn}   {_HELP}"

    def handle(self, event: dict[str, Any]) -> None:
        if event["event_type"] != "key_down":
            return
        match event["key"]:
            case "o":
                self._overlay = not self._overlay
            case " ":
                self._paused = not self._paused
            case "q" | "Escape":
                self.closed = True

    def close(self) -> None:
        self._stage.close()


def run_live_outputs(
    exhibit: Exhibit, display: Display, tour: Tour | Viewer, say: Callable[[str], None], *,
    overlay: bool = False, seconds: float | None = None,
) -> list[Shown]:  # fmt: skip
    """Show every quilt of a display on its screen until a window is closed; returns the quilts' last reports.

    A quilt whose ``output`` is a screen's name, or its number from 1, fills that screen; others get a window of their
    size. ``say`` is told which is where.
    """
    with open_device() as device:
        live = LiveOutputs(device, exhibit, display, tour, overlay=overlay)
        canvases = []
        for number, quilt in enumerate(display.quilts):
            screen = _screen_of(quilt.output, screen_names())
            canvases.append(open_canvas(device.wgpu, quilt.size_px, quilt.output or f"quilt {number}", screen=screen))
            place = "a window" if screen is None else f"screen {screen + 1}"
            say(f"{quilt.output or f'quilt {number}'}: {quilt.size_px[0]} x {quilt.size_px[1]} pixels in {place}")
        say(f"keys: {_HELP}")
        draws = [partial(live.draw, number) for number in range(len(canvases))]
        run_together(canvases, draws, live, seconds=seconds)
        return [report for report in live.last if report is not None]


def _screen_of(output: str, names: list[str]) -> int | None:
    """The screen that an output means: by its name where just one has it, or by its number from 1."""
    if names.count(output) == 1:
        return names.index(output)
    return int(output) - 1 if output.isdigit() and 1 <= int(output) <= len(names) else None
