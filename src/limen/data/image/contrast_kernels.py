"""What a finer page adds to a coarser one: the hot loops of measuring contrast.

Rows are worked on in three steps, so that the middle one, all the arithmetic, holds no look-ups and runs in wide
registers. Arrays over a row's texels are (3, columns): bands or mechanisms first.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["BLOCK", "WINDOW_BLOCKS", "largest_contrasts"]

BLOCK = 8
"""Edge of the squares, in texels, whose energy is summed first; windows begin where they do."""

WINDOW_BLOCKS = (4, 2, 2)
"""Edges of windows in blocks, for luminance and the two colours; at a quarter's borders they are cut to half."""

_MOST_ENERGY = np.float32(4.0)
"""A contrast counts up to 2, for a lone star in the dark would outshine any grating."""

# Catmull-Rom at distances 1/4, 3/4, 5/4 and 7/4: texels of the finer grid lie a quarter beside those of the coarser.
_NEAR, _NEXT, _FAR, _LAST = (np.float32(x) for x in (0.8671875, 0.2265625, -0.0703125, -0.0234375))


@compiled(error_model="python")
def _widen(coarse: Any, left: Any, top: Any, light: Any, wide: Any) -> None:
    """Rows ``top - 2 ..`` of the coarse page in linear light, twice as wide: ``wide`` is (rows, 3, 2 n)."""
    line = np.empty(wide.shape[2] // 2 + 4, dtype=np.float32)
    for row in range(wide.shape[0]):
        for band in range(3):
            for i in range(line.shape[0]):
                line[i] = light[coarse[top - 2 + row, left - 2 + i, band]]
            for k in range(wide.shape[2] // 2):
                a, b, c, d, e = line[k], line[k + 1], line[k + 2], line[k + 3], line[k + 4]
                wide[row, band, 2 * k] = _LAST * a + _NEXT * b + _NEAR * c + _FAR * d
                wide[row, band, 2 * k + 1] = _FAR * b + _NEAR * c + _NEXT * d + _LAST * e


@compiled(error_model="python")
def _heighten(wide: Any, y: Any, line: Any) -> None:
    """Row ``y`` of the finer grid, held to what a display shows: ``line`` is (3, columns)."""
    first = (y + 1) // 2
    near, beside = (_NEXT, _NEAR) if y % 2 == 0 else (_NEAR, _NEXT)
    outer, other = (_LAST, _FAR) if y % 2 == 0 else (_FAR, _LAST)
    for band in range(3):
        a, b, c, d = wide[first, band], wide[first + 1, band], wide[first + 2, band], wide[first + 3, band]
        for i in range(line.shape[1]):
            value = outer * a[i] + near * b[i] + beside * c[i] + other * d[i]
            line[band, i] = min(max(value, np.float32(0.0)), np.float32(1.0))


@compiled(error_model="python")
def _look_up(texels: Any, light: Any, low: Any, high: Any, below: Any, above: Any, same: Any) -> None:
    """A row of the finer page in linear light, and whether rounding can have made what is drawn without it."""
    for x in range(same.shape[0]):
        r, g, b = texels[x, 0], texels[x, 1], texels[x, 2]
        above[0, x], above[1, x], above[2, x] = light[r], light[g], light[b]
        u, v, w = below[0, x], below[1, x], below[2, x]
        # Not `and`: whether texels are the same can hardly be predicted, and a wrong guess costs more than looking.
        same[x] = (low[r] <= u) & (u <= high[r]) & (low[g] <= v) & (v <= high[g]) & (low[b] <= w) & (w <= high[b])


@compiled
def _contrast_energies(
    below: Any, above: Any, same: Any, mechanisms: Any, black: Any, energies: Any, dark: Any
) -> None:
    """Squares of a row's contrasts before darkness discounts them, and 255 times the root of its luminance."""
    luminance_of, cones_of, red_of, violet_of = mechanisms[0], mechanisms[1], mechanisms[2], mechanisms[3]
    none, all_of_it, steps = np.float32(0.0), np.float32(1.0), np.float32(255.0)
    for x in range(dark.shape[0]):
        u, v, w = below[0, x], below[1, x], below[2, x]
        dr, dg, db = above[0, x] - u, above[1, x] - v, above[2, x] - w
        luminance = luminance_of[0] * u + luminance_of[1] * v + luminance_of[2] * w
        cones = cones_of[0] * u + cones_of[1] * v + cones_of[2] * w
        counts = none if same[x] else all_of_it
        per_luminance, per_cones = counts / (luminance + black), counts / (cones + black)
        white = (luminance_of[0] * dr + luminance_of[1] * dg + luminance_of[2] * db) * per_luminance
        red = (red_of[0] * dr + red_of[1] * dg + red_of[2] * db) * per_cones
        violet = (violet_of[0] * dr + violet_of[1] * dg + violet_of[2] * db) * per_cones
        energies[0, x], energies[1, x], energies[2, x] = white * white, red * red, violet * violet
        dark[x] = min(np.int32(np.ceil(np.sqrt(luminance) * steps)), np.int32(255))


@compiled(error_model="python")
def _add_to_blocks(energies: Any, dark: Any, discount: Any, blocks: Any) -> None:
    """Add a row's energies to those of its row of blocks, (blocks, 3)."""
    columns = dark.shape[0]
    for k in range((columns + BLOCK - 1) // BLOCK):
        white = red = violet = np.float32(0.0)
        for x in range(k * BLOCK, min((k + 1) * BLOCK, columns)):
            white += min(energies[0, x] * discount[0, dark[x]], _MOST_ENERGY)
            red += min(energies[1, x] * discount[1, dark[x]], _MOST_ENERGY)
            violet += min(energies[2, x] * discount[2, dark[x]], _MOST_ENERGY)
        blocks[k, 0] += white
        blocks[k, 1] += red
        blocks[k, 2] += violet


@compiled(error_model="python")
def _strongest_window(blocks: Any, edge: Any, rows: Any, columns: Any) -> Any:
    """The largest contrast of all windows of ``edge`` x ``edge`` blocks (n, m), of ``rows`` x ``columns`` texels."""
    half, most = edge // 2, 0.0
    # What little of an image reaches into a window at its edge is not thereby an image of its own.
    fewest = (half * BLOCK) ** 2
    for top in range(-half, blocks.shape[0] - half + 1):
        first, last = max(top, 0), min(top + edge, blocks.shape[0])
        height = min(last * BLOCK, rows) - first * BLOCK
        for left in range(-half, blocks.shape[1] - half + 1):
            start, end = max(left, 0), min(left + edge, blocks.shape[1])
            energy = 0.0
            for i in range(first, last):
                for k in range(start, end):
                    energy += blocks[i, k]
            most = max(most, energy / max(height * (min(end * BLOCK, columns) - start * BLOCK), fewest))
    return np.sqrt(2.0 * most)  # the mean energy of a grating is half the square of its contrast


@compiled(error_model="python")
def largest_contrasts(
    coarse: Any,
    fine: Any,
    left: Any,
    top: Any,
    rows: Any,
    columns: Any,
    light: Any,
    low: Any,
    high: Any,
    mechanisms: Any,
    discount: Any,
    black: Any,
    found: Any,
) -> None:
    """Raise ``found`` (3,) to the largest windowed contrasts (achromatic, red-green, yellow-violet) of ``fine``.

    ``coarse`` (n, m, 3 or more) and ``fine`` (256, 256, 3 or more) are uint8; the coarse texel (left, top) lies over
    the first four fine ones, and two more are there on every side. Only the first ``rows`` and ``columns`` of
    ``fine`` count. ``light``, ``low``, ``high`` (256,) are linear light of a code and of what rounding may have made
    it from, ``mechanisms`` (4, 3) the weights of linear sRGB in luminance, in cone luminance and in the two opponent
    colours, ``discount`` (3, 256) what darkness leaves of each one's energy over the root of luminance, ``black`` a
    display's black.
    """
    wide = np.empty((fine.shape[0] // 2 + 4, 3, fine.shape[1]), dtype=np.float32)
    line = np.empty((3, fine.shape[1]), dtype=np.float32)
    above = np.empty((3, columns), dtype=np.float32)
    energies = np.empty((3, columns), dtype=np.float32)
    dark = np.empty(columns, dtype=np.int32)
    same = np.empty(columns, dtype=np.bool_)
    blocks = np.zeros(((rows + BLOCK - 1) // BLOCK, (columns + BLOCK - 1) // BLOCK, 3), dtype=np.float32)
    _widen(coarse, left, top, light, wide)
    for y in range(rows):
        _heighten(wide, y, line)
        _look_up(fine[y], light, low, high, line, above, same)
        if not same.all():
            _contrast_energies(line, above, same, mechanisms, black, energies, dark)
            _add_to_blocks(energies, dark, discount, blocks[y // BLOCK])
    for mechanism in range(3):
        strongest = _strongest_window(blocks[:, :, mechanism], WINDOW_BLOCKS[mechanism], rows, columns)
        found[mechanism] = max(found[mechanism], strongest)
