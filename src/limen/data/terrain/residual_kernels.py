"""How far a triangle is from the surface, and which post to insert against it.

The surface is that of all posts: two triangles for four posts, cut from the first to the last (`exact_patch`). The
vertical distance between it and a triangulation is linear wherever both are, so it is largest at a post, or where an
edge crosses a line of the surface: a row, a column or a diagonal. In a rim, a triangle with an edge on the border that
is longer than a post, it is the largest distance that neighbours can cause by adding vertices to that edge: these lie
between the lower and the upper hull of the border's posts, and the triangle between two cones over these hulls.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["rim_of", "scan_lines", "scan_posts"]

_NUDGE = 1e-6
"""Crossings of an edge and a row are multiples of 1 / 8192: this much is rounding, and no distance."""

_COLUMN, _ROW, _DIAGONAL = 0, 1, 2
"""Lines of the surface."""


@compiled
def rim_of(points: Any, edges: Any, t: Any) -> Any:
    """How many edges on the border longer than a post, the last one's half-edge, and its side."""
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


@compiled
def _sorted_by_row(points: Any, a: Any, b: Any, c: Any) -> Any:
    if points[b, 1] < points[a, 1]:
        a, b = b, a
    if points[c, 1] < points[a, 1]:
        a, c = c, a
    if points[c, 1] < points[b, 1]:
        b, c = c, b
    return a, b, c


@compiled
def _side_of_border(border: Any, side: Any, along: Any) -> Any:
    """Column and row of a place on a side."""
    if side == 0 or side == 2:
        return along, (0 if side == 0 else border.length[1] - 1)
    return (border.length[0] - 1 if side == 1 else 0), along


@compiled
def _cone_residual(border: Any, side: Any, apex: Any, x: Any, y: Any, z: Any) -> Any:
    """Of a post in a rim: its ray from the apex ends on the border, anywhere between the two hulls."""
    flat = side == 0 or side == 2
    along, apex_along = (x, apex[0]) if flat else (y, apex[1])
    depth, apex_depth = (y, apex[1]) if flat else (x, apex[0])
    far = 0 if side == 0 or side == 3 else border.length[1 if flat else 0] - 1
    share = (apex_depth - depth) / (apex_depth - far)
    if share <= 0.0:
        return 0.0
    end = apex_along + (along - apex_along) / share
    k = min(max(np.int64(end), 0), border.length[side] - 2)
    f = end - k
    lower = border.lower_m[side, k] * (1.0 - f) + border.lower_m[side, k + 1] * f
    upper = border.upper_m[side, k] * (1.0 - f) + border.upper_m[side, k + 1] * f
    return max(abs(apex[2] + share * (lower - apex[2]) - z), abs(apex[2] + share * (upper - apex[2]) - z))


@compiled
def _on_line(truth: Any, kind: Any, u: Any, w: Any) -> Any:
    """Height of the surface at place ``w`` of line ``u``, and the post before it."""
    k = np.int64(w)
    if kind == _COLUMN:
        k = min(k, truth.shape[0] - 2)
        x, y, z, z1 = u, k, truth[k, u], truth[k + 1, u]
    elif kind == _ROW:
        k = min(k, truth.shape[1] - 2)
        x, y, z, z1 = k, u, truth[u, k], truth[u, k + 1]
    else:
        k = min(k, truth.shape[1] - 2, truth.shape[0] - 2 + u)
        x, y, z, z1 = k, k - u, truth[k - u, k], truth[k - u + 1, k + 1]
    f = w - k
    return z * (1.0 - f) + z1 * f, x, y, f


@compiled
def _cross(truth: Any, a: Any, b: Any, sign: Any, worst: Any) -> Any:
    """Where the way from a to b (column, row, height) crosses the lines of the surface.

    ``worst`` is a residual, the kind of place, the post before it, and the share of the way to the post after it; it is
    given back, or what is worse. ``sign`` 1 counts only places above the surface, -1 below it, 0 both.
    """
    for kind in range(3):
        if kind == _COLUMN:
            first, last, w, w1 = a[0], b[0], a[1], b[1]
        elif kind == _ROW:
            first, last, w, w1 = a[1], b[1], a[0], b[0]
        else:
            first, last, w, w1 = a[0] - a[1], b[0] - b[1], a[0], b[0]
        step = 1 if last > first else -1
        per_line = 1.0 / (last - first) if last != first else 0.0
        for u in range(first + step, last, step):
            s = (u - first) * per_line
            z, x, y, f = _on_line(truth, kind, u, w + s * (w1 - w))
            above = a[2] + s * (b[2] - a[2]) - z
            residual = abs(above) if sign == 0 else sign * above
            if residual > worst[0]:
                worst = residual, kind, x, y, f
    return worst


