"""Points in groups: 64 neighbours along the curve are split into 8 x 8, and tell how far apart they lie.

Sixteen groups are worked on at once. Arrays hold a point of every group side by side (rows of `LANES`), so that every
inner loop is long, has no branches and runs in wide registers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from limen.data.point_nodes import FAN

__all__ = ["GROUP", "LANES", "NEIGHBOURS", "arrange"]

GROUP = 64
LANES = 16

NEIGHBOURS = 3
"""The radius of a point is the distance to its third neighbour: on a square grid, one spacing."""

_BLOCK = 2 * FAN
"""Neighbours are looked for among so many: on lidar and on scans of statues, splats then leave 1 hole in 1000."""

_WIDEST = np.float32(2.0)
"""Of what is typical in its group: what is farther from the others lies alone, and closes no surface."""

_FAR = np.float32(1e30)
"""Where there is no point: rows beyond the last are filled up with it. Its square is infinite."""


@njit(cache=True, nogil=True)
def _widths(values: Any, width: Any) -> None:
    """From the lowest to the highest value of every lane."""
    least, most = np.full(LANES, _FAR), np.full(LANES, -_FAR)
    for row in range(0, values.shape[0], LANES):
        one = values[row : row + LANES]
        for lane in range(LANES):
            v = one[lane]
            known = v if v < _FAR else -_FAR
            least[lane] = v if v < least[lane] else least[lane]
            most[lane] = known if known > most[lane] else most[lane]
    for lane in range(LANES):
        width[lane] = most[lane] - least[lane]


@njit(cache=True, nogil=True)
def _longest(x: Any, y: Any, z: Any, keys: Any) -> None:
    """Copy each lane's coordinates along its longest axis into ``keys``."""
    across, up, along = np.empty(LANES, np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    _widths(x, across)
    _widths(y, up)
    _widths(z, along)
    for row in range(0, x.shape[0], LANES):
        a, b, c, key = x[row : row + LANES], y[row : row + LANES], z[row : row + LANES], keys[row : row + LANES]
        for lane in range(LANES):
            rest = b[lane] if up[lane] >= along[lane] else c[lane]
            key[lane] = a[lane] if across[lane] >= max(up[lane], along[lane]) else rest


@njit(cache=True, nogil=True)
def _compare(one: Any, other: Any, before_one: Any, before_other: Any) -> None:
    for i in range(one.shape[0]):
        later = np.int32(other[i] < one[i])
        before_one[i] += later
        before_other[i] += np.int32(1) - later


@njit(cache=True, nogil=True)
def _sort(
    at: Any, label: Any, low: int, high: int, keys: Any, lower: Any, upper: Any, out: Any, out_label: Any
) -> None:
    """Sort every lane's ``low:high`` along its longest axis, from ``at`` (3, N) into ``out``: in its middle, halves
    then lie on either side of a median.

    Everyone counts who comes before: for so few, there is no faster way to sort.
    """
    count = keys.shape[0]
    _longest(at[0, low:high], at[1, low:high], at[2, low:high], keys)
    for i in range(count):
        lower[i], upper[i] = 0, 0
    for apart in range(LANES, count, LANES):
        _compare(keys[: count - apart], keys[apart:], lower[: count - apart], upper[apart:])
    x, y, z, own = at[0, low:high], at[1, low:high], at[2, low:high], label[low:high]
    out_x, out_y, out_z, outs = out[0, low:high], out[1, low:high], out[2, low:high], out_label[low:high]
    for i in range(count):
        to = np.uint32((lower[i] + upper[i]) * LANES + (i & (LANES - 1)))
        out_x[to], out_y[to], out_z[to], outs[to] = x[i], y[i], z[i], own[i]


@njit(cache=True, nogil=True)
def _apart(x: Any, y: Any, z: Any, other_x: Any, other_y: Any, other_z: Any, squares: Any) -> None:
    for i in range(x.shape[0]):
        dx, dy, dz = other_x[i] - x[i], other_y[i] - y[i], other_z[i] - z[i]
        d = dx * dx + dy * dy + dz * dz
        squares[i] = d if d > np.float32(0.0) else _FAR * _FAR  # what lies in the same place is no neighbour


@njit(cache=True, nogil=True)
def _insert(squares: Any, first: Any, second: Any, third: Any) -> None:
    """Keep the three smallest."""
    for i in range(squares.shape[0]):
        d, a, b, c = squares[i], first[i], second[i], third[i]
        first[i] = a if a < d else d
        d = d if a < d else a
        second[i] = b if b < d else d
        d = d if b < d else b
        third[i] = c if c < d else d


@njit(cache=True, nogil=True)
def _near(x: Any, y: Any, z: Any, first: Any, second: Any, third: Any, squares: Any) -> None:
    """Squared distances from all to their three nearest in the same lane; ``squares`` is overwritten."""
    count = x.shape[0]
    for i in range(count):
        first[i], second[i], third[i] = _FAR * _FAR, _FAR * _FAR, _FAR * _FAR
    for apart in range(LANES, count, LANES):
        keep = count - apart
        _apart(x[:keep], y[:keep], z[:keep], x[apart:], y[apart:], z[apart:], squares)
        _insert(squares[:keep], first[:keep], second[:keep], third[:keep])
        _insert(squares[:keep], first[apart:], second[apart:], third[apart:])


@njit(cache=True, nogil=True)
def _radii(near: Any, lane: int, count: int, step: float, radii: Any) -> None:
    """Of a lane's points: the third distance, or the last there is, but not much more than is typical."""
    total = np.float32(0.0)
    for i in range(count):
        d = np.float32(0.0)
        for k in range(NEIGHBOURS):
            if near[k, i * LANES + lane] < _FAR:
                d = near[k, i * LANES + lane]
        radii[i] = np.sqrt(d) * np.float32(step)
        total += np.sqrt(radii[i])
    # The mean of roots: one that is far away weighs little in it.
    typical = total / np.float32(count)
    most = typical * typical * _WIDEST
    for i in range(count):
        radii[i] = min(radii[i], most)


@njit(cache=True, nogil=True)
def _gather(places: Any, order: Any, at: Any, label: Any) -> None:
    """Places of up to ``LANES`` groups, each relative to its first point, side by side."""
    for lane in range(LANES):
        begin = min(lane * GROUP, order.shape[0])
        count = min(GROUP, order.shape[0] - begin)
        for i in range(count):
            for axis in range(3):
                at[axis, i * LANES + lane] = np.float32(places[order[begin + i], axis] - places[order[begin], axis])
            label[i * LANES + lane] = i
        for i in range(count, GROUP):
            for axis in range(3):
                at[axis, i * LANES + lane] = _FAR
            label[i * LANES + lane] = i


@njit(cache=True, nogil=True)
def arrange(places: Any, rows: Any, order: Any, step: float, out_places: Any, out_rows: Any, radii: Any) -> None:
    """Points in ``order`` (N,), each 64 split into eights, with radii (N,) in metres for a lattice of ``step`` metres.

    ``places`` (N, 3) int32 and ``rows`` (N, 8) uint8 (what is not place) view what comes in, ``out_*`` what goes out.
    """
    size = GROUP * LANES
    at, spare = np.empty((3, size), np.float32), np.empty((3, size), np.float32)
    near, squares, keys = (
        np.empty((NEIGHBOURS, size), np.float32),
        np.empty(size, np.float32),
        np.empty(size, np.float32),
    )
    label, spare_label = np.empty(size, np.int32), np.empty(size, np.int32)
    lower, upper = np.empty(size, np.int32), np.empty(size, np.int32)
    for begin in range(0, order.shape[0], size):
        own = order[begin : begin + size]
        _gather(places, own, at, label)
        part = size
        while part > FAN * LANES:
            for low in range(0, size, part):
                _sort(at, label, low, low + part, keys[:part], lower[:part], upper[:part], spare, spare_label)
            at, spare, label, spare_label = spare, at, spare_label, label
            part //= 2
        for low in range(0, size, _BLOCK * LANES):
            high = low + _BLOCK * LANES
            _near(
                at[0, low:high], at[1, low:high], at[2, low:high],
                near[0, low:high], near[1, low:high], near[2, low:high], squares,
            )  # fmt: skip
        for lane in range(-(-own.shape[0] // GROUP)):
            first = lane * GROUP
            count = min(GROUP, own.shape[0] - first)
            _radii(near, lane, count, step, radii[begin + first : begin + first + count])
            for i in range(count):
                source = own[first + label[i * LANES + lane]]
                for axis in range(3):
                    out_places[begin + first + i, axis] = places[source, axis]
                for b in range(8):
                    out_rows[begin + first + i, b] = rows[source, b]
