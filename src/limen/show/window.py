"""A window that somebody else draws into."""

from __future__ import annotations

import contextlib
import math
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import glfw

from limen.errors import DeviceError

__all__ = ["Canvas", "open_canvas", "run_together", "screen_names"]


class Surface(NamedTuple):
    """What one frame is drawn into."""

    target: Any  # wgpu texture view
    target_format: str
    size_px: tuple[int, int]
    time_s: float  # since the window opened


class WindowContent(Protocol):
    """What windows draw: changed by events, until it wants to be closed."""

    closed: bool

    def handle(self, event: dict[str, Any]) -> None: ...

    def close(self) -> None: ...


class Canvas:
    """A window on the screen; `run_together` draws into it."""

    def __init__(self, canvas: Any, loop: Any, wgpu_device: Any) -> None:
        self._canvas, self._loop = canvas, loop
        self._context = canvas.get_context("wgpu")
        self._format = str(self._context.get_preferred_format(wgpu_device.adapter))
        self._context.configure(device=wgpu_device, format=self._format)
        self._fault: BaseException | None = None

    def _begin(self, draw: Callable[[Surface], str], handle: Callable[[dict[str, Any]], None], until_s: float) -> None:
        begin = time.perf_counter()

        def paint() -> None:
            now = time.perf_counter() - begin
            if now > until_s:
                self._canvas.close()
                return
            texture = self._context.get_current_texture()
            size = (int(texture.size[0]), int(texture.size[1]))
            try:
                self._canvas.set_title(draw(Surface(texture.create_view(), self._format, size, now)))
            except BaseException as error:  # the loop would swallow it and show a frozen window
                self._fault = error
                self._canvas.close()

        self._canvas.add_event_handler(handle, "wheel", "pointer_down", "pointer_move", "pointer_up", "key_down")
        self._canvas.request_draw(paint)

    @property
    def pixel_ratio(self) -> float:
        """Physical pixels for each of the pixels that events are told in."""
        return float(self._canvas.get_pixel_ratio())

    def close(self) -> None:
        self._canvas.close()


def run_together(
    canvases: Sequence[Canvas],
    draws: Sequence[Callable[[Surface], str]],
    live: WindowContent,
    *,
    seconds: float | None = None,
) -> None:
    """Draw windows until they are closed, for ``seconds``, or until Ctrl-C.

    Parameters
    ----------
    draws
        One a window, called for every frame; returns the window's title. An error in one closes all and is raised here.
    live
        What they draw; told every event, and closed in the end.
    """

    def handle(event: dict[str, Any]) -> None:
        live.handle(event)
        if live.closed:
            _close(canvases)

    try:
        for canvas, draw in zip(canvases, draws, strict=True):
            canvas._begin(_closing(draw, canvases), handle, math.inf if seconds is None else seconds)
        with contextlib.suppress(KeyboardInterrupt):
            canvases[0]._loop.run()
    finally:
        _close(canvases)
        live.close()
    for canvas in canvases:
        if canvas._fault is not None:
            raise canvas._fault


def _close(canvases: Sequence[Canvas]) -> None:
    for canvas in canvases:
        canvas.close()


def _closing(draw: Callable[[Surface], str], canvases: Sequence[Canvas]) -> Callable[[Surface], str]:
    """The same drawing; an error in it closes all windows."""

    def draw_or_close(surface: Surface) -> str:
        try:
            return draw(surface)
        except BaseException:
            _close(canvases)
            raise

    return draw_or_close


def _connect() -> None:
    """Ask for the screen; without one, the backend's import would end the process (an assertion in C)."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if not glfw.init():
            raise _no_window(said[-1].message if said else "GLFW finds no screen")


def screen_names() -> list[str]:
    """What the system calls this machine's screens; those of one name are told apart by their order.

    Raises
    ------
    DeviceError
        If there is no screen.
    """
    _connect()
    return [_text(glfw.get_monitor_name(monitor)) for monitor in glfw.get_monitors()]


def open_canvas(wgpu_device: Any, size: tuple[int, int], title: str, *, screen: int | None = None) -> Canvas:
    """Open a window.

    Parameters
    ----------
    size
        Of a window with a frame, in the units that the system counts windows in.
    screen
        Fills this screen, by its number in `screen_names`.

    Raises
    ------
    DeviceError
        If there is no screen to open it on; the message says what to do instead.
    """
    try:
        _connect()
        # Importing the backend connects to the screen, so it can only be asked for when a window is wanted.
        from rendercanvas.glfw import RenderCanvas, loop

        canvas = RenderCanvas(size=size, title=title, update_mode="continuous", max_fps=60, vsync=True)
        if screen is not None:
            _fill(canvas, glfw.get_monitors()[screen])
    except DeviceError:
        raise
    except Exception as error:
        raise _no_window(error) from None
    return Canvas(canvas, loop, wgpu_device)


def _no_window(reason: object) -> DeviceError:
    said = " ".join(str(reason).split())
    return DeviceError(f"no window can be opened here ({said}); add --out FOLDER to write pictures instead")


def _fill(canvas: Any, monitor: Any) -> None:
    """Lay a window over a whole screen. (The system's own full screen hides when another window is clicked.)"""
    window, mode = canvas._window, glfw.get_video_mode(monitor)  # rendercanvas has no word for screens
    x, y = glfw.get_monitor_pos(monitor)
    glfw.set_window_attrib(window, glfw.DECORATED, glfw.FALSE)
    glfw.set_window_pos(window, x, y)
    glfw.set_window_size(window, mode.size.width, mode.size.height)


def _text(name: bytes | str) -> str:
    return name.decode() if isinstance(name, bytes) else name
