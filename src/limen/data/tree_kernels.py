"""Edge collapses in the order of their cost, each making a node of two: the loops of `limen.data.tree_build`.

Triangles around a node are a linked list of their corners, so that two nodes become one by joining two lists. The queue
is 512 bins of the logarithm of the cost instead of a heap: what lies in one bin differs by a fifth, and is taken in the
order it came, which is the order of the mesh, and kind to caches.

References
----------
Garland, Heckbert 1997, *Surface Simplification Using Quadric Error Metrics*, sections 4 to 6.
Ronfard, Rossignac 1996, *Full-range Approximation of Triangulated Polyhedra*: the largest distance from planes.
Dey, Edelsbrunner, Guha, Nekhayev 1999, *Topology Preserving Edge Contraction*: the link condition.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["APART", "FIXED", "INNER", "RIM", "classify", "collapse", "link_corners", "sum_quadrics"]

INNER, RIM, FIXED, APART = 0, 1, 2, 3
"""What a vertex is: inside a surface, on the edge of one, where it is none, or where textures meet.

What is inside may be joined to any, a rim to a rim along it; a node has the larger kind of the two, and its place.
"""

_BINS = 512
_BINS_AN_OCTAVE = 4
_SMALLEST_OCTAVE = -112.0  # of a cost in units of the mesh's size to the fourth power; the largest bins hold the rest
_PULL = (
    1e-3  # of the planes' weight: how much a new place is drawn to the middle of the edge where planes leave it free
)
_COMPACT = 1e-5  # of the planes' weight: how much long edges cost where planes cost nothing
_RIM_WEIGHT = 1.0
_FLAT = 0.04  # square of the least cosine between a triangle's normal before and after
_MOST_CORNERS = 48  # around a node: more would make a collapse slow, and triangles thin
_RETRY_BINS = 8


@njit(cache=True, nogil=True, error_model="numpy")
def link_corners(corners: Any, head: Any, tail: Any, following: Any) -> None:
    """Lists of the corners (3 T) at each node: ``head``, ``tail`` (N,) and ``following`` (3 T,) are -1 at first."""
    for corner in range(corners.shape[0]):
        node = corners[corner]
        if node < 0:
            continue
        if head[node] < 0:
            head[node] = corner
        else:
            following[tail[node]] = corner
        tail[node] = corner


@njit(cache=True, nogil=True, error_model="numpy")
def _others(corner: Any) -> Any:
    first = corner - corner % 3
    return first + (corner + 1) % 3, first + (corner + 2) % 3


@njit(cache=True, nogil=True, error_model="numpy")
def _add_plane(q: Any, node: Any, x: Any, y: Any, z: Any, d: Any, weight: Any) -> None:
    """The square of the distance from a plane of unit normal (x, y, z), times a weight."""
    q[node, 0] += weight * x * x
    q[node, 1] += weight * x * y
    q[node, 2] += weight * x * z
    q[node, 3] += weight * y * y
    q[node, 4] += weight * y * z
    q[node, 5] += weight * z * z
    q[node, 6] += weight * x * d
    q[node, 7] += weight * y * d
    q[node, 8] += weight * z * d
    q[node, 9] += weight * d * d


@njit(cache=True, nogil=True, error_model="numpy")
def sum_quadrics(corners: Any, place: Any, q: Any) -> None:
    """Add to ``q`` (N, 10) of each corner the plane of its triangle, weighted by a third of the area."""
    for t in range(corners.shape[0] // 3):
        a, b, c = corners[3 * t], corners[3 * t + 1], corners[3 * t + 2]
        if a < 0:
            continue
        px, py, pz = place[a, 0], place[a, 1], place[a, 2]
        ux, uy, uz = place[b, 0] - px, place[b, 1] - py, place[b, 2] - pz
        vx, vy, vz = place[c, 0] - px, place[c, 1] - py, place[c, 2] - pz
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        double = np.sqrt(x * x + y * y + z * z)
        if double > 0.0:
            x, y, z = x / double, y / double, z / double
            d, weight = -(x * px + y * py + z * pz), double / 6.0
            _add_plane(q, a, x, y, z, d, weight)
            _add_plane(q, b, x, y, z, d, weight)
            _add_plane(q, c, x, y, z, d, weight)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_rim(q: Any, place: Any, node: Any, end: Any, third: Any) -> None:
    """The plane through an edge of the surface, upright on its triangle: leaving it would show."""
    ex, ey, ez = place[end, 0] - place[node, 0], place[end, 1] - place[node, 1], place[end, 2] - place[node, 2]
    fx, fy, fz = place[third, 0] - place[node, 0], place[third, 1] - place[node, 1], place[third, 2] - place[node, 2]
    length2 = ex * ex + ey * ey + ez * ez
    if length2 <= 0.0:
        return
    along = (ex * fx + ey * fy + ez * fz) / length2
    x, y, z = fx - along * ex, fy - along * ey, fz - along * ez
    high = np.sqrt(x * x + y * y + z * z)
    if high > 0.0:
        x, y, z = x / high, y / high, z / high
        d = -(x * place[node, 0] + y * place[node, 1] + z * place[node, 2])
        _add_plane(q, node, x, y, z, d, _RIM_WEIGHT * length2 / 2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def classify(corners: Any, head: Any, following: Any, place: Any, kind: Any, q: Any) -> None:
    """What each vertex is, by the edges opposite to it: one ring inside, one open chain on a rim, else fixed.

    ``kind`` (N,) is `APART` already where textures meet. Rims add their planes to ``q``.
    """
    nodes = head.shape[0]
    one, other = np.empty(nodes, np.int32), np.empty(nodes, np.int32)
    seen = np.full(nodes, -1, np.int32)
    count = np.zeros(nodes, np.int8)
    for node in range(nodes):
        corner = head[node]
        edges, ends, broken, start = 0, 0, False, -1
        while corner >= 0:
            i, k = _others(corner)
            a, b = corners[i], corners[k]
            for end, far in ((a, b), (b, a)):
                if seen[end] != node:
                    seen[end], count[end], one[end] = node, 1, far
                    ends += 1
                else:
                    ends -= count[end] == 1
                    broken |= count[end] == 2
                    other[end] = far
                    count[end] = 2
            edges += 1
            start = a
            corner = following[corner]
        if edges == 0 or broken or ends > 2:
            kind[node] = max(kind[node], FIXED)
            continue
        if ends == 2:
            corner = head[node]
            while corner >= 0:
                i, k = _others(corner)
                a, b = corners[i], corners[k]
                if count[a] == 1:
                    start = a
                    _add_rim(q, place, node, a, b)
                if count[b] == 1:
                    start = b
                    _add_rim(q, place, node, b, a)
                corner = following[corner]
        steps, before, here = 0, -1, start
        while steps < edges:
            ahead = one[here]
            if count[here] == 2 and (ahead == before):
                ahead = other[here]
            before, here = here, ahead
            steps += 1
            if here == start or count[here] == 1:
                break
        if steps != edges:
            kind[node] = max(kind[node], FIXED)
        elif kind[node] != APART:
            kind[node] = RIM if ends == 2 else INNER


@njit(cache=True, nogil=True, error_model="numpy")
def _cost_at(
    a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, i: Any, j: Any, x: Any, y: Any, z: Any
) -> Any:
    return x * (a * x + 2.0 * (b * y + c * z + g)) + y * (d * y + 2.0 * (e * z + h)) + z * (f * z + 2.0 * i) + j


@njit(cache=True, nogil=True, error_model="numpy")
def _place_and_cost(q: Any, place: Any, kind: Any, u: Any, w: Any) -> Any:
    """Where the node of ``u`` and ``w`` is to be, and the cost: x, y, z, cost."""
    a, b, c = q[u, 0] + q[w, 0], q[u, 1] + q[w, 1], q[u, 2] + q[w, 2]
    d, e, f = q[u, 3] + q[w, 3], q[u, 4] + q[w, 4], q[u, 5] + q[w, 5]
    g, h, i, j = q[u, 6] + q[w, 6], q[u, 7] + q[w, 7], q[u, 8] + q[w, 8], q[u, 9] + q[w, 9]
    ux, uy, uz = place[u, 0], place[u, 1], place[u, 2]
    wx, wy, wz = place[w, 0], place[w, 1], place[w, 2]
    x, y, z = 0.5 * (ux + wx), 0.5 * (uy + wy), 0.5 * (uz + wz)
    length2 = (ux - wx) * (ux - wx) + (uy - wy) * (uy - wy) + (uz - wz) * (uz - wz)
    weight = a + d + f
    if kind[u] > kind[w]:
        x, y, z = ux, uy, uz
    elif kind[w] > kind[u]:
        x, y, z = wx, wy, wz
    elif weight > 0.0:
        pull = _PULL * weight
        m, n, o = a + pull, d + pull, f + pull
        c00, c01, c02 = n * o - e * e, c * e - b * o, b * e - c * n
        c11, c12, c22 = m * o - c * c, b * c - m * e, m * n - b * b
        down = 1.0 / (m * c00 + b * c01 + c * c02)
        rx, ry, rz = pull * x - g, pull * y - h, pull * z - i
        sx = (c00 * rx + c01 * ry + c02 * rz) * down
        sy = (c01 * rx + c11 * ry + c12 * rz) * down
        sz = (c02 * rx + c12 * ry + c22 * rz) * down
        if (sx - x) * (sx - x) + (sy - y) * (sy - y) + (sz - z) * (sz - z) < length2:
            x, y, z = sx, sy, sz
    cost = max(_cost_at(a, b, c, d, e, f, g, h, i, j, x, y, z), 0.0)
    area_u, area_w = q[u, 0] + q[u, 3] + q[u, 5], q[w, 0] + q[w, 3] + q[w, 5]
    if weight > 0.0:
        cost += _COMPACT * length2 * area_u * area_w / weight
    return x, y, z, cost


@njit(cache=True, nogil=True, error_model="numpy")
def _bin_of(cost: Any) -> Any:
    if cost <= 0.0:
        return 0
    return min(max(int((np.log2(cost) - _SMALLEST_OCTAVE) * _BINS_AN_OCTAVE), 0), _BINS - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _may_join(corners: Any, head: Any, following: Any, kind: Any, stamp: Any, mark: Any, u: Any, w: Any) -> Any:
    """The link condition: neighbours that both have are exactly those of the triangles at the edge."""
    corner, around, shared = head[u], 0, 0
    while corner >= 0:
        i, k = _others(corner)
        if corners[corner] >= 0:
            a, b = corners[i], corners[k]
            stamp[a], stamp[b] = mark, mark
            shared += (a == w) | (b == w)
            around += 1
        corner = following[corner]
    if shared == 0 or shared > 2:
        return False
    if kind[u] == RIM and kind[w] == RIM and shared == 2:
        return False
    corner, common = head[w], 0
    while corner >= 0:
        i, k = _others(corner)
        if corners[corner] >= 0:
            for end in (corners[i], corners[k]):
                if stamp[end] == mark:
                    stamp[end] = mark + 1
                    common += end != u
            around += 1
        corner = following[corner]
    return common == shared and 0 < around - 2 * shared <= _MOST_CORNERS


@njit(cache=True, nogil=True, error_model="numpy")
def _move(corners: Any, head: Any, following: Any, place: Any, u: Any, w: Any, x: Any, y: Any, z: Any) -> Any:
    """How far the surface around ``u`` moves when ``u`` goes to (x, y, z); -1 if a triangle would turn over."""
    px, py, pz = place[u, 0], place[u, 1], place[u, 2]
    mx, my, mz = x - px, y - py, z - pz
    way2 = mx * mx + my * my + mz * mz
    if way2 == 0.0:
        return 0.0
    corner, most = head[u], 0.0
    while corner >= 0:
        i, k = _others(corner)
        a, b = corners[i], corners[k]
        if corners[corner] >= 0 and a != w and b != w:
            ax, ay, az = place[a, 0] - px, place[a, 1] - py, place[a, 2] - pz
            bx, by, bz = place[b, 0] - px, place[b, 1] - py, place[b, 2] - pz
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            ax, ay, az, bx, by, bz = ax - mx, ay - my, az - mz, bx - mx, by - my, bz - mz
            ox, oy, oz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            before2, after2 = nx * nx + ny * ny + nz * nz, ox * ox + oy * oy + oz * oz
            turn = nx * ox + ny * oy + nz * oz
            if before2 > 0.0:
                if turn <= 0.0 or turn * turn < _FLAT * before2 * after2:
                    return -1.0
                volume = nx * mx + ny * my + nz * mz
                most = max(most, volume * volume / min(before2, after2))
            else:
                most = way2
        corner = following[corner]
    return np.sqrt(min(most, way2))


@njit(cache=True, nogil=True, error_model="numpy")
def _join(corners: Any, head: Any, tail: Any, following: Any, u: Any, w: Any, new: Any) -> None:
    """Make ``new`` the corner of all triangles around ``u`` and ``w``; those that have both are gone."""
    begin, end = -1, -1
    for node in (u, w):
        corner = head[node]
        while corner >= 0:
            ahead = following[corner]
            if corners[corner] >= 0:
                i, k = _others(corner)
                if corners[i] == new or corners[k] == new or corners[i] == w or corners[k] == w:
                    corners[corner] = corners[i] = corners[k] = -1
                else:
                    corners[corner] = new
                    if begin < 0:
                        begin = corner
                    else:
                        following[end] = corner
                    end = corner
            corner = ahead
    if end >= 0:
        following[end] = -1
    head[new], tail[new] = begin, end


@njit(cache=True, nogil=True, error_model="numpy")
def _push(queue: Any, first: Any, last: Any, entry: Any, u: Any, w: Any, number: Any) -> None:
    """Append an edge to a bin as entry number ``entry``."""
    queue[entry, 0], queue[entry, 1], queue[entry, 2] = u, w, -1
    if first[number] < 0:
        first[number] = entry
    else:
        queue[last[number], 2] = entry
    last[number] = entry


@njit(cache=True, nogil=True, error_model="numpy")
def collapse(
    corners: Any, head: Any, tail: Any, following: Any, place: Any, kind: Any, q: Any,
    parent: Any, displacement: Any, begin: Any,
) -> Any:  # fmt: skip
    """Collapse edges from the cheapest on until none may be; returns the number of nodes.

    All arrays have room for all nodes there can be; ``begin`` are there. ``corners`` (3 T) hold nodes, or -1 where a
    triangle is gone; lists of them as `link_corners` makes them. ``place`` (N, 3), ``kind`` (N,), ``q`` (N, 10),
    ``parent`` (N,) and ``displacement`` (N,) are by node.
    """
    nodes = begin
    stamp = np.full(parent.shape[0], -1, np.int32)
    first, last = np.full(_BINS, -1, np.int32), np.full(_BINS, -1, np.int32)
    queue, size = np.empty((4 * corners.shape[0], 3), np.int32), 0
    for corner in range(corners.shape[0]):
        u = corners[corner]
        if u < 0:
            continue
        w = corners[_others(corner)[0]]
        if (u < w or (kind[u] == RIM and kind[w] == RIM)) and min(kind[u], kind[w]) < FIXED:
            cost = _place_and_cost(q, place, kind, u, w)[3]
            _push(queue, first, last, size, u, w, _bin_of(cost))
            size += 1
    number, mark = 0, 0
    while number < _BINS:
        entry = first[number]
        if entry < 0:
            number += 1
            continue
        u, w, first[number] = queue[entry, 0], queue[entry, 1], queue[entry, 2]
        if parent[u] >= 0 or parent[w] >= 0:
            continue
        x, y, z, _ = _place_and_cost(q, place, kind, u, w)
        mark += 2
        far_u = far_w = -1.0
        if _may_join(corners, head, following, kind, stamp, mark, u, w):
            far_u = _move(corners, head, following, place, u, w, x, y, z)
            if far_u >= 0.0:
                far_w = _move(corners, head, following, place, w, u, x, y, z)
        if far_w < 0.0:
            if number + _RETRY_BINS < _BINS:
                _push(queue, first, last, size, u, w, number + _RETRY_BINS)
                size += 1
            continue
        new = nodes
        nodes += 1
        parent[u] = parent[w] = new
        parent[new] = -1
        place[new, 0], place[new, 1], place[new, 2] = x, y, z
        kind[new] = max(kind[u], kind[w])
        for n in range(10):
            q[new, n] = q[u, n] + q[w, n]
        displacement[new] = max(displacement[u] + far_u, displacement[w] + far_w)
        _join(corners, head, tail, following, u, w, new)
        mark += 2
        corner = head[new]
        while corner >= 0:
            i, k = _others(corner)
            for end in (corners[i], corners[k]):
                if stamp[end] != mark:
                    stamp[end] = mark
                    if min(kind[new], kind[end]) < FIXED:
                        cost = _place_and_cost(q, place, kind, new, end)[3]
                        bin_number = _bin_of(cost)
                        _push(queue, first, last, size, new, end, bin_number)
                        size += 1
                        number = min(number, bin_number)
            corner = following[corner]
    return nodes
