"""Delaunay triangulation of posts in a rectangle, one inserted after the other (Lawson 1977; Guibas, Stolfi 1985).

Half-edge ``e`` is side ``e % 3`` of triangle ``e // 3``; ``edges[e]`` holds the vertex that it starts at and the
half-edge on its other side, -1 on the border. ``points`` holds column, row, and for a vertex on the border the
half-edge that leaves it along the border. Coordinates are below 2^13, so that every predicate is exact in 64 bits.
``counts`` holds how many vertices, triangles, and stale triangles there are; ``stale`` lists those that changed since
their posts were last looked at, marked by a negative value in ``worst``. Seen with columns to the right and rows *up*,
triangles turn counter-clockwise.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled

__all__ = ["STALE", "TRIANGLES", "VERTICES", "DelaunayMesh", "insert", "insert_on_border", "locate", "start", "touch"]

VERTICES, TRIANGLES, STALE = 0, 1, 2
"""Places in ``counts``."""


class DelaunayMesh(NamedTuple):
    """A triangulation that grows; arrays have room for more than ``counts`` says."""

    points: NDArray[np.int32]  # (V, 3)
    edges: NDArray[np.int32]  # (3 T, 2)
    worst: NDArray[np.float64]  # (T,): largest residual in metres
    whole: NDArray[np.bool_]  # (T,): whether that is the largest of all places, not only of posts
    post: NDArray[np.int32]  # (T, 2): column and row of the post to insert against it
    stale: NDArray[np.int32]  # (T,)
    stack: NDArray[np.int32]  # (T + 4,): edges that may have to be flipped
    taken: NDArray[np.bool_]  # (rows, columns): posts that are vertices
    counts: NDArray[np.int64]  # (3,)


@compiled
def _orient(points: Any, a: Any, b: Any, x: Any, y: Any) -> Any:
    """Twice the area of a, b and (x, y): positive to the left of a-b, where rows go up."""
    ax, ay = np.int64(points[a, 0]), np.int64(points[a, 1])
    return (points[b, 0] - ax) * (y - ay) - (points[b, 1] - ay) * (x - ax)


@compiled
def _in_circle(points: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Positive where d lies inside the circle through a, b, c, 0 on it (Guibas, Stolfi 1985, InCircle)."""
    dx, dy = np.int64(points[d, 0]), np.int64(points[d, 1])
    ax, ay = points[a, 0] - dx, points[a, 1] - dy
    bx, by = points[b, 0] - dx, points[b, 1] - dy
    cx, cy = points[c, 0] - dx, points[c, 1] - dy
    ab, bc, ca = ax * by - ay * bx, bx * cy - by * cx, cx * ay - cy * ax
    return (ax * ax + ay * ay) * bc + (bx * bx + by * by) * ca + (cx * cx + cy * cy) * ab


@compiled
def _diagonal(points: Any, a: Any, b: Any) -> Any:
    """1 if a-b is the diagonal of four posts that the surface of all posts has (see `exact_patch`), -1 if the other."""
    return (points[a, 0] - points[b, 0]) * (points[a, 1] - points[b, 1])


@compiled
def _next(e: Any) -> Any:
    return e - 2 if e % 3 == 2 else e + 1


@compiled
def _link(points: Any, edges: Any, e: Any, other: Any) -> None:
    edges[e, 1] = other
    if other >= 0:
        edges[other, 1] = e
    else:
        points[edges[e, 0], 2] = e


@compiled
def touch(worst: Any, whole: Any, stale: Any, counts: Any, t: Any) -> None:
    """Have the posts of triangle ``t`` looked at again."""
    if worst[t] >= 0.0:
        worst[t] = -1.0
        whole[t] = False
        stale[counts[2]] = t
        counts[2] += 1


@compiled
def _triangle(edges: Any, worst: Any, whole: Any, stale: Any, counts: Any, t: Any, a: Any, b: Any, c: Any) -> None:
    edges[3 * t, 0], edges[3 * t + 1, 0], edges[3 * t + 2, 0] = a, b, c
    touch(worst, whole, stale, counts, t)


