"""What an eye in the room looks at: the panels that face it, or among panels what the head points at."""

from __future__ import annotations

import math

import numpy as np

from limen.display.display import Display
from limen.geometry import Floats, Vec3, as_vec3
from limen.viewing.camera import Camera

__all__ = ["eye_camera"]

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
