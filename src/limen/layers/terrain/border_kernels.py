"""Compiled part of `limen.layers.terrain.borders`."""

from __future__ import annotations

import numpy as np

from limen.compiled import compiled

__all__ = ["BORDER_FIRST", "LINE", "RIM_FIRST", "SLOT_COLUMNS", "fan_rims"]

RIM_FIRST, BORDER_FIRST, LINE = 0, 5, 10
SLOT_COLUMNS = 14
"""A slot's row: where the rims of its four sides begin and the last ends, the same of border vertices, four lines."""

_BITS = 28  # posts of a terrain along either side


@compiled(error_model="python")
def _line_key(side, line, beyond):
    """A border line, and from which side of it: sorts sides so that those face each other that differ in one bit.

    ``beyond`` (0 or 1): asked for is the key of whoever lies on the line's other side.
    """
    axis = side & 1
    after = 1 if side == 0 or side == 3 else 0  # below its first row, right of its first column
    return (((axis << _BITS) | line) << 1) | (after ^ beyond)


@compiled(error_model="python")
def _sides_by_line(slot_of, first, last, slots, border):
    """The sides of a panel's pairs, sorted along their lines: keys, and four times pair plus side."""
    keys = np.empty(4 * (last - first), np.int64)
    for pair in range(first, last):
        slot = slot_of[pair]
        for side in range(4):
            begin = border[slots[slot, BORDER_FIRST + side], 0]
            keys[4 * (pair - first) + side] = (_line_key(side, slots[slot, LINE + side], 0) << _BITS) | begin
    order = np.argsort(keys)
    return keys[order], order


@compiled(error_model="python")
def _first_above(border, begin, end, position):
    """The first border vertex of a range that lies farther along than a position."""
    while begin < end:
        middle = (begin + end) // 2
        if border[middle, 0] <= position:
            begin = middle + 1
        else:
            end = middle
    return begin


@compiled(error_model="python")
def _emit(out, count, apex, low, high, turned):
    out[count, 0] = apex
    out[count, 1], out[count, 2] = (high, low) if turned else (low, high)
    return count + 1


@compiled(error_model="python")
def fan_rims(pair_first, slot_of, slots, rims, border, out, panel_first):
    """All rim triangles of every panel's pairs as fans, one panel after the other.

    Parameters
    ----------
    pair_first
        The pairs of panel ``p`` are ``pair_first[p]`` up to ``pair_first[p + 1]``, shape (N + 1,).
    slot_of
        Row of ``slots`` of every pair's patch, shape (M,).
    rims, border
        The pool; see `limen.layers.terrain.borders.BorderPool`.
    out
        Takes the triangles, uint32 (T, 3), long enough for every rim and border vertex of all pairs.
    panel_first
        Takes where each panel's triangles begin, and the last ends, shape (N + 1,).
    """
    count = 0
    for p in range(len(pair_first) - 1):
        panel_first[p] = count
        first, last = pair_first[p], pair_first[p + 1]
        if first == last:
            continue
        keys, order = _sides_by_line(slot_of, first, last, slots, border)
        for pair in range(first, last):
            slot = slot_of[pair]
            for side in range(4):
                rim, rim_end = slots[slot, RIM_FIRST + side], slots[slot, RIM_FIRST + side + 1]
                if rim == rim_end:
                    continue
                facing = _line_key(side, slots[slot, LINE + side], 1)
                # The last neighbour that begins no farther along than the first rim, if there is one, else the next.
                e = max(np.searchsorted(keys, (facing << _BITS) | rims[rim, 3], side="right") - 1, 0)
                b, b_end = 0, 0
                while rim < rim_end:
                    low, position = rims[rim, 1], rims[rim, 3]
                    while True:
                        if b == b_end:
                            if e == len(keys) or (keys[e] >> _BITS) > facing:
                                break
                            if (keys[e] >> _BITS) == facing:
                                other, its = slot_of[first + order[e] // 4], order[e] % 4
                                b_end = slots[other, BORDER_FIRST + its + 1]
                                b = _first_above(border, slots[other, BORDER_FIRST + its], b_end, position)
                            e += 1
                        elif border[b, 0] <= position:
                            b += 1
                        elif border[b, 0] < rims[rim, 4]:
                            count = _emit(out, count, rims[rim, 0], low, border[b, 1], rims[rim, 5])
                            low, position = border[b, 1], border[b, 0]
                            b += 1
                        else:
                            break
                    count = _emit(out, count, rims[rim, 0], low, rims[rim, 2], rims[rim, 5])
                    rim += 1
    panel_first[len(pair_first) - 1] = count
    return count
