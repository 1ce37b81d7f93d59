"""What dragging, the wheel and keys do to what is shown: move an image, turn what is behind a window, lead a viewer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from limen.display.display import Display
from limen.geometry import Floats, as_vec3
from limen.layers.base import STILL, Layer, Turn
from limen.layers.image.layer import ImageLayer
from limen.show.canvas import Surface
from limen.viewing.arrangement import arrangement_of
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface
from limen.viewing.state import FrameState
from limen.viewing.viewer import Viewer

__all__ = ["Hand", "ImageHand", "LeadingHand", "TurningHand"]

_DRAG_DEG_PER_PX = 0.3
_STEEPEST_DEG = 85.0
_NEAREST, _FARTHEST = 0.2, 5.0
_NEAR_WALL = 1 - _NEAREST
"""Share of the way to a room's wall that the wheel leads, forward or back."""
_ZOOM_STEP = 1.2
_LENS_STEP = 1.25
_LENS_SHARE = 0.25


class Hand:
    """A hand that changes nothing: where what is shown is not for dragging."""

    help = ""
    """What it does, for people: keys, then what follows "drag"."""
    drag_help = ""

    def __init__(self) -> None:
        self._drag_from: tuple[float, float] | None = None

    def handle(self, event: Mapping[str, Any]) -> None:
        """An event of rendercanvas', whose places are in logical pixels from the upper left."""
        match event["event_type"]:
            case "key_down":
                self.pressed(event["key"])
            case "wheel":
                self.wheeled(event["dy"], (event["x"], event["y"]))
            case "pointer_down":
                self._drag_from = (event["x"], event["y"])
            case "pointer_up":
                self._drag_from = None
            case "pointer_move":
                at = (event["x"], event["y"])
                self.pointed(at)
                if self._drag_from is not None:
                    x, y = self._drag_from
                    self._drag_from = at
                    self.dragged(at[0] - x, at[1] - y)

    def pressed(self, key: str) -> None: ...

    def wheeled(self, dy: float, at: tuple[float, float]) -> None: ...

    def pointed(self, at: tuple[float, float]) -> None: ...

    def dragged(self, dx: float, dy: float) -> None: ...

    @property
    def turn(self) -> Turn:
        """What has been done to what is behind the display."""
        return STILL

    def led(self, person: Viewer) -> Viewer:
        """Where somebody has been led."""
        return person

    def framed_from(self, person: Viewer) -> Viewer:
        """From where a picture of the display is as wide as it: coming nearer than that shows it larger."""
        return person

    def placed(self, frame: FrameState, display: Display, surface: Surface) -> FrameState:
        """The frame with layers where they have been moved to, on the display that the surface shows."""
        return frame


class TurningHand(Hand):
    """Turns what is behind a window, and brings it nearer."""

    help = "0 start"
    drag_help = "turn, wheel to come nearer"

    def __init__(self) -> None:
        super().__init__()
        self._start()

    def _start(self) -> None:
        self.yaw_deg = self.pitch_deg = 0.0
        self.nearer = 1.0

    def pressed(self, key: str) -> None:
        if key == "0":
            self._start()

    def wheeled(self, dy: float, at: tuple[float, float]) -> None:
        self.nearer = min(max(self.nearer * 1.1 ** (dy / 100), _NEAREST), _FARTHEST)

    def dragged(self, dx: float, dy: float) -> None:
        self.yaw_deg += dx * _DRAG_DEG_PER_PX
        self.pitch_deg = min(max(self.pitch_deg + dy * _DRAG_DEG_PER_PX, -_STEEPEST_DEG), _STEEPEST_DEG)

    @property
    def turn(self) -> Turn:
        return Turn(self.yaw_deg, self.pitch_deg, self.nearer)


class LeadingHand(TurningHand):
    """Leads somebody around a display, or turns a head in a room and leads across it."""

    def __init__(self, display: Display) -> None:
        super().__init__()
        self._bounds_m = display.bounds_m
        self._in_a_room = arrangement_of(display) == "room"

    @property
    def turn(self) -> Turn:
        return STILL

    def led(self, person: Viewer) -> Viewer:
        return self._led(person, self.nearer)

    def framed_from(self, person: Viewer) -> Viewer:
        return self._led(person, 1.0)

    def _led(self, person: Viewer, nearer: float) -> Viewer:
        place, (low, high) = np.array(person.position_m), self._bounds_m
        if self._in_a_room:
            look = self._orbited(np.array(person.direction), -1.0)
            level = look * [1, 0, 1] / max(math.hypot(look[0], look[2]), 1e-9)
            steps_m = max(1 - nearer, -_NEAR_WALL) * min(high[0] - low[0], high[2] - low[2]) / 2
            return replace(
                person, position_m=as_vec3(place + level * steps_m, "place"), direction=as_vec3(look, "look")
            )
        middle = (low + high) / 2
        way = self._orbited(place - middle) * nearer
        if not way.any():  # at the very middle, there is no way around it
            return person
        return replace(person, position_m=as_vec3(middle + way, "place"), direction=as_vec3(-way, "way"))

    def _orbited(self, way: Floats, sense: float = 1.0) -> Floats:
        """A way, shape (3,), turned about the vertical and raised as dragging has done, never over the top.

        What is dragged to the right goes to the right if the viewer goes to the left, or the head turns to the left:
        the ``sense`` of the one is 1, of the other -1.
        """
        x, y, z = way
        level = math.hypot(x, z)
        bearing = math.atan2(x, z) - sense * math.radians(self.yaw_deg)
        steepest = max(math.radians(_STEEPEST_DEG), abs(math.atan2(y, level)))
        rise = math.atan2(y, level) + math.radians(self.pitch_deg)
        rise = min(max(rise, -steepest), steepest)
        turned = [math.sin(bearing) * math.cos(rise), math.sin(rise), math.cos(bearing) * math.cos(rise)]
        return np.array(turned) * math.hypot(level, y)


