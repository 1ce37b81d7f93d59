"""The order of points along Hilbert's curve: keys, and a radix sort by them.

References
----------
Hamilton 2006, *Compact Hilbert Indices*, Dalhousie University CS-2006-07, section 2 (entry points and directions).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled

__all__ = [
    "DIGIT_BITS",
    "KEY_LEVELS",
    "LATTICE_BITS",
    "NUMBER_BITS",
    "box_of",
    "crowded",
    "hilbert_keys",
    "numbered",
    "round_to_lattice",
    "sort_digit",
]

LATTICE_BITS = 30
"""Places are whole numbers below ``2**30`` along each axis."""

KEY_LEVELS = 21
"""Levels that fit a 64-bit key, three bits each."""

DIGIT_BITS = 11
"""Bits that one pass of the sort looks at: counters of all digits stay in the first cache."""

NUMBER_BITS = 31
"""Of a 64-bit word that is sorted, behind three digits of a key: whose key it is."""


def _steps() -> NDArray[np.uint8]:
    """What to do at an octant: shape (192,), at ``8 * state + octant`` (x the lowest bit) the octant's number along
    the curve; shape (384,) with the state inside the octant behind it.

    A state is where the curve enters a cube (a corner, 3 bits) and along which axis it leaves (Hamilton 2006, lemmas
    2.6 and 2.8): 24 of them.
    """
    gray = [i ^ (i >> 1) for i in range(8)]
    number_of_gray = {code: i for i, code in enumerate(gray)}
    entry = [0, *(gray[2 * ((i - 1) // 2)] for i in range(1, 8))]
    trailing = [(~i & (i + 1)).bit_length() - 1 for i in range(8)]  # set bits at the low end of i
    axis = [0, *(trailing[i - 1 if i % 2 == 0 else i] % 3 for i in range(1, 8))]
    numbers, states = np.empty(192, np.uint8), np.empty(192, np.uint8)
    for start in range(8):
        for leaves in range(3):
            turn = leaves + 1
            for octant in range(8):
                number = number_of_gray[_rotated(octant ^ start, -turn)]
                inside = start ^ _rotated(entry[number], turn), (leaves + axis[number] + 1) % 3
                at = 8 * (3 * start + leaves) + octant
                numbers[at], states[at] = number, 3 * inside[0] + inside[1]
    return np.concatenate([numbers, states])


def _rotated(bits: int, left: int) -> int:
    """Three bits turned to the left."""
    left %= 3
    return ((bits << left) | (bits >> (3 - left))) & 7


def _double_steps() -> NDArray[np.uint16]:
    """Two levels at once: at ``64 * state + 8 * octant + octant inside`` six bits of key, the state above them."""
    one = _steps().astype(np.uint16)
    number, state = one[:192].reshape(24, 8), one[192:].reshape(24, 8)
    first = np.repeat(np.arange(8), 8)
    second = np.tile(np.arange(8), 8)
    between = state[:, first]
    return (state[between, second] << 6 | number[:, first] << 3 | number[between, second]).astype(np.uint16).ravel()


_STEPS = _steps()
_DOUBLE = _double_steps()


@compiled(error_model="python")
def box_of(places: Any, box: Any) -> None:
    """Lowest and highest coordinates of places (N, 3) into ``box`` (2, 3): NumPy takes twenty times as long."""
    x, y, z = places[0, 0], places[0, 1], places[0, 2]
    u, v, w = x, y, z
    for i in range(places.shape[0]):
        a, b, c = places[i, 0], places[i, 1], places[i, 2]
        x, y, z = min(x, a), min(y, b), min(z, c)
        u, v, w = max(u, a), max(v, b), max(w, c)
    box[0, 0], box[0, 1], box[0, 2], box[1, 0], box[1, 1], box[1, 2] = x, y, z, u, v, w


@compiled(error_model="python")
def crowded(words: Any, longest: int) -> int:
    """How many of some sorted words (N,) are among more than ``longest`` whose keys are equal."""
    found, begin, behind = 0, 0, np.uint64(NUMBER_BITS)
    for i in range(1, words.shape[0] + 1):
        if i == words.shape[0] or words[i] >> behind != words[begin] >> behind:
            if i - begin > longest:
                found += i - begin
            begin = i
    return found


@compiled(error_model="python")
def round_to_lattice(positions: Any, low: Any, step: float, places: Any) -> None:
    """The nearest places (N, 3) int32 of positions (N, 3); what lies outside is moved to the border."""
    per_step, most = 1.0 / step, float((1 << LATTICE_BITS) - 1)
    for i in range(positions.shape[0]):
        for axis in range(3):
            place = (positions[i, axis] - low[axis]) * per_step + 0.5
            places[i, axis] = np.int32(min(max(place, 0.0), most))


@compiled(error_model="python")
def _spread(number: Any) -> Any:
    """Two zeros behind each of 21 bits."""
    bits = np.uint64(number)
    bits = (bits | bits << np.uint64(32)) & np.uint64(0x1F00000000FFFF)
    bits = (bits | bits << np.uint64(16)) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | bits << np.uint64(8)) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | bits << np.uint64(4)) & np.uint64(0x10C30C30C30C30C3)
    return (bits | bits << np.uint64(2)) & np.uint64(0x1249249249249249)


@compiled(error_model="python")
def hilbert_keys(places: Any, levels: int, keys: Any) -> None:
    """Keys (N,) uint64 of ``3 * levels`` bits, for the top bits of places (N, 3) int32 on the lattice."""
    down = LATTICE_BITS - levels
    for i in range(places.shape[0]):
        x, y, z = _spread(places[i, 0] >> down), _spread(places[i, 1] >> down), _spread(places[i, 2] >> down)
        keys[i] = x | y << np.uint64(1) | z << np.uint64(2)
    # Octants now follow each other, the largest first.
    pairs, odd, top = levels // 2, levels % 2, np.uint64(3 * levels)
    for i in range(keys.shape[0]):
        octants, key, state, shift = keys[i], np.uint64(0), np.uint64(0), top
        for _ in range(pairs):
            shift -= np.uint64(6)
            step = np.uint64(_DOUBLE[state << np.uint64(6) | octants >> shift & np.uint64(63)])
            key = key << np.uint64(6) | step & np.uint64(63)
            state = step >> np.uint64(6)
        if odd:
            key = key << np.uint64(3) | np.uint64(_STEPS[state << np.uint64(3) | octants & np.uint64(7)])
        keys[i] = key


@compiled(error_model="python")
def numbered(keys: Any, order: Any, shift: int, words: Any, counts: Any) -> None:
    """Bits of keys (N,) from ``shift`` on with what stands in ``order`` (N,) behind them, in its order: ``words`` (N,).

    ``counts`` (3, 2048) are how often each of their digits is there.
    """
    down, digit = np.uint64(shift), np.uint64((1 << DIGIT_BITS) - 1)
    counts[:] = 0
    for i in range(order.shape[0]):
        key = (keys[order[i]] >> down) & np.uint64((1 << 3 * DIGIT_BITS) - 1)
        counts[0, key & digit] += np.int64(1)
        counts[1, key >> np.uint64(DIGIT_BITS) & digit] += np.int64(1)
        counts[2, key >> np.uint64(2 * DIGIT_BITS)] += np.int64(1)
        words[i] = key << np.uint64(NUMBER_BITS) | np.uint64(order[i])


@compiled(error_model="python")
def sort_digit(words: Any, number: int, counts: Any, out: Any) -> None:
    """One stable pass by a digit of words (N,), of which there are ``counts`` (3, 2048), which are overwritten."""
    begin, down, digit = 0, np.uint64(NUMBER_BITS + number * DIGIT_BITS), np.uint64((1 << DIGIT_BITS) - 1)
    for value in range(1 << DIGIT_BITS):
        count = counts[number, value]
        counts[number, value] = begin
        begin += count
    for i in range(words.shape[0]):
        own = words[i] >> down & digit
        to = counts[number, own]
        counts[number, own] = to + 1
        out[to] = words[i]
