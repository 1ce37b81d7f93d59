"""How people are with a display: before a wall, around an object, or inside a room."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from limen.display.display import Display
from limen.geometry import Floats

__all__ = ["Arrangement", "arrangement_of", "facing_of_wall", "middle_of_wall"]

Arrangement: TypeAlias = Literal["wall", "object", "room"]
_WALL = 0.75
"""Length of the mean normal from which a display counts as a wall whatever its size."""
_PERSON_M = np.array([1.2, 1.5, 1.2])
"""Least width, height and depth of what a person can stand in."""


def arrangement_of(display: Display) -> Arrangement:
    """How people are with a display: before a ``wall``, around an ``object``, or inside a ``room``.

    Panels of an object face away from its middle. Others make a room if they face several ways and a person has
    room between them (a CAVE), else a wall: a desk has an inside too, but nobody stands in it.
    """
    low, high = display.bounds_m
    middle = (low + high) / 2
    if float(np.linalg.norm(display.facing)) > _WALL:
        return "wall"
    normals = np.array([panel.normal for panel in display.panels])
    centres = np.array([panel.centre_m for panel in display.panels])
    if float(np.sum(normals * (centres - middle))) > 0:
        return "object"
    return "room" if bool(np.all(high - low >= _PERSON_M)) else "wall"


def facing_of_wall(display: Display) -> Floats:
    """Unit vector toward where a wall is looked at from, shape (3,).

    At most 50 degrees above the horizon, and then from +z: nobody hangs over a table.
    """
    facing = display.facing
    strength = float(np.linalg.norm(facing))
    if strength < 1e-6:
        return np.array([0.0, 0.0, 1.0])
    across, up = facing * [1, 0, 1] / strength, float(facing[1]) / strength
    steepest = math.sin(math.radians(50))
    if abs(up) <= steepest:
        return np.asarray(facing / strength)
    level = float(np.linalg.norm(across))
    across = across / level if level > 0.1 else np.array([0.0, 0.0, 1.0])
    return np.asarray(across * math.cos(math.radians(50)) + [0, math.copysign(steepest, up), 0])


def middle_of_wall(display: Display) -> Floats:
    """Mean of the panels' middles weighted by area, shape (3,): behind it are panels, also of a desk with a hole."""
    areas = np.array([panel.size_m[0] * panel.size_m[1] for panel in display.panels])
    centres = np.array([panel.centre_m for panel in display.panels])
    return np.asarray((centres * areas[:, None]).sum(axis=0) / areas.sum())