@compiled
def _vertex(points: Any, heights: Any, v: Any) -> Any:
    x, y = np.int64(points[v, 0]), np.int64(points[v, 1])
    return x, y, np.float64(heights[y, x])


@compiled
def _cross_edges(points: Any, edges: Any, heights: Any, truth: Any, t: Any, worst: Any) -> Any:
    """Along the inner edges that go down; those that go up belong to the triangle on the other side."""
    for k in range(3):
        if edges[3 * t + k, 1] >= 0:
            a = _vertex(points, heights, edges[3 * t + k, 0])
            b = _vertex(points, heights, edges[3 * t + (k + 1) % 3, 0])
            if b[1] > a[1] or (b[1] == a[1] and b[0] > a[0]):
                worst = _cross(truth, a, b, np.int64(0), worst)
    return worst


@compiled
def _cross_cones(border: Any, truth: Any, side: Any, apex: Any, i: Any, j: Any, worst: Any) -> Any:
    """Along the edges of both cones over the hulls of a border's posts from i to j."""
    for k in range(i + 1, j):
        x, y = _side_of_border(border, side, k)
        z = border.heights_m[side, k]
        above, below = border.upper_m[side, k] <= z, border.lower_m[side, k] >= z
        if above or below:
            sign = (1 if above else 0) - (1 if below else 0)
            worst = _cross(truth, apex, (x, y, z), sign, worst)
    return worst


@compiled
def _corners(points: Any, edges: Any, heights: Any, t: Any, edge: Any) -> Any:
    """Both ends of an edge of triangle ``t``, and the vertex opposite."""
    a, b = edges[edge, 0], edges[3 * t + (edge + 1) % 3, 0]
    apex = edges[3 * t + (edge + 2) % 3, 0]
    return _vertex(points, heights, a), _vertex(points, heights, b), _vertex(points, heights, apex)


@compiled
def _scan_rim(corners: Any, border: Any, truth: Any, side: Any) -> Any:
    """The worst of the inner posts of a rim."""
    rows, columns = truth.shape
    a, b, apex = corners
    best, best_x, best_y = 0.0, -1, -1
    for y in range(max(min(a[1], b[1], apex[1]), 1), min(max(a[1], b[1], apex[1]), rows - 2) + 1):
        for x in range(max(min(a[0], b[0], apex[0]), 1), min(max(a[0], b[0], apex[0]), columns - 2) + 1):
            left = (b[0] - apex[0]) * (y - apex[1]) - (b[1] - apex[1]) * (x - apex[0])
            right = (a[0] - apex[0]) * (y - apex[1]) - (a[1] - apex[1]) * (x - apex[0])
            if left <= 0 and right >= 0:
                residual = _cone_residual(border, side, apex, x, y, np.float64(truth[y, x]))
                if residual > best:
                    best, best_x, best_y = residual, x, y
    return best, best_x, best_y


@compiled
def _scan_inner(points: Any, edges: Any, heights: Any, truth: Any, t: Any) -> Any:
    """The worst of the inner posts of a triangle; a post on an edge belongs to that right of it or below."""
    rows, columns = truth.shape
    first, second, third = _sorted_by_row(points, edges[3 * t, 0], edges[3 * t + 1, 0], edges[3 * t + 2, 0])
    ax, ay, az = _vertex(points, heights, first)
    bx, by, bz = _vertex(points, heights, second)
    cx, cy, cz = _vertex(points, heights, third)
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    per_area = 1.0 / (ux * vy - uy * vx)
    per_x, per_y = (uz * vy - uy * vz) * per_area, (ux * vz - uz * vx) * per_area
    slope = vx / vy
    upper_slope = ux / uy if by > ay else 0.0
    lower_slope = (cx - bx) / (cy - by) if cy > by else 0.0
    best, best_x, best_y = 0.0, -1, -1
    top, bottom = max(ay, 1), min(cy, rows - 1)
    for y in range(top, bottom):
        p = ax + (y - ay) * slope
        q = ax + (y - ay) * upper_slope if y < by else bx + (y - by) * lower_slope
        start = max(int(np.ceil(min(p, q) - _NUDGE)), 1)
        end = min(int(np.ceil(max(p, q) - _NUDGE)), int(columns - 1))
        base = az + (y - ay) * per_y - ax * per_x
        for x in range(start, end):
            residual = abs(truth[y, x] - (base + x * per_x))
            if residual > best:
                best, best_x, best_y = residual, x, y
    return best, best_x, best_y


