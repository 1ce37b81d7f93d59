"""Greedy insertion: which post lies farthest from its triangle, and making it a vertex (Garland, Heckbert 1995).

The residual of a post is its vertical distance from its triangle. In a rim, a triangle with an edge on the border that
is longer than a post, it is the largest distance that neighbours can cause by adding vertices to that edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from limen.data.delaunay_kernels import insert, locate

__all__ = ["DONE", "FULL", "OVER", "extract", "improve", "scan_stale", "seed", "worst_of_all"]

DONE, FULL, OVER = 0, 1, 2
"""How `improve` and `seed` end: nothing left to do; the arrays must grow first; more triangles than allowed."""

_NUDGE = 1e-6
"""Crossings of an edge and a row are multiples of 1 / 8192: this much is rounding, and no distance."""


@njit(cache=True, nogil=True, error_model="numpy")
def _rim(mesh: Any, t: Any) -> Any:
    """How many edges on the border longer than a post, the last one's half-edge, and its side."""
    points, edges = mesh.points, mesh.edges
    count, edge, side = 0, -1, -1
    if edges[3 * t, 1] >= 0 and edges[3 * t + 1, 1] >= 0 and edges[3 * t + 2, 1] >= 0:
        return count, edge, side
    for k in range(3):
        e = 3 * t + k
        if edges[e, 1] >= 0:
            continue
        a, b = edges[e, 0], edges[3 * t + (k + 1) % 3, 0]
        dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        if abs(dx) + abs(dy) > 1:
            count, edge = count + 1, e
            side = (0 if dx > 0 else 2) if dy == 0 else (1 if dy > 0 else 3)
    return count, edge, side


@njit(cache=True, nogil=True, error_model="numpy")
def _sorted_by_row(points: Any, a: Any, b: Any, c: Any) -> Any:
    if points[b, 1] < points[a, 1]:
        a, b = b, a
    if points[c, 1] < points[a, 1]:
        a, c = c, a
    if points[c, 1] < points[b, 1]:
        b, c = c, b
    return a, b, c


@njit(cache=True, nogil=True, error_model="numpy")
def _robust_residual(border: Any, side: Any, apex: Any, apex_z: Any, x: Any, y: Any, z: Any) -> Any:
    """Of a post in a rim: on its ray from the apex, the border's end lies anywhere between the two hulls."""
    ax, ay = np.float64(apex[0]), np.float64(apex[1])
    if side == 0 or side == 2:
        along, apex_along, depth, apex_depth = np.float64(x), ax, np.float64(y), ay
        far = border.length[1] - 1 if side == 2 else 0
    else:
        along, apex_along, depth, apex_depth = np.float64(y), ay, np.float64(x), ax
        far = border.length[0] - 1 if side == 1 else 0
    share = (apex_depth - depth) / (apex_depth - far)
    if share <= 0.0:
        return 0.0
    end = apex_along + (along - apex_along) / share
    k = min(max(np.int64(end), 0), border.length[side] - 2)
    f = end - k
    lower = border.lower_m[side, k] * (1.0 - f) + border.lower_m[side, k + 1] * f
    upper = border.upper_m[side, k] * (1.0 - f) + border.upper_m[side, k + 1] * f
    return max(abs(apex_z + share * (lower - apex_z) - z), abs(apex_z + share * (upper - apex_z) - z))


