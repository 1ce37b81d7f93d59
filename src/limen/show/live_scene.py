"""A live window onto a scene: behind the window itself, or on a simulated display that somebody walks around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport
from limen.frame.simulator import DisplaySimulator
from limen.geometry import Floats, Vec3, as_vec3
from limen.gpu.device import Device, open_device
from limen.layers.base import Turn
from limen.show.show import Show, Tour, summary
from limen.show.window import Surface, open_canvas, run_together
from limen.viewing.arrangement import arrangement_of
from limen.viewing.camera import Camera
from limen.viewing.viewer import Viewer

__all__ = ["LiveScene", "eye_camera", "run_live_scene"]

_SIZE = (1280, 800)
_DRAG_DEG_PER_PX = 0.3
_STEEPEST_DEG = 85.0
_NEAREST, _FARTHEST = 0.2, 5.0
_NEAR_WALL = 1 - _NEAREST
"""Share of the way to a room's wall that the wheel leads, forward or back."""
_HELP = "o overlay   space pause   0 start   q close"
_LIT_PX = 1 << 23
"""Pixels of a simulated display in all: more are not seen in a window."""
_AROUND_DEG = 65.0
"""From this angle between the panels' corners and their middle on, an eye is among them."""
_WIDEST_DEG = 90.0


def eye_camera(
    display: Display, eye_m: Floats, size_px: tuple[int, int], look: Vec3 | Floats = (0.0, 0.0, -1.0)
) -> Camera:
    """A camera at an eye that shows the panels that face it; where they are all around the eye, what it looks at.

    Parameters
    ----------
    eye_m
        Place in the room, shape (3,).
    look
        Where the head points: of use among panels alone.
    """
    facing = [panel for panel in display.panels if np.dot(eye_m - panel.centre_m, panel.normal) > 0]
    ways = np.concatenate([panel.outline_m for panel in facing or display.panels]) - eye_m
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    middle = ways.mean(axis=0)
    middle = middle / max(float(np.linalg.norm(middle)), 1e-9)
    if float((ways @ middle).min()) < math.cos(math.radians(_AROUND_DEG)):
        return _camera(eye_m, np.asarray(look, dtype=float), size_px, _WIDEST_DEG)
    for _ in range(3):  # the middle of what is seen, rather than of the panels, of which more may be on one side
        axes = _camera(eye_m, middle, size_px, _WIDEST_DEG).axes
        across = ways @ axes.T
        slopes = across[:, :2] / np.maximum(across[:, 2:], 0.1)
        low, high = slopes.min(axis=0), slopes.max(axis=0)
        middle = axes[2] + (low + high) / 2 @ axes[:2]
    reach = float(((high - low) / 2 * [size_px[1] / size_px[0], 1.0]).max())
    return _camera(eye_m, middle, size_px, min(max(2 * math.degrees(math.atan(1.1 * reach)), 1.0), _WIDEST_DEG))


def _camera(eye_m: Floats, forward: Floats, size_px: tuple[int, int], fov_deg: float) -> Camera:
    forward = forward / np.linalg.norm(forward)
    up = (0.0, 1.0, 0.0) if abs(forward[1]) < 0.99 else (0.0, 0.0, -1.0)
    return Camera(as_vec3(eye_m, "eye"), as_vec3(eye_m + forward, "target"), size_px, fov_deg, up)


