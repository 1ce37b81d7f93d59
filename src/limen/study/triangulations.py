"""Limen's triangulation of a whole terrain at one error, as it is drawn, and how true any triangulation is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch
from limen.data.terrain.tin_tree import Grown, exact_patch, grow_tree
from limen.errors import InputError
from limen.study.error_kernels import fan_out, measure_residuals

__all__ = ["BLOCK", "Posts", "Triangles", "build_trees", "drawn", "patches_at", "residuals_m", "true_error_m"]

BLOCK = 4096
"""Posts from border to border of a root."""

Triangles = NDArray[np.int32]
"""Shape (T, 3): numbers of posts, row * columns + column."""


class Posts(NamedTuple):
    """The terrain that is triangulated."""

    heights_m: NDArray[np.float32]  # (rows, columns), voids filled
    void: NDArray[np.bool_] | None  # where heights do not count; None: nowhere
    spacing_m: tuple[float, float] = (1.0, 1.0)


def build_trees(posts: Posts, errors_m: Sequence[float]) -> list[list[Grown]]:
    """The trees of all roots, as `limen ingest` makes them, each node before its children."""
    rows, columns = posts.heights_m.shape
    trees = []
    for top in range(0, rows - 1, BLOCK):
        for left in range(0, columns - 1, BLOCK):
            own = np.s_[top : top + BLOCK + 1, left : left + BLOCK + 1]
            void = None if posts.void is None else posts.void[own]
            trees.append([*grow_tree(np.ascontiguousarray(posts.heights_m[own]), void, errors_m, origin=(left, top))])
    return trees


def patches_at(posts: Posts, trees: Iterable[Iterable[Grown]], error_m: float) -> Iterator[Patch]:
    """The coarsest patches of trees that keep an error."""
    for tree in trees:
        kept = [False]  # by a node further up, in the order of nodes, to which children are added as they are met
        for node, done in zip(tree, kept, strict=False):
            patch = next(
                (each for each, has_m in zip(node.patches, node.errors_m, strict=True) if has_m <= error_m), None
            )
            if patch is None and not any(node.children):
                left, top, right, bottom = node.rect
                patch = exact_patch(posts.heights_m[top : bottom + 1, left : right + 1], node.rect)
            if patch is not None and not done:
                yield patch
            kept += [done or patch is not None] * sum(node.children)


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
