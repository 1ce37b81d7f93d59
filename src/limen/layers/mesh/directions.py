"""Which panels an eye may see in which direction: a grid over the view, made anew for every eye.

Sorting triangles to panels asks two things of it, both cheaply: *which panel is this vertex in the middle of* (its
core, where no other panel reaches), and *which panels can this triangle touch at all*.

The view is one picture plane where all panels that face the eye lie within a wide cone, and the six sides of a cube
around the eye otherwise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.viewing.projection import PanelProjections

__all__ = ["DirectionGrid", "direction_grid"]

_WIDEST_COS = math.cos(math.radians(65))
_CELLS_PER_PANEL = 6.0
_MOST_CELLS = 96  # along a side of one picture plane
_SIDES = np.array(
    [
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    ],
    dtype=float,
)
"""Right, up and forward of the six sides of a cube."""


class DirectionGrid(NamedTuple):
    """The grid, as what the sorting shader reads.

    A direction ``d`` lies on plane ``f`` at ``(planes[f, :2] . d) / (planes[f, 2] . d)``, in units of cells; cell
    ``(x, y)`` of it has number ``(f * cells + y) * cells + x``.
    """

    planes: Floats  # (F, 3, 3); F is 1 or 6
    cells: int  # along each side of a plane
    starts: NDArray[np.uint32]  # (F * cells * cells, 2): first entry of a cell, first that is no core
    ends: NDArray[np.uint32]  # (F * cells * cells,)
    entries: NDArray[np.uint32]  # panels by cell, those whose core touches the cell first
    extents: NDArray[np.float32]  # (F, N, 4): every panel's, in cells, x0 y0 x1 y1; x0 > x1 if it is not there
    erosion_px: Floats  # (N, 8): how far inside an edge (and its guard) a panel's core begins


def direction_grid(views: PanelProjections) -> DirectionGrid:
    """The grid of the panels that face the eye."""
    from limen.layers.mesh import direction_kernels as kernels

    planes = _planes(views)
    facing = int(views.facing.sum())
    share = 1.0 if len(planes) == 1 else 2.5  # a panel lies on one or two sides of six
    cells = int(min(max(math.sqrt(_CELLS_PER_PANEL * share * facing / len(planes)), 4), _MOST_CELLS))
    planes[:, :2] = (planes[:, :2] + planes[:, 2:]) * (cells / 2)
    extents = kernels.panel_extents(planes, cells, views.corners, views.corner_count, views.facing)
    loose_ends, loose = kernels.cell_entries(extents, cells)
    depth = np.ascontiguousarray(views.clip[:, 2])
    erosion = kernels.core_erosion(
        loose_ends, loose, extents, cells, views.edges, views.corners, depth, views.corner_count
    )
    starts, ends, entries = kernels.cores_first(
        loose_ends, loose, cells, np.linalg.inv(planes), views.edges, depth, views.corner_count, erosion
    )
    return DirectionGrid(planes, cells, starts, ends, entries, extents, erosion)


def _planes(views: PanelProjections) -> Floats:
    """Rows that take a direction to -1 ... 1 on every picture plane needed: shape (F, 3, 3)."""
    used = views.facing[:, None] & (np.arange(views.corners.shape[1]) < views.corner_count[:, None])
    corners = views.corners[used]
    if not len(corners):
        return _SIDES[:1].copy()
    middle = corners.mean(axis=0)
    middle = middle / max(float(np.linalg.norm(middle)), 1e-300)
    if (corners @ middle).min() < _WIDEST_COS:
        return _SIDES.copy()
    helper = np.eye(3)[np.abs(middle).argmin()]
    right = np.cross(middle, helper)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(middle, right), middle])
    place = corners @ frame.T
    place = place[:, :2] / place[:, 2:]
    low, high = place.min(axis=0), place.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-9) * (1 + 1e-4)
    frame[:2] = (frame[:2] - ((low + high) / 2)[:, None] * frame[2]) / half[:, None]
    return frame[None]