class LiveScene:
    """The state of a window, changed by events and drawn frame by frame."""

    def __init__(
        self, device: Device, show: Show, display: Display | None, tour: Tour | Viewer, *, overlay: bool = False
    ) -> None:
        show.check_one_picture()
        self._device, self._show, self._tour = device, show, tour
        self._simulated = None if display is None else _as_fine_as_seen(display)
        self._in_a_room = display is not None and arrangement_of(display) == "room"
        self._overlay = overlay
        self._yaw_deg = self._pitch_deg = 0.0
        self._nearer = 1.0
        self._renderer: Renderer | None = None
        self._lit: DisplaySimulator | None = None
        self._size_px = (0, 0)
        self._dragging_from: tuple[float, float] | None = None
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False
        self.last: FrameReport | None = None

    def draw(self, surface: Surface) -> str:
        """Draw one frame; returns the window's title."""
        if surface.size_px != self._size_px:
            self._resize(surface.size_px)
        assert self._renderer is not None
        if not self._paused:
            self._clock_s += surface.time_s - self._last_s
        self._last_s = surface.time_s
        if self._simulated is None:
            self._draw_window(self._renderer, surface)
        else:
            self._draw_display(self._renderer, self._simulated, surface)
        assert self.last is not None
        return f"{self._show.name}   {summary(self.last)}   {_HELP}"

    def handle(self, event: dict[str, Any]) -> None:
        match event["event_type"]:
            case "key_down":
                self._key(event["key"])
            case "wheel":
                self._nearer = min(max(self._nearer * 1.1 ** (event["dy"] / 100), _NEAREST), _FARTHEST)
            case "pointer_down":
                self._dragging_from = (event["x"], event["y"])
            case "pointer_up":
                self._dragging_from = None
            case "pointer_move" if self._dragging_from is not None:
                x, y = self._dragging_from
                self._dragging_from = (event["x"], event["y"])
                self._yaw_deg += (event["x"] - x) * _DRAG_DEG_PER_PX
                self._pitch_deg = min(
                    max(self._pitch_deg + (event["y"] - y) * _DRAG_DEG_PER_PX, -_STEEPEST_DEG), _STEEPEST_DEG
                )

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
        if self._lit is not None:
            self._lit.destroy()
        self._renderer = self._lit = None

    def _key(self, key: str) -> None:
        match key:
            case "o":
                self._overlay = not self._overlay
            case " ":
                self._paused = not self._paused
            case "0":
                self._yaw_deg = self._pitch_deg = 0.0
                self._nearer = 1.0
            case "q" | "Escape":
                self.closed = True

    def _resize(self, size_px: tuple[int, int]) -> None:
        self._size_px = size_px
        if self._simulated is not None and self._renderer is not None:
            return
        self.close()
        if self._simulated is None:
            quilt = Quilt(size_px, (0,), ((0, 0),))
            self._renderer = self._show.renderer(self._device, Display.window(size_px), [quilt])
        else:
            self._renderer = self._show.renderer(self._device, self._simulated)
            quilts, guard_px = self._renderer.quilts, self._renderer.guard_px
            self._lit = DisplaySimulator(self._device, self._simulated, quilts, guard_px=guard_px)

    def _draw_window(self, renderer: Renderer, surface: Surface) -> None:
        """The window is the display: what is behind it is turned by dragging."""
        # Before a window somebody sits still, and may be told to look elsewhere than at its middle.
        gaze = self._tour.gaze if isinstance(self._tour, Viewer) else None
        viewer = Viewer((0.0, 0.0, 0.0), gaze=gaze, time_s=self._clock_s)
        frame = self._show.frame(
            renderer.display, self._clock_s, [viewer], turn=Turn(self._yaw_deg, self._pitch_deg, self._nearer),
            overlay=self._overlay, paused=self._paused,
        )  # fmt: skip
        self.last = renderer.frame(
            frame, target=surface.target, target_format=surface.target_format, now_s=surface.time_s
        )

    def _draw_display(self, renderer: Renderer, display: Display, surface: Surface) -> None:
        """A simulated display, seen by the viewer that it is lit for; dragging leads the viewer around it."""
        assert self._lit is not None
        viewers = self._viewers()
        frame = self._show.frame(display, self._clock_s, viewers, overlay=self._overlay, paused=self._paused)
        textures, self.last = renderer.textures(frame, now_s=surface.time_s)
        viewer = viewers[0]
        camera = eye_camera(display, np.array(viewer.position_m), surface.size_px, viewer.direction)
        if isinstance(self._tour, Viewer) and self._nearer != 1:  # or whoever comes nearer would be shown less
            fitted = eye_camera(display, np.array(self._led(self._tour).position_m), surface.size_px, viewer.direction)
            camera = replace(camera, fov_deg=fitted.fov_deg)
        samples = 1 if self._device.is_software else 2
        self._lit.draw(textures, camera, samples=samples, target=surface.target, target_format=surface.target_format)

    def _viewers(self) -> Sequence[Viewer]:
        """Who looks: those of a tour, or whom dragging leads around the display or turns in a room."""
        if isinstance(self._tour, Viewer):
            return [self._led(self._tour, self._nearer)]
        return self._tour(self._clock_s)

    def _led(self, person: Viewer, nearer: float = 1.0) -> Viewer:
        """Where dragging has led somebody."""
        assert self._simulated is not None
        standing, place = replace(person, time_s=self._clock_s), np.array(person.position_m)
        low, high = self._simulated.bounds_m
        if self._in_a_room:
            look = self._orbited(np.array(standing.direction), -1.0)
            level = look * [1, 0, 1] / max(math.hypot(look[0], look[2]), 1e-9)
            steps_m = max(1 - nearer, -_NEAR_WALL) * min(high[0] - low[0], high[2] - low[2]) / 2
            return replace(
                standing, position_m=as_vec3(place + level * steps_m, "place"), direction=as_vec3(look, "look")
            )
        middle = (low + high) / 2
        way = self._orbited(place - middle) * nearer
        if not way.any():  # at the very middle, there is no way around it
            return standing
        return replace(standing, position_m=as_vec3(middle + way, "place"), direction=as_vec3(-way, "way"))

    def _orbited(self, way: Floats, sense: float = 1.0) -> Floats:
        """A way, shape (3,), turned about the vertical and raised as dragging has done, never over the top.

        What is dragged to the right goes to the right if the viewer goes to the left, or the head turns to the left:
        the ``sense`` of the one is 1, of the other -1.
        """
        x, y, z = way
        level = math.hypot(x, z)
        bearing = math.atan2(x, z) - sense * math.radians(self._yaw_deg)
        steepest = max(math.radians(_STEEPEST_DEG), abs(math.atan2(y, level)))
        rise = math.atan2(y, level) + math.radians(self._pitch_deg)
        rise = min(max(rise, -steepest), steepest)
        turned = [math.sin(bearing) * math.cos(rise), math.sin(rise), math.cos(bearing) * math.cos(rise)]
        return np.array(turned) * math.hypot(level, y)


def _as_fine_as_seen(display: Display) -> Display:
    return display.scaled(min(1.0, math.sqrt(_LIT_PX / display.total_px)))


def run_live_scene(
    show: Show, display: Display | None, tour: Tour | Viewer, say: Callable[[str], None], *,
    overlay: bool = False, seconds: float | None = None,
) -> FrameReport | None:  # fmt: skip
    """Open a window and draw until it is closed; returns the last frame's report.

    Parameters
    ----------
    display
        Simulated: seen from the viewer's eye; ``None`` makes the window itself the display.
    tour
        Who looks at what time; or where the viewer stands at first, whom dragging leads around.
    say
        Told once what the keys do.
    seconds
        Close the window after this long.
    """
    with open_device() as device:
        live = LiveScene(device, show, display, tour, overlay=overlay)
        canvas = open_canvas(device.wgpu, _SIZE, show.name)
        say(f"keys: {_HELP}; drag to turn, wheel to come nearer")
        run_together([canvas], [live.draw], live, seconds=seconds)
        return live.last
