"""What is near a node: lists that are handed down from a node to its children, who keep what meets them.

A node lies in its parent's sphere, and so does everything below a neighbour in that neighbour's. What meets a node is
therefore below what meets its parent. No list is longer than `MOST_NEAR`; where it would be (points that all lie in one
place), the parent's is kept, whose spheres hold more. Either way nothing that meets a node is forgotten.

Lists are rows of two tables: ``ids`` (rows, N), and ``near`` (rows, 6, N) float32: x, y, z from the chunk's origin,
radius, lowest and highest luminance below. An entry is the number of a node, ``585 * neighbour + node of its chunk``,
or ``-1 - k`` for the k-th of the coarse spheres, which have no children at hand.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.decode_kernels import FAR, INNER
from limen.data.points.light_kernels import code_of
from limen.data.points.nodes import CHUNK_LEVEL, FAN

__all__ = ["MOST_NEAR", "ROOM", "WIDE", "below", "first_list", "keep", "pick", "top_contrasts"]

MOST_NEAR = 128
WIDE = 32
"""Lists are filled up to a multiple of it with what is far away: loops then run in wide registers to their end."""

ROOM = FAN * MOST_NEAR + WIDE

_SAFE = 1.0 + 1e-6
_ROUNDING = 1e-6
"""Of the distances at hand: more than what float32 does to them."""


@compiled(error_model="python")
def _mark(near: Any, level: int, count: int, sphere: Any, low: float, high: float, marks: Any) -> None:
    """Which of the first entries meet ``sphere`` (4,) and hold what is below ``low`` or above ``high``."""
    x, y, z, reach = sphere[0], sphere[1], sphere[2], sphere[3]
    for k in range(count):
        dx, dy, dz = near[level, 0, k] - x, near[level, 1, k] - y, near[level, 2, k] - z
        both = near[level, 3, k] + reach
        meets = dx * dx + dy * dy + dz * dz <= both * both
        marks[k] = np.int32(meets & ((near[level, 4, k] < low) | (near[level, 5, k] > high)))


@compiled(error_model="python")
def pick(marks: Any, count: int, picked: Any) -> int:
    """The numbers of what is marked; returns how many."""
    found = 0
    for k in range(count):
        picked[found] = k
        found += marks[k]
    return found


@compiled(error_model="python")
def _fill_up(near: Any, level: int, count: int) -> None:
    """Far away up to the next multiple of `WIDE`."""
    for k in range(count, -(-count // WIDE) * WIDE):
        near[level, 0, k], near[level, 3, k] = FAR, np.float32(0.0)
        for part in range(1, 3):
            near[level, part, k] = np.float32(0.0)
        near[level, 4, k], near[level, 5, k] = FAR, np.float32(0.0)


@compiled(error_model="python")
def keep(ids: Any, near: Any, row: int, count: int, full_row: int, full: int, sphere: Any, marks: Any, picked: Any,
          to: int) -> int:  # fmt: skip
    """Copy those of the entries of a row that meet ``sphere`` to row ``to``; returns how many.

    If they are more than a list takes, those of the ``full`` entries of ``full_row`` are taken instead.
    """
    found, source = MOST_NEAR + 1, row
    while found > MOST_NEAR:
        _mark(near, source, -(-count // WIDE) * WIDE, sphere, np.float32(np.inf), np.float32(-np.inf), marks)
        found = pick(marks, count, picked)
        if found > MOST_NEAR:
            source, count = full_row, full
    for k in range(found):
        ids[to, k] = ids[source, picked[k]]
        for part in range(6):
            near[to, part, k] = near[source, part, picked[k]]
    _fill_up(near, to, found)
    return found


@compiled(error_model="python")
def _meet(x: float, y: float, z: float, reach: float, bx: float, by: float, bz: float, radius: float) -> bool:
    dx, dy, dz, both = bx - x, by - y, bz - z, radius + reach
    return bool(dx * dx + dy * dy + dz * dz <= both * both)


@compiled(error_model="python")
def below(ids: Any, near: Any, row: int, count: int, inner: Any, slots: Any, offsets: Any, sphere: Any, to: int) -> int:
    """The children of entries of a row that meet ``sphere``, into row ``to``; coarse spheres stay themselves."""
    kept = 0
    for k in range(count):
        entry = ids[row, k]
        if entry < 0:
            ids[to, kept] = entry
            for part in range(6):
                near[to, part, kept] = near[row, part, k]
            kept += 1
            continue
        which = entry // INNER
        first, slot = FAN * (entry - which * INNER) + 1, slots[which]
        for child in range(first, first + FAN):
            x, y, z = (
                inner[slot, 0, child] + offsets[which, 0],
                inner[slot, 1, child] + offsets[which, 1],
                inner[slot, 2, child] + offsets[which, 2],
            )
            if _meet(sphere[0], sphere[1], sphere[2], sphere[3], x, y, z, inner[slot, 3, child]):
                ids[to, kept] = which * INNER + child
                near[to, 0, kept], near[to, 1, kept], near[to, 2, kept] = x, y, z
                for part in range(3, 6):
                    near[to, part, kept] = inner[slot, part, child]
                kept += 1
    _fill_up(near, to, kept)
    return kept


@compiled(error_model="python")
def first_list(
    chunk: int, tops: Any, met: Any, count: int, frames: Any, ids: Any, near: Any, near_chunks: Any, offsets: Any
) -> Any:
    """What meets a chunk's root into row 4, the chunk itself the first; how many chunks they are, and what float32 may
    do to their distances.
    """
    which, coarse, farthest = 1, 0, 0.0
    near_chunks[0] = chunk
    for axis in range(3):
        offsets[0, axis] = 0.0
    row = CHUNK_LEVEL
    for n in range(count):
        entry = np.int64(met[chunk, n])
        reach = 0.0
        k = n
        if entry == chunk:
            ids[row, n] = 0
        elif entry < frames.shape[0]:
            ids[row, n] = which * INNER
            near_chunks[which] = entry
            for axis in range(3):
                offsets[which, axis] = np.float64(frames[entry, axis]) - np.float64(frames[chunk, axis])
            which += 1
        else:
            coarse += 1
            ids[row, n] = -coarse
        for part in range(6):
            value = tops[entry, part] - (np.float64(frames[chunk, part]) if part < 3 else 0.0)
            near[row, part, k] = value
            reach += abs(value) if part < 4 else 0.0
        farthest = max(farthest, reach)
    _fill_up(near, row, count)
    return which, farthest * _ROUNDING


@compiled(error_model="python")
def _top_meets(spheres: Any, a: int, b: int) -> bool:
    dx, dy, dz = spheres[a, 0] - spheres[b, 0], spheres[a, 1] - spheres[b, 1], spheres[a, 2] - spheres[b, 2]
    reach = (spheres[a, 3] + spheres[b, 3]) * _SAFE
    return bool(dx * dx + dy * dy + dz * dz <= reach * reach)


@compiled(error_model="python")
def top_contrasts(spheres: Any, shown: Any, begin: Any, lists: Any, lengths: Any, codes: Any) -> None:
    """Codes (N,) of all tops above level 4, and what meets every top: ``lists`` (N, 128) int32, ``lengths`` (N,).

    ``spheres`` (N, 6) float64 are places, radii and ranges of luminance, level 4 first; ``begin`` (L + 1,) is where
    levels begin and end; ``shown`` (N,) are tops' own luminances.
    """
    met = np.empty(FAN * MOST_NEAR, np.int32)
    last = begin.shape[0] - 2
    lists[begin[last], 0] = begin[last]
    lengths[begin[last]] = 1
    for level in range(last, 0, -1):
        for node in range(begin[level], begin[level + 1]):
            count = 0
            low, high = spheres[node, 4], spheres[node, 5]
            for k in range(lengths[node]):
                entry = lists[node, k]
                at = level
                while begin[at + 1] <= entry:  # a list that was full was kept
                    at += 1
                first = begin[at - 1] + (entry - begin[at]) * FAN
                for child in range(first, min(first + FAN, begin[at])):
                    if _top_meets(spheres, child, node):
                        met[count] = child
                        count += 1
                        low, high = min(low, spheres[child, 4]), max(high, spheres[child, 5])
            codes[node] = code_of(shown[node], low, high)
            first = begin[level - 1] + (node - begin[level]) * FAN
            for child in range(first, min(first + FAN, begin[level])):
                kept = _hand_down(spheres, child, met, count, lists)
                if kept > MOST_NEAR:
                    kept = _hand_down(spheres, child, lists[node], np.int64(lengths[node]), lists)
                lengths[child] = kept


@compiled(error_model="python")
def _hand_down(spheres: Any, child: int, entries: Any, count: int, lists: Any) -> int:
    """Those of the first entries that meet a child, as far as its list takes them; returns how many."""
    kept = 0
    for k in range(count):
        if _top_meets(spheres, entries[k], child):
            if kept < MOST_NEAR:
                lists[child, kept] = entries[k]
            kept += 1
    return kept
