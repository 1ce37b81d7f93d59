"""Distances from points to triangles."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["fill_grid", "nearest_squared"]


@compiled
def _to_edge(x: Any, y: Any, z: Any, ex: Any, ey: Any, ez: Any) -> Any:
    """Square of the distance of (x, y, z) from the line from 0 to (ex, ey, ez)."""
    length2 = ex * ex + ey * ey + ez * ez
    along = (x * ex + y * ey + z * ez) / length2 if length2 > 0.0 else 0.0
    along = min(max(along, 0.0), 1.0)
    x, y, z = x - along * ex, y - along * ey, z - along * ez
    return x * x + y * y + z * z


@compiled
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


@compiled
def _cells(places: Any, triangle: Any, low: Any, cell: Any, count: Any, ends: Any) -> None:
    """First and last cell along each axis that the box of a triangle meets, into ``ends`` (6,)."""
    for axis in range(3):
        a, b, c = places[triangle[0], axis], places[triangle[1], axis], places[triangle[2], axis]
        ends[axis] = min(max(int((min(a, b, c) - low[axis]) / cell), 0), count[axis] - 1)
        ends[3 + axis] = min(max(int((max(a, b, c) - low[axis]) / cell), 0), count[axis] - 1)


@compiled
def fill_grid(places: Any, triangles: Any, low: Any, cell: Any, count: Any, starts: Any, members: Any) -> None:
    """Which triangles meet which cube: those of cell c are ``members[starts[c]:starts[c + 1]]``.

    With ``members`` of length 0, only ``starts`` (cells + 1,) is made, of zeros; with its last number as length, both.
    """
    ends = np.empty(6, np.int64)
    counting = members.shape[0] == 0
    for t in range(triangles.shape[0] - 1, -1, -1):
        _cells(places, triangles[t], low, cell, count, ends)
        for i in range(ends[0], ends[3] + 1):
            for k in range(ends[1], ends[4] + 1):
                for m in range(ends[2], ends[5] + 1):
                    at = (i * count[1] + k) * count[2] + m
                    if counting:
                        starts[at] += 1
                    else:
                        starts[at] -= 1
                        members[starts[at]] = t
    if counting:
        for at in range(1, starts.shape[0]):
            starts[at] += starts[at - 1]


@compiled
def nearest_squared(
    points: Any, places: Any, triangles: Any, low: Any, cell: Any, count: Any, starts: Any, members: Any, found: Any
) -> None:
    """Squares of the distances of ``points`` (P, 3) from the nearest triangle, in shells of cells around each point.

    A shell is looked at while it may hold something nearer than what was found.
    """
    most = max(count[0], count[1], count[2])
    for p in range(points.shape[0]):
        home = np.empty(3, np.int64)
        for axis in range(3):
            home[axis] = min(max(int((points[p, axis] - low[axis]) / cell), 0), count[axis] - 1)
        nearest, shell = np.inf, 0
        while shell <= most and ((shell - 1) * cell <= 0.0 or ((shell - 1) * cell) ** 2 < nearest):
            for i in range(max(home[0] - shell, 0), min(home[0] + shell, count[0] - 1) + 1):
                for k in range(max(home[1] - shell, 0), min(home[1] + shell, count[1] - 1) + 1):
                    side = abs(i - home[0]) == shell or abs(k - home[1]) == shell
                    for m in range(home[2] - shell, home[2] + shell + 1, 1 if side or shell == 0 else 2 * shell):
                        if 0 <= m < count[2]:
                            at = (i * count[1] + k) * count[2] + m
                            for n in range(starts[at], starts[at + 1]):
                                a, b, c = triangles[members[n]]
                                nearest = min(nearest, _to_triangle(points, p, places, a, b, c))
            shell += 1
        found[p] = nearest
