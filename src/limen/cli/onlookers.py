"""From where a simulated display is looked at in pictures of it."""

from __future__ import annotations

import math

import numpy as np

from limen.cli.arguments import place
from limen.display.display import Display
from limen.geometry import Floats
from limen.viewing.arrangement import arrangement_of, facing_of_wall
from limen.viewing.camera import Camera
from limen.viewing.eye_camera import eye_camera
from limen.viewing.viewer import Viewer

__all__ = ["ONLOOKERS", "lit_display", "onlookers"]

ONLOOKERS = ("eye", "elsewhere", "afar")
"""What `onlookers` are called."""

_SEEN_PX = (1440, 1080)
_ASIDE_DEG = 35.0
_LIT_PX = 1 << 26
"""Pixels of a simulated display in all, which lie in memory together: more are not seen in a picture."""


def onlookers(display: Display, viewer: Viewer, seen_from: str = "") -> dict[str, Camera]:
    """Cameras at the viewer's eye, at another place (``seen_from``, or a few steps on), and where all is in sight."""
    eye_m = np.array(viewer.position_m)
    elsewhere = np.array(place(seen_from, "--seen-from")) if seen_from else _aside(eye_m, display)
    corners = np.concatenate([panel.outline_m for panel in display.panels])
    is_wall = arrangement_of(display) == "wall"
    onlooker = facing_of_wall(display) + np.array([0.5, 0.3, 0.0]) if is_wall else np.array([0.45, 0.35, 1.0])
    eye, beside = (eye_camera(display, each, _SEEN_PX, viewer.direction) for each in (eye_m, elsewhere))
    return {"eye": eye, "elsewhere": beside, "afar": Camera.framing(corners, onlooker, _SEEN_PX)}


def lit_display(display: Display) -> Display:
    """A display with no more pixels than are seen in a picture of it, and lie in memory together."""
    return display if display.total_px <= _LIT_PX else display.scaled(math.sqrt(_LIT_PX / display.total_px))


def _aside(eye_m: Floats, display: Display) -> Floats:
    """Where the viewer would be a few steps on: around the display, or across the room."""
    low, high = display.bounds_m
    if arrangement_of(display) == "room":
        return np.asarray(eye_m + np.array([0.25 * (high[0] - low[0]), 0.0, 0.0]))
    middle = (low + high) / 2
    x, y, z = eye_m - middle
    turn = math.radians(_ASIDE_DEG)
    step = [math.cos(turn) * x + math.sin(turn) * z, y, -math.sin(turn) * x + math.cos(turn) * z]
    return np.asarray(middle + np.array(step))
