"""Edge collapses in the order of their cost, each making a node of two: the loops of `limen.data.mesh.tree_build`.

Triangles around a node are a linked list of their corners, so that two nodes become one by joining two lists. The queue
is bins of the logarithm of the cost instead of a heap: what lies in one bin is taken in the order it came, which is the
order of the mesh, and kind to caches. For their sake, too, all that is asked of a node lies in one record of 128
bytes (`limen.data.mesh.record_kernels`), and of a triangle in one of 32.

Nodes of one cube of space are worked on for a while, all
edges up to a cost, before those of the next: so they stay in a core's own cache.

References
----------
Garland, Heckbert 1997, *Surface Simplification Using Quadric Error Metrics*, sections 4 to 6.
Ronfard, Rossignac 1996, *Full-range Approximation of Triangulated Polyhedra*: the largest distance from planes.
Dey, Edelsbrunner, Guha, Nekhayev 1999, *Topology Preserving Edge Contraction*: the link condition.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.mesh.record_kernels import (
    FIXED,
    HEAD,
    MOVED,
    PLACE,
    RIM,
    SLOTS,
    STAMP,
    best_place,
    cost_of,
    merge,
)  # fmt: skip

__all__ = ["CORNERS", "ROUNDS", "STEPS", "collapse"]

CORNERS = 8
"""Words of a triangle's record: three nodes, three next corners of theirs, and two that are not used.

