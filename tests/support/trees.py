"""A tree of triangulations in memory, with the tables that a file has of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Nodes, Patch, PatchTable
from limen.data.terrain.tin import Tin, grow
from limen.data.terrain.tin_tree import Grown, grow_tree

__all__ = ["Block", "build_tree", "collect", "cut_at", "refine"]


class Block(NamedTuple):
    """A root and all below it, level by level; ``contents`` is None for patches that `exact_patch` makes."""

    nodes: Nodes
    patches: PatchTable
    contents: list[Patch | None]


def collect(grown: Iterable[Grown]) -> Block:
    """Number the nodes and patches of `grow_tree`; a leaf gets its exact patch on top of the others."""
    rects, bounds, children, first_patch = [], [], [], [0]
    rows: list[tuple[int, float, int, int]] = []
    contents: list[Patch | None] = []
    known = 1
    for number, node in enumerate(grown):
        rects.append(node.rect)
        bounds.append(node.low_high_m)
        children.append([-1] * 4)
        for quarter, exists in enumerate(node.children):
            if exists:
                children[-1][quarter], known = known, known + 1
        for patch, error_m in zip(node.patches, node.errors_m, strict=True):
            rows.append((number, error_m, len(patch.posts), len(patch.core) + len(patch.rims)))
        contents += node.patches
        if not any(node.children):
            width, height = node.rect[2] - node.rect[0], node.rect[3] - node.rect[1]
            rows.append((number, 0.0, (width + 1) * (height + 1), 2 * width * height))
            contents.append(None)
        first_patch.append(len(rows))
    of_node, errors_m, vertices, triangles = zip(*rows, strict=True)
    nodes = Nodes(
        np.array(rects, np.int32),
        np.array(bounds, np.float32),
        np.array(children, np.int32),
        np.array(first_patch, np.int32),
        1,
    )
    table = PatchTable(
        np.array(of_node, np.int32),
        _rounded_up(np.array(errors_m)),
        np.array(vertices, np.int32),
        np.array(triangles, np.int32),
    )
    return Block(nodes, table, contents)


def _rounded_up(errors_m: NDArray[np.float64]) -> NDArray[np.float32]:
    nearest = errors_m.astype(np.float32)
    return np.where(nearest < errors_m, np.nextafter(nearest, np.float32(np.inf)), nearest).astype(np.float32)


def build_tree(
    heights_m: NDArray[np.float32],
    void: NDArray[np.bool_] | None,
    errors_m: Sequence[float],
    *,
    origin: tuple[int, int] = (0, 0),
    leaf: int = 128,
    max_triangles: int = 4096,
    threads: int = 2,
) -> Block:
    """The whole tree of `grow_tree` in memory."""
    return collect(
        grow_tree(heights_m, void, errors_m, origin=origin, leaf=leaf, max_triangles=max_triangles, threads=threads)
    )


def cut_at(nodes: Nodes, patches: PatchTable, error_m: float) -> Iterator[int]:
    """The coarsest patches of a tree that keep an error."""
    pending = list(range(nodes.roots))
    while pending:
        node = pending.pop()
        first, last = nodes.first_patch[node : node + 2]
        fine = np.flatnonzero(patches.error_m[first:last] <= error_m)
        if len(fine):
            yield int(first + fine[0])
        else:
            pending += [int(child) for child in nodes.children[node] if child >= 0]


def refine(
    heights_m: NDArray[np.float32],
    void: NDArray[np.bool_] | None,
    errors_m: Sequence[float],
    max_triangles: int | None = None,
) -> list[Tin]:
    """The steps of one greedy run, from nothing."""
    return grow(heights_m, void, errors_m, max_triangles).tins
