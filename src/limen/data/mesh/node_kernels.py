"""What the nodes of a vertex tree say of all that is below them: linear passes over triangles and over parents."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled

__all__ = [
    "CELLS_A_SIDE",
    "add_up",
    "cell_of",
    "first_at_places",
    "leaf_regions",
    "merge_regions",
    "reach_up",
    "rise",
    "weld_places",
    "widen_up",
]

CELLS_A_SIDE = 8
_EMPTY = -1


def first_at_places(positions: NDArray[np.float32]) -> NDArray[np.int32]:
    """The first vertex at each vertex's place: (V, 3) to (V,)."""
    first = np.empty(len(positions), np.int32)
    weld_places((positions + np.float32(0)).view(np.int32), first)  # -0 becomes 0
    return first


@compiled
def weld_places(bits: Any, first: Any) -> None:
    """The first vertex at each vertex's place: ``bits`` (V, 3) int32 of the floats, -0 as 0, into ``first`` (V,)."""
    size = 16
    while size < 2 * bits.shape[0]:
        size *= 2
    table = np.full(size, _EMPTY, np.int32)
    for v in range(bits.shape[0]):
        key = np.uint32(bits[v, 0]) * np.uint32(0x9E3779B1)
        key = (key ^ (key >> np.uint32(15))) + np.uint32(bits[v, 1]) * np.uint32(0x85EBCA77)
        key = (key ^ (key >> np.uint32(13))) + np.uint32(bits[v, 2]) * np.uint32(0xC2B2AE3D)
        key ^= key >> np.uint32(16)
        slot = np.int64(key) & (size - 1)
        while True:
            held = table[slot]
            if held == _EMPTY:
                table[slot] = v
                first[v] = v
                break
            if bits[held, 0] == bits[v, 0] and bits[held, 1] == bits[v, 1] and bits[held, 2] == bits[v, 2]:
                first[v] = held
                break
            slot = (slot + 1) & (size - 1)


@compiled
def places(records: Any, numbers: Any, parent: Any, stays: Any, middle: Any, size: Any, position: Any) -> None:
    """Places of inner nodes in the mesh's own coordinates, from ``records`` to ``position`` (N, 3).

    Where ``stays`` (n,) and the parent is one of the n first, it has the very place of the child: what is rounded
    would open a seam. So it is where ``numbers`` (V,) gives several vertices one node.
    """
    for node in range(numbers.shape[0], position.shape[0]):
        for axis in range(3):
            position[node, axis] = np.float64(records[node, 10 + axis]) * size + middle[axis]
    for v in range(numbers.shape[0]):
        if numbers[v] >= numbers.shape[0]:
            for axis in range(3):
                position[numbers[v], axis] = position[v, axis]
    for node in range(stays.shape[0]):
        above = parent[node]
        if stays[node] and 0 <= above < stays.shape[0]:
            for axis in range(3):
                position[above, axis] = position[node, axis]


@compiled
def cell_of(x: Any, y: Any, z: Any) -> Any:
    """The cell of the Gauss sphere, 0 ... 383, that a direction lies in: ``64 face + 8 row + column``.

    Faces are +x, -x, +y, -y, +z, -z; columns and rows run along the other two axes, in the order of x, y, z.
    """
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, most = 0 + (x < 0), y, z, ax
    elif ay >= az:
        face, u, v, most = 2 + (y < 0), x, z, ay
    else:
        face, u, v, most = 4 + (z < 0), x, y, az
    scale = 0.5 * CELLS_A_SIDE / most
    column = min(int(u * scale + 0.5 * CELLS_A_SIDE), CELLS_A_SIDE - 1)
    row = min(int(v * scale + 0.5 * CELLS_A_SIDE), CELLS_A_SIDE - 1)
    return face * CELLS_A_SIDE * CELLS_A_SIDE + row * CELLS_A_SIDE + column


@compiled
def _stretch(box: Any, node: Any, x: Any, y: Any, z: Any) -> None:
    box[node, 0], box[node, 3] = min(box[node, 0], x), max(box[node, 3], x)
    box[node, 1], box[node, 4] = min(box[node, 1], y), max(box[node, 4], y)
    box[node, 2], box[node, 5] = min(box[node, 2], z), max(box[node, 5], z)