A corner's number is that of its word among all; a node is -1 where the triangle is gone, a next corner at the end.
"""

ROUNDS, STEPS = 64, 8
_ROUND_SHIFT, _STEP_SHIFT = 25, 22  # of a cost's bits as a 32-bit float: four octaves a round, half an octave a step
_FLAT = 0.04  # square of the least cosine between a triangle's normal before and after
_STEEP = 0.06  # square of the least cosine between a triangle and the mean of those around a node
_MOST_CORNERS = 48  # around a node: more would make a collapse slow, and triangles thin
_RETRY_STEPS = 4


@compiled(inline="always")
def _next(corner: Any) -> Any:
    return corner + 1 - 3 * ((corner & 7) == 2)


@compiled
def _gather(tri: Any, words: Any, node: Any, partner: Any, around: Any, count: Any, edge: Any) -> Any:
    """Triangles around a node as rows (corner, node, node) from ``count`` on; returns how many rows there are then.

    Those at the edge to ``partner`` are not: they are rows of ``edge`` (4, 2), how many is the second result. No step
    asks what the last one found, so that nothing has to be guessed.
    """
    corner, shared = words[SLOTS * node + HEAD], 0
    while corner >= 0 and count < _MOST_CORNERS:
        a, b = tri[_next(corner)], tri[_next(_next(corner))]
        there, at_edge = tri[corner] >= 0, (a == partner) | (b == partner)
        around[count, 0], around[count, 1], around[count, 2] = corner, a, b
        edge[shared, 0], edge[shared, 1] = corner, a + b - partner
        count += there & ~at_edge
        shared = min(shared + (there & at_edge), 3)
        corner = tri[corner + 3]
    return count, shared


@compiled(fastmath=True)
def _move(record: Any, node: Any, around: Any, begin: Any, end: Any, normals: Any, x: Any, y: Any, z: Any) -> Any:
    """How far the surface around a node moves when the node goes by (x, y, z); -1 if a triangle would turn over.

    The largest distance of the new place from the planes of the triangles, and of the old one from those they become.
    That says nothing where they do not all look one way, as around the edge of a blade: there, the whole way counts.
    """
    way2 = x * x + y * y + z * z
    if way2 == 0.0:
        return 0.0
    at, most = SLOTS * node + PLACE, 0.0
    mean_x = mean_y = mean_z = 0.0
    px, py, pz = np.float64(record[at]), np.float64(record[at + 1]), np.float64(record[at + 2])
    for row in range(begin, end):
        i, k = SLOTS * around[row, 1] + PLACE, SLOTS * around[row, 2] + PLACE
        ax, ay, az = record[i] - px, record[i + 1] - py, record[i + 2] - pz
        bx, by, bz = record[k] - px, record[k + 1] - py, record[k + 2] - pz
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        ax, ay, az, bx, by, bz = ax - x, ay - y, az - z, bx - x, by - y, bz - z
        ox, oy, oz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        before2, after2 = nx * nx + ny * ny + nz * nz, ox * ox + oy * oy + oz * oz
        turn, volume = nx * ox + ny * oy + nz * oz, nx * x + ny * y + nz * z
        normals[row, 0], normals[row, 1], normals[row, 2], normals[row, 3] = nx, ny, nz, before2
        mean_x, mean_y, mean_z = mean_x + nx, mean_y + ny, mean_z + nz
        if before2 <= 0.0:
            most = way2
        elif turn <= 0.0 or turn * turn < _FLAT * before2 * after2:
            return -1.0
        else:
            most = max(most, volume * volume / min(before2, after2))
    steep = _STEEP * (mean_x * mean_x + mean_y * mean_y + mean_z * mean_z)
    for row in range(begin, end):
        toward = normals[row, 0] * mean_x + normals[row, 1] * mean_y + normals[row, 2] * mean_z
        if toward < 0.0 or toward * toward < steep * normals[row, 3]:
            most = way2
    return np.sqrt(min(most, way2))


@compiled
def _move_rim(record: Any, node: Any, around: Any, begin: Any, end: Any, third: Any, x: Any, y: Any, z: Any) -> Any:
    """How far the rim moves when a node on it goes by (x, y, z): the two places from the lines to the next on the rim.

    That is the one neighbour, besides the third corner of the triangle that vanishes, that a single triangle has.
    """
    way2 = x * x + y * y + z * z
    if way2 == 0.0:
        return 0.0
    ahead = third
    for row in range(begin, end):
        ahead ^= around[row, 1] ^ around[row, 2]
    i, k = SLOTS * node + PLACE, SLOTS * ahead + PLACE
    ax, ay, az = (
        np.float64(record[k]) - record[i],
        np.float64(record[k + 1]) - record[i + 1],
        np.float64(record[k + 2]) - record[i + 2],
    )
    nx, ny, nz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
    before2 = ax * ax + ay * ay + az * az
    ax, ay, az = ax - x, ay - y, az - z
    least = min(before2, ax * ax + ay * ay + az * az)
    return np.sqrt(min((nx * nx + ny * ny + nz * nz) / least, way2) if least > 0.0 else way2)


@compiled
def _neighbours(words: Any, around: Any, middle: Any, end: Any, edge: Any, shared: Any, mark: Any, ring: Any) -> Any:
    """List in ``ring`` all nodes of the rows of two nodes, which end at ``middle`` and ``end``; returns how many.

    -1 where the link condition fails: a neighbour of both must be a corner of a triangle at their edge.
    """
    third, other, count, fails = edge[0, 1], edge[shared - 1, 1], 0, False
    for row in range(middle):
        for column in range(1, 3):
            node = around[row, column]
            at = SLOTS * node + STAMP
            ring[count] = node
            count += words[at] < mark
            words[at] = mark
    for row in range(middle, end):
        for column in range(1, 3):
            node = around[row, column]
            at = SLOTS * node + STAMP
            before = words[at]
            ring[count] = node
            count += before < mark
            fails |= (before == mark) & (node != third) & (node != other)
            words[at] = mark + 1
    return -1 if fails else count


@compiled
def _rename(tri: Any, words: Any, around: Any, end: Any, edge: Any, shared: Any, new: Any) -> None:
    """Give the triangles in rows a new corner, and take those at the edge away."""
    for row in range(shared):
        corner = edge[row, 0]
        tri[corner] = tri[_next(corner)] = tri[_next(_next(corner))] = -1
    words[SLOTS * new + HEAD] = around[0, 0]
    around[end, 0] = -1
    for row in range(end):
        corner = around[row, 0]
        tri[corner] = new
        tri[corner + 3] = around[row + 1, 0]


@compiled
def _push(queue: Any, first: Any, last: Any, entry: Any, u: Any, w: Any, number: Any) -> None:
    """Append an edge to a bin as entry number ``entry``."""
    queue[3 * entry], queue[3 * entry + 1], queue[3 * entry + 2] = u, w, -1
    if first[number] < 0:
        first[number] = entry
    else:
        queue[3 * last[number] + 2] = entry
    last[number] = entry


@compiled
def collapse(
    tri: Any, record: Any, words: Any, kind: Any, tile: Any, parent: Any, begin: Any, mark: Any, queue: Any, bins: Any
) -> Any:
    """Collapse edges from the cheapest on until none may be, or the queue is full; returns nodes, mark, and which.

    All arrays have room for all nodes there can be; ``begin`` are there, and no stamp is larger than ``mark`` + 1.
    ``tri`` (8 T,) are triangles' records, ``record`` (32 N,) float32 those of nodes and ``words`` the same as int32;
    ``kind``, ``tile`` and ``parent`` (N,).
    ``queue`` (3 n,) int32 has room for n edges, two nodes and the next of the bin; ``bins`` (2, 64 x 8 tiles) are -1.
    """
    nodes, size, room = begin, 0, queue.shape[0] // 3 - 2 * _MOST_CORNERS
    first, last = bins[0], bins[1]
    steps_a_round = bins.shape[1] // ROUNDS
    around, ring = np.empty((_MOST_CORNERS + 1, 3), np.int32), np.empty(2 * _MOST_CORNERS, np.int32)
    edge, cost, normals = np.empty((4, 2), np.int32), np.empty(1, np.float32), np.empty((_MOST_CORNERS, 4))
    bits = cost.view(np.int32)
    for t in range(tri.shape[0] // CORNERS):
        for corner in range(CORNERS * t, CORNERS * t + 3):
            u, w = tri[corner], tri[_next(corner)]
            if u >= 0 and (u < w or (kind[u] == RIM and kind[w] == RIM)) and min(kind[u], kind[w]) < FIXED:
                cost[0] = cost_of(record, kind, u, w)
                at = (bits[0] >> _ROUND_SHIFT) * steps_a_round + STEPS * tile[u] + ((bits[0] >> _STEP_SHIFT) & 7)
                _push(queue, first, last, size, u, w, at)
                size += 1
    number = 0
    while number < bins.shape[1]:
        entry = first[number]
        if entry < 0:
            number += 1
            continue
        u, w, first[number] = queue[3 * entry], queue[3 * entry + 1], queue[3 * entry + 2]
        if parent[u] >= 0 or parent[w] >= 0:
            continue
        if size > room:
            return nodes, mark, True
        mark += 2
        count = -1
        middle, _ = _gather(tri, words, u, w, around, 0, edge)
        end, shared = _gather(tri, words, w, u, around, middle, edge)
        along = min(kind[u], kind[w]) < RIM or shared == 1
        if 0 < end < _MOST_CORNERS and 0 < shared < 3 and along:
            count = _neighbours(words, around, middle, end, edge, shared, mark, ring)
        ux, uy, uz, wx, wy, wz = best_place(record, kind, u, w)
        far_u = far_w = -1.0
        if count >= 0:
            far_u = _move(record, u, around, 0, middle, normals, ux, uy, uz)
            if far_u >= 0.0:
                far_w = _move(record, w, around, middle, end, normals, wx, wy, wz)
            if far_w >= 0.0 and shared == 1:
                far_u = max(far_u, _move_rim(record, u, around, 0, middle, edge[0, 1], ux, uy, uz))
                far_w = max(far_w, _move_rim(record, w, around, middle, end, edge[0, 1], wx, wy, wz))
        if far_w < 0.0:
            later = number + (_RETRY_STEPS if (number & 7) + _RETRY_STEPS < STEPS else steps_a_round)
            if later < bins.shape[1]:
                _push(queue, first, last, size, u, w, later)
                size += 1
            continue
        new = nodes
        nodes += 1
        parent[u] = parent[w] = new
        kind[new], tile[new] = max(kind[u], kind[w]), tile[u]
        merge(record, u, w, new, ux, uy, uz, wx, wy, wz)
        record[SLOTS * new + MOVED] = max(record[SLOTS * u + MOVED] + far_u, record[SLOTS * w + MOVED] + far_w)
        words[SLOTS * new + STAMP] = mark
        _rename(tri, words, around, end, edge, shared, new)
        turn = number // steps_a_round
        base = STEPS * tile[new]
        for n in range(count):
            neighbour = ring[n]
            if min(kind[new], kind[neighbour]) < FIXED:
                cost[0] = cost_of(record, kind, new, neighbour)
                due = bits[0] >> _ROUND_SHIFT
                at = base + (
                    due * steps_a_round + ((bits[0] >> _STEP_SHIFT) & 7) if due >= turn else turn * steps_a_round
                )
                _push(queue, first, last, size, new, neighbour, at)
                size += 1
                if at < number:
                    number = at
    return nodes, mark, False