@njit(cache=True, nogil=True, error_model="numpy")
def _corner_post(mesh: Any, t: Any) -> Any:
    """An inner post of a triangle that has two edges on borders: on the diagonal from the corner they share."""
    points, edges = mesh.points, mesh.edges
    x, y, reach = 0, 0, np.int64(1)
    for k in range(3):
        v = edges[3 * t + k, 0]
        if edges[3 * t + k, 1] < 0 and edges[3 * t + (k + 2) % 3, 1] < 0:
            a, b = edges[3 * t + (k + 1) % 3, 0], edges[3 * t + (k + 2) % 3, 0]
            u = np.int64(abs(points[a, 0] - points[v, 0]) + abs(points[a, 1] - points[v, 1]))
            w = np.int64(abs(points[b, 0] - points[v, 0]) + abs(points[b, 1] - points[v, 1]))
            reach = max(u * w // (u + w) // 2, 1)
            x, y = points[v, 0], points[v, 1]
    return (reach if x == 0 else x - reach), (reach if y == 0 else y - reach)


@njit(cache=True, nogil=True, error_model="numpy")
def _scan(mesh: Any, border: Any, heights: Any, truth: Any, t: Any) -> None:
    """Find the worst of the inner posts of triangle ``t``; a post on an edge belongs to that right of it or below."""
    rows, columns = heights.shape
    points, edges = mesh.points, mesh.edges
    count, edge, side = _rim(mesh, t)
    a, b, c = _sorted_by_row(points, edges[3 * t, 0], edges[3 * t + 1, 0], edges[3 * t + 2, 0])
    ax, ay = np.float64(points[a, 0]), points[a, 1]
    bx, by = np.float64(points[b, 0]), points[b, 1]
    cx, cy = np.float64(points[c, 0]), points[c, 1]
    az = np.float64(heights[ay, points[a, 0]])
    ux, uy, uz = bx - ax, np.float64(by - ay), heights[by, points[b, 0]] - az
    vx, vy, vz = cx - ax, np.float64(cy - ay), heights[cy, points[c, 0]] - az
    area = ux * vy - uy * vx
    per_x, per_y = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
    apex = edges[edge - 1 if edge % 3 == 2 else (edge + 2 if edge % 3 == 0 else edge - 1), 0] if count == 1 else 0
    apex_z = np.float64(heights[points[apex, 1], points[apex, 0]])
    best, best_x, best_y = 0.0, -1, -1
    long_slope = vx / vy
    upper_slope = ux / uy if by > ay else 0.0
    lower_slope = (cx - bx) / (cy - by) if cy > by else 0.0
    for y in range(int(max(ay, 1)), int(min(cy, rows - 1))):
        p = ax + (y - ay) * long_slope
        q = ax + (y - ay) * upper_slope if y < by else bx + (y - by) * lower_slope
        left, right = (p, q) if p < q else (q, p)
        first = max(np.int64(np.ceil(left - _NUDGE)), 1)
        end = min(np.int64(np.ceil(right - _NUDGE)), columns - 1)
        if count == 1:
            for x in range(first, end):
                residual = _robust_residual(border, side, points[apex], apex_z, x, y, np.float64(truth[y, x]))
                if residual > best:
                    best, best_x, best_y = residual, x, y
        else:
            base = az + (y - ay) * per_y - ax * per_x
            for x in range(first, end):
                residual = abs(truth[y, x] - (base + x * per_x))
                if residual > best:
                    best, best_x, best_y = residual, x, y
    if count >= 2:
        best = np.inf
        if best_x < 0:
            best_x, best_y = _corner_post(mesh, t)
    mesh.worst[t], mesh.post[t, 0], mesh.post[t, 1] = best, best_x, best_y


@njit(cache=True, nogil=True, error_model="numpy")
def scan_stale(mesh: Any, border: Any, heights: Any, truth: Any) -> None:
    for s in range(mesh.counts[2]):
        _scan(mesh, border, heights, truth, mesh.stale[s])
    mesh.counts[2] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def seed(mesh: Any, posts: Any, begin: Any) -> Any:
    """Insert inner posts, no vertices yet, from number ``begin`` on; how many are in, all if there was room."""
    t = np.int64(0)
    for s in range(begin, posts.shape[0]):
        if mesh.counts[1] + 2 > mesh.worst.shape[0] or mesh.counts[0] == mesh.points.shape[0]:
            return s
        t = locate(mesh, t, posts[s, 0], posts[s, 1])
        insert(mesh, t, posts[s, 0], posts[s, 1])
    return posts.shape[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _push(keys: Any, items: Any, size: Any, key: Any, item: Any) -> None:
    k = size
    while k > 0:
        parent = (k - 1) // 2
        if keys[parent] >= key:
            break
        keys[k], items[k] = keys[parent], items[parent]
        k = parent
    keys[k], items[k] = key, item


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _collect(mesh: Any, error: Any, keys: Any, items: Any) -> Any:
    size = 0
    for t in range(mesh.counts[1]):
        if mesh.worst[t] > error:
            _push(keys, items, size, mesh.worst[t], t)
            size += 1
    return size


@njit(cache=True, nogil=True, error_model="numpy")
def improve(mesh: Any, border: Any, heights: Any, truth: Any, error: Any, most: Any) -> Any:
    """Insert the worst post of all until none is worse than ``error``, or there are more than ``most`` triangles."""
    room = mesh.worst.shape[0]
    keys, items = np.empty(2 * room, dtype=np.float64), np.empty(2 * room, dtype=np.int32)
    scan_stale(mesh, border, heights, truth)
    size = _collect(mesh, error, keys, items)
    while size > 0:
        if mesh.counts[1] > most:
            return OVER
        if mesh.counts[1] + 2 > room or mesh.counts[0] == mesh.points.shape[0]:
            return FULL
        key, t = keys[0], items[0]
        _drop_first(keys, items, size)
        size -= 1
        if mesh.worst[t] != key:
            continue
        insert(mesh, t, np.int64(mesh.post[t, 0]), np.int64(mesh.post[t, 1]))
        if size + mesh.counts[2] > keys.shape[0]:
            scan_stale(mesh, border, heights, truth)
            size = _collect(mesh, error, keys, items)
        for s in range(mesh.counts[2]):
            t = mesh.stale[s]
            _scan(mesh, border, heights, truth, t)
            if mesh.worst[t] > error:
                _push(keys, items, size, mesh.worst[t], t)
                size += 1
        mesh.counts[2] = 0
    return OVER if mesh.counts[1] > most else DONE


@njit(cache=True, nogil=True, error_model="numpy")
def worst_of_all(mesh: Any) -> Any:
    """The largest residual of all inner posts, in metres."""
    worst = 0.0
    for t in range(mesh.counts[1]):
        worst = max(worst, mesh.worst[t])
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def extract(mesh: Any, core: Any, rims: Any, rim_side: Any) -> Any:
    """Write triangles, counter-clockwise where rows go down; how many core and rims there are."""
    edges = mesh.edges
    inner, outer = 0, 0
    for t in range(mesh.counts[1]):
        count, e, side = _rim(mesh, t)
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
