"""What is known of nodes and triangles before the first edge collapses: the loops that
`limen.data.mesh.collapse_kernels` begins with, whose records these are.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.mesh.collapse_kernels import CORNERS, _next
from limen.data.mesh.record_kernels import APART, AREA, BEND, FIXED, HEAD, INNER, NORMAL, PLACE, RIM, SLOTS

__all__ = ["classify", "fill", "link_corners", "sum_bends", "sum_quadrics", "tile"]


@compiled
def fill(positions: Any, middle: Any, size: Any, triangles: Any, numbers: Any, records: Any, tri: Any) -> None:
    """Records of the nodes ``numbers`` (V,) of vertices, and of triangles that have three different ones.

    ``records`` (N, 32) are 0 at first, ``tri`` (T, 8). Places are from ``middle`` (3,) in units of ``size``.
    """
    for v in range(numbers.shape[0]):
        node = numbers[v]
        for axis in range(3):
            records[v, PLACE + axis] = records[node, PLACE + axis] = (positions[v, axis] - middle[axis]) / size
    for t in range(triangles.shape[0]):
        a, b, c = numbers[triangles[t, 0]], numbers[triangles[t, 1]], numbers[triangles[t, 2]]
        there = a != b and b != c and c != a
        tri[t, 0], tri[t, 1], tri[t, 2] = (a, b, c) if there else (-1, -1, -1)


@compiled
def tile(record: Any, nodes: Any, edge: Any, found: Any) -> Any:
    """The numbers of the cubes that nodes lie in, of ``edge`` to the mesh's size: into ``found``; returns how many."""
    numbers = np.full(edge * edge * edge, -1, np.int32)
    count = 0
    for node in range(nodes):
        cell = 0
        for axis in range(PLACE, PLACE + 3):
            cell = cell * edge + min(max(int((record[SLOTS * node + axis] + 0.5) * edge), 0), edge - 1)
        if numbers[cell] < 0:
            numbers[cell] = count
            count += 1
        found[node] = numbers[cell]
    return count


