"""Where a person would stand who is not tracked: the viewer of a picture that names none."""

from __future__ import annotations

import math

import numpy as np

from limen.display.display import Display
from limen.geometry import Floats, as_vec3
from limen.viewing.arrangement import arrangement_of, facing_of_wall, middle_of_wall
from limen.viewing.viewer import Viewer

__all__ = ["standing_viewer"]

EYE_HEIGHT_M = 1.7

_BESIDE_DEG, _ABOVE_DEG = 30.0, 20.0
"""From where an object is looked at, seen from +z: three of a cube's panels rather than one."""


def standing_viewer(display: Display) -> Viewer:
    """A viewer in the middle of a room, before a wall, or before an object and a little beside and above it.

    Before a wall, at about its smaller side's distance (0.6 to 3 m). Eyes are 1.7 m high in a room, and before a wall
    that reaches to both sides of that height.
    """
    low, high = display.bounds_m
    middle = (low + high) / 2
    match arrangement_of(display):
        case "room":
            return Viewer((float(middle[0]), _eye_height_m(display), float(middle[2])), direction=(0.0, 0.0, -1.0))
        case "object":
            way = _way_to(_BESIDE_DEG, _ABOVE_DEG)
            place = middle + way * max(2.0 * float((high - low).max()), 0.6)
        case _:
            way = facing_of_wall(display)
            place = middle_of_wall(display) + way * min(max(float(np.sort(high - low)[1]), 0.6), 3.0)
            if abs(way[1]) < 0.3:
                place[1] = _eye_height_m(display)
    return Viewer(as_vec3(place, "place"), direction=as_vec3(-way, "way"))


def _way_to(beside_deg: float, above_deg: float) -> Floats:
    """Unit vector to the right of +z and up, shape (3,)."""
    beside, above = math.radians(beside_deg), math.radians(above_deg)
    return np.array([math.sin(beside) * math.cos(above), math.sin(above), math.cos(beside) * math.cos(above)])


def _eye_height_m(display: Display) -> float:
    low, high = display.bounds_m[:, 1]
    return EYE_HEIGHT_M if low < EYE_HEIGHT_M < high else float(low + high) / 2
