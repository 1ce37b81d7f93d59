"""Rows that the shaders of meshes read, beside those of panels. No GPU here.

The dtypes are the structs of ``sort.wgsl`` and ``scene.wgsl``, field by field; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.geometry import Floats
from limen.layers.common.panel_uniforms import Rows
from limen.layers.mesh.directions import DirectionGrid

__all__ = ["CORNER", "SCENE", "SORT_FRAME", "corner_rows", "grid_words", "scene_row", "sort_frame"]

SORT_FRAME = np.dtype(
    [
        ("vertices", "<u4"),
        ("triangles", "<u4"),
        ("panels", "<u4"),
        ("pair_capacity", "<u4"),
        ("grids", "<u4", (2, 4)),
        ("entries", "<u4", 4),
        ("eye_from_mesh", "<f4", (6, 4)),
        ("planes", "<f4", (36, 4)),
    ]
)
CORNER = np.dtype([("normal", "<f4", 3), ("colour", "<u4"), ("uv", "<f4", 2), ("layer", "<u4"), ("padding", "<u4")])
SCENE = np.dtype(
    [
        ("vertices", "<u4"),
        ("panels", "<u4"),
        ("near", "<f4"),
        ("padding", "<u4"),
        ("forward", "<f4", (2, 4)),
        ("normal_from_mesh", "<f4", (3, 4)),
        ("light", "<f4", 4),
    ]
)


def grid_words(grids: Sequence[DirectionGrid]) -> tuple[NDArray[np.uint32], list[tuple[int, int, int]]]:
    """All grids in one buffer, rows of four numbers, and the rows where cells, extents and entries of each begin."""
    parts: list[NDArray[np.uint32]] = []
    begins: list[tuple[int, int, int]] = []
    size = 0
    for grid in grids:
        cells = np.zeros((len(grid.ends), 4), np.uint32)
        cells[:, :2], cells[:, 2] = grid.starts, grid.ends
        entries = np.zeros((-(-len(grid.entries) // 4), 4), np.uint32)
        entries.reshape(-1)[: len(grid.entries)] = grid.entries
        each = [cells, grid.extents.reshape(-1, 4).view(np.uint32), entries]
        edges = np.cumsum([size, *(len(part) for part in each)])
        begins.append((int(edges[0]), int(edges[1]), int(edges[2])))
        size = int(edges[3])
        parts += each
    return np.concatenate(parts), begins


def sort_frame(
    grids: Sequence[DirectionGrid],
    begins: Sequence[tuple[int, int, int]],
    eye_from_mesh: Floats,
    *,
    vertices: int,
    triangles: int,
    panels: int,
) -> Rows:
    """The one row of `SORT_FRAME`, but for its ``pair_capacity``. ``eye_from_mesh``: shape (E, 3, 4)."""
    row = np.zeros(1, SORT_FRAME)
    row["vertices"], row["triangles"], row["panels"] = vertices, triangles, panels
    for eye, (grid, (cells, extents, entries)) in enumerate(zip(grids, begins, strict=True)):
        row["grids"][0, eye] = len(grid.planes), grid.cells, cells, extents
        row["entries"][0, eye] = entries
        planes = grid.planes.reshape(-1, 3)
        row["planes"][0, eye * 18 : eye * 18 + len(planes), :3] = planes
    row["eye_from_mesh"][0, : 3 * len(eye_from_mesh)] = eye_from_mesh.reshape(-1, 4)
    return row


def corner_rows(mesh: Mesh) -> Rows:
    """Rows of `CORNER`, one a vertex."""
    rows = np.zeros(len(mesh.positions), CORNER)
    rows["normal"], rows["uv"], rows["layer"] = mesh.normals, mesh.uv, mesh.layers
    rows["colour"] = np.ascontiguousarray(mesh.colours).view("<u4")[:, 0]
    return rows


def scene_row(
    room_from_mesh: Floats,
    *,
    vertices: int,
    panels: int,
    forward: Floats,
    near_m: float,
    light: Floats,
) -> Rows:
    """The one row of `SCENE`.

    Parameters
    ----------
    room_from_mesh
        Affine, shape (4, 4).
    forward
        Where each eye's camera looks, unit vectors, shape (E, 3).
    light
        Toward the light (unit vector) and the share of light that comes from everywhere: shape (4,).
    """
    row = np.zeros(1, SCENE)
    row["vertices"], row["panels"], row["near"], row["light"] = vertices, panels, near_m, light
    row["forward"][0, : len(forward), :3] = forward
    row["normal_from_mesh"][0, :, :3] = np.linalg.inv(np.asarray(room_from_mesh)[:3, :3]).T
    return row