@compiled
def link_corners(tri: Any, words: Any, tail: Any) -> None:
    """Make the lists of corners at each node; ``tail`` (N,) is -1 at first."""
    for node in range(tail.shape[0]):
        words[SLOTS * node + HEAD] = -1
    for t in range(tri.shape[0] // CORNERS):
        for corner in range(CORNERS * t, CORNERS * t + 3):
            node = tri[corner]
            tri[corner + 3] = -1
            if node < 0:
                continue
            if tail[node] < 0:
                words[SLOTS * node + HEAD] = corner
            else:
                tri[tail[node] + 3] = corner
            tail[node] = corner


@compiled
def _add_plane(record: Any, node: Any, x: Any, y: Any, z: Any, weight: Any) -> None:
    """The square of the distance from a plane through the node, of unit normal (x, y, z), times a weight."""
    at = SLOTS * node
    record[at] += weight * x * x
    record[at + 1] += weight * x * y
    record[at + 2] += weight * x * z
    record[at + 3] += weight * y * y
    record[at + 4] += weight * y * z
    record[at + 5] += weight * z * z


@compiled
def sum_quadrics(tri: Any, record: Any) -> None:
    """Add to the records of each triangle's corners its plane, weighted by a third of the area."""
    for t in range(tri.shape[0] // CORNERS):
        a, b, c = tri[CORNERS * t], tri[CORNERS * t + 1], tri[CORNERS * t + 2]
        if a < 0:
            continue
        i, k, m = SLOTS * a + PLACE, SLOTS * b + PLACE, SLOTS * c + PLACE
        ux, uy, uz = record[k] - record[i], record[k + 1] - record[i + 1], record[k + 2] - record[i + 2]
        vx, vy, vz = record[m] - record[i], record[m + 1] - record[i + 1], record[m + 2] - record[i + 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        double = np.sqrt(x * x + y * y + z * z)
        if double > 0.0:
            x, y, z, weight = x / double, y / double, z / double, double / np.float32(6.0)
            _add_plane(record, a, x, y, z, weight)
            _add_plane(record, b, x, y, z, weight)
            _add_plane(record, c, x, y, z, weight)


@compiled
def sum_bends(triangles: Any, numbers: Any, normals: Any, record: Any) -> None:
    """Means of the normals around the nodes ``numbers`` (V,) of vertices, and of how they bend along their triangles.

    Along a triangle normals are linear; what is not symmetric of that is of no surface, and left out.
    """
    bend = np.empty((3, 3))
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        i, k, m = SLOTS * numbers[a] + PLACE, SLOTS * numbers[b] + PLACE, SLOTS * numbers[c] + PLACE
        ux, uy, uz = record[k] - record[i], record[k + 1] - record[i + 1], record[k + 2] - record[i + 2]
        vx, vy, vz = record[m] - record[i], record[m + 1] - record[i + 1], record[m + 2] - record[i + 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        double2 = x * x + y * y + z * z
        if double2 <= 0.0:
            continue
        weight = np.sqrt(double2) / np.float32(6.0)
        # Ways in the plane that go 1 along one edge and 0 along the other.
        px, py, pz = (vy * z - vz * y) / double2, (vz * x - vx * z) / double2, (vx * y - vy * x) / double2
        qx, qy, qz = (y * uz - z * uy) / double2, (z * ux - x * uz) / double2, (x * uy - y * ux) / double2
        for axis in range(3):
            du, dv = normals[b, axis] - normals[a, axis], normals[c, axis] - normals[a, axis]
            bend[axis, 0], bend[axis, 1], bend[axis, 2] = du * px + dv * qx, du * py + dv * qy, du * pz + dv * qz
        for corner in range(3):
            vertex = triangles[t, corner]
            at = SLOTS * numbers[vertex]
            record[at + AREA] += weight
            word = at + BEND
            for axis in range(3):
                record[at + NORMAL + axis] += weight * normals[vertex, axis]
                for other in range(axis, 3):
                    record[word] += weight * 0.5 * (bend[axis, other] + bend[other, axis])
                    word += 1
    for at in range(0, record.shape[0], SLOTS):
        if record[at + AREA] > 0.0:
            for word in range(at + NORMAL, at + AREA):
                record[word] /= record[at + AREA]


@compiled
def _add_rim(record: Any, node: Any, end: Any, third: Any) -> None:
    """The plane through an edge of the surface, upright on its triangle: leaving it would show."""
    i, k, m = SLOTS * node + PLACE, SLOTS * end + PLACE, SLOTS * third + PLACE
    ex, ey, ez = record[k] - record[i], record[k + 1] - record[i + 1], record[k + 2] - record[i + 2]
    fx, fy, fz = record[m] - record[i], record[m + 1] - record[i + 1], record[m + 2] - record[i + 2]
    length2 = ex * ex + ey * ey + ez * ez
    if length2 <= 0.0:
        return
    along = (ex * fx + ey * fy + ez * fz) / length2
    x, y, z = fx - along * ex, fy - along * ey, fz - along * ez
    high = np.sqrt(x * x + y * y + z * z)
    if high > 0.0:
        _add_plane(record, node, x / high, y / high, z / high, length2 / np.float32(2.0))


@compiled
def classify(tri: Any, record: Any, words: Any, kind: Any) -> None:
    """What each node is, by the edges opposite to it: one ring inside, one open chain on a rim, else fixed.

    ``kind`` (N,) is `APART` already where textures meet. Rims add their planes to the records.
    """
    nodes = kind.shape[0]
    both = np.zeros(nodes, np.int32)  # of a neighbour: the numbers of the two next to it, one xor the other
    seen = np.full(nodes, -1, np.int32)
    count = np.zeros(nodes, np.int32)
    for node in range(nodes):
        corner = words[SLOTS * node + HEAD]
        edges, ends, broken, start, before = 0, 0, False, -1, -1
        while corner >= 0:
            a, b = tri[_next(corner)], tri[_next(_next(corner))]
            for turn in range(2):
                end, far = (a, b) if turn == 0 else (b, a)
                again = seen[end] == node
                times = count[end] * again + 1
                both[end] = both[end] * again ^ far
                seen[end], count[end] = node, times
                ends += (times == 1) - (times == 2)
                broken |= times > 2
            edges += 1
            start, before = b, a
            corner = tri[corner + 3]
        if edges == 0 or broken or ends > 2:
            kind[node] = max(kind[node], FIXED)
            continue
        if ends == 2:
            corner = words[SLOTS * node + HEAD]
            while corner >= 0:
                a, b = tri[_next(corner)], tri[_next(_next(corner))]
                if count[a] == 1:
                    start, before = b, a
                    _add_rim(record, node, a, b)
                if count[b] == 1:
                    start, before = a, b
                    _add_rim(record, node, b, a)
                corner = tri[corner + 3]
        steps, begin = 1, before
        while start != begin and count[start] == 2 and steps <= edges:
            before, start = start, both[start] ^ before
            steps += 1
        if steps != edges:
            kind[node] = max(kind[node], FIXED)
        elif kind[node] != APART:
            kind[node] = RIM if ends == 2 else INNER
