"""Texels of a terrain's pages, post by post: relief (normals) and coded heights, and their halving."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["MOST_CODE", "halve", "texels_of_posts"]

MOST_CODE = (1 << 24) - 1
"""The code of the highest height."""


@compiled
def texels_of_posts(
    heights_m: Any, void: Any, spacing_x: Any, spacing_y: Any, low_m: Any, high_m: Any, relief: Any, coded: Any
) -> None:
    """RGBA of every post into ``relief`` and ``coded``, both uint8 (rows, columns, 4).

    Normals by central differences, one-sided in the first and last row and column.
    """
    rows, columns = heights_m.shape
    per_metre = MOST_CODE / (np.float64(high_m) - np.float64(low_m))
    for j in range(rows):
        above, below = max(j - 1, 0), min(j + 1, rows - 1)
        for i in range(columns):
            left, right = max(i - 1, 0), min(i + 1, columns - 1)
            east = (np.float64(heights_m[j, right]) - heights_m[j, left]) / ((right - left) * spacing_x)
            north = (np.float64(heights_m[above, i]) - heights_m[below, i]) / ((below - above) * spacing_y)
            up = 1.0 / np.sqrt(1.0 + east * east + north * north)
            relief[j, i, 0] = np.uint8(127.5 - 127.5 * east * up + 0.5)
            relief[j, i, 1] = np.uint8(127.5 - 127.5 * north * up + 0.5)
            relief[j, i, 2] = np.uint8(127.5 + 127.5 * up + 0.5)
            code: Any = np.int64((np.float64(heights_m[j, i]) - low_m) * per_metre + 0.5)
            code = min(max(code, 0), MOST_CODE)
            coded[j, i, 0], coded[j, i, 1], coded[j, i, 2] = code >> 16, (code >> 8) & 255, code & 255
            share = 0 if void[j, i] else 255
            relief[j, i, 3] = share
            coded[j, i, 3] = share


@compiled
def _rounded(total: Any, count: Any) -> Any:
    """The quotient of whole numbers, halves to the even one: rounding up would add an eighth of a code every level."""
    whole, rest = total // count, total % count
    if 2 * rest > count or (2 * rest == count and whole % 2 == 1):
        return whole + 1
    return whole


@compiled
def halve(fine: Any, coarse: Any, whole: bool) -> None:
    """Means of 2 x 2 texels weighted by the share of valid posts; uint8 (rows, columns, 4), sizes rounded up.

    ``whole``: the three bytes are one number, as of heights; otherwise each is one, as of relief.
    """
    rows, columns = fine.shape[0], fine.shape[1]
    for j in range(coarse.shape[0]):
        last_row = min(2 * j + 2, rows)
        for i in range(coarse.shape[1]):
            last_column = min(2 * i + 2, columns)
            count = (last_row - 2 * j) * (last_column - 2 * i)
            share: Any = 0
            for y in range(2 * j, last_row):
                for x in range(2 * i, last_column):
                    share += np.int64(fine[y, x, 3])
            for channel in range(1 if whole else 3):
                total: Any = 0
                for y in range(2 * j, last_row):
                    for x in range(2 * i, last_column):
                        number = np.int64(fine[y, x, channel])
                        if whole:
                            number = number * 65536 + np.int64(fine[y, x, 1]) * 256 + np.int64(fine[y, x, 2])
                        total += number * np.int64(fine[y, x, 3]) if share > 0 else number
                mean = _rounded(total, share if share > 0 else count)
                if whole:
                    coarse[j, i, 0], coarse[j, i, 1], coarse[j, i, 2] = mean >> 16, (mean >> 8) & 255, mean & 255
                else:
                    coarse[j, i, channel] = mean
            coarse[j, i, 3] = _rounded(share, count)
