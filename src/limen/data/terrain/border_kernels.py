"""Borders of a triangulation: each simplified from its own posts, so that both its neighbours simplify it alike.

Between two vertices of a border, whatever posts a neighbour adds, the line through them stays between the lower and the
upper convex hull of the posts (in the vertical plane). So the thickness of that hull bounds the error of the border.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled
from limen.data.terrain.delaunay_kernels import insert_on_border

__all__ = ["Border", "begin_border", "insert_beside", "insert_chosen", "split_side", "thickest"]

_CHOSEN = -2


class Border(NamedTuple):
    """The four sides in the order of `SIDES` of `limen.data.terrain.model`; shorter ones end early."""

    length: NDArray[np.int64]  # (4,): posts along each side
    heights_m: NDArray[np.float64]  # (4, N)
    lower_m: NDArray[np.float64]  # (4, N): hulls of the posts of each segment
    upper_m: NDArray[np.float64]  # (4, N)
    thickness_m: NDArray[np.float64]  # (4, N): of the segment that begins at a vertex
    vertex: NDArray[np.int32]  # (4, N): its number, -1 where the post is none


@compiled
def _hull(heights: Any, i: Any, j: Any, sign: Any, out: Any, kept: Any) -> None:
    """Upper (``sign`` 1) or lower (-1) convex hull of posts i to j, at every post (Andrew 1979)."""
    size = 0
    for k in range(i, j + 1):
        while size >= 2:
            a, b = kept[size - 2], kept[size - 1]
            turn = (heights[b] - heights[a]) * (k - a) - (heights[k] - heights[a]) * (b - a)
            if sign * turn > 0.0:
                break
            size -= 1
        kept[size] = k
        size += 1
    for s in range(size - 1):
        a, b = kept[s], kept[s + 1]
        slope = (heights[b] - heights[a]) / (b - a)
        for k in range(a, b):
            out[k] = heights[a] + slope * (k - a)
    out[j] = heights[j]


@compiled
def _measure(border: Any, side: Any, i: Any, j: Any, kept: Any) -> None:
    heights, lower, upper = border.heights_m[side], border.lower_m[side], border.upper_m[side]
    _hull(heights, i, j, 1.0, upper, kept)
    _hull(heights, i, j, -1.0, lower, kept)
    thickness = 0.0
    for k in range(i + 1, j):
        thickness = max(thickness, upper[k] - lower[k])
    border.thickness_m[side, i] = thickness


@compiled
def _farthest(heights: Any, i: Any, j: Any) -> Any:
    """The post between i and j that deviates most from the chord."""
    best, most = i + 1, -1.0
    slope = (heights[j] - heights[i]) / (j - i)
    for k in range(i + 1, j):
        deviation = abs(heights[k] - heights[i] - slope * (k - i))
        if deviation > most:
            best, most = k, deviation
    return best


@compiled
def begin_border(border: Any) -> None:
    """One segment a side; vertices are the corners 0 to 3, around from the first row's first post."""
    first, last = (0, 1, 3, 0), (1, 2, 2, 3)
    kept = np.empty(border.heights_m.shape[1], dtype=np.int64)
    for side in range(4):
        end = border.length[side] - 1
        border.vertex[side, 0], border.vertex[side, end] = first[side], last[side]
        _measure(border, side, np.int64(0), end, kept)


@compiled
def split_side(border: Any, side: Any, error: Any) -> None:
    """Choose posts until no segment's hull is thicker than ``error`` (Ramer 1972, with the hull as measure)."""
    heights, vertex, thickness = border.heights_m[side], border.vertex[side], border.thickness_m[side]
    kept = np.empty(heights.shape[0], dtype=np.int64)
    i, end = np.int64(0), border.length[side] - 1
    while i < end:
        j = i + 1
        while vertex[j] == -1:
            j += 1
        while thickness[i] > error:
            middle = _farthest(heights, i, j)
            vertex[middle] = _CHOSEN
            _measure(border, side, i, middle, kept)
            _measure(border, side, middle, j, kept)
            j = middle
        i = j


@compiled
def insert_chosen(mesh: Any, border: Any, side: Any) -> None:
    """Make vertices of posts that `split_side` chose; half-edges go along the first two sides, against the others."""
    vertex, last = border.vertex[side], border.length[side] - 1
    x = border.length[0] - 1 if side == 1 else 0
    y = border.length[1] - 1 if side == 2 else 0
    along = side == 0 or side == 2
    previous = vertex[0] if side < 2 else vertex[last]
    for step in range(1, last):
        k = step if side < 2 else last - step
        if vertex[k] == _CHOSEN:
            vertex[k] = insert_on_border(mesh, previous, k if along else x, y if along else k)
        if vertex[k] >= 0:
            previous = vertex[k]


@compiled
def insert_beside(mesh: Any, border: Any, side: Any, k: Any) -> None:
    """Make post ``k`` of a side a vertex, because triangles beside it need it."""
    vertex = border.vertex[side]
    i, j = k - 1, k + 1
    while vertex[i] == -1:
        i -= 1
    while vertex[j] == -1:
        j += 1
    kept = np.empty(j - i + 1, dtype=np.int64)
    _measure(border, side, i, k, kept)
    _measure(border, side, k, j, kept)
    vertex[k] = _CHOSEN
    insert_chosen(mesh, border, side)


@compiled
def thickest(border: Any) -> Any:
    """The largest thickness of all segments, in metres."""
    thickness = 0.0
    for side in range(4):
        for k in range(border.length[side] - 1):
            if border.vertex[side, k] >= 0:
                thickness = max(thickness, border.thickness_m[side, k])
    return thickness
