"""Rows that the shaders of three-dimensional layers read: every panel as every eye sees it. No GPU here.

The dtypes are the structs of ``sort.wgsl`` and ``scene.wgsl``, field by field; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.geometry import Floats
from limen.layers.mesh.directions import DirectionGrid
from limen.viewing.projection import PanelViews

__all__ = [
    "CORNER",
    "MOST_EYES",
    "OCTREE_FRAME",
    "PANEL_VIEW",
    "PAPER_FRAME",
    "SCENE",
    "SORT_FRAME",
    "Rows",
    "corner_rows",
    "grid_words",
    "scene_row",
    "sort_frame",
    "view_rows",
    "ways_of_pixels",
]

Rows: TypeAlias = NDArray[np.void]

MOST_EYES = 2

PANEL_VIEW = np.dtype(
    [
        ("x", "<f4", 4),
        ("y", "<f4", 4),
        ("w", "<f4", 4),
        ("edges", "<f4", (8, 4)),
        ("corners", "<f4", (8, 4)),
        ("corner_count", "<u4"),
        ("eye", "<u4"),
        ("padding", "<u4", 2),
    ]
)
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
PAPER_FRAME = np.dtype(
    [
        ("vertices", "<u4"),
        ("triangles", "<u4"),
        ("panels", "<u4"),
        ("pair_capacity", "<u4"),
        ("eyes", "<u4"),
        ("padding_a", "<u4"),
        ("padding_b", "<u4"),
        ("padding_c", "<u4"),
        ("leaves_per_m", "<f4", 4),
        ("eye_leaves", "<f4", (2, 4)),
        ("eye_from_mesh", "<f4", (6, 4)),
        ("camera", "<f4", (6, 4)),
    ]
)
OCTREE_FRAME = np.dtype(
    [
        ("vertices", "<u4"),
        ("triangles", "<u4"),
        ("panels", "<u4"),
        ("pair_capacity", "<u4"),
        ("eyes", "<u4"),
        ("member_capacity", "<u4"),
        ("padding_a", "<u4"),
        ("padding_b", "<u4"),
        ("eye_from_mesh", "<f4", (6, 4)),
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


def view_rows(views: Sequence[PanelViews], erosion_px: Sequence[Floats]) -> Rows:
    """Rows of `PANEL_VIEW`: all panels of the first eye, then all of the second.

    Parameters
    ----------
    erosion_px
        For each eye: how far inside each edge and its guard the sorter takes a panel to begin, (N, 8) or one number.
    """
    rows = np.zeros((len(views), len(views[0].near)), PANEL_VIEW)
    for eye, (row, view, erosion) in enumerate(zip(rows, views, erosion_px, strict=True)):
        row["x"][:, :3], row["y"][:, :3], row["w"][:, :3] = (view.clip[:, axis] for axis in range(3))
        row["x"][:, 3] = view.near
        row["edges"][..., :3], row["edges"][..., 3] = view.edges, erosion
        row["corners"][..., :3] = view.corners
        row["corner_count"], row["eye"] = view.corner_count, eye
    return rows.reshape(-1)


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


def ways_of_pixels(clip: Floats, size_px: tuple[int, int]) -> Floats:
    """Ways from the eye through pixels of what is drawn into, shape (N, 3, 3): times (x, y, 1), with w = 1.

    Clip space's x, y, w are linear in the way from the eye, so it is the inverse of those forms (``clip``, shape
    (N, 3, 3)), applied to (x / w, y / w, 1), which is affine in the pixel.
    """
    width, height = size_px
    clip_from_pixel = np.array([[2 / width, 0.0, -1.0], [0.0, -2 / height, 1.0], [0.0, 0.0, 1.0]])
    return np.asarray(np.linalg.inv(clip) @ clip_from_pixel)
