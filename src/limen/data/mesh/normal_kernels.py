"""Vertex normals of triangles: the one loop of a deforming mesh that every frame runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["sum_normals"]


@compiled(error_model="python")
def sum_normals(positions: Any, triangles: Any, welds: Any, normals: Any) -> None:
    """Unit normals (V, 3) float32 into ``normals``: the mean of the triangles around, weighted by area.

    Vertices with the same number in ``welds`` (V,) share one normal. Where no triangle has an area, +z.
    """
    total = np.zeros((positions.shape[0], 3), dtype=np.float64)
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        px, py, pz = np.float64(positions[a, 0]), np.float64(positions[a, 1]), np.float64(positions[a, 2])
        ux, uy, uz = positions[b, 0] - px, positions[b, 1] - py, positions[b, 2] - pz
        vx, vy, vz = positions[c, 0] - px, positions[c, 1] - py, positions[c, 2] - pz
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for vertex in (welds[a], welds[b], welds[c]):
            total[vertex, 0] += nx
            total[vertex, 1] += ny
            total[vertex, 2] += nz
    for v in range(positions.shape[0]):
        x, y, z = total[welds[v], 0], total[welds[v], 1], total[welds[v], 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            normals[v, 0], normals[v, 1], normals[v, 2] = x / length, y / length, z / length
        else:
            normals[v, 0], normals[v, 1], normals[v, 2] = 0.0, 0.0, 1.0
