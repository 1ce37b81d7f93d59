"""Points in groups: 64 neighbours along the curve are split into 8 x 8, and tell how far apart they lie.

Sixteen groups are worked on at once. Arrays hold a point of every group side by side (rows of `LANES`), so that every
inner loop is long, has no branches and runs in wide registers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.nodes import FAN

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


@compiled(error_model="python")
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


@compiled(error_model="python")
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


@compiled(error_model="python")
def _compare(one: Any, other: Any, before_one: Any, before_other: Any) -> None:
    for i in range(one.shape[0]):
        later = np.int32(other[i] < one[i])
        before_one[i] += later
        before_other[i] += np.int32(1) - later


@compiled(error_model="python")
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


@compiled(error_model="python")
def _apart(x: Any, y: Any, z: Any, other_x: Any, other_y: Any, other_z: Any, squares: Any) -> None:
    for i in range(x.shape[0]):
        dx, dy, dz = other_x[i] - x[i], other_y[i] - y[i], other_z[i] - z[i]
        d = dx * dx + dy * dy + dz * dz
        squares[i] = d if d > np.float32(0.0) else _FAR * _FAR  # what lies in the same place is no neighbour


@compiled(error_model="python")
def _insert(squares: Any, first: Any, second: Any, third: Any) -> None:
    """Keep the three smallest."""
    for i in range(squares.shape[0]):
        d, a, b, c = squares[i], first[i], second[i], third[i]
        first[i] = a if a < d else d
        d = d if a < d else a
        second[i] = b if b < d else d
        d = d if b < d else b
        third[i] = c if c < d else d


@compiled(error_model="python")
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


@compiled(error_model="python")
def _radii(near: Any, step: float, count: int, radii: Any) -> None:
    """Of points, lane by lane: the third distance, or the last there is, but not much more than is typical."""
    first, second, third = near[0], near[1], near[2]
    for i in range(radii.shape[0]):
        d = first[i] if first[i] < _FAR else np.float32(0.0)
        d = second[i] if second[i] < _FAR else d
        d = third[i] if third[i] < _FAR else d
        radii[i] = np.sqrt(d) * np.float32(step)
    most = np.zeros(LANES, np.float32)
    for row in range(0, radii.shape[0], LANES):
        for lane in range(LANES):
            most[lane] += np.sqrt(radii[row + lane])
    # The mean of roots: one that is far away weighs little in it.
    for lane in range(LANES):
        held = min(max(count - lane * GROUP, 1), GROUP)
        typical = most[lane] / np.float32(held)
        most[lane] = typical * typical * _WIDEST
    for row in range(0, radii.shape[0], LANES):
        for lane in range(LANES):
            radii[row + lane] = min(radii[row + lane], most[lane])


@compiled(error_model="python")
def _gather(words: Any, order: Any, begin: int, count: int, at: Any, label: Any) -> None:
    """Places of up to ``LANES`` groups, each relative to its first point, side by side."""
    for lane in range(LANES):
        first = min(lane * GROUP, count)
        held = min(GROUP, count - first)
        if held > 0:
            origin = order[begin + first]
            x, y, z = np.int32(words[origin, 0]), np.int32(words[origin, 1]), np.int32(words[origin, 2])
        for i in range(held):
            source, to = order[begin + first + i], i * LANES + lane
            at[0, to] = np.float32(np.int32(words[source, 0]) - x)
            at[1, to] = np.float32(np.int32(words[source, 1]) - y)
            at[2, to] = np.float32(np.int32(words[source, 2]) - z)
            label[to] = i
        for i in range(held, GROUP):
            to = i * LANES + lane
            at[0, to], at[1, to], at[2, to], label[to] = _FAR, _FAR, _FAR, i


@compiled(error_model="python")
def arrange(words: Any, order: Any, step: float, out: Any, radii: Any) -> None:
    """Points in ``order`` (N,), each 64 split into eights, with radii (N,) in metres for a lattice of ``step`` metres.

    ``words`` (M, 5) uint32 are what comes in, ``out`` (N, 5) what goes out: places, and two words that go along.
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
        total = min(size, order.shape[0] - begin)
        _gather(words, order, begin, total, at, label)
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
        _radii(near, step, total, squares)
        for lane in range(-(-total // GROUP)):
            first = lane * GROUP
            for i in range(min(GROUP, total - first)):
                own = i * LANES + lane
                source, to = order[begin + first + label[own]], begin + first + i
                radii[to] = squares[own]
                for word in range(5):
                    out[to, word] = words[source, word]
