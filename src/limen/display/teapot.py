"""Newell's teapot as 1,024 triangles.

References
----------
Newell 1975, *The Utilization of Procedure Models in Digital Image Synthesis* (the teapot). Crow 1987, *The Origins of
the Teapot*, IEEE Computer Graphics and Applications 7 (1) (the 32 patches, with the later bottom).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from limen.display.mesh import PolygonMesh
from limen.geometry import Floats

__all__ = ["teapot"]

_ROUND = 0.56
"""Newell's quarter circles: control points at this share of the radius (0.5523 would be nearest to a circle)."""

# Profiles of the parts that are round, each one Bezier curve of (distance from the axis, height), z up.
_RIM = ((1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4))
_SIDE = ((1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9))
_FOOT = ((2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15))
_KNOB = ((0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7))
_LID = ((0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4))
_BOTTOM = ((0.0, 0.0), (1.425, 0.0), (1.5, 0.075), (1.5, 0.15))

# Tubes: rows of control points (x, half width, z) from one end to the other; in a row from the inner side of the bend
# to its outer side. The other half is the mirror image.
_HANDLE = (
    (((-1.6, 0.0, 2.025), (-1.6, 0.3, 2.025), (-1.5, 0.3, 2.25), (-1.5, 0.0, 2.25)),
     ((-2.3, 0.0, 2.025), (-2.3, 0.3, 2.025), (-2.5, 0.3, 2.25), (-2.5, 0.0, 2.25)),
     ((-2.7, 0.0, 2.025), (-2.7, 0.3, 2.025), (-3.0, 0.3, 2.25), (-3.0, 0.0, 2.25)),
     ((-2.7, 0.0, 1.8), (-2.7, 0.3, 1.8), (-3.0, 0.3, 1.8), (-3.0, 0.0, 1.8))),
    (((-2.7, 0.0, 1.8), (-2.7, 0.3, 1.8), (-3.0, 0.3, 1.8), (-3.0, 0.0, 1.8)),
     ((-2.7, 0.0, 1.575), (-2.7, 0.3, 1.575), (-3.0, 0.3, 1.35), (-3.0, 0.0, 1.35)),
     ((-2.5, 0.0, 1.125), (-2.5, 0.3, 1.125), (-2.65, 0.3, 0.9375), (-2.65, 0.0, 0.9375)),
     ((-2.0, 0.0, 0.9), (-2.0, 0.3, 0.9), (-1.9, 0.3, 0.6), (-1.9, 0.0, 0.6))),
)  # fmt: skip
_SPOUT = (
    (((1.7, 0.0, 1.425), (1.7, 0.66, 1.425), (1.7, 0.66, 0.6), (1.7, 0.0, 0.6)),
     ((2.6, 0.0, 1.425), (2.6, 0.66, 1.425), (3.1, 0.66, 0.825), (3.1, 0.0, 0.825)),
     ((2.3, 0.0, 2.1), (2.3, 0.25, 2.1), (2.4, 0.25, 2.025), (2.4, 0.0, 2.025)),
     ((2.7, 0.0, 2.4), (2.7, 0.25, 2.4), (3.3, 0.25, 2.4), (3.3, 0.0, 2.4))),
    (((2.7, 0.0, 2.4), (2.7, 0.25, 2.4), (3.3, 0.25, 2.4), (3.3, 0.0, 2.4)),
     ((2.8, 0.0, 2.475), (2.8, 0.25, 2.475), (3.525, 0.25, 2.49375), (3.525, 0.0, 2.49375)),
     ((2.9, 0.0, 2.475), (2.9, 0.15, 2.475), (3.45, 0.15, 2.5125), (3.45, 0.0, 2.5125)),
     ((2.8, 0.0, 2.4), (2.8, 0.15, 2.4), (3.2, 0.15, 2.4), (3.2, 0.0, 2.4))),
)  # fmt: skip

_Patch = Floats  # (4, 4, 3)
_Row = tuple[Floats, int]  # points of one row of a patch, (n + 1, 3), and how many steps n

