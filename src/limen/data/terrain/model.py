"""A terrain: a quadtree of nodes, each with triangulations of growing fineness that keep a known error.

Posts are counted from 0 along columns (east, where the raster is north up) and rows (south). A node covers a rectangle
of posts, borders included, so neighbours share their border posts. Its patches are triangulations of all of it; a
patch's error is the largest vertical distance, at posts and anywhere between them, from the surface of all posts, two
triangles for four posts (`limen.data.terrain.tin_tree.exact_patch`), **whatever vertices its neighbours add to its
borders**. Where a triangle of that surface has a post without data, nothing counts. Heights of vertices are those of
the posts, exactly.

Where two patches of any fineness meet, the border carries the vertices of both. Every triangle with an edge on a border
(a rim) has its third vertex, the apex, inside, so adding vertices to the edge makes a fan about the apex, and no crack.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats

__all__ = ["SIDES", "Nodes", "Patch", "PatchSource", "PatchTable", "Sides", "metric_from_posts"]

SIDES = ("top", "right", "bottom", "left")
"""Borders of a node: its first row, last column, last row, first column; rims name them by number."""

Sides = tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint16]]


class Nodes(NamedTuple):
    """The quadtree, one row a node; the roots come first and lie side by side, row by row.

    ``rect`` is first column, first row, last column, last row, in posts of the whole terrain. ``low_high_m`` bounds the
    heights of all posts inside. ``first_patch`` has one entry more than there are nodes: the patches of node ``n`` are
    ``first_patch[n]`` up to ``first_patch[n + 1]``, at least one, the coarsest first; those of its children are finer.
    """

    rect: NDArray[np.int32]  # (N, 4)
    low_high_m: NDArray[np.float32]  # (N, 2)
    children: NDArray[np.int32]  # (N, 4): -1 where there is none; a leaf has none
    first_patch: NDArray[np.int32]  # (N + 1,)
    roots: int

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        return np.asarray((self.children < 0).all(axis=1))


class PatchTable(NamedTuple):
    """What is known of every patch before it is read, one row a patch."""

    node: NDArray[np.int32]  # (P,)
    error_m: NDArray[np.float32]  # (P,): not growing within a node, 0 where every post is a vertex
    vertices: NDArray[np.int32]  # (P,)
    triangles: NDArray[np.int32]  # (P,): core and rims


class Patch(NamedTuple):
    """One triangulation of a node. All triangles turn the same way: counter-clockwise as seen from above."""

    posts: NDArray[np.int32]  # (V, 2): column and row in the whole terrain
    heights_m: NDArray[np.float32]  # (V,)
    core: NDArray[np.uint16]  # (T, 3): triangles that no neighbour can change
    rims: NDArray[np.uint16]  # (R, 3): apex and the two ends of an edge on the border, longer than a post
    rim_side: NDArray[np.uint8]  # (R,): which border, an index into `SIDES`
    sides: Sides  # vertices along each border in the order of columns or rows, both corners included


class PatchSource(Protocol):
    """What patches are read from; `limen.Terrain` is one."""

    @property
    def nodes(self) -> Nodes: ...

    @property
    def patches(self) -> PatchTable: ...

    def read_patch(self, patch: int) -> Patch:
        """Thread-safe. Raises PageError if the file does not give it."""
        ...


def metric_from_posts(spacing_m: tuple[float, float], exaggeration: float = 1.0) -> Floats:
    """Metres east, up and south from column, row and height: an affine map of shape (4, 4)."""
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 2], matrix[2, 1], matrix[3, 3] = spacing_m[0], exaggeration, spacing_m[1], 1.0
    return matrix
