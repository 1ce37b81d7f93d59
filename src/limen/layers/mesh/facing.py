"""Which cells of the Gauss sphere may face an eye, or away from it, from any direction there is.

A node may be on the silhouette if its normals meet both (Luebke, Hallen 2001, section 5.2). The paper makes two masks
for a view, as if all of an object were seen in one direction. Here directions are divided like normals, only finer, and
there are two masks for each, once and for all: each node is asked in the direction that it is seen in, and neither the
view nor its perspective matters.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.normal_masks import CELLS, cell_corners, face_grid
from limen.data.mesh.vertex_tree import MASK_WORDS
from limen.geometry import Floats

__all__ = ["DIRECTIONS", "SPREAD_SINES", "FacingMasks", "facing_masks"]

DIRECTIONS = 32
"""Cells along a side of a face of directions."""

SPREAD_SINES: Floats = np.sin(np.radians([0.5, 1.0, 2.0, 4.0, 8.0]))
"""Sines of the angles within which all of a node is seen in a direction: a pair of masks for each."""


class FacingMasks(NamedTuple):
    """Masks of `limen.data.mesh.normal_masks`, shape (spreads, directions, 6) each."""

    front: NDArray[np.uint64]  # cells with a normal that may face the eye
    back: NDArray[np.uint64]  # cells with a normal that may face away


@cache
def facing_masks() -> FacingMasks:
    """The masks of all directions from a node to the eye; made when first asked for, in about a third of a second.

    Of normals and directions in two cells the sines of their angles reach their extremes at corners, as far as signs
    go: both are convex cones, and the product is linear in each.
    """
    corners = cell_corners().reshape(-1, 3)
    borders = np.linspace(-1.0, 1.0, DIRECTIONS + 1)
    spreads, directions = len(SPREAD_SINES), MASK_WORDS * DIRECTIONS**2
    front = np.empty((spreads, directions, MASK_WORDS), np.uint64)
    back = np.empty_like(front)
    for begin in range(0, directions, DIRECTIONS**2):
        seen_from = face_grid(borders)[begin : begin + DIRECTIONS**2].reshape(-1, 3)
        products = (seen_from @ corners.T).reshape(-1, 4, CELLS, 4)
        most, least = products.max(axis=(1, 3)), products.min(axis=(1, 3))
        for spread, sine in enumerate(SPREAD_SINES):
            front[spread, begin : begin + DIRECTIONS**2] = _packed(most > -sine)
            back[spread, begin : begin + DIRECTIONS**2] = _packed(least < sine)
    return FacingMasks(front, back)


def _packed(bits: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """(n, 384) to (n, 6)."""
    return np.packbits(bits, axis=1, bitorder="little").view("<u8").astype(np.uint64)
