"""Points in groups: 64 neighbours along the curve are split into 8 x 8, and tell how far apart they lie.

A point as it travels through the build is a row of 20 bytes, `limen.data.points_tree.POINT`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["GROUP", "NEIGHBOURS", "arrange"]

GROUP = 64
NEIGHBOURS = 4
"""The radius of a point is the distance to its fourth neighbour: on a square grid, one spacing."""

_WIDEST = np.float32(2.0)
"""Of the median of its group: what is farther from the others lies alone, and closes no surface."""

_FAR = np.float32(3.0e38)


@njit(cache=True, nogil=True)
def _part(value: Any, label: Any, low: int, high: int, middle: int) -> None:
    """Reorder ``value[low:high]`` and its labels until nothing before ``middle`` is larger than what follows (Hoare's
    quickselect).
    """
    while high - low > 1:
        pivot = value[(low + high) // 2]
        i, j = low, high - 1
        while i <= j:
            while value[i] < pivot:
                i += 1
            while value[j] > pivot:
                j -= 1
            if i <= j:
                value[i], value[j] = value[j], value[i]
                label[i], label[j] = label[j], label[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j + 1
        elif middle >= i:
            low = i
        else:
            return


@njit(cache=True, nogil=True)
def _split(at: Any, label: Any, value: Any, low: int, high: int) -> None:
    """Halve points ``low:high`` at the median of their longest axis; the first half is whole groups of 8."""
    best, axis = np.float32(-1.0), 0
    for a in range(3):
        least, most = _FAR, -_FAR
        for i in range(low, high):
            v = at[a, label[i]]
            least, most = min(least, v), max(most, v)
        if most - least > best:
            best, axis = most - least, a
    for i in range(low, high):
        value[i] = at[axis, label[i]]
    half = ((high - low + 7) // 8 + 1) // 2 * 8
    _part(value, label, low, high, low + half)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _reach(at: Any, count: int, near: Any) -> None:
    """Squared distances (4, 64) into ``near`` from every point to its four nearest that lie elsewhere, ascending."""
    near[:, :] = _FAR
    for j in range(count):
        x, y, z = at[0, j], at[1, j], at[2, j]
        for i in range(GROUP):
            dx, dy, dz = at[0, i] - x, at[1, i] - y, at[2, i] - z
            d = dx * dx + dy * dy + dz * dz
            d = d if d > np.float32(0.0) else _FAR
            a, b, c, e = near[0, i], near[1, i], near[2, i], near[3, i]
            near[0, i] = min(a, d)
            d = max(a, d)
            near[1, i] = min(b, d)
            d = max(b, d)
            near[2, i] = min(c, d)
            d = max(c, d)
            near[3, i] = min(e, d)


@njit(cache=True, nogil=True)
def _radii(near: Any, count: int, step: float, value: Any, label: Any, radii: Any) -> None:
    """Of the points of a group, in the order of ``at``: the fourth distance, or the last there is, within bounds."""
    for i in range(count):
        d = np.float32(0.0)
        for k in range(NEIGHBOURS):
            if near[k, i] < _FAR:
                d = near[k, i]
        radii[i] = np.float32(np.sqrt(d) * step)
        value[i] = radii[i]
        label[i] = i
    _part(value, label, 0, count, count // 2)
    most = value[count // 2] * _WIDEST
    for i in range(count):
        radii[i] = min(radii[i], most)


@njit(cache=True, nogil=True)
def arrange(places: Any, rows: Any, order: Any, step: float, out_places: Any, out_rows: Any, radii: Any) -> None:
    """Points in ``order`` (N,), each 64 split into eights, with radii (N,) in metres for a lattice of ``step`` metres.

    ``places`` (N, 3) int32 and ``rows`` (N, 8) uint8 (what is not place) view what comes in, ``out_*`` what goes out.
    """
    at = np.empty((3, GROUP), np.float32)
    tidy = np.empty((3, GROUP), np.float32)
    near = np.empty((NEIGHBOURS, GROUP), np.float32)
    value = np.empty(GROUP, np.float32)
    label = np.empty(GROUP, np.int64)
    for begin in range(0, order.shape[0], GROUP):
        count = min(GROUP, order.shape[0] - begin)
        first = order[begin]
        for i in range(count):
            label[i] = i
            for a in range(3):
                at[a, i] = np.float32(places[order[begin + i], a] - places[first, a])
        size = GROUP
        while size > 8:
            for low in range(0, count, size):
                if min(low + size, count) - low > 8:
                    _split(at, label, value, low, min(low + size, count))
            size //= 2
        for i in range(count):
            source = order[begin + label[i]]
            for a in range(3):
                tidy[a, i] = at[a, label[i]]
                out_places[begin + i, a] = places[source, a]
            for b in range(8):
                out_rows[begin + i, b] = rows[source, b]
        for i in range(count, GROUP):
            for a in range(3):
                tidy[a, i] = _FAR
        _reach(tidy, count, near)
        _radii(near, count, step, value, label, radii[begin : begin + count])
