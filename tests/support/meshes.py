"""Meshes of given numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.data.mesh.mesh import NO_TEXTURE, Mesh, smooth_normals

__all__ = ["mesh_of", "plain", "square"]


def mesh_of(positions: Any, triangles: Any, **fields: Any) -> Mesh:
    """A white mesh without textures; ``fields`` are given instead."""
    positions, triangles = np.asarray(positions, np.float32), np.asarray(triangles, np.uint32)
    count = len(positions)
    rest: dict[str, Any] = {
        "normals": np.tile(np.float32([0, 0, 1]), (count, 1)),
        "colours": np.full((count, 4), 255, np.uint8),
        "uv": np.zeros((count, 2), np.float32),
        "layers": np.full(count, NO_TEXTURE, np.uint32),
        "textures": np.zeros((0, 1, 1, 4), np.uint8),
    }
    return Mesh(path=None, positions=positions, triangles=triangles, **rest | fields)


def plain(positions: Any, triangles: Any, colours: Any = (255, 255, 255, 255)) -> Mesh:
    """A mesh of one colour, or of one a vertex, without textures."""
    places = np.asarray(positions, np.float32)
    numbers = np.asarray(triangles, np.uint32)
    count = len(places)
    welds = np.arange(count, dtype=np.uint32)
    return Mesh(
        None, places, numbers, smooth_normals(places, numbers, welds),
        np.broadcast_to(np.asarray(colours, np.uint8), (count, 4)), np.zeros((count, 2), np.float32),
        np.full(count, NO_TEXTURE, np.uint32), np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip


def square(z: float, half: float = 1.0, colour: Any = (255, 255, 255, 255)) -> Mesh:
    return plain(
        [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)], [(0, 1, 2), (0, 2, 3)], colour
    )
