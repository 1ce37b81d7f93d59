"""Compiled parts of `limen.layers.mesh.directions`."""

from __future__ import annotations

import numpy as np

from limen.compiled import compiled

__all__ = ["cell_entries", "core_erosion", "cores_first", "panel_extents"]

_SLACK_CELLS = 1e-3  # the shader finds cells in single precision
_NO_CORE = 1e30
_HORIZON = 1e-6
_FAR = 1e30


@compiled(error_model="python")
def _dot(a, b):
    """Of three numbers each; ``@`` calls a library for that."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(error_model="python")
def panel_extents(planes, cells, corners, corner_count, facing):
    """Extent of every panel on every plane in cells, cut off at the plane's rim, (F, N, 4): x0 y0 x1 y1.

    x0 > x1 where a panel is not on a plane.
    """
    extents = np.empty((planes.shape[0], corners.shape[0], 4), np.float32)
    here, there, box = np.empty(3), np.empty(3), np.empty(4)
    for f in range(planes.shape[0]):
        for n in range(corners.shape[0]):
            box[0], box[1], box[2], box[3] = _FAR, _FAR, -_FAR, -_FAR
            if facing[n]:
                for k in range(corner_count[n]):
                    _place(here, planes[f], corners[n, k])
                    _place(there, planes[f], corners[n, (k + 1) % corner_count[n]])
                    _widen(box, here, there)
            for axis in range(2):
                extents[f, n, axis] = max(box[axis] - _SLACK_CELLS, 0.0)
                extents[f, n, axis + 2] = min(box[axis + 2] + _SLACK_CELLS, cells - 1e-3)
            if extents[f, n, 0] >= extents[f, n, 2] or extents[f, n, 1] >= extents[f, n, 3]:
                extents[f, n, 0], extents[f, n, 2] = 1.0, -1.0
    return extents


@compiled(error_model="python")
def _widen(box, here, there):
    """Take a place on a picture plane into an extent, and where the line to the next one leaves for the horizon."""
    if here[2] > _HORIZON:
        for axis in range(2):
            box[axis] = min(box[axis], here[axis] / here[2])
            box[axis + 2] = max(box[axis + 2], here[axis] / here[2])
    if (here[2] > _HORIZON) != (there[2] > _HORIZON):
        share = (_HORIZON - here[2]) / (there[2] - here[2])
        for axis in range(2):
            cut = (here[axis] + (there[axis] - here[axis]) * share) / _HORIZON
            box[axis] = min(box[axis], cut)
            box[axis + 2] = max(box[axis + 2], cut)


@compiled(error_model="python")
def _place(out, plane, direction):
    for axis in range(3):
        out[axis] = _dot(plane[axis], direction)


@compiled(error_model="python")
def cell_entries(extents, cells):
    """Panels by cell: where each cell's entries end, and the entries."""
    ends = np.zeros(extents.shape[0] * cells * cells + 1, np.int64)
    for f in range(extents.shape[0]):
        for n in range(extents.shape[1]):
            x0, y0, x1, y1 = extents[f, n]
            if x0 > x1:
                continue
            for y in range(int(y0), int(y1) + 1):
                for x in range(int(x0), int(x1) + 1):
                    ends[(f * cells + y) * cells + x + 1] += 1
    ends = np.cumsum(ends)
    entries = np.zeros(ends[-1], np.int64)
    begin = ends[:-1].copy()
    for f in range(extents.shape[0]):
        for n in range(extents.shape[1]):
            x0, y0, x1, y1 = extents[f, n]
            if x0 > x1:
                continue
            for y in range(int(y0), int(y1) + 1):
                for x in range(int(x0), int(x1) + 1):
                    cell = (f * cells + y) * cells + x
                    entries[begin[cell]] = n
                    begin[cell] += 1
    return ends, entries


@compiled(error_model="python")
def core_erosion(ends, entries, extents, cells, edges, corners, depth, corner_count):
    """How far inside each of its edges a panel has to begin so that no other panel reaches into it, pixels: (N, 8).

    Of the edges of a panel, the one beyond which most of a neighbour lies gives way to that neighbour.
    """
    erosion = np.zeros(edges.shape[:2])
    for f in range(extents.shape[0]):
        for y in range(cells):
            for x in range(cells):
                cell = (f * cells + y) * cells + x
                for i in range(ends[cell], ends[cell + 1]):
                    a = entries[i]
                    for j in range(i + 1, ends[cell + 1]):
                        b = entries[j]
                        # A pair meets in several cells; the first that both can share speaks for all.
                        if x == int(max(extents[f, a, 0], extents[f, b, 0])) and y == int(
                            max(extents[f, a, 1], extents[f, b, 1])
                        ):
                            _give_way(erosion, a, b, edges, corners, depth, corner_count)
                            _give_way(erosion, b, a, edges, corners, depth, corner_count)
    return erosion


@compiled(error_model="python")
def _give_way(erosion, a, b, edges, corners, depth, corner_count):
    best, best_edge = _NO_CORE, 0
    for k in range(corner_count[a]):
        reach = _intrusion(edges[a, k], depth[a], corners[b], corner_count[b])
        # An edge that has already given way further costs nothing more.
        if max(reach - erosion[a, k], 0.0) < best:
            best, best_edge = max(reach - erosion[a, k], 0.0), k
    erosion[a, best_edge] += best


@compiled(error_model="python")
def _intrusion(edge, depth, corners, count):
    """How many pixels inside an edge the polygon of ``corners`` reaches; `_NO_CORE` if no number says it."""
    reach = 0.0
    for k in range(count):
        w = _dot(depth, corners[k])
        if w > 0:
            reach = max(reach, _dot(edge, corners[k]) / w)
    for k in range(count):
        w = _dot(depth, corners[k])
        if w <= 0 and _dot(edge, corners[k]) - reach * w >= 0:
            return _NO_CORE
    return reach * (1 + 1e-5) + 0.01


@compiled(error_model="python")
def cores_first(ends, entries, cells, outward, edges, depth, corner_count, erosion):
    """The entries of every cell with those panels first whose core touches it.

    ``outward``: from cells to directions, shape (F, 3, 3).
    """
    starts = np.zeros((len(ends) - 1, 2), np.uint32)
    ordered = np.zeros(max(len(entries), 1), np.uint32)
    around, place = np.empty((4, 3)), np.ones(3)
    for f in range(outward.shape[0]):
        for y in range(cells):
            for x in range(cells):
                for k in range(4):
                    place[0], place[1] = x + (k & 1), y + (k >> 1)
                    _place(around[k], outward[f], place)
                cell = (f * cells + y) * cells + x
                front, back = ends[cell], ends[cell + 1]
                starts[cell, 0] = front
                for i in range(ends[cell], ends[cell + 1]):
                    n = entries[i]
                    if _core_touches(around, edges[n], depth[n], erosion[n], corner_count[n]):
                        ordered[front] = n
                        front += 1
                    else:
                        back -= 1
                        ordered[back] = n
                starts[cell, 1] = front
    return starts, ends[1:].astype(np.uint32), ordered


@compiled(error_model="python")
def _core_touches(around, edges, depth, erosion, count):
    for k in range(count):
        touches = False
        for corner in range(4):
            if _dot(edges[k], around[corner]) >= erosion[k] * _dot(depth, around[corner]):
                touches = True
                break
        if not touches:
            return False
    return True
