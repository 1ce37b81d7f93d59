"""Where frames appear: windows on the screen, a page in the browser, a notebook's cell, or nowhere.

What keys mean is no matter of these files, nor what is drawn.
"""

from __future__ import annotations

import contextlib
import math
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import glfw

from limen.errors import DeviceError

__all__ = ["Backend", "Canvas", "Drawing", "Surface", "open_canvas", "run_canvases", "screen_names"]

Backend: TypeAlias = Literal["window", "browser", "notebook", "offscreen"]

_MODULES: dict[Backend, str] = {
    "browser": "rendercanvas.http",
    "notebook": "rendercanvas.jupyter",  # its anywidget calls itself without end when it is closed
    "offscreen": "rendercanvas.offscreen",
}
_EVENTS = ("wheel", "pointer_down", "pointer_move", "pointer_up", "key_down")


class Surface(NamedTuple):
    """What one frame is drawn into."""

    target: Any  # wgpu texture view
    target_format: str
    size_px: tuple[int, int]
    time_s: float  # since the canvas opened
    pixel_ratio: float = 1.0
    """Physical pixels for each of the pixels that events are told in."""


class Drawing(Protocol):
    """What canvases show: changed by events, until it wants to be closed."""

    @property
    def closed(self) -> bool: ...

    def draw(self, number: int, surface: Surface) -> str:
        """Draw one frame of a canvas, by its number; returns its title."""
        ...

    def handle(self, event: dict[str, Any]) -> None: ...

    def close(self) -> None: ...


class Canvas:
    """One of rendercanvas' canvases, which `run_canvases` draws into."""

    def __init__(self, canvas: Any, backend: Backend, wgpu_device: Any) -> None:
        self.canvas, self.backend = canvas, backend
        self._context = canvas.get_context("wgpu")
        self._format = str(self._context.get_preferred_format(wgpu_device.adapter))
        self._context.configure(device=wgpu_device, format=self._format)
        self.fault: BaseException | None = None

    def begin(self, draw: Callable[[Surface], str], end: Callable[[], bool]) -> None:
        """Draw a frame whenever the canvas wants one, until ``end`` says that it is over; an error is kept."""
        begin_s = time.perf_counter()

        def paint() -> None:
            if end():
                return
            texture = self._context.get_current_texture()
            size = (int(texture.size[0]), int(texture.size[1]))
            now_s, ratio = time.perf_counter() - begin_s, float(self.canvas.get_pixel_ratio())
            try:
                self.canvas.set_title(draw(Surface(texture.create_view(), self._format, size, now_s, ratio)))
            except BaseException as error:  # the loop would swallow it and show a frozen picture
                self.fault = error

        self.canvas.request_draw(paint)


def run_canvases(
    canvases: Sequence[Canvas],
    drawing: Drawing,
    *,
    seconds: float | None = None,
    port: int = 0,
    say: Callable[[str], None] = print,
) -> None:
    """Draw canvases of one backend until one is closed, for ``seconds``, or until Ctrl-C.

    In a notebook it returns at once, and the canvas is drawn while its cell is there.

    Parameters
    ----------
    drawing
        Told every event, and closed in the end. An error in it closes all canvases and is raised here.
    port
        Where a browser finds the page, on this machine; 0 takes a free one. ``say`` is told the address.

    Raises
    ------
    InputError
        If another program listens there.
    """
    until_s = math.inf if seconds is None else time.perf_counter() + seconds
    backend = canvases[0].backend

    def over() -> bool:
        stopped = any(canvas.canvas.get_closed() or canvas.fault is not None for canvas in canvases)
        return stopped or drawing.closed or time.perf_counter() > until_s

    def close() -> None:
        for canvas in canvases:
            canvas.canvas.close()

    def end() -> bool:
        """Whether it is over; windows and cells are closed then, which end their loops."""
        ended = over()
        if ended and backend in ("window", "notebook"):
            close()
        return ended

    for number, canvas in enumerate(canvases):
        canvas.begin(partial(drawing.draw, number), end)
        canvas.canvas.add_event_handler(drawing.handle, *_EVENTS)
    if backend == "notebook":
        canvases[0].canvas.add_event_handler(lambda _event: drawing.close(), "close")
        return
    try:
        with contextlib.suppress(KeyboardInterrupt):
            if backend == "browser":
                from limen.show.browser import serve  # a server that no other backend needs

                serve(over, port, say)
            elif backend == "offscreen":
                while not over():
                    for canvas in canvases:
                        canvas.canvas.draw()
            else:
                _window_backend().loop.run()
    finally:
        close()
        drawing.close()
    for canvas in canvases:
        if canvas.fault is not None:
            raise canvas.fault


def open_canvas(
    wgpu_device: Any, size: tuple[int, int], title: str, *, backend: Backend = "window", screen: int | None = None
) -> Canvas:
    """Open a canvas.

    Parameters
    ----------
    size
        Of a window with a frame, in the units that the system counts windows in; of a notebook's cell, in its pixels. A
        page in the browser fills its window.
    screen
        A window that fills this screen, by its number in `screen_names`.

    Raises
    ------
    DeviceError
        If there is no screen to open a window on, or a package is missing; the message says what to do instead.
    """
    try:
        made = _module(backend).RenderCanvas(size=size, title=title, update_mode="continuous", max_fps=60, vsync=True)
        if screen is not None:
            _fill(made, glfw.get_monitors()[screen])
    except DeviceError:
        raise
    except Exception as error:
        raise _no_window(error) from None
    return Canvas(made, backend, wgpu_device)


def screen_names() -> list[str]:
    """What the system calls this machine's screens; those of one name are told apart by their order.

    Raises
    ------
    DeviceError
        If there is no screen.
    """
    _connect()
    return [_text(glfw.get_monitor_name(monitor)) for monitor in glfw.get_monitors()]


def _module(backend: Backend) -> Any:
    """rendercanvas' own module."""
    if backend == "window":
        return _window_backend()
    try:
        return import_module(_MODULES[backend])
    except ImportError as error:
        raise DeviceError(f"a {backend} needs the package {error.name}: pip install 'limen[{backend}]'") from None


def _window_backend() -> Any:
    """The module for windows: importing it connects to the screen, so it can only be asked for when one is wanted."""
    _connect()
    return import_module("rendercanvas.glfw")


def _connect() -> None:
    """Ask for the screen; without one, the backend's import would end the process (an assertion in C)."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if not glfw.init():
            raise _no_window(said[-1].message if said else "GLFW finds no screen")


def _no_window(reason: object) -> DeviceError:
    said = " ".join(str(reason).split())
    return DeviceError(
        f"no window can be opened here ({said}); add --out FOLDER to write pictures instead, or --window browser"
    )


def _fill(canvas: Any, monitor: Any) -> None:
    """Lay a window over a whole screen. (The system's own full screen hides when another window is clicked.)"""
    window, mode = canvas._window, glfw.get_video_mode(monitor)  # rendercanvas has no word for screens
    x, y = glfw.get_monitor_pos(monitor)
    glfw.set_window_attrib(window, glfw.DECORATED, glfw.FALSE)
    glfw.set_window_pos(window, x, y)
    glfw.set_window_size(window, mode.size.width, mode.size.height)


def _text(name: bytes | str) -> str:
    return name.decode() if isinstance(name, bytes) else name
