"""Distances from points to triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["nearest_squared"]


@njit(cache=True, nogil=True, error_model="numpy")
def _to_edge(x: Any, y: Any, z: Any, ex: Any, ey: Any, ez: Any) -> Any:
    """Square of the distance of (x, y, z) from the line from 0 to (ex, ey, ez)."""
    length2 = ex * ex + ey * ey + ez * ez
    along = (x * ex + y * ey + z * ez) / length2 if length2 > 0.0 else 0.0
    along = min(max(along, 0.0), 1.0)
    x, y, z = x - along * ex, y - along * ey, z - along * ez
    return x * x + y * y + z * z


@njit(cache=True, nogil=True, error_model="numpy")
def _to_triangle(points: Any, p: Any, places: Any, a: Any, b: Any, c: Any) -> Any:
    """Square of the distance: from the plane if the foot lies inside, else from the nearest edge."""
    x, y, z = points[p, 0] - places[a, 0], points[p, 1] - places[a, 1], points[p, 2] - places[a, 2]
    ux, uy, uz = places[b, 0] - places[a, 0], places[b, 1] - places[a, 1], places[b, 2] - places[a, 2]
    vx, vy, vz = places[c, 0] - places[a, 0], places[c, 1] - places[a, 1], places[c, 2] - places[a, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    up, vp = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
    whole = uu * vv - uv * uv
    s, t = vv * up - uv * vp, uu * vp - uv * up
    if whole > 1e-14 * uu * vv and s >= 0.0 and t >= 0.0 and s + t <= whole:
        s, t = s / whole, t / whole
        x, y, z = x - s * ux - t * vx, y - s * uy - t * vy, z - s * uz - t * vz
        return x * x + y * y + z * z
    nearest = min(_to_edge(x, y, z, ux, uy, uz), _to_edge(x, y, z, vx, vy, vz))
    return min(nearest, _to_edge(x - ux, y - uy, z - uz, vx - ux, vy - uy, vz - uz))


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_squared(points: Any, candidates: Any, places: Any, triangles: Any, found: Any) -> None:
    """Squares of the distances of ``points`` (P, 3) from the nearest of their candidates (P, k), rows of triangles."""
    for p in range(points.shape[0]):
        nearest = np.inf
        for k in range(candidates.shape[1]):
            t = candidates[p, k]
            square = _to_triangle(points, p, places, triangles[t, 0], triangles[t, 1], triangles[t, 2])
            nearest = min(nearest, square)
        found[p] = nearest
