"""The quadtree over one root block, and a ladder of triangulations for every node of it.

A node holds as many steps of the ladder as fit below a number of triangles; its children begin with the inner vertices
that it had chosen by then and carry on with the next step. So the posts of a node are looked at a few times a level.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch, Sides
from limen.data.terrain.tin import Growth, Tin, grow

__all__ = ["Grown", "exact_patch", "grow_tree"]

Rect = tuple[int, int, int, int]


class Grown(NamedTuple):
    """One node of the tree. Its patch that holds every post, the last of a leaf, is not made: see `exact_patch`."""

    rect: Rect  # in posts of the whole terrain
    low_high_m: tuple[float, float]
    children: tuple[
        bool, bool, bool, bool
    ]  # which of the quarters exist: top left, top right, bottom left, bottom right
    patches: list[Patch]  # the coarsest first
    errors_m: list[float]  # of the patches


class _Task(NamedTuple):
    """A node to be triangulated, in posts of the block."""

    rect: Rect
    size: int  # posts from border to border, were the block whole
    step: int  # of the ladder, to begin with
    bound_m: float  # never worse than this, which the parent reached
    seeds: NDArray[np.int32]  # (S, 2): inner posts to begin with


class _Source(NamedTuple):
    heights_m: NDArray[np.float32]
    void: NDArray[np.bool_] | None
    errors_m: list[float]
    origin: tuple[int, int]
    leaf: int
    max_triangles: int


def exact_patch(heights_m: NDArray[np.float32], rect: Rect) -> Patch:
    """Every post of ``rect``, whose heights are (rows, columns): two triangles for four posts, and no error.

    No border has an edge longer than a post, so all triangles are core.
    """
    rows, columns = heights_m.shape
    row, column = np.mgrid[0:rows, 0:columns].astype(np.int32)
    posts = np.stack([column + np.int32(rect[0]), row + np.int32(rect[1])], axis=-1).reshape(-1, 2)
    number = np.arange(rows * columns, dtype=np.uint16).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    core = np.stack([a, d, c, a, c, b], axis=-1).reshape(-1, 3)
    sides: Sides = (number[0].copy(), number[:, -1].copy(), number[-1].copy(), number[:, 0].copy())
    return Patch(posts, heights_m.reshape(-1), core, np.empty((0, 3), np.uint16), np.empty(0, np.uint8), sides)


def _quarters(rect: Rect, size: int) -> Iterator[Rect | None]:
    """Top left, top right, bottom left, bottom right; None beyond the block's end."""
    left, top, right, bottom = rect
    half = size // 2
    for row in (top, top + half):
        for column in (left, left + half):
            inside = column < right and row < bottom
            yield (column, row, min(column + half, right), min(row + half, bottom)) if inside else None


def _fitting_size(rect: Rect, leaf: int) -> int:
    """The smallest of ``leaf`` times a power of two that the rectangle fits in."""
    size = leaf
    while size < max(rect[2] - rect[0], rect[3] - rect[1]):
        size *= 2
    return size


def _inside(posts: NDArray[np.int32], rect: Rect) -> NDArray[np.int32]:
    """Posts off the borders of ``rect``, along a snake, so that each is found from the one before in a few steps."""
    x, y = posts[:, 0], posts[:, 1]
    inner = posts[(x > rect[0]) & (x < rect[2]) & (y > rect[1]) & (y < rect[3])]
    spacing = max(1, int((rect[3] - rect[1]) / np.sqrt(len(inner) + 1)))
    band = (inner[:, 1] - rect[1]) // spacing
    return inner[np.lexsort((inner[:, 1], np.where(band % 2, -inner[:, 0], inner[:, 0]), band))]


def _children(source: _Source, task: _Task, growth: Growth, posts: NDArray[np.int32]) -> list[_Task | None]:
    if task.size <= source.leaf:
        return [None] * 4
    step = task.step + len(growth.tins)
    # Where the ladder has ended, one patch a node leads down to the leaves, none worse than its parent's.
    bound_m = growth.tins[-1].error_m if step >= len(source.errors_m) else task.bound_m
    step = min(step, len(source.errors_m) - 1)
    return [
        rect and _Task(rect, _fitting_size(rect, source.leaf), step, bound_m, _inside(posts, rect))
        for rect in _quarters(task.rect, task.size)
    ]


def _patch(tin: Tin, heights_m: NDArray[np.float32], corner: tuple[int, int]) -> Patch:
    a, b, c, d = (side.astype(np.uint16) for side in tin.sides)
    return Patch(
        tin.posts + np.array(corner, np.int32),
        heights_m[tin.posts[:, 1], tin.posts[:, 0]],
        tin.core.astype(np.uint16),
        tin.rims.astype(np.uint16),
        tin.rim_side,
        (a, b, c, d),
    )


def _grow_node(source: _Source, task: _Task) -> tuple[Grown, list[_Task | None]]:
    left, top, right, bottom = task.rect
    own = np.s_[top : bottom + 1, left : right + 1]
    heights_m = np.ascontiguousarray(source.heights_m[own])
    void = None if source.void is None else source.void[own]
    corner = np.array([left, top], np.int32)
    bounds_m = [min(error_m, task.bound_m) for error_m in source.errors_m[task.step :]]
    most = None if task.size <= source.leaf else source.max_triangles
    growth = grow(heights_m, void, bounds_m, most, task.seeds - corner)
    children = _children(source, task, growth, growth.posts + corner)
    tins = [tin for tin, before in zip(growth.tins, [None, *growth.tins], strict=False) if tin is not before]
    first, second = left + source.origin[0], top + source.origin[1]
    a, b, c, d = (child is not None for child in children)
    node = Grown(
        (first, second, right + source.origin[0], bottom + source.origin[1]),
        (float(heights_m.min()), float(heights_m.max())),
        (a, b, c, d),
        [_patch(tin, heights_m, (first, second)) for tin in tins],
        [tin.error_m for tin in tins],
    )
    return node, children


def grow_tree(
    heights_m: NDArray[np.float32],
    void: NDArray[np.bool_] | None,
    errors_m: Sequence[float],
    *,
    origin: tuple[int, int] = (0, 0),
    leaf: int = 128,
    max_triangles: int = 4096,
    threads: int = 2,
) -> Iterator[Grown]:
    """The nodes of one root block, level by level; whoever writes them away as they come needs little memory.

    Parameters
    ----------
    heights_m
        Posts (rows, columns), at least 2 x 2, voids filled.
    void
        True where a post has no data, and its height counts as no error; None if all have.
    errors_m
        The ladder of vertical errors in metres, descending, at least one.
    origin
        Column and row of the first post in the whole terrain.
    leaf
        Posts from border to border of the smallest nodes; at most 255, so that 16 bits number the posts of a leaf.
    max_triangles
        Of a patch above the leaves, unless it is the first of its node; at most 65535.
    threads
        Nodes of a level are triangulated side by side.
    """
    rows, columns = heights_m.shape
    source = _Source(heights_m, void, list(errors_m), origin, leaf, max_triangles)
    rect = (0, 0, columns - 1, rows - 1)
    level = [_Task(rect, _fitting_size(rect, leaf), 0, np.inf, np.empty((0, 2), np.int32))]
    with ThreadPoolExecutor(threads) as pool:
        while level:
            next_level: list[_Task] = []
            for node, children in pool.map(_grow_node, [source] * len(level), level):
                next_level += [child for child in children if child is not None]
                yield node
            level = next_level
