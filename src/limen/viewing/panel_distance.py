"""Panels as an eye sees them: the smallest angle, the nearest place and the smallest tolerance over a whole panel.

All in closed form, or by a search that is sure to end at the minimum: nothing is sampled, so that no part of a panel is
overlooked however near it is. Panels are flat convex outlines, given from the eye: ``corners_m`` has shape (..., K, 3),
clockwise as seen from the side that ``normal`` points to, (..., 3); corners may repeat. The eye must be in front.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.vision.acuity import GAZE_PER_DEG, eccentricity_scale

__all__ = ["angle_deg", "least_tolerance_m", "nearest_m", "smallest_angle_deg"]

MOST_SLACK_DEG = 80.0
"""Where the gaze is known no better than this, `least_tolerance_m` takes no account of it, which errs toward detail."""

_CONVEX_DEG = 120.0
_STEEPNESS = math.degrees(GAZE_PER_DEG)  # of eccentricity_scale, per radian
_NOTHING = 1e-200  # divided by less, a length overflows
_GOLDEN = (math.sqrt(5) - 1) / 2
_STEPS = 20  # they leave a fifteen-thousandth of an edge open


def angle_deg(places_m: Floats, line: Floats) -> Floats:
    """Angle between a line of sight and the ways to places: (..., 3) and unit vectors (..., 3) to (...) degrees.

    >>> angle_deg(np.array([[0.0, 0, -2], [1, 0, -1], [0, 0, 3]]), np.array([0.0, 0, -1])).round(6).tolist()
    [0.0, 45.0, 180.0]
    """
    across = np.linalg.norm(np.cross(places_m, line), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, _dot(places_m, line))))


def smallest_angle_deg(corners_m: Floats, normal: Floats, line: Floats) -> Floats:
    """The smallest angle between a line of sight, unit (..., 3), and any place of a panel: 0 where the line meets it.

    Else it lies on an edge ``a + t e``. There the cosine ``(a.g + t e.g) / |a + t e|`` has one stationary place,
    ``t = (e.g a.a - a.g a.e) / (a.g e.e - e.g a.e)``, so that place and the two ends are all that must be asked.
    """
    step = _edges(corners_m)
    seen = line[..., None, :]
    ahead, turn = _dot(corners_m, seen), _dot(step, seen)
    far2, lean, long2 = _dot(corners_m, corners_m), _dot(corners_m, step), _dot(step, step)
    along = _ratio(turn * far2 - ahead * lean, ahead * long2 - turn * lean)
    between = corners_m + np.clip(along, 0, 1)[..., None] * step
    angle = np.minimum(angle_deg(corners_m, seen), angle_deg(between, seen)).min(axis=-1)
    return np.asarray(np.where(_meets(corners_m, normal, line), 0.0, angle))


def nearest_m(corners_m: Floats, normal: Floats) -> Floats:
    """Distance from the eye to the nearest place of a panel, (...): square to it, or to an edge."""
    step = _edges(corners_m)
    along = np.clip(_ratio(-_dot(corners_m, step), _dot(step, step)), 0, 1)
    edge = np.linalg.norm(corners_m + along[..., None] * step, axis=-1).min(axis=-1)
    height = -_dot(corners_m[..., 0, :], normal)
    return np.asarray(np.where(_meets(corners_m, normal, -normal), np.minimum(np.abs(height), edge), edge))


def least_tolerance_m(corners_m: Floats, normal: Floats, line: Floats, slack_deg: Floats) -> Floats:
    """The smallest product of distance and `eccentricity_scale` over a panel, (...): never more, and hardly less.

    Parameters
    ----------
    line
        Unit vectors along which the eye looks, (..., 3); zeros where that is unknown.
    slack_deg
        How far from ``line`` the eye may really look, (...).

    Notes
    -----
    ``f(x) = |x| U(angle)`` is what makes this safe: with ``U`` linear in the angle, ``U + U''`` is nowhere negative, so
    the places with ``f <= 1`` are a convex body (its meridian is ``1 / U`` in polar coordinates), and ``f``, which is
    its gauge, a convex function. Its smallest value over a panel lies on an edge, or on the line from the
    foot of the perpendicular toward where the line of sight meets the panel's plane, about which all is symmetric; on
    each of them golden sections close in on it, and what they leave open is subtracted.
    Beyond 120 degrees, where ``f`` is no longer convex, ``U`` is continued by ``U'' = -U``, which is less.
    """
    nearest = nearest_m(corners_m, normal)
    known = line.any(axis=-1) & (slack_deg <= MOST_SLACK_DEG)
    ways = _ways(corners_m, normal, line)
    slack = slack_deg[..., None]
    low, high = np.zeros_like(ways.long2), np.ones_like(ways.long2)
    left, right = 1 - _GOLDEN + low, _GOLDEN + low
    at_left, at_right = _tolerance_m(ways, left, slack), _tolerance_m(ways, right, slack)
    for _ in range(_STEPS):
        lower = at_left < at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
        fresh = np.where(lower, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_fresh = _tolerance_m(ways, fresh, slack)
        left, right = np.where(lower, fresh, right), np.where(lower, left, fresh)
        at_left, at_right = np.where(lower, at_fresh, at_right), np.where(lower, at_left, at_fresh)
    middle = (low + high) / 2
    value = _tolerance_m(ways, middle, slack)
    slope = _ratio(value, ways.away_m(middle)) + _STEEPNESS  # at most, in any direction: U + U'
    least = (value - slope * (high - low) * np.sqrt(ways.long2)).min(axis=-1)
    return np.asarray(np.where(known, np.maximum(least, nearest), nearest))


class _Ways(NamedTuple):
    """Lines ``a + t e``, 0 <= t <= 1, as the eye sees them: all that distance and angle need, shape (..., L) each."""

    far2: Floats  # a.a
    lean: Floats  # a.e
    long2: Floats  # e.e
    ahead: Floats  # a.g
    turn: Floats  # e.g

    def away_m(self, along: Floats) -> Floats:
        return np.sqrt(np.maximum(self.far2 + along * (2 * self.lean + along * self.long2), 0))


def _tolerance_m(ways: _Ways, along: Floats, slack_deg: Floats) -> Floats:
    away = ways.away_m(along)
    cosine = np.clip(_ratio(ways.ahead + along * ways.turn, away), -1, 1)
    angle = np.degrees(np.arccos(cosine))
    scale = eccentricity_scale(np.maximum(np.minimum(angle, _CONVEX_DEG) - slack_deg, 0))
    beyond = np.radians(np.maximum(angle - _CONVEX_DEG, 0))
    return np.asarray(away * (scale * np.cos(beyond) + _STEEPNESS * np.sin(beyond)))


def _ways(corners_m: Floats, normal: Floats, line: Floats) -> _Ways:
    """The edges, and the line across the panel on which the smallest tolerance lies if it lies inside."""
    step = _edges(corners_m)
    foot = _dot(corners_m[..., 0, :], normal)[..., None] * normal
    toward = line - _dot(line, normal)[..., None] * normal
    inward = np.cross(step, normal[..., None, :])
    inside = _dot(foot[..., None, :] - corners_m, inward)
    rate = _dot(toward[..., None, :], inward)
    rate = np.where(np.abs(rate) > _NOTHING, rate, 0.0)
    crossing = _ratio(-inside, rate)
    enters = np.where(rate > 0, crossing, 0.0).max(axis=-1, initial=0.0)
    leaves = np.where(rate < 0, crossing, np.inf).min(axis=-1)
    leaves = np.where(np.isfinite(leaves), leaves, enters)  # looked at square on: the foot itself
    misses = ((enters > leaves) | ((rate == 0) & (inside < 0)).any(axis=-1))[..., None]
    start = np.where(misses, corners_m[..., 0, :], foot + enters[..., None] * toward)[..., None, :]
    across = np.where(misses, 0.0, (leaves - enters)[..., None] * toward)[..., None, :]
    start, step = np.concatenate([corners_m, start], axis=-2), np.concatenate([step, across], axis=-2)
    seen = line[..., None, :]
    return _Ways(_dot(start, start), _dot(start, step), _dot(step, step), _dot(start, seen), _dot(step, seen))


def _meets(corners_m: Floats, normal: Floats, line: Floats) -> NDArray[np.bool_]:
    """Whether a ray from the eye meets a panel: it is on the same side of all planes through the eye and an edge."""
    side = _dot(np.cross(corners_m, np.roll(corners_m, -1, axis=-2)), line[..., None, :])
    same = (side >= 0).all(axis=-1) | (side <= 0).all(axis=-1)
    return np.asarray(same & (_dot(line, normal) < 0))


def _edges(corners_m: Floats) -> Floats:
    return np.roll(corners_m, -1, axis=-2) - corners_m


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=-1))


def _ratio(above: Floats, below: Floats) -> Floats:
    """A quotient that is 0 where there is none."""
    there = np.abs(below) > _NOTHING
    return np.divide(above, below, out=np.zeros(np.broadcast_shapes(above.shape, below.shape)), where=there)
