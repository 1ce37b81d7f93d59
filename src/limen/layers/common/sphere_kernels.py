"""What an eye and a panel make of a sphere that stands for something: loops that points and meshes are chosen by.

Rows that they take:

* ``eyes`` (E, 8): place relative to the eye that is drawn for, tangent of the tolerated angle, gaze (or zeros), degrees
  that the gaze may be off; metres in the room, turned as the room is. Or (E, 20): also how places move past the eye,
  a matrix of 9 by which the way from the eye that is drawn for is multiplied, and 3 that are added, m/s.
* ``panel`` (30,): planes of the outline as unit vectors, 8 x 3, positive inside; the panel's normal away from the eye,
  3; pixels of a metre at a metre's depth; 2 spare.
"""

from __future__ import annotations

import math

from limen.compiled import compiled
from limen.vision.acuity import GAZE_PER_DEG
from limen.vision.motion import DRIFT_DEG_S, FASTEST_DEG_S, KELLY_DEG_S, MOST_DEG_S, PURSUIT_GAIN

BINS = 256
BINS_PER_OCTAVE = 8
LOWEST_OCTAVE = -8

_DEG = 180.0 / math.pi
_CODE_STEP = math.log(1000.0) / 254.0


@compiled
def motion_scale(x, y, z, dx, dy, dz, away, radius, row, farther):
    """`limen.vision.motion.motion_scale` of the slowest place of a sphere.

    ``x, y, z`` is the way from the eye that is drawn for, ``dx, dy, dz`` and ``away`` that from the eye of the row,
    ``farther`` the scale of its angle from the gaze.
    """
    speed2, squares, along = 0.0, 0.0, 0.0
    for axis in range(3):
        at = 8 + 3 * axis
        moves = row[at] * x + row[at + 1] * y + row[at + 2] * z + row[17 + axis]
        speed2 += moves * moves
        squares += row[at] * row[at] + row[at + 1] * row[at + 1] + row[at + 2] * row[at + 2]
        along += moves * (dx if axis == 0 else dy if axis == 1 else dz)
    along = abs(along) / away
    across = math.sqrt(max(speed2 - along * along, 0.0))
    # Elsewhere in the sphere the line of sight is turned, and places move otherwise, by no more than this.
    sine = radius / away
    across = across * math.sqrt(1.0 - sine * sine) - along * sine - math.sqrt(squares) * radius
    velocity = max(across, 0.0) / (away + radius) * _DEG
    retinal = max(velocity - min(PURSUIT_GAIN * velocity + DRIFT_DEG_S, FASTEST_DEG_S), DRIFT_DEG_S)
    retinal = max(min(retinal, MOST_DEG_S) / farther, DRIFT_DEG_S)
    return math.sqrt((retinal + KELLY_DEG_S) / (DRIFT_DEG_S + KELLY_DEG_S))


@compiled
def least_allowed_m(x, y, z, radius, eyes):
    """The largest length that nobody sees at the nearest place of a sphere."""
    least = math.inf
    for number in range(eyes.shape[0]):
        dx, dy, dz = x - eyes[number, 0], y - eyes[number, 1], z - eyes[number, 2]
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        if away <= radius:
            return 0.0
        allowed, farther = (away - radius) * eyes[number, 3], 1.0
        gx, gy, gz = eyes[number, 4], eyes[number, 5], eyes[number, 6]
        if gx != 0.0 or gy != 0.0 or gz != 0.0:
            cosine = min(max((dx * gx + dy * gy + dz * gz) / away, -1.0), 1.0)
            beside = (math.acos(cosine) - math.asin(radius / away)) * _DEG - eyes[number, 7]
            farther = 1.0 + GAZE_PER_DEG * max(beside, 0.0)
        if eyes.shape[1] > 8:
            allowed *= motion_scale(x, y, z, dx, dy, dz, away, radius, eyes[number], farther)
        least = min(least, allowed * farther)
    return least


@compiled
def is_outside(x, y, z, radius, panel):
    for edge in range(8):
        if panel[3 * edge] * x + panel[3 * edge + 1] * y + panel[3 * edge + 2] * z < -radius:
            return True
    return panel[24] * x + panel[25] * y + panel[26] * z < -radius


@compiled
def diameter_px(x, y, z, radius, panel):
    """The diameter of a sphere on the panel, as it is nearest."""
    deep = panel[24] * x + panel[25] * y + panel[26] * z - radius
    return math.inf if deep <= 0.0 else 2.0 * radius * panel[27] / deep


@compiled
def lit_range(cosine, spread, two_sided):
    """Least and largest of a cosine over directions up to ``spread`` radians around one of that cosine."""
    angle = math.acos(min(max(cosine, -1.0), 1.0))
    high = math.cos(max(angle - spread, 0.0))
    low = math.cos(min(angle + spread, math.pi))
    if two_sided:
        if low < 0.0 < high:
            return 0.0, max(-low, high)
        return min(abs(low), abs(high)), max(abs(low), abs(high))
    return max(low, 0.0), max(high, 0.0)


@compiled
def contrast_of(code):
    """As `limen.vision.contrast_codes.CONTRAST_OF_CODE` has it."""
    return 0.0 if code == 0 else 0.001 * math.exp((code - 1) * _CODE_STEP)


@compiled
def code_of(contrast):
    """The smallest code that is no less than a contrast; the largest for all beyond 1."""
    if contrast <= 0.001:
        return 0 if contrast <= 0.0 else 1
    return math.ceil(math.log(min(contrast, 1.0) / 0.001) / _CODE_STEP - 1e-9) + 1


@compiled
def bin_of(k):
    """Which of `BINS` logarithmic bins a ``k`` falls into: bin ``b`` holds what is above ``2 ** (b / 8 - 8)``."""
    if k <= 2.0**LOWEST_OCTAVE:
        return 0
    if k == math.inf:
        return BINS - 1
    return min(BINS - 1, max(0, math.ceil((math.log2(k) - LOWEST_OCTAVE) * BINS_PER_OCTAVE) - 1))
