"""A mesh on the real panels of this machine: a window for every quilt, on the screen that the quilt is named after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from limen.data.mesh import Mesh
from limen.display.display import Display
from limen.errors import InputError
from limen.gpu.device import Device, open_device
from limen.live import Tour
from limen.live_scene import SceneSettings, check_one_picture, posed
from limen.present.window import Surface, open_canvas, run_together, screen_names
from limen.scene import SceneRenderer, SceneReport
from limen.viewer import Viewer

__all__ = ["LiveOutputs", "run_live_outputs"]

_HELP = "o overlay   space pause   q close"


class LiveOutputs:
    """The state of all windows, changed by events and drawn quilt by quilt.

    Raises
    ------
    InputError
        If the display says nothing of quilts, or for a stereo that makes two pictures of one.
    """

    def __init__(
        self, device: Device, mesh: Mesh, display: Display, tour: Tour | Viewer, settings: SceneSettings
    ) -> None:
        if not display.quilts:
            raise InputError(
                f"display '{display.name}' does not say which panels lie where on which output: add [[quilt]] to its "
                "file, or save a packing with `limen display NAME --quilt --to-toml FILE`"
            )
        check_one_picture(settings.stereo)
        self._mesh, self._tour, self._settings = mesh, tour, settings
        self._renderer = SceneRenderer(
            device, display, mesh, room_from_mesh=settings.room_from_mesh(mesh, display), stereo=settings.stereo,
            background=settings.background,
        )  # fmt: skip
        self._overlay = settings.overlay
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False
        self.last: list[SceneReport | None] = [None] * len(display.quilts)

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
            posed(self._renderer, self._mesh, self._settings, self._clock_s)
        viewer = self._tour if isinstance(self._tour, Viewer) else self._tour(self._clock_s)[0]
        viewer = replace(viewer, time_s=self._clock_s)
        report = self._renderer.frame(
            viewer, quilt=quilt, overlay="panels" if self._overlay else None,
            target=surface.target, target_format=surface.target_format,
        )  # fmt: skip
        self.last[number] = report
        return f"{quilt.output or number}   {report.panels_active} panels, {report.triangles:,} triangles   {_HELP}"

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
        self._renderer.close()


def run_live_outputs(
    mesh: Mesh, display: Display, tour: Tour | Viewer, settings: SceneSettings, say: Callable[[str], None]
) -> SceneReport | None:
    """Show every quilt of a display on its screen until a window is closed; returns the last frame's report.

    A quilt whose ``output`` is a screen's name, or its number from 1, fills that screen; others get a window of their
    size. ``say`` is told which is where.
    """
    with open_device() as device:
        live = LiveOutputs(device, mesh, display, tour, settings)
        canvases = []
        for number, quilt in enumerate(display.quilts):
            screen = _screen_of(quilt.output, screen_names())
            canvases.append(open_canvas(device.wgpu, quilt.size_px, quilt.output or f"quilt {number}", screen=screen))
            place = "a window" if screen is None else f"screen {screen + 1}"
            say(f"{quilt.output or f'quilt {number}'}: {quilt.size_px[0]} x {quilt.size_px[1]} pixels in {place}")
        say(f"keys: {_HELP}")
        draws = [partial(live.draw, number) for number in range(len(canvases))]
        run_together(canvases, draws, live, seconds=settings.seconds)
        drawn = [report for report in live.last if report is not None]
        return SceneReport.of(drawn) if drawn else None


def _screen_of(output: str, names: list[str]) -> int | None:
    """The screen that an output means: by its name where just one has it, or by its number from 1."""
    if names.count(output) == 1:
        return names.index(output)
    return int(output) - 1 if output.isdigit() and 1 <= int(output) <= len(names) else None
