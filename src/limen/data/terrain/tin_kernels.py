"""Greedy insertion: the post against the worst triangle of all becomes a vertex (Garland, Heckbert 1995).

Whole numbers are handed to functions in 64 bits: Numba compiles a function anew for every type, literals among them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.terrain.border_kernels import insert_beside
from limen.data.terrain.delaunay_kernels import insert, locate, touch
from limen.data.terrain.residual_kernels import rim_of, scan_lines, scan_posts

__all__ = ["DONE", "FULL", "OVER", "extract", "improve", "scan_stale", "seed", "worst_of_all"]

DONE, FULL, OVER = 0, 1, 2
"""How `improve` and `seed` end: nothing left to do; the arrays must grow first; more triangles than allowed."""


@compiled
def scan_stale(mesh: Any, border: Any, heights: Any, truth: Any) -> None:
    for s in range(mesh.counts[2]):
        scan_posts(mesh, border, heights, truth, np.int64(mesh.stale[s]))
    mesh.counts[2] = 0


@compiled
def seed(mesh: Any, posts: Any, begin: Any) -> Any:
    """Insert inner posts, no vertices yet, from number ``begin`` on; how many are in, all if there was room."""
    t = np.int64(0)
    for s in range(begin, posts.shape[0]):
        if mesh.counts[1] + 2 > mesh.worst.shape[0] or mesh.counts[0] == mesh.points.shape[0]:
            return s
        x, y = np.int64(posts[s, 0]), np.int64(posts[s, 1])
        t = locate(mesh.points, mesh.edges, t, x, y)
        insert(mesh, t, x, y)
    return posts.shape[0]


@compiled
def _push(keys: Any, items: Any, size: Any, key: Any, item: Any) -> None:
    k = size
    while k > 0:
        parent = (k - 1) // 2
        if keys[parent] >= key:
            break
        keys[k], items[k] = keys[parent], items[parent]
        k = parent
    keys[k], items[k] = key, item


@compiled
def _drop_first(keys: Any, items: Any, size: Any) -> None:
    """Of ``size`` entries; one fewer are left."""
    last = size - 1
    key, item, k = keys[last], items[last], 0
    while True:
        child = 2 * k + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] > keys[child]:
            child += 1
        if keys[child] <= key:
            break
        keys[k], items[k] = keys[child], items[child]
        k = child
    keys[k], items[k] = key, item


@compiled
def _collect(worst: Any, triangles: Any, error: Any, keys: Any, items: Any) -> Any:
    """A heap of the triangles that are worse than ``error``; how many."""
    size = np.int64(0)
    for t in range(triangles):
        if worst[t] > error:
            _push(keys, items, size, worst[t], t)
            size += 1
    return size


@compiled
def _look_between_posts(mesh: Any, border: Any, heights: Any, truth: Any) -> None:
    for t in range(mesh.counts[1]):
        if not mesh.whole[t]:
            scan_lines(mesh, border, heights, truth, t)


@compiled
def _insert_against(mesh: Any, border: Any, t: Any) -> None:
    """The post that was found for triangle ``t``, which may lie beside it, or on the border.

    If it lies beside it, another triangle may have made it a vertex since: then there is a better one.
    """
    x, y = np.int64(mesh.post[t, 0]), np.int64(mesh.post[t, 1])
    rows, columns = mesh.taken.shape
    touch(mesh.worst, mesh.whole, mesh.stale, mesh.counts, t)
    if mesh.taken[y, x]:
        return
    if 0 < x < columns - 1 and 0 < y < rows - 1:
        insert(mesh, locate(mesh.points, mesh.edges, t, x, y), x, y)
    else:
        side = 0 if y == 0 else (2 if y == rows - 1 else (1 if x == columns - 1 else 3))
        insert_beside(mesh, border, side, x if side % 2 == 0 else y)


@compiled
def improve(mesh: Any, border: Any, heights: Any, truth: Any, error: Any, most: Any) -> Any:
    """Insert the worst post of all until no place is worse than ``error``, or there are more than ``most`` triangles.

    Places between posts are looked at when no post is too far any more: two thirds of all triangles are gone by then.
    """
    room = mesh.worst.shape[0]
    keys, items = np.empty(2 * room, dtype=np.float64), np.empty(2 * room, dtype=np.int32)
    scan_stale(mesh, border, heights, truth)
    size = _collect(mesh.worst, mesh.counts[1], error, keys, items)
    while True:
        if size == 0:
            _look_between_posts(mesh, border, heights, truth)
            size = _collect(mesh.worst, mesh.counts[1], error, keys, items)
            if size == 0:
                return OVER if mesh.counts[1] > most else DONE
        if mesh.counts[1] > most:
            return OVER
        if mesh.counts[1] + 2 > room or mesh.counts[0] == mesh.points.shape[0]:
            return FULL
        key, t = keys[0], np.int64(items[0])
        _drop_first(keys, items, size)
        size -= 1
        if mesh.worst[t] != key:
            continue
        _insert_against(mesh, border, t)
        if size + mesh.counts[2] > keys.shape[0]:
            scan_stale(mesh, border, heights, truth)
            size = _collect(mesh.worst, mesh.counts[1], error, keys, items)
        for s in range(mesh.counts[2]):
            t = np.int64(mesh.stale[s])
            scan_posts(mesh, border, heights, truth, t)
            if mesh.worst[t] > error:
                _push(keys, items, size, mesh.worst[t], t)
                size += 1
        mesh.counts[2] = 0


@compiled
def worst_of_all(mesh: Any) -> Any:
    """The largest residual of all triangles, in metres."""
    worst = 0.0
    for t in range(mesh.counts[1]):
        worst = max(worst, mesh.worst[t])
    return worst


@compiled
def extract(mesh: Any, core: Any, rims: Any, rim_side: Any) -> Any:
    """Write triangles, counter-clockwise where rows go down; how many core and rims there are."""
    points, edges = mesh.points, mesh.edges
    inner, outer = 0, 0
    for t in range(mesh.counts[1]):
        count, e, side = rim_of(points, edges, t)
        if count == 0:
            core[inner, 0], core[inner, 1], core[inner, 2] = edges[3 * t, 0], edges[3 * t + 2, 0], edges[3 * t + 1, 0]
            inner += 1
        else:
            k = e % 3
            rims[outer, 0] = edges[3 * t + (k + 2) % 3, 0]
            rims[outer, 1] = edges[3 * t + (k + 1) % 3, 0]
            rims[outer, 2] = edges[e, 0]
            rim_side[outer] = side
            outer += 1
    return inner, outer
