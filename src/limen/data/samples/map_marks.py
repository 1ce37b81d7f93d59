"""What a map maker adds: a graticule with numbers, names of cities, and the chart that one reads from afar."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.samples.glyphs import CONSONANTS, DOTS, VOWELS
from limen.data.samples.land import mix, unit
from limen.data.samples.noise import random_at, smooth_step

__all__ = ["chart_texel", "graticule_ink", "label_ink"]

GRATICULE_PX = 2048
_CHART_ROWS = 22
_TITLE = (11, 8, 12, 4, 13)  # LIMEN


@compiled
def glyph_ink(code: Any, u: Any, v: Any, dot_px: Any) -> Any:
    """0 .. 1 inside a letter; (u, v) in dots from its top left corner. Large letters get round corners."""
    if u < -0.5 or v < -0.5 or u > 5.5 or v > 7.5:
        return 0.0
    if dot_px < 3.0:
        iu, iv = math.floor(u), math.floor(v)
        inside = 0 <= iu < 5 and 0 <= iv < 7
        return float(DOTS[code, iv, iu]) if inside else 0.0
    iu, iv = math.floor(u - 0.5), math.floor(v - 0.5)
    fu, fv = u - 0.5 - iu, v - 0.5 - iv
    total = 0.0
    for k in range(4):
        a, b = iu + k % 2, iv + k // 2
        if 0 <= a < 5 and 0 <= b < 7 and DOTS[code, b, a]:
            total += (fu if k % 2 else 1.0 - fu) * (fv if k // 2 else 1.0 - fv)
    soft = min(0.5, 0.9 / dot_px)
    return smooth_step(0.46 - soft, 0.46 + soft, total)


@compiled
def _number_ink(value: Any, digits: Any, u: Any, v: Any, dot_px: Any) -> Any:
    """A decimal number of so many digits, letters 6 dots apart."""
    place = math.floor(u / 6.0)
    if place < 0 or place >= digits:
        return 0.0
    digit = value // 10 ** (digits - 1 - place) % 10
    return glyph_ink(26 + digit, u - 6.0 * place, v, dot_px)


@compiled
def graticule_ink(x: Any, y: Any) -> Any:
    """Lines every 2048 texels with ticks like a ruler's, and at each crossing its place in texels."""
    step = GRATICULE_PX
    fx, fy = x & (step - 1), y & (step - 1)
    if fx > 108 and fy > 46 and min(fx, fy) > 28:
        return 0.0
    if fx == 0 or fy == 0:
        return 0.42
    near, along = (fx, fy) if fx < fy else (fy, fx)
    if along % 16 == 0 and near <= (28 if along % 256 == 0 else 14 if along % 64 == 0 else 6):
        return 0.42
    if 8 <= fx < 108 and 8 <= fy < 46:
        column, line = (fx - 8) / 2.0, (fy - 8) / 2.0
        value = np.int64(x // step * step) if line < 9.5 else np.int64(y // step * step)
        code = 23 if line < 9.5 else 24
        row = line if line < 9.5 else line - 10.0
        if column < 6.0:
            return 0.75 * glyph_ink(code, column, row, 2.0)
        return 0.75 * _number_ink(value, 6, column - 8.0, row, 2.0)
    return 0.0


@compiled
def _letter_of(bits: Any, place: Any) -> Any:
    if place % 2 == 0:
        return CONSONANTS[np.int64((bits >> np.uint64(4 * place)) & np.uint64(15))]
    return VOWELS[np.int64((bits >> np.uint64(4 * place)) & np.uint64(7))]


@compiled
def label_ink(bits: Any, dx: Any, dy: Any, dot_px: Any) -> Any:
    """(ink, halo) of a city's name; (dx, dy) in texels from the middle of the name."""
    letters = 4 + np.int64(bits & np.uint64(3)) + np.int64((bits >> np.uint64(2)) & np.uint64(1))
    u, v = dx / dot_px + 3.0 * letters - 0.5, dy / dot_px + 3.5
    if u < -1.0 or v < -1.0 or u > 6.0 * letters or v > 8.0:
        return 0.0, 0.0
    place = min(max(math.floor(u / 6.0), 0), letters - 1)
    ink = glyph_ink(_letter_of(bits, place), u - 6.0 * place, v, dot_px)
    return ink, 1.0


@compiled
def chart_texel(seed: Any, x: Any, y: Any, wide: Any, high: Any) -> Any:
    """Colour of the reading chart: letters that shrink to single texels, gratings, a scale."""
    edge = min(min(x, wide - 1 - x), min(y, high - 1 - y))
    paper, ink = (0.955, 0.935, 0.880), (0.13, 0.13, 0.16)
    rule = max(1.0, wide / 600.0)
    if 3.0 * rule <= edge < 4.0 * rule or 5.5 * rule <= edge < 8.0 * rule:
        return ink
    share = y / high
    if share > 0.80:
        return mix(paper, ink, _gratings(x - 0.07 * wide, y - 0.83 * high, 0.86 * wide, 0.11 * high))
    top, dot = 0.07 * high, 0.74 * wide / 29.0
    for row in range(_CHART_ROWS):
        if dot < 1.0:
            break
        whole = max(1.0, math.floor(dot))
        if y < top:
            break
        if y < top + 7.0 * whole:
            amount = _chart_row(seed, row, x - 0.5 * wide, (y - top) / whole, whole, wide)
            return mix(paper, ink, amount)
        top += 7.0 * whole + max(3.0, 2.6 * whole)
        dot *= 0.62 if row == 0 else 0.74
        if top + 7.0 * dot > 0.79 * high:
            break
    return paper


@compiled
def _chart_row(seed: Any, row: Any, dx: Any, v: Any, dot_px: Any, wide: Any) -> Any:
    letters = 5 if row == 0 else min(5 + 2 * row, np.int64(0.80 * wide / (6.0 * dot_px)))
    u = dx / dot_px + 3.0 * letters - 0.5
    place = np.int64(math.floor(u / 6.0))
    if place < 0 or place >= letters:
        return 0.0
    code = _TITLE[place] if row == 0 else np.int64(random_at(seed + 40 + row, place, row) % np.uint64(26))
    return glyph_ink(code, u - 6.0 * place, v, dot_px)


@compiled
def _gratings(x: Any, y: Any, wide: Any, high: Any) -> Any:
    """Eight patches with lines 2, 3, 4, 6, 8, 12, 16 and 24 texels apart, upright above and level below."""
    if x < 0 or y < 0 or x >= wide or y >= high:
        return 0.0
    number = np.int64(8.0 * x / wide)
    inside = x - number * wide / 8.0
    if inside > 0.92 * wide / 8.0 or 0.47 * high < y < 0.53 * high:
        return 0.0
    period = 2
    for k in range(number):
        period = period + period // 2 if k % 2 == 0 else period + (period + 2) // 3
    along = np.int64(x) if y < 0.5 * high else np.int64(y)
    return 0.92 if (2 * (along % period)) < period else 0.0


@compiled
def city_bits(seed: Any, ix: Any, iy: Any) -> Any:
    return random_at(seed + 50, ix, iy)


@compiled
def name_size_px(bits: Any) -> Any:
    """Texels a dot of a city's name: big cities have big names."""
    return 3.0 + math.floor(6.0 * unit(bits, 20) * unit(bits, 20))