@compiled
def _new_triangle(worst: Any, counts: Any) -> Any:
    t = counts[1]
    counts[1] += 1
    worst[t] = 0.0
    return t


@compiled
def _new_vertex(points: Any, taken: Any, counts: Any, x: Any, y: Any) -> Any:
    p = counts[0]
    counts[0] += 1
    points[p, 0], points[p, 1], points[p, 2] = x, y, -1
    taken[y, x] = True
    return p


@compiled
def _flip_until_delaunay(
    points: Any, edges: Any, stack: Any, worst: Any, whole: Any, stale: Any, counts: Any, size: Any
) -> None:
    """Flip edges on the stack, each opposite the vertex just inserted, and those that flips uncover (Lawson 1977)."""
    while size > 0:
        size -= 1
        e = np.int64(stack[size])
        h = np.int64(edges[e, 1])
        if h < 0:
            continue
        en, hn = _next(e), _next(h)
        ep, hp = _next(en), _next(hn)
        a, b, p, q = edges[e, 0], edges[en, 0], edges[ep, 0], edges[hp, 0]
        inside = _in_circle(points, p, a, b, q)
        if inside < 0 or (inside == 0 and not (_diagonal(points, a, b) == -1 and _diagonal(points, p, q) == 1)):
            continue
        beside_aq, beside_qb, beside_bp = np.int64(edges[hn, 1]), np.int64(edges[hp, 1]), np.int64(edges[en, 1])
        edges[en, 0], edges[h, 0], edges[hn, 0], edges[hp, 0] = q, q, b, p
        _link(points, edges, e, beside_aq)
        _link(points, edges, h, beside_qb)
        _link(points, edges, hn, beside_bp)
        _link(points, edges, en, hp)
        touch(worst, whole, stale, counts, e // 3)
        touch(worst, whole, stale, counts, h // 3)
        stack[size], stack[size + 1] = e, h
        size += 2


@compiled
def _insert_on_edge(mesh: Any, e: Any, x: Any, y: Any) -> Any:
    """Split edge a-b, and the one or two triangles beside it."""
    points, edges, stack = mesh.points, mesh.edges, mesh.stack
    worst, whole, stale, counts = mesh.worst, mesh.whole, mesh.stale, mesh.counts
    p = _new_vertex(points, mesh.taken, counts, x, y)
    h, t = np.int64(edges[e, 1]), e // 3
    en = _next(e)
    ep = _next(en)
    a, b, c = edges[e, 0], edges[en, 0], edges[ep, 0]
    beside_bc, beside_ca = np.int64(edges[en, 1]), np.int64(edges[ep, 1])
    right = _new_triangle(worst, counts)
    _triangle(edges, worst, whole, stale, counts, t, c, a, p)
    _triangle(edges, worst, whole, stale, counts, right, b, c, p)
    _link(points, edges, 3 * t, beside_ca)
    _link(points, edges, 3 * right, beside_bc)
    _link(points, edges, 3 * t + 2, 3 * right + 1)
    stack[0], stack[1] = 3 * t, 3 * right
    if h < 0:
        _link(points, edges, 3 * t + 1, h)
        _link(points, edges, 3 * right + 2, h)
        _flip_until_delaunay(points, edges, stack, worst, whole, stale, counts, np.int64(2))
        return p
    hn, u = _next(h), h // 3
    hp = _next(hn)
    d, beside_ad, beside_db = edges[hp, 0], np.int64(edges[hn, 1]), np.int64(edges[hp, 1])
    other = _new_triangle(worst, counts)
    _triangle(edges, worst, whole, stale, counts, u, a, d, p)
    _triangle(edges, worst, whole, stale, counts, other, d, b, p)
    _link(points, edges, 3 * u, beside_ad)
    _link(points, edges, 3 * other, beside_db)
    _link(points, edges, 3 * u + 1, 3 * other + 2)
    _link(points, edges, 3 * t + 1, 3 * u + 2)
    _link(points, edges, 3 * right + 2, 3 * other + 1)
    stack[2], stack[3] = 3 * u, 3 * other
    _flip_until_delaunay(points, edges, stack, worst, whole, stale, counts, np.int64(4))
    return p


@compiled
def insert(mesh: Any, t: Any, x: Any, y: Any) -> Any:
    """Make (x, y), a post in triangle ``t`` or on one of its edges, a vertex; its number."""
    points, edges, stack = mesh.points, mesh.edges, mesh.stack
    a, b, c = edges[3 * t, 0], edges[3 * t + 1, 0], edges[3 * t + 2, 0]
    if _orient(points, a, b, x, y) == 0:
        return _insert_on_edge(mesh, 3 * t, x, y)
    if _orient(points, b, c, x, y) == 0:
        return _insert_on_edge(mesh, 3 * t + 1, x, y)
    if _orient(points, c, a, x, y) == 0:
        return _insert_on_edge(mesh, 3 * t + 2, x, y)
    worst, whole, stale, counts = mesh.worst, mesh.whole, mesh.stale, mesh.counts
    p = _new_vertex(points, mesh.taken, counts, x, y)
    beside_bc, beside_ca = np.int64(edges[3 * t + 1, 1]), np.int64(edges[3 * t + 2, 1])
    u, v = _new_triangle(worst, counts), _new_triangle(worst, counts)
    _triangle(edges, worst, whole, stale, counts, t, a, b, p)
    _triangle(edges, worst, whole, stale, counts, u, b, c, p)
    _triangle(edges, worst, whole, stale, counts, v, c, a, p)
    _link(points, edges, 3 * u, beside_bc)
    _link(points, edges, 3 * v, beside_ca)
    _link(points, edges, 3 * t + 1, 3 * u + 2)
    _link(points, edges, 3 * u + 1, 3 * v + 2)
    _link(points, edges, 3 * v + 1, 3 * t + 2)
    stack[0], stack[1], stack[2] = 3 * t, 3 * u, 3 * v
    _flip_until_delaunay(points, edges, stack, worst, whole, stale, counts, np.int64(3))
    return p


@compiled
def insert_on_border(mesh: Any, a: Any, x: Any, y: Any) -> Any:
    """Make (x, y), a post on the border edge that leaves vertex ``a``, a vertex; its number."""
    return _insert_on_edge(mesh, np.int64(mesh.points[a, 2]), x, y)


@compiled
def locate(points: Any, edges: Any, t: Any, x: Any, y: Any) -> Any:
    """A triangle that (x, y) lies in, or on the edge of; walks there from triangle ``t``."""
    while True:
        e = 3 * t
        while e < 3 * t + 3 and _orient(points, edges[e, 0], edges[_next(e), 0], x, y) >= 0:
            e += 1
        if e == 3 * t + 3:
            return t
        t = np.int64(edges[e, 1]) // 3


@compiled
def start(mesh: Any, columns: Any, rows: Any) -> None:
    """Two triangles over the rectangle from (0, 0) to the last column and row."""
    x, y = columns - 1, rows - 1
    points, edges, taken, worst, counts = mesh.points, mesh.edges, mesh.taken, mesh.worst, mesh.counts
    for k in range(3):
        counts[k] = 0
    o = np.int64(0)
    a, b = _new_vertex(points, taken, counts, o, o), _new_vertex(points, taken, counts, x, o)
    c, d = _new_vertex(points, taken, counts, x, y), _new_vertex(points, taken, counts, o, y)
    first, second = _new_triangle(worst, counts), _new_triangle(worst, counts)
    _triangle(edges, worst, mesh.whole, mesh.stale, counts, first, a, b, c)
    _triangle(edges, worst, mesh.whole, mesh.stale, counts, second, a, c, d)
    _link(points, edges, 3 * first + 2, 3 * second)
    for e in (3 * first, 3 * first + 1, 3 * second + 1, 3 * second + 2):
        _link(points, edges, e, np.int64(-1))
