"""Sets of normals as bits: the cells of a cube around the Gauss sphere, 8 x 8 a face.

Face ``2 a`` is where the coordinate ``a`` is the largest and positive, ``2 a + 1`` where it is negative. The other two,
in their order, are column and row; borders between cells lie at equal distances on the cube.
Bit ``8 row + column`` of word ``face`` stands for the cell ``64 face + 8 row + column``.

References
----------
Zhang, Hoff 1997, *Fast Backface Culling Using Normal Masks*.
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 5.2.
"""

from __future__ import annotations

import numpy as np

from limen.data.mesh.vertex_tree import MASK_WORDS
from limen.geometry import Floats

__all__ = ["ALL_CELLS", "CELLS", "CELL_BORDERS", "cell_corners", "face_grid"]

SIDE = 8
CELLS = MASK_WORDS * SIDE * SIDE

CELL_BORDERS: Floats = np.linspace(-1.0, 1.0, SIDE + 1)
"""Where cells of a face end, along column and row, over the face's own coordinate: shape (9,), from -1 to 1."""

ALL_CELLS = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""A word of a mask that holds every normal, as on rims."""


def cell_corners() -> Floats:
    """Unit vectors toward the four corners of every cell, shape (384, 4, 3)."""
    return face_grid(CELL_BORDERS)


def face_grid(borders: Floats) -> Floats:
    """Unit vectors toward the corners of all cells of a cube whose faces are divided at ``borders`` (n + 1,).

    Shape (6 n n, 4, 3), numbered as cells are.
    """
    cells = len(borders) - 1
    row, column = np.divmod(np.arange(cells * cells), cells)
    u = np.stack([borders[column], borders[column + 1], borders[column], borders[column + 1]], axis=-1)
    v = np.stack([borders[row], borders[row], borders[row + 1], borders[row + 1]], axis=-1)
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            corners = np.empty((*u.shape, 3))
            first, second = (other for other in range(3) if other != axis)
            corners[..., axis], corners[..., first], corners[..., second] = sign, u, v
            faces.append(corners)
    grid = np.concatenate(faces)
    return np.asarray(grid / np.linalg.norm(grid, axis=-1, keepdims=True))
