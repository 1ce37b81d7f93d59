"""What a finer page adds to a coarser one: the one hot loop of measuring contrast."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["largest_contrasts"]

# Catmull-Rom at distances 1/4, 3/4, 5/4 and 7/4: texels of the finer grid lie a quarter beside those of the coarser.
_NEAR, _NEXT, _FAR, _LAST = (np.float32(x) for x in (0.8671875, 0.2265625, -0.0703125, -0.0234375))


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True, error_model="numpy")
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
    """Raise ``found`` (3,) to the largest contrasts (achromatic, red-green, yellow-violet) that ``fine`` adds.

    ``coarse`` (n, m, 3 or more) and ``fine`` (256, 256, 3 or more) are uint8; the coarse texel (left, top) lies over
    the first four fine ones, and two more are there on every side. Only the first ``rows`` and ``columns`` of
    ``fine`` count. ``light``, ``low``, ``high`` (256,) are linear light of a code and of what rounding may have made
    it from, ``mechanisms`` (4, 3) the weights of linear sRGB in luminance, in cone luminance and in the two opponent
    colours, ``discount`` (3, 256) what darkness leaves of each over the root of luminance, ``black`` a display's black.
    """
    wide = np.empty((fine.shape[0] // 2 + 4, 3, fine.shape[1]), dtype=np.float32)
    line = np.empty((3, fine.shape[1]), dtype=np.float32)
    _widen(coarse, left, top, light, wide)
    most_a, most_r, most_y = found[0], found[1], found[2]
    steps = np.float32(255.0)
    for y in range(rows):
        _heighten(wide, y, line)
        for x in range(columns):
            r, g, b = fine[y, x, 0], fine[y, x, 1], fine[y, x, 2]
            u, v, w = line[0, x], line[1, x], line[2, x]
            dr, dg, db = light[r] - u, light[g] - v, light[b] - w
            luminance = mechanisms[0, 0] * u + mechanisms[0, 1] * v + mechanisms[0, 2] * w
            cones = mechanisms[1, 0] * u + mechanisms[1, 1] * v + mechanisms[1, 2] * w
            white = abs(mechanisms[0, 0] * dr + mechanisms[0, 1] * dg + mechanisms[0, 2] * db)
            red = abs(mechanisms[2, 0] * dr + mechanisms[2, 1] * dg + mechanisms[2, 2] * db)
            violet = abs(mechanisms[3, 0] * dr + mechanisms[3, 1] * dg + mechanisms[3, 2] * db)
            # Darkness only discounts, so most texels are known to be less than what was found already.
            back, backs = luminance + black, cones + black
            if white <= most_a * back and red <= most_r * backs and violet <= most_y * backs:
                continue
            if low[r] <= u <= high[r] and low[g] <= v <= high[g] and low[b] <= w <= high[b]:
                continue
            dark = min(int(np.ceil(np.sqrt(luminance) * steps)), 255)
            most_a = max(most_a, white / back * discount[0, dark])
            most_r = max(most_r, red / backs * discount[1, dark])
            most_y = max(most_y, violet / backs * discount[2, dark])
    found[0], found[1], found[2] = most_a, most_r, most_y
