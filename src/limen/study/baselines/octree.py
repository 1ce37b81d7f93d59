"""Panels in an octree of which only the leaves are kept: an array of boxes, each with the panels that enter it.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.2.1 (depth 3, 512 leaves).
Ericson 2005, *Real-Time Collision Detection*, section 5.2.9 (polygon against box, by separating axes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats

__all__ = ["LEAVES", "Octree"]

LEAVES = 8
"""Along each axis: depth 3."""

_SLACK = 1e-3  # of a leaf; whoever walks the leaves does so in single precision


@dataclass(frozen=True, eq=False)
class Octree:
    """The leaves around some panels.

    Parameters
    ----------
    outline_m
        The panels' corners, shape (N, K, 3); a panel with fewer than K repeats one.
    low_m, leaves_per_m
        The lowest corner of the first leaf, and how many leaves there are in a metre: shape (3,).
    starts, entries
        Panels of leaf ``(z * 8 + y) * 8 + x`` are ``entries[starts[leaf]:starts[leaf + 1]]``.
    """

    outline_m: Floats
    low_m: Floats
    leaves_per_m: Floats
    starts: NDArray[np.int64]
    entries: NDArray[np.int64]

    @classmethod
    def of(cls, outline_m: Floats) -> Octree:
        """The octree over the bounding box of panels."""
        low, high = outline_m.min(axis=(0, 1)), outline_m.max(axis=(0, 1))
        margin = max(float((high - low).max()), 1e-9) * 1e-3  # a flat wall has a box, too
        low, high = low - margin, high + margin
        per_m = LEAVES / (high - low)
        leaf, panel = _met((outline_m - low) * per_m)
        order = np.argsort(leaf, kind="stable")
        starts = np.searchsorted(leaf[order], np.arange(LEAVES**3 + 1))
        return cls(outline_m, low, per_m, starts, panel[order])


def _met(outlines: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Leaves and the panels that enter them, one row a meeting; outlines (N, K, 3) in leaves."""
    first = np.clip(np.floor(outlines.min(axis=1) - _SLACK), 0, LEAVES - 1).astype(np.int64)
    last = np.clip(np.floor(outlines.max(axis=1) + _SLACK), 0, LEAVES - 1).astype(np.int64)
    x, y, z = (np.arange(LEAVES).reshape(shape) for shape in ((1, 1, 1, -1), (1, 1, -1, 1), (1, -1, 1, 1)))
    inside = np.ones((len(outlines), LEAVES, LEAVES, LEAVES), bool)
    for axis, number in enumerate((x, y, z)):
        bounds = (slice(None), axis, None, None, None)
        inside &= (number >= first[bounds]) & (number <= last[bounds])
    panel, depth, row, column = np.nonzero(inside)
    boxes = np.stack([column, row, depth], axis=1)
    kept = _enters(outlines[panel] - boxes[:, None] - 0.5)
    return ((depth * LEAVES + row) * LEAVES + column)[kept], panel[kept]


def _enters(polygons: Floats) -> NDArray[np.bool_]:
    """Whether plane convex polygons (M, K, 3) enter the box of side 1 about the origin; its axes do not part them."""
    sides = np.roll(polygons, -1, axis=1) - polygons
    normals = np.cross(sides[:, 0], sides[:, 1])[:, None]
    across = np.cross(sides[:, :, None], np.eye(3)).reshape(len(polygons), -1, 3)
    axes = np.concatenate([normals, across], axis=1)
    reach = (0.5 + _SLACK) * np.abs(axes).sum(axis=2)
    along = np.einsum("mka,mja->mkj", polygons, axes)
    return np.asarray(((along.min(axis=1) <= reach) & (along.max(axis=1) >= -reach)).all(axis=1))
