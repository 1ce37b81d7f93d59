"""Posts without data get heights that join smoothly, the same whatever block of the raster is looked at.

Pull and push (Gortler, Grzeszczuk, Szeliski, Cohen 1996, The lumigraph, sec. 3.4): means of valid posts over cells of
2, 4, 8, ... posts, then from the coarsest on down every empty cell is interpolated between the coarser ones around it.
Cells lie on multiples of their size, so blocks agree; from `CELL` posts on they are held for the whole raster.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CELL", "REACH", "complete", "fill", "pull"]

_HALVINGS = 6
CELL = 1 << _HALVINGS
"""Posts along a cell of the grid that is held for the whole raster."""

REACH = 4 * CELL
"""A height depends on posts up to twice the sum of all cells' sizes away, besides the grid."""

Heights = NDArray[np.float32]
Mask = NDArray[np.bool_]


def _halved(heights: Heights, valid: Mask) -> tuple[Heights, Mask]:
    """Means of 2 x 2 valid cells; sizes must be even."""
    shape = heights.shape[0] // 2, 2, heights.shape[1] // 2, 2
    count = valid.reshape(shape).sum((1, 3), dtype=np.float32)
    total = np.where(valid, heights, np.float32(0.0)).reshape(shape).sum((1, 3), dtype=np.float32)
    return total / np.maximum(count, np.float32(1.0)), count > 0


def _doubled(coarse: Heights) -> Heights:
    """Linear interpolation between the centres of cells, at centres of cells half as large."""
    for axis in (0, 1):
        lines = np.moveaxis(coarse, axis, 0)
        before = np.concatenate([lines[:1], lines[:-1]])
        after = np.concatenate([lines[1:], lines[-1:]])
        both = np.stack([0.25 * before + 0.75 * lines, 0.75 * lines + 0.25 * after], axis=1)
        coarse = np.moveaxis(both.reshape(-1, lines.shape[1]).astype(np.float32), 0, axis)
    return coarse


def pull(heights: Heights, valid: Mask) -> tuple[Heights, Mask]:
    """Means of valid posts over cells of `CELL` posts, and where there are any; sizes are rounded up."""
    rows, columns = (-size % CELL for size in heights.shape)
    heights, valid = np.pad(heights, ((0, rows), (0, columns))), np.pad(valid, ((0, rows), (0, columns)))
    for _ in range(_HALVINGS):
        heights, valid = _halved(heights, valid)
    return heights, valid


def complete(grid: Heights, valid: Mask) -> Heights:
    """The grid of `pull` for a whole raster with no cell empty; at least one must be valid."""
    if valid.all():
        return grid
    rows, columns = grid.shape
    even = ((0, rows % 2), (0, columns % 2))
    coarse = complete(*_halved(np.pad(grid, even), np.pad(valid, even)))
    return np.where(valid, grid, _doubled(coarse)[:rows, :columns])


def fill(heights: Heights, valid: Mask, grid: Heights) -> Heights:
    """Heights with those that are not valid interpolated.

    The first post lies on a multiple of `CELL`, and ``grid`` holds the cells of `complete` below these posts. At edges
    of ``heights`` that are not the raster's, `REACH` posts are not yet what they should be.
    """
    rows, columns = heights.shape
    below = (grid.shape[0] * CELL - rows), (grid.shape[1] * CELL - columns)
    heights = np.pad(heights, ((0, below[0]), (0, below[1])))
    valid = np.pad(valid, ((0, below[0]), (0, below[1])))
    levels = [(heights, valid)]
    for _ in range(_HALVINGS - 1):
        levels.append(_halved(*levels[-1]))
    filled = grid
    while levels:
        known, where = levels.pop()
        filled = np.where(where, known, _doubled(filled))
    return filled[:rows, :columns]
