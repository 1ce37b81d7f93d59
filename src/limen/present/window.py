"""A window that somebody else draws into."""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import glfw

from limen.errors import DeviceError

__all__ = ["Canvas", "open_canvas"]


class Surface(NamedTuple):
    """What one frame is drawn into."""

    target: Any  # wgpu texture view
    target_format: str
    size_px: tuple[int, int]
    time_s: float  # since the window opened


class Canvas:
    """A window on the screen; `run` draws until it is closed."""

    def __init__(self, canvas: Any, loop: Any, wgpu_device: Any) -> None:
        self._canvas, self._loop = canvas, loop
        self._context = canvas.get_context("wgpu")
        self._format = str(self._context.get_preferred_format(wgpu_device.adapter))
        self._context.configure(device=wgpu_device, format=self._format)
        self._fault: BaseException | None = None

    def run(
        self,
        draw: Callable[[Surface], str],
        handle: Callable[[dict[str, Any]], None],
        *,
        seconds: float | None = None,
    ) -> None:
        """Call ``draw`` for every frame (it returns the window's title) and ``handle`` for every event.

        Returns when the window is closed, after ``seconds``, or on Ctrl-C. An error in ``draw`` closes the window
        and is raised here.
        """
        begin = time.perf_counter()

        def paint() -> None:
            now = time.perf_counter() - begin
            if seconds is not None and now > seconds:
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
        with contextlib.suppress(KeyboardInterrupt):
            self._loop.run()
        self._canvas.close()
        if self._fault is not None:
            raise self._fault

    @property
    def pixel_ratio(self) -> float:
        """Physical pixels for each of the pixels that events are told in."""
        return float(self._canvas.get_pixel_ratio())

    def close(self) -> None:
        self._canvas.close()


def _connect() -> None:
    """Ask for the screen; without one, the backend's import would end the process (an assertion in C)."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if not glfw.init():
            raise DeviceError(str(said[-1].message) if said else "GLFW finds no screen")


def open_canvas(wgpu_device: Any, size: tuple[int, int], title: str) -> Canvas:
    """Open a window.

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
    except Exception as error:
        raise DeviceError(
            f"no window can be opened here ({' '.join(str(error).split())}); add --out FOLDER to write pictures instead"
        ) from None
    return Canvas(canvas, loop, wgpu_device)
