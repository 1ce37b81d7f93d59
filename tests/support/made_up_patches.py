"""Triangulations of rectangles with made-up vertices, and rectangles that tile a terrain unevenly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch

Rect = tuple[int, int, int, int]


def uneven_tiling(random: np.random.Generator, size: int, smallest: int, kept: float) -> list[Rect]:
    """Leaves of a quadtree that is split by chance; some are left out."""
    found: list[Rect] = []

    def split(rect: Rect) -> None:
        c0, r0, c1, _ = rect
        half = (c1 - c0) // 2
        if half >= smallest and random.random() < 0.7:
            for k in range(4):
                left, above = c0 + half * (k & 1), r0 + half * (k >> 1)
                split((left, above, left + half, above + half))
        elif random.random() < kept:
            found.append(rect)

    for column in range(2):
        split((column * size, 0, (column + 1) * size, size))
    return found


def twice_area(a: Any, b: Any, c: Any) -> int:
    """Positive for triangles that turn counter-clockwise as seen from above: rows run south."""
    return -int((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def made_up_patch(random: np.random.Generator, rect: Rect, share: float, inner: int) -> Patch:
    """A rectangle's border with a share of its posts, all seen from one post inside; then triangles split by posts.

    So every triangle has at most one edge on the border, and its third vertex inside.
    """
    c0, r0, c1, r1 = rect
    sides = [_some(random, c0, c1, share), _some(random, r0, r1, share)]
    sides += [_some(random, c0, c1, share), _some(random, r0, r1, share)]
    around = [(c, r0) for c in sides[0]] + [(c1, r) for r in sides[1][1:]]
    around += [(c, r1) for c in sides[2][-2::-1]] + [(c0, r) for r in sides[3][-2:0:-1]]
    hub = (int(random.integers(c0 + 1, c1)), int(random.integers(r0 + 1, r1)))
    posts = [*around, hub]
    triangles = [(len(around), (k + 1) % len(around), k) for k in range(len(around))]
    for _ in range(inner):
        number = int(random.integers(len(triangles)))
        a, b, c = triangles[number]
        weights = random.dirichlet([2, 2, 2])
        post = tuple(np.rint(weights @ np.array([posts[a], posts[b], posts[c]])).astype(int).tolist())
        pairs = ((a, b), (b, c), (c, a))
        if all(twice_area(posts[i], posts[j], post) > 0 for i, j in pairs):
            posts.append(post)
            triangles[number : number + 1] = [(i, j, len(posts) - 1) for i, j in pairs]
    return _patch(rect, np.array(posts, np.int32), triangles, random)


def _some(random: np.random.Generator, begin: int, end: int, share: float) -> list[int]:
    return [begin, *(x for x in range(begin + 1, end) if random.random() < share), end]


def _patch(rect: Rect, posts: NDArray[np.int32], triangles: list[Any], random: np.random.Generator) -> Patch:
    """Sort the triangles into core and rims, in an order of their own and begun at any corner of theirs in the core."""
    c0, r0, c1, r1 = rect
    on = [posts[:, 1] == r0, posts[:, 0] == c1, posts[:, 1] == r1, posts[:, 0] == c0]
    core, rims, rim_side = [], [], []
    for a, b, c in triangles:
        for apex, i, j in ((a, b, c), (b, c, a), (c, a, b)):
            side = [number for number in range(4) if on[number][i] and on[number][j]]
            if side and np.abs(posts[i] - posts[j]).max() > 1:
                rims.append((apex, i, j))
                rim_side.append(side[0])
                break
        else:
            core.append((a, b, c))
    order = random.permutation(len(rims))
    sides: Any = tuple(
        np.flatnonzero(on[k])[np.argsort(posts[on[k], k % 2])].astype(np.uint16) for k in range(4)
    )  # fmt: skip
    return Patch(
        posts,
        np.zeros(len(posts), np.float32),
        np.array(core, np.uint16).reshape(-1, 3),
        np.array(rims, np.uint16).reshape(-1, 3)[order],
        np.array(rim_side, np.uint8)[order],
        sides,
    )