_STEPS = 4
_EVEN = [(k / _STEPS, _STEPS) for k in range(_STEPS + 1)]
"""Rows of corners of a patch, each at a parameter with a number of steps along it: 4 x 4 x 2 triangles."""

_POLE = [(0.0, 0), (0.2, 2), (0.4, 4), (0.6, 4), (0.8, 4), (1.0, 4)]
"""Of a patch that begins in a point, where 4 of the 32 triangles would have no area: 2 + 6 + 8 + 8 + 8 instead."""


def teapot(*, width_m: float = 1.2) -> PolygonMesh:
    """32 patches of 32 triangles each, ``width_m`` from the handle to the spout, in Blinn's flattened proportions."""
    round_parts = [(_RIM, _EVEN), (_SIDE, _EVEN), (_FOOT, _EVEN), (_KNOB, _POLE), (_LID, _EVEN), (_BOTTOM, _POLE)]
    triangles = []
    for profile, rows in round_parts:
        for quarter in range(4):
            # The rim and the lid run outward and down, the bottom outward and up: seen from outside, the other way.
            triangles += _triangles(_quarter(profile, quarter), rows, flip=profile is _BOTTOM)
    for tube in (_HANDLE, _SPOUT):
        for half in tube:
            for mirrored in (1, -1):
                patch = np.array(half) * [1, mirrored, 1]
                triangles += _triangles(patch, _EVEN, flip=mirrored < 0)
    soup = np.array(triangles)[..., [0, 2, 1]] * [1, 1, -1]  # z up to y up
    extent = soup.reshape(-1, 3).max(axis=0) - soup.reshape(-1, 3).min(axis=0)
    corners, index = np.unique(np.round(soup.reshape(-1, 3), 9), axis=0, return_inverse=True)
    faces = tuple((int(a), int(b), int(c)) for a, b, c in index.reshape(-1, 3))
    return PolygonMesh(corners * width_m / extent[0], faces, "shape 'teapot'")


def _quarter(profile: tuple[tuple[float, float], ...], quarter: int) -> _Patch:
    """A quarter of a surface of revolution as a patch; its rows are the profile's control points."""
    turn = quarter * math.pi / 2
    along, across = np.array([math.cos(turn), math.sin(turn), 0]), np.array([-math.sin(turn), math.cos(turn), 0])
    circle = np.array([[1, 0], [1, _ROUND], [_ROUND, 1], [0, 1]]) @ np.stack([along, across])
    return np.array([distance * circle + [0, 0, height] for distance, height in profile])


def _triangles(patch: _Patch, rows: list[tuple[float, int]], *, flip: bool) -> list[Floats]:
    points = [(_bezier(patch, v, np.linspace(0, 1, steps + 1)), steps) for v, steps in rows]
    found = [triangle for above, below in pairwise(points) for triangle in _band(above, below)]
    return [triangle[::-1] for triangle in found] if flip else found


def _band(above: _Row, below: _Row) -> list[Floats]:
    """Triangles between two rows with any numbers of steps: always the next one to end, so that none is skewed."""
    (upper, upper_steps), (lower, lower_steps) = above, below
    i = j = 0
    triangles = []
    while i < upper_steps or j < lower_steps:
        if j < lower_steps and (i == upper_steps or (j + 1) * upper_steps <= (i + 1) * lower_steps):
            triangles.append(np.array([upper[i], lower[j], lower[j + 1]]))
            j += 1
        else:
            triangles.append(np.array([upper[i], lower[j], upper[i + 1]]))
            i += 1
    return triangles


def _bezier(patch: _Patch, v: float, u: Floats) -> Floats:
    """Points of a bicubic Bezier patch at one ``v`` and several ``u``, shape (len(u), 3)."""
    return np.asarray(np.einsum("i,uj,ijk->uk", _bernstein(np.array([v]))[0], _bernstein(u), patch))


def _bernstein(t: Floats) -> Floats:
    return np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
