"""A show that runs: one source of frames, one view of it, and the canvases that it is drawn on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from limen.display.display import Display
from limen.errors import InputError
from limen.frame.report import FrameReport
from limen.gpu.device import Device, open_device
from limen.layers.registry import kind_of
from limen.show.canvas import Backend, Canvas, Surface, open_canvas, run_canvases, screen_names
from limen.show.hands import Hand, ImageHand, LeadingHand, TurningHand
from limen.show.show import Show, Tour, summary
from limen.show.sources import LiveFrames
from limen.show.views import VIEWS, View, ViewName, WindowView
from limen.viewing.viewer import Viewer

__all__ = ["App", "default_view", "run_show", "show_widget"]

_SIZE = (1440, 810)


class App:
    """What the canvases of a show draw, changed by events.

    Parameters
    ----------
    display
        Shown as the view says; ``None`` makes the window itself the display.
    who
        Who looks at what time; or who stands where at first and may be led around by dragging.
    overlay
        Whether overlays are shown at first; by default as the layers say.

    Raises
    ------
    InputError
        For what cannot be shown in this way.
    """

    def __init__(
        self,
        device: Device,
        show: Show,
        display: Display | None,
        who: Tour | Viewer,
        view: ViewName | None = None,
        *,
        overlay: bool | None = None,
    ) -> None:
        show.check_one_picture()
        name = view or default_view(show)
        self._show = show
        self._hand = _hand(show, display, who, name)
        self._source = LiveFrames(show, who, self._hand, overlay=overlay)
        self._view: View = WindowView(device, show, None) if display is None else VIEWS[name](device, show, display)
        self.last: FrameReport | None = None

    @property
    def closed(self) -> bool:
        return self._source.closed

    @property
    def help(self) -> str:
        """What keys and dragging do."""
        dragging = f"; drag to {self._hand.drag_help}" if self._hand.drag_help else ""
        return f"keys: {self._keys}{dragging}"

    @property
    def _keys(self) -> str:
        return "   ".join(filter(None, [LiveFrames.keys, self._hand.help]))

    def draw(self, number: int, surface: Surface) -> str:
        """Draw one frame of a canvas, by its number; returns its title."""
        self.last = report = self._view.draw(number, surface, self._source)
        policies = ", ".join(dict.fromkeys(row.policy for row in report.layers))
        return f"{self._show.name}   {policies}   {summary(report)}   {self._keys}"

    def handle(self, event: dict[str, Any]) -> None:
        if self._source.handle(event):
            self._view.changed()

    def close(self) -> None:
        self._view.close()


def default_view(show: Show) -> ViewName:
    """Images, which lie on panels, are seen best unrolled; what stands in the room, from a viewer's eye."""
    return "unrolled" if all(kind_of(layer).on_panels for layer in show.layers) else "eye"


def run_show(
    show: Show,
    display: Display | None,
    who: Tour | Viewer,
    say: Callable[[str], None] = print,
    *,
    view: ViewName | None = None,
    backend: Backend = "window",
    overlay: bool | None = None,
    seconds: float | None = None,
    port: int = 0,
) -> FrameReport | None:
    """Run a show until it is closed; the last frame's report.

    Parameters
    ----------
    display, who, overlay
        See `App`.
    view
        ``eye``: what the first viewer's eye sees of the simulated display. ``unrolled``: all its panels side by side.
        ``outputs``: every quilt on the screen that it is named after, or numbered from 1; others get a window of their
        size. By default images alone are shown unrolled, all else to the eye.
    backend
        Windows, a page in the browser on this machine, or nothing that is seen.
    seconds
        Close it after this long.
    port
        Of the page; 0 takes a free one.
    say
        Told once what keys do, and what is shown where.

    Raises
    ------
    DeviceError
        If there is no screen.
    InputError
        For what cannot be shown in this way.
    """
    with ExitStack() as stack:
        device = stack.enter_context(open_device())
        app = App(device, show, display, who, view, overlay=overlay)
        stack.callback(app.close)
        if view == "outputs" and display is not None:
            canvases = _outputs(device, display, backend, say)
        else:
            canvases = [open_canvas(device.wgpu, _SIZE, show.name, backend=backend)]
        say(app.help)
        run_canvases(canvases, app, seconds=seconds, port=port, say=say)
        return app.last


def show_widget(
    show: Show, display: Display | None, who: Tour | Viewer, *, view: ViewName | None, size_px: tuple[int, int]
) -> Any:
    """A widget for a notebook's cell, drawn while it is there; see `limen.Show.widget`."""
    if view == "outputs":
        raise InputError("outputs are screens of a wall, not a notebook's cell: give the view eye or unrolled")
    device = open_device()
    canvas = open_canvas(device.wgpu, size_px, show.name, backend="notebook")
    run_canvases([canvas], App(device, show, display, who, view))
    return canvas.canvas


def _hand(show: Show, display: Display | None, who: Tour | Viewer, view: ViewName) -> Hand:
    """The hand for what is shown: nobody drags on a wall's own screens, or leads those who are tracked."""
    if view == "outputs" and display is not None:
        return Hand()
    if all(kind_of(layer).on_panels for layer in show.layers) and (display is None or view == "unrolled"):
        return ImageHand(show.layers)
    if display is None:
        return TurningHand()
    return LeadingHand(display) if isinstance(who, Viewer) else Hand()


def _outputs(device: Device, display: Display, backend: Backend, say: Callable[[str], None]) -> list[Canvas]:
    """A canvas for every quilt."""
    if backend == "browser" and len(display.quilts) > 1:
        raise InputError(
            f"a browser shows one picture, and the display '{display.name}' has {len(display.quilts)} quilts: leave "
            "out --view outputs"
        )
    canvases, names = [], screen_names() if backend == "window" else []
    for number, quilt in enumerate(display.quilts):
        screen, title = _screen_of(quilt.output, names), quilt.output or f"quilt {number}"
        canvases.append(open_canvas(device.wgpu, quilt.size_px, title, backend=backend, screen=screen))
        place = f"screen {screen + 1}" if screen is not None else "a window"
        say(f"{title}: {quilt.size_px[0]} x {quilt.size_px[1]} pixels in {place}")
    return canvases


def _screen_of(output: str, names: list[str]) -> int | None:
    """The screen that an output means: by its name where just one has it, or by its number from 1."""
    if names.count(output) == 1:
        return names.index(output)
    return int(output) - 1 if output.isdigit() and 1 <= int(output) <= len(names) else None
