"""Normals where a file has none: planes through neighbours.

References
----------
Hoppe, DeRose, Duchamp, McDonald, Stuetzle 1992, *Surface Reconstruction from Unorganized Points*, section 3.1 (tangent
planes). Pauly, Gross, Kobbelt 2002, *Efficient Simplification of Point-Sampled Surfaces*, section 2.1 (surface
variation).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.cone_kernels import NO_NORMAL, pack_normal
from limen.data.points.group_kernels import GROUP

__all__ = ["MOST_VARIATION", "REACH", "estimate_normals"]

REACH = 3.0
"""Neighbours count up to so many radii away: about 25 of them on a surface."""

MOST_VARIATION = 0.06
"""Share of the smallest of the three variances beyond which points are no surface (leaves, grass): 0 is a plane, 1/3
are points all around.
"""

_LEAST_WIDTH = 0.1
"""Share of the middle one below which they are a line, which has no normal."""

_FEWEST = 5.0
"""Sum of weights, 1 at the point itself and 0 at the farthest."""


@compiled(error_model="python", fastmath={"reassoc", "contract", "nsz"})
def _moments(x: Any, y: Any, z: Any, i: int, reach: float, moments: Any) -> float:
    """Weighted sums of x, y, z and of their six products about point ``i`` into ``moments`` (9,); the weights' sum."""
    a, b, c, scale = x[i], y[i], z[i], np.float32(1.0) / reach
    total = sx = sy = sz = xx = yy = zz = xy = yz = zx = np.float32(0.0)
    for j in range(x.shape[0]):
        dx, dy, dz = (x[j] - a) * scale, (y[j] - b) * scale, (z[j] - c) * scale
        w = max(np.float32(1.0) - (dx * dx + dy * dy + dz * dz), np.float32(0.0))
        total += w
        sx, sy, sz = sx + w * dx, sy + w * dy, sz + w * dz
        xx, yy, zz = xx + w * dx * dx, yy + w * dy * dy, zz + w * dz * dz
        xy, yz, zx = xy + w * dx * dy, yz + w * dy * dz, zx + w * dz * dx
    moments[0], moments[1], moments[2] = sx, sy, sz
    moments[3], moments[4], moments[5], moments[6], moments[7], moments[8] = xx, yy, zz, xy, yz, zx
    return float(total)


@compiled(error_model="python")
def _plane(moments: Any, total: float, normal: Any) -> bool:
    """The direction of least variance into ``normal`` (3,); whether it is that of a surface."""
    mx, my, mz = moments[0] / total, moments[1] / total, moments[2] / total
    xx, yy, zz = moments[3] / total - mx * mx, moments[4] / total - my * my, moments[5] / total - mz * mz
    xy, yz, zx = moments[6] / total - mx * my, moments[7] / total - my * mz, moments[8] / total - mz * mx
    mean = (xx + yy + zz) / 3.0
    if mean <= 0.0:
        return False
    # Eigenvalues of a symmetric matrix by the angle of its cubic (Smith 1961).
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + yz * yz + zx * zx)) / 6.0)
    if spread <= 1e-9 * mean:
        return False
    det = (a * (b * c - yz * yz) - xy * (xy * c - yz * zx) + zx * (xy * yz - b * zx)) / spread**3
    angle = np.arccos(min(max(det / 2.0, -1.0), 1.0)) / 3.0
    most = mean + 2.0 * spread * np.cos(angle)
    least = mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
    middle = 3.0 * mean - most - least
    if least > MOST_VARIATION * 3.0 * mean or middle < _LEAST_WIDTH * 3.0 * mean:
        return False
    # Two rows of what is left of the matrix without the least variance are perpendicular to its direction.
    a, b, c = xx - least, yy - least, zz - least
    best = 0.0
    for rows in range(3):
        if rows == 0:
            u, v, w = xy * yz - zx * b, zx * xy - a * yz, a * b - xy * xy
        elif rows == 1:
            u, v, w = xy * c - zx * yz, zx * zx - a * c, a * yz - xy * zx
        else:
            u, v, w = b * c - yz * yz, yz * zx - xy * c, xy * yz - b * zx
        size = u * u + v * v + w * w
        if size > best:
            best = size
            normal[0], normal[1], normal[2] = u, v, w
    return best > 0.0


@compiled(error_model="python")
def estimate_normals(places: Any, radii: Any, step: float, octahedral: Any) -> None:
    """Normals (N, 2) of arranged points, upward (z not negative), from the neighbours in their groups of 64.

    ``places`` (N, 3) int32 on a lattice of ``step`` metres, ``radii`` (N,) in metres. `NO_NORMAL` twice where the
    neighbours are too few, or no surface.
    """
    x, y, z = np.empty(GROUP, np.float32), np.empty(GROUP, np.float32), np.empty(GROUP, np.float32)
    moments, normal = np.empty(9, np.float64), np.empty(3, np.float64)
    for begin in range(0, places.shape[0], GROUP):
        count = min(GROUP, places.shape[0] - begin)
        for i in range(count):
            x[i] = np.float32(places[begin + i, 0] - places[begin, 0])
            y[i] = np.float32(places[begin + i, 1] - places[begin, 1])
            z[i] = np.float32(places[begin + i, 2] - places[begin, 2])
        for i in range(count):
            octahedral[begin + i, 0], octahedral[begin + i, 1] = NO_NORMAL, NO_NORMAL
            reach = np.float32(REACH * radii[begin + i] / step)
            if reach <= np.float32(0.0):
                continue
            total = _moments(x[:count], y[:count], z[:count], i, reach, moments)
            if total >= _FEWEST and _plane(moments, total, normal):
                sign = -1.0 if normal[2] < 0.0 else 1.0
                pack_normal(sign * normal[0], sign * normal[1], sign * normal[2], octahedral[begin + i])
