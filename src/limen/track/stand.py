"""Where a person would stand who is not tracked: the viewer of a picture that names none."""

from __future__ import annotations

import numpy as np

from limen.display.display import Display
from limen.viewer import Viewer

__all__ = ["standing_viewer"]

EYE_HEIGHT_M = 1.7


def standing_viewer(display: Display) -> Viewer:
    """A viewer in the middle of a room, in front of a wall at about the distance of its height, or before an object.

    Eyes are 1.7 m high, or at the middle of a display that is smaller than a person.
    """
    facing = display.facing
    low, high = display.bounds_m
    middle = (low + high) / 2
    strength = float(np.linalg.norm(facing))
    if strength > 0.3:
        height = float(high[1] - low[1])
        distance = min(max(height, 0.6), 3.0)
        place = middle + facing / strength * distance
        look = -facing
    else:
        normals = np.array([panel.normal for panel in display.panels])
        outward = float(np.sum(normals * (np.array([panel.centre_m for panel in display.panels]) - middle)))
        first = display.panels[len(display.panels) // 2]
        if outward > 0:  # something to walk around, looked at along -z
            extent = float((high - low).max())
            place = middle + np.array([0, 0, (high[2] - low[2]) / 2 + max(1.5 * extent, 0.6)])
            look = middle - place
        else:
            place = middle
            look = first.centre_m - place
    eye_height = EYE_HEIGHT_M if low[1] < EYE_HEIGHT_M < high[1] else float(middle[1])
    position = (float(place[0]), eye_height, float(place[2]))
    return Viewer(position, direction=(float(look[0]), 0.0, float(look[2]) or -1e-9))
