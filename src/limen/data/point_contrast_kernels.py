"""How far the colour of a node may be from what its sphere meets: top down, with lists of what is near.

A node lies in its parent's sphere, and so does everything below a neighbour in that neighbour's. What meets a node is
therefore below what meets its parent: every node hands a list of neighbours down to its children, who keep what
meets them. No list is longer than `MOST_NEAR`; where it would be (points that all lie in one place), the parent's is
kept, whose spheres hold more. Either way nothing that meets a node is forgotten.

An entry of a list is the number of a node, ``4681 * neighbour + node of its chunk``, or ``-1 - k`` for the k-th of the
coarse spheres, which have no children at hand.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from limen.data.point_nodes import CHUNK_LEVEL, CHUNK_NODES, FAN, LEVEL_BEGIN

__all__ = ["MOST_NEAR", "chunk_contrasts", "decode_chunk", "luminance_ranges", "top_contrasts"]

MOST_NEAR = 128

_BEGIN = LEVEL_BEGIN
_POINTS = LEVEL_BEGIN[0]
_FAR = np.float32(1e30)
_FAR_BITS = np.int32(np.float32(1e30).view(np.int32))
_SAFE = 1.0 + 1e-6
"""Luminances are float32."""


@njit(cache=True, nogil=True)
def luminance_ranges(nodes: Any, counts: Any, channels: Any, dark: float, ranges: Any) -> None:
    """Lowest and highest luminance of the points below all inner nodes: ``ranges`` (585, 2) float32, in cd/m2.

    ``nodes`` (4681, 16) uint8 of one chunk, ``counts`` (5,) of its levels, ``channels`` (3, 256) float32.
    """
    ranges[:, 0], ranges[:, 1] = np.float32(np.inf), np.float32(-np.inf)
    for i in range(counts[0]):
        light = _light(nodes[_POINTS + i], channels, dark)
        above = _BEGIN[1] + i // FAN
        ranges[above, 0], ranges[above, 1] = min(ranges[above, 0], light), max(ranges[above, 1], light)
    for level in range(1, CHUNK_LEVEL):
        for i in range(counts[level]):
            node, above = _BEGIN[level] + i, _BEGIN[level + 1] + i // FAN
            ranges[above, 0] = min(ranges[above, 0], ranges[node, 0])
            ranges[above, 1] = max(ranges[above, 1], ranges[node, 1])


@njit(cache=True, nogil=True)
def _light(node: Any, channels: Any, dark: float) -> float:
    light: float = np.float32(dark) + channels[0, node[12]] + channels[1, node[13]] + channels[2, node[14]]
    return light


@njit(cache=True, nogil=True)
def _code(shown: float, low: float, high: float, contrast_of_code: Any) -> int:
    """The smallest code of `limen.vision.grades` that is no less than the larger contrast of ``shown``."""
    contrast = 0.0
    if shown + low > 0.0:
        contrast = abs(shown - low) / (shown + low)
    if shown + high > 0.0:
        contrast = max(contrast, abs(shown - high) / (shown + high))
    contrast = min(contrast * _SAFE, 1.0)
    first, last = 0, 255
    while first < last:
        middle = (first + last) // 2
        if contrast_of_code[middle] >= contrast:
            last = middle
        else:
            first = middle + 1
    return first


@njit(cache=True, nogil=True)
def decode_chunk(places: Any, nodes: Any, counts: Any, step: float, largest: float, scale: Any, channels: Any,
                 dark: float, ranges: Any, out: Any) -> None:  # fmt: skip
    """Nodes of a chunk side by side, ``out`` (6, 4681) float32: x, y, z from the chunk's origin, radius, and the lowest
    and the highest luminance below; far away where there is no node.

    ``places`` (4681, 8) uint16 and ``nodes`` (4681, 16) uint8 are the same nodes, ``scale`` (256,) float32 of codes of
    radii, ``ranges`` (585, 2).
    """
    out[:] = np.float32(0.0)
    out[0, :] = _FAR
    for level in range(CHUNK_LEVEL + 1):
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            for axis in range(3):
                out[axis, node] = np.float32(places[node, axis]) * np.float32(step)
            out[3, node] = scale[nodes[node, 6]] * np.float32(largest)
            if level > 0:
                out[4, node], out[5, node] = ranges[node, 0], ranges[node, 1]
            else:
                out[4, node] = _light(nodes[node], channels, dark)
                out[5, node] = out[4, node]


@njit(cache=True, nogil=True)
def _first_child(node: int) -> int:
    """Of an inner node of a chunk; the others lie behind it."""
    if node >= _BEGIN[1]:
        level = 1
    elif node >= _BEGIN[2]:
        level = 2
    elif node >= _BEGIN[3]:
        level = 3
    else:
        level = 4
    return _BEGIN[level - 1] + (node - _BEGIN[level]) * FAN


@njit(cache=True, nogil=True)
def _touch(x: Any, y: Any, z: Any, radius: Any, sphere: Any, meets: Any) -> None:
    """Which of some spheres meet ``sphere`` (5,): x, y, z, radius, and what rounding may do."""
    a, b, c, reach = sphere[0], sphere[1], sphere[2], sphere[3] + sphere[4]
    for i in range(x.shape[0]):
        dx, dy, dz, both = x[i] - a, y[i] - b, z[i] - c, radius[i] + reach
        meets[i] = np.int32(dx * dx + dy * dy + dz * dz <= both * both)


@njit(cache=True, nogil=True)
def _touch_children(own: Any, first: int, fan: int, x: float, y: float, z: float, reach: float) -> int:
    """Which of ``fan`` children meet a sphere, one bit each.

    Numbers without a sign spare a look at whether an index counts from the end; a constant in place of ``fan`` would
    be unrolled, and no longer run in one wide register.
    """
    bits, begin = np.uint32(0), np.uint64(first)
    for child in range(fan):
        i = begin + np.uint64(child)
        dx, dy, dz, both = own[0, i] - x, own[1, i] - y, own[2, i] - z, own[3, i] + reach
        bits |= np.uint32(dx * dx + dy * dy + dz * dz <= both * both) << np.uint32(child)
    return bits  # type: ignore[return-value]


@njit(cache=True, nogil=True)
def _keep(ids: Any, spheres: Any, count: int, sphere: Any, meets: Any, out_ids: Any, out: Any) -> int:
    """Those of the first ``count`` entries that meet ``sphere``; -1 if they are more than there is room for."""
    _touch(spheres[0, :count], spheres[1, :count], spheres[2, :count], spheres[3, :count], sphere, meets)
    kept = 0
    for k in range(count):
        if meets[k] != 0:
            if kept == out_ids.shape[0]:
                return -1
            out_ids[kept] = ids[k]
            for part in range(6):
                out[part, kept] = spheres[part, k]
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def _below(ids: Any, spheres: Any, count: int, arena: Any, slots: Any, offsets: Any, fan: int, sphere: Any,
           out_ids: Any, out: Any) -> int:  # fmt: skip
    """The children of entries that meet ``sphere``; entries that have none above the points stay themselves."""
    kept = 0
    reach = sphere[3] + sphere[4]
    for k in range(count):
        entry = ids[k]
        which = entry // CHUNK_NODES
        node = entry - which * CHUNK_NODES
        if entry < 0 or node >= _BEGIN[1]:
            out_ids[kept] = entry
            for part in range(6):
                out[part, kept] = spheres[part, k]
            kept += 1
            continue
        first = _first_child(node)
        own = arena[slots[which]]
        bits = _touch_children(
            own,
            first,
            fan,
            sphere[0] - offsets[which, 0],
            sphere[1] - offsets[which, 1],
            sphere[2] - offsets[which, 2],
            reach,
        )
        for child in range(FAN):
            if bits >> np.uint32(child) & np.uint32(1):
                out_ids[kept] = which * CHUNK_NODES + first + child
                for axis in range(3):
                    out[axis, kept] = own[axis, first + child] + offsets[which, axis]
                for part in range(3, 6):
                    out[part, kept] = own[part, first + child]
                kept += 1
    return kept


@njit(cache=True, nogil=True)
def _move_points(own: Any, first: int, fan: int, x: float, y: float, z: float, out: Any, to: int) -> None:
    begin, end = np.uint64(first), np.uint64(to)
    for child in range(fan):
        i, o = begin + np.uint64(child), end + np.uint64(child)
        out[0, o], out[1, o], out[2, o] = own[0, i] + x, own[1, i] + y, own[2, i] + z
        out[3, o], out[4, o] = own[3, i], own[4, i]


@njit(cache=True, nogil=True)
def _gather_points(ids: Any, spheres: Any, count: int, arena: Any, slots: Any, offsets: Any, fan: int, points: Any,
                   found: Any) -> int:  # fmt: skip
    """The points below entries side by side, (5, N): x, y, z, radius, luminance; returns how many.

    Entries above level 1 are not opened: their ranges widen ``found``.
    """
    total = 0
    for k in range(count):
        which = ids[k] // CHUNK_NODES
        node = ids[k] - which * CHUNK_NODES
        if ids[k] < 0 or node < _BEGIN[1]:
            found[0], found[1] = min(found[0], spheres[4, k]), max(found[1], spheres[5, k])
            continue
        first = _first_child(node)
        _move_points(
            arena[slots[which]], first, fan, offsets[which, 0], offsets[which, 1], offsets[which, 2], points, total
        )
        total += fan
    return total


@njit(cache=True, nogil=True)
def _range_of_points(x: Any, y: Any, z: Any, radius: Any, light: Any, sphere: Any, found: Any) -> None:
    """Widen ``found`` by the luminances of the points that meet ``sphere``.

    Luminances come as the bits of their numbers, int32, which are in the same order: the least of whole numbers is
    found in wide registers, that of float32 is not, for there might be a NaN among them.
    """
    a, b, c, reach = sphere[0], sphere[1], sphere[2], sphere[3] + sphere[4]
    low, high = found[0], found[1]
    for i in range(x.shape[0]):
        dx, dy, dz, both = x[i] - a, y[i] - b, z[i] - c, radius[i] + reach
        meets = dx * dx + dy * dy + dz * dz <= both * both
        low = min(low, light[i] if meets else _FAR_BITS)
        high = max(high, light[i] if meets else np.int32(0))
    found[0], found[1] = low, high


@njit(cache=True, nogil=True)
def _exact_code(node: int, own: Any, points: Any, total: int, below: Any, slack: float, shown: float,
                contrast_of_code: Any, sphere: Any, found: Any) -> int:  # fmt: skip
    """Of a node of level 1 or 2: from those of the ``total`` points that meet it, and ranges ``below``."""
    for part in range(4):
        sphere[part] = own[part, node]
    sphere[4] = slack
    found[0], found[1] = min(below[0], own[4, node]), max(below[1], own[5, node])
    _range_of_points(
        points[0, :total], points[1, :total], points[2, :total], points[3, :total], points.view(np.int32)[4, :total],
        sphere, found.view(np.int32),
    )  # fmt: skip
    code: int = _code(shown, found[0], found[1], contrast_of_code)
    return code


@njit(cache=True, nogil=True)
def chunk_contrasts(
    counts: Any, count: int, ids: Any, spheres: Any, arena: Any, slots: Any, offsets: Any, slack: float, nodes: Any,
    channels: Any, dark: float, contrast_of_code: Any, met_spheres: Any, points: Any, codes: Any,
) -> None:  # fmt: skip
    """Codes (585,) of all inner nodes of a chunk with ``counts`` (5,) nodes a level; the first is that of its root.

    What meets the root are ``count`` entries, with numbers ``ids`` (128,) and ``spheres`` (6, 128) float32: x, y, z,
    radius and range of luminance. ``arena`` (S, 6, 4681) holds chunks as `decode_chunk` leaves them, in ``slots`` (K,)
    those that entries name, the chunk itself the first, and ``offsets`` (K, 3) from its origin to theirs. ``slack`` is
    what rounding may do to a distance, ``nodes`` (4681, 16) are the chunk's, for their colours. ``met_spheres``
    (5, 6, 1024) and ``points`` (5, 8192), float32, are overwritten.
    """
    room, fan = FAN * MOST_NEAR, counts.shape[0] + 3  # eight, but the compiler must not know
    lists, list_spheres = np.empty((5, MOST_NEAR), np.int64), np.empty((5, 6, MOST_NEAR), np.float32)
    met = np.empty((5, room), np.int64)
    lengths, met_lengths = np.zeros(5, np.int64), np.zeros(5, np.int64)
    meets = np.empty(room, np.int32)
    sphere, found, below = np.empty(5, np.float32), np.empty(2, np.float32), np.empty(2, np.float32)
    sphere[4] = slack
    own = arena[slots[0]]
    lists[CHUNK_LEVEL], list_spheres[CHUNK_LEVEL], lengths[CHUNK_LEVEL] = ids, spheres, count
    for pair in range(counts[2]):
        # From the highest node that begins here down to level 2.
        level = 2
        while level < CHUNK_LEVEL and pair % FAN ** (level - 1) == 0:
            level += 1
        while level >= 2:
            node = _BEGIN[level] + pair // FAN ** (level - 2)
            for part in range(4):
                sphere[part] = own[part, node]
            if level < CHUNK_LEVEL:
                up = level + 1
                kept = _keep(
                    met[up], met_spheres[up], met_lengths[up], sphere, meets, lists[level], list_spheres[level]
                )
                if kept < 0:
                    kept = _keep(
                        lists[up], list_spheres[up], lengths[up], sphere, meets, lists[level], list_spheres[level]
                    )
                lengths[level] = kept
            reached = _below(
                lists[level], list_spheres[level], lengths[level], arena, slots, offsets, fan, sphere, met[level],
                met_spheres[level],
            )  # fmt: skip
            met_lengths[level] = reached
            if level > 2:
                found[0], found[1] = own[4, node], own[5, node]
                for k in range(reached):
                    found[0] = min(found[0], met_spheres[level, 4, k])
                    found[1] = max(found[1], met_spheres[level, 5, k])
                codes[node] = _code(_light(nodes[node], channels, dark), found[0], found[1], contrast_of_code)
            level -= 1
        below[0], below[1] = _FAR, np.float32(0.0)
        total = _gather_points(met[2], met_spheres[2], met_lengths[2], arena, slots, offsets, fan, points, below)
        codes[node] = _exact_code(
            node, own, points, total, below, slack, _light(nodes[node], channels, dark), contrast_of_code, sphere, found
        )
        first = _first_child(node)
        for child in range(first, min(first + FAN, _BEGIN[1] + counts[1])):
            codes[child] = _exact_code(
                child,
                own,
                points,
                total,
                below,
                slack,
                _light(nodes[child], channels, dark),
                contrast_of_code,
                sphere,
                found,
            )


@njit(cache=True, nogil=True)
def _top_meets(spheres: Any, a: int, b: int) -> bool:
    dx, dy, dz = spheres[a, 0] - spheres[b, 0], spheres[a, 1] - spheres[b, 1], spheres[a, 2] - spheres[b, 2]
    reach = (spheres[a, 3] + spheres[b, 3]) * _SAFE
    return bool(dx * dx + dy * dy + dz * dz <= reach * reach)


@njit(cache=True, nogil=True)
def top_contrasts(
    spheres: Any, shown: Any, begin: Any, contrast_of_code: Any, lists: Any, lengths: Any, codes: Any
) -> None:
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
            codes[node] = _code(shown[node], low, high, contrast_of_code)
            first = begin[level - 1] + (node - begin[level]) * FAN
            for child in range(first, min(first + FAN, begin[level])):
                kept = _hand_down(spheres, child, met[:count], lists[child])
                lengths[child] = (
                    kept if kept >= 0 else _hand_down(spheres, child, lists[node, : lengths[node]], lists[child])
                )


@njit(cache=True, nogil=True)
def _hand_down(spheres: Any, child: int, entries: Any, out: Any) -> int:
    """Those of the entries that meet a child; -1 if they are more than ``out`` takes."""
    kept = 0
    for k in range(entries.shape[0]):
        if _top_meets(spheres, entries[k], child):
            if kept == out.shape[0]:
                return -1
            out[kept] = entries[k]
            kept += 1
    return kept