@compiled
def _corner_post(points: Any, edges: Any, t: Any) -> Any:
    """An inner post of a triangle that has two edges on borders: on the diagonal from the corner they share."""
    x, y, reach = np.int64(0), np.int64(0), np.int64(1)
    for k in range(3):
        v = edges[3 * t + k, 0]
        if edges[3 * t + k, 1] < 0 and edges[3 * t + (k + 2) % 3, 1] < 0:
            a, b = edges[3 * t + (k + 1) % 3, 0], edges[3 * t + (k + 2) % 3, 0]
            u = np.int64(abs(points[a, 0] - points[v, 0]) + abs(points[a, 1] - points[v, 1]))
            w = np.int64(abs(points[b, 0] - points[v, 0]) + abs(points[b, 1] - points[v, 1]))
            reach = max(u * w // (u + w) // 2, np.int64(1))
            x, y = points[v, 0], points[v, 1]
    return (reach if x == 0 else x - reach), (reach if y == 0 else y - reach)


@compiled
def _end_of(taken: Any, kind: Any, x: Any, y: Any, f: Any) -> Any:
    """Of the two posts beside a place on a line: the nearer if it is no vertex, and on a border only if it has to be.

    One of them is no vertex: two vertices beside each other are always joined, and no edge would cross that line.
    """
    rows, columns = taken.shape
    dx, dy = (0 if kind == _COLUMN else 1), (0 if kind == _ROW else 1)
    if f > 0.5:
        x, y, dx, dy = x + dx, y + dy, -dx, -dy
    other_x, other_y = x + dx, y + dy
    free, other_free = not taken[y, x], not taken[other_y, other_x]
    inner = 0 < x < columns - 1 and 0 < y < rows - 1
    if free and (inner or not other_free or not (0 < other_x < columns - 1 and 0 < other_y < rows - 1)):
        return x, y
    return other_x, other_y


@compiled
def scan_posts(mesh: Any, border: Any, heights: Any, truth: Any, t: Any) -> None:
    """Find the post farthest from triangle ``t``. A triangle with two long edges on borders cannot stay."""
    points, edges, post = mesh.points, mesh.edges, mesh.post
    count, edge, side = rim_of(points, edges, t)
    if count == 1:
        residual, x, y = _scan_rim(_corners(points, edges, heights, t, edge), border, truth, side)
    else:
        residual, x, y = _scan_inner(points, edges, heights, truth, t)
    if count >= 2:
        residual = np.inf
        if x < 0:
            x, y = _corner_post(points, edges, t)
    mesh.worst[t], post[t, 0], post[t, 1] = residual, x, y


@compiled
def scan_lines(mesh: Any, border: Any, heights: Any, truth: Any, t: Any) -> None:
    """Find whether triangle ``t`` is farther from the surface between posts, and the post to insert against that."""
    points, edges = mesh.points, mesh.edges
    count, edge, side = rim_of(points, edges, t)
    worst = mesh.worst[t], np.int64(-1), np.int64(0), np.int64(0), 0.0
    worst = _cross_edges(points, edges, heights, truth, t, worst)
    if count == 1:
        a, b, apex = _corners(points, edges, heights, t, edge)
        i, j = (a[0], b[0]) if side == 0 or side == 2 else (a[1], b[1])
        worst = _cross_cones(border, truth, side, apex, min(i, j), max(i, j), worst)
    residual, kind, x, y, f = worst
    if residual > mesh.worst[t]:
        x, y = _end_of(mesh.taken, kind, x, y, f)
        mesh.worst[t], mesh.post[t, 0], mesh.post[t, 1] = residual, x, y
    mesh.whole[t] = True
