"""A live window onto a scene: behind the window itself, or on a simulated display that somebody walks around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.geometry import Floats, Vec3, as_vec3
from limen.gpu.device import Device, open_device
from limen.layers.common.simulator import DisplaySimulator
from limen.show.live import Tour
from limen.show.stage import Exhibit, Shown, Stage, Turn
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
        self, device: Device, exhibit: Exhibit, display: Display | None, tour: Tour | Viewer, *, overlay: bool = False
    ) -> None:
        self._device, self._exhibit, self._tour = device, exhibit, tour
        self._simulated = None if display is None else _as_fine_as_seen(display)
        self._in_a_room = display is not None and arrangement_of(display) == "room"
        self._overlay = overlay
        self._yaw_deg = self._pitch_deg = 0.0
        self._nearer = 1.0
        self._stage: Stage | None = None
        self._lit: DisplaySimulator | None = None
        self._size_px = (0, 0)
        self._dragging_from: tuple[float, float] | None = None
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False
        self.last: Shown | None = None

    def draw(self, surface: Surface) -> str:
        """Draw one frame; returns the window's title."""
        if surface.size_px != self._size_px:
            self._resize(surface.size_px)
        assert self._stage is not None
        if not self._paused:
            self._clock_s += surface.time_s - self._last_s
        self._last_s = surface.time_s
        if self._simulated is None:
            self._draw_window(self._stage, surface)
        else:
            self._draw_display(self._stage, self._simulated, surface)
        assert self.last is not None
        counts = f"{self.last.panels_active} panels, {self.last.drawn}"
        return f"{self._exhibit.name}   {counts}   {_HELP}"

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
        if self._stage is not None:
            self._stage.close()
        if self._lit is not None:
            self._lit.destroy()
        self._stage = self._lit = None

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
        if self._simulated is not None and self._stage is not None:
            return
        self.close()
        display = self._simulated or Display.window(size_px)
        self._stage = self._exhibit.on(self._device, display)
        if self._simulated is not None:
            self._lit = DisplaySimulator(self._device, display, self._stage.quilts, guard_px=self._stage.guard_px)

    def _draw_window(self, stage: Stage, surface: Surface) -> None:
        """The window is the display: what is behind it is turned by dragging."""
        stage.pose(self._clock_s, Turn(self._yaw_deg, self._pitch_deg, self._nearer), paused=self._paused)
        # Before a window somebody sits still, and may be told to look elsewhere than at its middle.
        gaze = self._tour.gaze if isinstance(self._tour, Viewer) else None
        viewer = Viewer((0.0, 0.0, 0.0), gaze=gaze, time_s=self._clock_s)
        self.last = stage.frame(
            [viewer], quilt=Quilt(surface.size_px, (0,), ((0, 0),)), overlay=self._overlay,
            target=surface.target, target_format=surface.target_format,
        )  # fmt: skip

    def _draw_display(self, stage: Stage, display: Display, surface: Surface) -> None:
        """A simulated display, seen by the viewer that it is lit for; dragging leads the viewer around it."""
        assert self._lit is not None
        stage.pose(self._clock_s, paused=self._paused)
        viewers = self._viewers()
        textures, self.last = stage.textures(viewers, overlay=self._overlay)
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
        viewers = self._tour(self._clock_s)
        return [viewer.at_rest for viewer in viewers] if self._paused else viewers

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
    exhibit: Exhibit, display: Display | None, tour: Tour | Viewer, say: Callable[[str], None], *,
    overlay: bool = False, seconds: float | None = None,
) -> Shown | None:  # fmt: skip
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
        live = LiveScene(device, exhibit, display, tour, overlay=overlay)
        canvas = open_canvas(device.wgpu, _SIZE, exhibit.name)
        say(f"keys: {_HELP}; drag to turn, wheel to come nearer")
        run_together([canvas], [live.draw], live, seconds=seconds)
        return live.last
