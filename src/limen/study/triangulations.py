"""Limen's triangulation of a whole terrain at one error, as it is drawn, and how true any triangulation is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch
from limen.data.terrain.tin_tree import Block, build_tree, exact_patch
from limen.errors import InputError
from limen.study.error_kernels import fan_out, measure_residuals

__all__ = ["BLOCK", "Posts", "Triangles", "build_blocks", "cut_at", "drawn", "residuals_m", "true_error_m"]

BLOCK = 4096
"""Posts from border to border of a root."""

Triangles = NDArray[np.int32]
"""Shape (T, 3): numbers of posts, row * columns + column."""


class Posts(NamedTuple):
    """The terrain that is triangulated."""

    heights_m: NDArray[np.float32]  # (rows, columns), voids filled
    void: NDArray[np.bool_] | None  # where heights do not count; None: nowhere
    spacing_m: tuple[float, float] = (1.0, 1.0)


def build_blocks(posts: Posts, errors_m: Sequence[float]) -> list[Block]:
    """The trees of all roots, as `limen ingest` makes them."""
    rows, columns = posts.heights_m.shape
    blocks = []
    for top in range(0, rows - 1, BLOCK):
        for left in range(0, columns - 1, BLOCK):
            own = np.s_[top : top + BLOCK + 1, left : left + BLOCK + 1]
            void = None if posts.void is None else posts.void[own]
            blocks.append(build_tree(np.ascontiguousarray(posts.heights_m[own]), void, errors_m, origin=(left, top)))
    return blocks


def cut_at(block: Block, error_m: float) -> Iterator[int]:
    """The coarsest patches of a tree that keep an error."""
    pending = list(range(block.nodes.roots))
    while pending:
        node = pending.pop()
        first, last = block.nodes.first_patch[node : node + 2]
        fine = np.flatnonzero(block.patches.error_m[first:last] <= error_m)
        if len(fine):
            yield int(first + fine[0])
        else:
            pending += [int(child) for child in block.nodes.children[node] if child >= 0]


def patches_at(posts: Posts, blocks: Iterable[Block], error_m: float) -> Iterator[Patch]:
    """The same with their contents."""
    for block in blocks:
        for number in cut_at(block, error_m):
            content = block.contents[number]
            if content is None:
                left, top, right, bottom = (int(side) for side in block.nodes.rect[block.patches.node[number]])
                content = exact_patch(posts.heights_m[top : bottom + 1, left : right + 1], (left, top, right, bottom))
            yield content


def drawn(patches: Iterable[Patch], size_posts: tuple[int, int]) -> Triangles:
    """All triangles of patches that lie side by side, with every rim a fan that carries both sides' vertices.

    Parameters
    ----------
    size_posts
        Columns and rows of the terrain.
    """
    columns, rows = size_posts
    on_border = np.zeros((rows, columns), dtype=bool)
    cores, rims = [np.empty((0, 3), np.int32)], [np.empty((0, 3), np.int32)]
    for patch in patches:
        number = patch.posts[:, 1] * np.int32(columns) + patch.posts[:, 0]
        for side in patch.sides:
            on_border.reshape(-1)[number[side]] = True
        cores.append(number[patch.core])
        rims.append(number[patch.rims])
    wide = np.concatenate(rims).astype(np.int64)
    fans = np.empty((fan_out(wide, on_border, np.empty((0, 3), np.int32)), 3), np.int32)
    fan_out(wide, on_border, fans)
    return np.concatenate([*cores, fans])


def residuals_m(posts: Posts, triangles: Triangles) -> NDArray[np.float32]:
    """Surface less height in metres at every post, shape (rows, columns); 0 where there are no data.

    Raises
    ------
    InputError
        If a post is not covered: the triangulation has a hole, and no error.
    """
    residuals = np.full(posts.heights_m.shape, np.nan, np.float32)
    measure_residuals(posts.heights_m, triangles.astype(np.int64), residuals)
    if posts.void is not None:
        residuals[posts.void] = 0.0
    holes = int(np.isnan(residuals).sum())
    if holes:
        raise InputError(f"triangles: {holes} of {residuals.size} posts are covered by none; give all of a surface")
    return residuals


def true_error_m(posts: Posts, triangles: Triangles) -> float:
    """The largest vertical distance between a post and the surface, metres."""
    residuals = residuals_m(posts, triangles)
    return float(max(residuals.max(), -residuals.min()))