@dataclass(frozen=True, slots=True)
class _HandLens:
    """A lens carried by the pointer; its radius is a share of the window's smaller side."""

    magnification: float = 4.0
    share: float = _LENS_SHARE

    def stronger(self, factor: float) -> _HandLens:
        return replace(self, magnification=min(max(self.magnification * factor, 1.0), 256.0))

    def wider(self, factor: float) -> _HandLens:
        return replace(self, share=min(max(self.share * factor, 0.02), 1.0))


class ImageHand(Hand):
    """Moves and zooms the images that lie on a window, all alike, and holds a lens over them."""

    help = "l lens, + - [ ] its power and size   0 fit"
    drag_help = "move, wheel to zoom"

    def __init__(self, layers: Sequence[Layer]) -> None:
        super().__init__()
        self._sizes_px: dict[int, tuple[int, int]] = {}
        self._placed: dict[int, OnSurface] = {}
        """Where images have been moved to, by the numbers of their layers."""
        for number, layer in enumerate(layers):
            if isinstance(layer, ImageLayer) and isinstance(layer.placement, OnSurface):
                self._sizes_px[number], self._placed[number] = layer.image.size_px, layer.placement
        self._lens: _HandLens | None = None
        self._last_lens = _HandLens()
        self._pointer = (0.0, 0.0)
        self._seen: tuple[Display, Surface] | None = None

    def pressed(self, key: str) -> None:
        match key:
            case "l":
                self._hold(self._last_lens if self._lens is None else None)
            case "+" | "=" | "-" if self._lens is not None:
                self._hold(self._lens.stronger(_LENS_STEP if key != "-" else 1 / _LENS_STEP))
            case "[" | "]" if self._lens is not None:
                self._hold(self._lens.wider(_LENS_STEP if key == "]" else 1 / _LENS_STEP))
            case "0":
                for number, placed in self._placed.items():
                    self._placed[number] = msgspec.structs.replace(placed, zoom=1.0, centre=(0.5, 0.5))

    def pointed(self, at: tuple[float, float]) -> None:
        self._pointer = at

    def dragged(self, dx: float, dy: float) -> None:
        for number in self._placed:
            self._move(number, -dx, -dy)

    def wheeled(self, dy: float, at: tuple[float, float]) -> None:
        """Zoom so that the texel under the pointer stays there."""
        factor = _ZOOM_STEP ** (-dy / 100)
        x, y = self._from_middle(at)
        for number, placed in self._placed.items():
            zoom = min(max(placed.zoom * factor, 0.5), 4096.0)
            ratio = 1 - placed.zoom / zoom
            self._move(number, x * ratio, y * ratio)
            self._placed[number] = msgspec.structs.replace(self._placed[number], zoom=zoom)

    def placed(self, frame: FrameState, display: Display, surface: Surface) -> FrameState:
        self._seen, layers = (display, surface), list(frame.layers)
        for number, placed in self._placed.items():
            placement = layers[number].placement
            assert isinstance(placement, OnSurface)
            lenses = placement.lenses + self._held(number)
            moved = msgspec.structs.replace(placement, zoom=placed.zoom, centre=placed.centre, lenses=lenses)
            layers[number] = msgspec.structs.replace(layers[number], placement=moved)
        return msgspec.structs.replace(frame, layers=tuple(layers))

    def _hold(self, lens: _HandLens | None) -> None:
        self._lens, self._last_lens = lens, lens or self._lens or self._last_lens

    def _texels_per_pixel(self, number: int) -> float:
        """Of the pixels that events are told in."""
        if self._seen is None:
            return 0.0
        display, surface = self._seen
        maps = self._placed[number].panel_maps(display, self._sizes_px[number])
        return float(maps.scale[0, 0]) * surface.pixel_ratio

    def _from_middle(self, at: tuple[float, float]) -> tuple[float, float]:
        """A place of the window from its middle, in the pixels that events are told in."""
        if self._seen is None:
            return 0.0, 0.0
        surface = self._seen[1]
        x, y = (at[axis] - surface.size_px[axis] / surface.pixel_ratio / 2 for axis in (0, 1))
        return x, y

    def _held(self, number: int) -> tuple[Lens, ...]:
        """The lens in the hand, over the pointer."""
        if self._lens is None or self._seen is None:
            return ()
        step, surface = self._texels_per_pixel(number), self._seen[1]
        x, y = (
            share * side + step * away
            for share, side, away in zip(
                self._placed[number].centre, self._sizes_px[number], self._from_middle(self._pointer), strict=True
            )
        )
        radius = self._lens.share * min(surface.size_px) / surface.pixel_ratio * step
        return (Lens((x, y), radius, self._lens.magnification),)

    def _move(self, number: int, dx: float, dy: float) -> None:
        """Move what is in the middle by so many pixels that events are told in."""
        step, placed = self._texels_per_pixel(number), self._placed[number]
        x, y = placed.centre
        width, height = self._sizes_px[number]
        centre = (min(max(x + dx * step / width, 0.0), 1.0), min(max(y + dy * step / height, 0.0), 1.0))
        self._placed[number] = msgspec.structs.replace(placed, centre=centre)