@compiled
def leaf_regions(triangles: Any, position: Any, normal: Any, box: Any, ring: Any, mask: Any, area: Any) -> None:
    """Of every vertex, what the triangles around it reach.

    ``box`` (N, 6) is stretched over their corners, ``ring`` (V,) raised to the square of the largest distance to one,
    the cells of their normals and of those of their corners are set in ``mask`` (V, 6), and a third of their areas is
    added to ``area`` (N,).
    """
    cells = np.empty(normal.shape[0], np.int64)
    one = np.uint64(1)
    for v in range(normal.shape[0]):
        cells[v] = cell_of(normal[v, 0], normal[v, 1], normal[v, 2])
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        px, py, pz = position[a, 0], position[a, 1], position[a, 2]
        qx, qy, qz = position[b, 0], position[b, 1], position[b, 2]
        rx, ry, rz = position[c, 0], position[c, 1], position[c, 2]
        ux, uy, uz = np.float64(qx) - px, np.float64(qy) - py, np.float64(qz) - pz
        vx, vy, vz = np.float64(rx) - px, np.float64(ry) - py, np.float64(rz) - pz
        wx, wy, wz = vx - ux, vy - uy, vz - uz
        ab, ac, bc = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
        ring[a] = max(ring[a], ab, ac)
        ring[b] = max(ring[b], ab, bc)
        ring[c] = max(ring[c], ac, bc)
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        double = np.sqrt(x * x + y * y + z * z)
        low_x, low_y, low_z = min(px, qx, rx), min(py, qy, ry), min(pz, qz, rz)
        high_x, high_y, high_z = max(px, qx, rx), max(py, qy, ry), max(pz, qz, rz)
        own = cell_of(x, y, z) if double > 0.0 else cells[a]
        for node in (a, b, c):
            area[node] += double / 6.0
            _stretch(box, node, low_x, low_y, low_z)
            _stretch(box, node, high_x, high_y, high_z)
            for cell in (own, cells[a], cells[b], cells[c]):
                mask[node, cell >> 6] |= one << np.uint64(cell & 63)


@compiled
def merge_regions(parent: Any, position: Any, box: Any, leaf_mask: Any, mask: Any) -> None:
    """Boxes (N, 6) and masks (N - V, 6) of parents from those of children; a box holds its own proxy, too."""
    vertices = leaf_mask.shape[0]
    for node in range(parent.shape[0]):
        _stretch(box, node, position[node, 0], position[node, 1], position[node, 2])
        above = parent[node]
        if above < 0:
            continue
        _stretch(box, above, box[node, 0], box[node, 1], box[node, 2])
        _stretch(box, above, box[node, 3], box[node, 4], box[node, 5])
        for word in range(6):
            bits = leaf_mask[node, word] if node < vertices else mask[node - vertices, word]
            mask[above - vertices, word] |= bits


@compiled
def reach_up(parent: Any, position: Any, ring: Any, middle: Any, radius: Any, way: Any) -> None:
    """Raise ``radius`` (N - V,) to hold, about ``middle``, all triangles around all vertices below.

    ``ring`` (V,) is how far the corners around a vertex are from it; below zero where it has no triangle. ``way``
    (N - V,) is raised to the square of the longest way from a vertex to the proxy.
    """
    vertices = ring.shape[0]
    for v in range(vertices):
        above = parent[v]
        if ring[v] < 0.0:
            continue
        x, y, z = position[v, 0], position[v, 1], position[v, 2]
        while above >= 0:
            inner = above - vertices
            dx, dy, dz = x - middle[inner, 0], y - middle[inner, 1], z - middle[inner, 2]
            radius[inner] = max(radius[inner], np.sqrt(dx * dx + dy * dy + dz * dz) + ring[v])
            dx, dy, dz = x - position[above, 0], y - position[above, 1], z - position[above, 2]
            way[inner] = max(way[inner], dx * dx + dy * dy + dz * dz)
            above = parent[above]


@compiled
def rise(parent: Any, vertices: Any, value: Any) -> None:
    """Make no inner node's ``value`` (N - V,) smaller than that of one below."""
    for node in range(vertices, parent.shape[0]):
        above = parent[node]
        if above >= 0:
            value[above - vertices] = max(value[above - vertices], value[node - vertices])


@compiled
def add_up(parent: Any, sums: Any) -> None:
    """Add the rows of ``sums`` (N, n) to those of their parents, children first."""
    for node in range(parent.shape[0]):
        above = parent[node]
        if above >= 0:
            for column in range(sums.shape[1]):
                sums[above, column] += sums[node, column]


@compiled
def widen_up(triangles: Any, parent: Any, value: Any, low: Any, high: Any) -> None:
    """The range of a value of vertices, ``value`` (V,), over the region of each node: ``low`` and ``high`` (N,)."""
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        least, most = min(value[a], value[b], value[c]), max(value[a], value[b], value[c])
        for node in (a, b, c):
            low[node], high[node] = min(low[node], least), max(high[node], most)
    for node in range(parent.shape[0]):
        above = parent[node]
        if above >= 0:
            low[above], high[above] = min(low[above], low[node]), max(high[above], high[node])
