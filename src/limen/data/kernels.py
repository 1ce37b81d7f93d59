"""Halving image rows in linear light: the one hot loop of building pyramids."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["HALO", "halve_rows"]

HALO = 3
"""Fine rows (and columns) needed on either side of those that are halved."""


@njit(cache=True, nogil=True)
def _load(row: Any, line: Any, first: int, to_light: Any) -> None:
    """Linear light of fine columns ``first ...`` of one row, colours weighed by opacity where there is a 4th band."""
    width, bands = row.shape
    count = line.shape[0] // bands
    for i in range(count):
        x = min(max(first + i, 0), width - 1)
        at = i * bands
        if bands == 3:
            line[at] = to_light[row[x, 0]]
            line[at + 1] = to_light[row[x, 1]]
            line[at + 2] = to_light[row[x, 2]]
        else:
            opacity = np.float32(row[x, 3]) * np.float32(1.0 / 255.0)
            line[at] = to_light[row[x, 0]] * opacity
            line[at + 1] = to_light[row[x, 1]] * opacity
            line[at + 2] = to_light[row[x, 2]] * opacity
            line[at + 3] = opacity


@njit(cache=True, nogil=True)
def _weigh_rows(ring: Any, first: int, line: Any, taps: Any) -> None:
    """The vertical half: contiguous, so that the compiler vectorises it."""
    r0, r1, r2, r3 = ring[first % 8], ring[(first + 1) % 8], ring[(first + 2) % 8], ring[(first + 3) % 8]
    r4, r5, r6, r7 = ring[(first + 4) % 8], ring[(first + 5) % 8], ring[(first + 6) % 8], ring[(first + 7) % 8]
    t0, t1, t2, t3 = taps[0], taps[1], taps[2], taps[3]
    for i in range(line.shape[0]):
        line[i] = t0 * (r0[i] + r7[i]) + t1 * (r1[i] + r6[i]) + t2 * (r2[i] + r5[i]) + t3 * (r3[i] + r4[i])


@njit(cache=True, nogil=True)
def _weigh_columns(line: Any, out: Any, taps: Any, to_code: Any) -> None:
    """The horizontal half, and back to 8-bit codes. ``out`` is (columns, bands)."""
    columns, bands = out.shape
    t0, t1, t2, t3 = taps[0], taps[1], taps[2], taps[3]
    top = np.float32(65535.0)
    half = np.float32(0.5)
    for x in range(columns):
        weight = np.float32(1.0)
        for back in range(bands):
            band = bands - 1 - back  # opacity first
            p = 2 * x * bands + band
            light = (
                t0 * (line[p] + line[p + 7 * bands])
                + t1 * (line[p + bands] + line[p + 6 * bands])
                + t2 * (line[p + 2 * bands] + line[p + 5 * bands])
                + t3 * (line[p + 3 * bands] + line[p + 4 * bands])
            )
            if band == 3:
                opacity = min(max(light, np.float32(0.0)), np.float32(1.0))
                out[x, 3] = np.uint8(opacity * np.float32(255.0) + half)
                weight = np.float32(1.0) / max(opacity, np.float32(1e-6))
            else:
                light = min(max(light * weight * top + half, half), top)
                out[x, band] = to_code[np.int32(light)]


@njit(cache=True, nogil=True)
def halve_rows(fine: Any, coarse: Any, first: int, last: int, taps: Any, to_light: Any, to_code: Any) -> None:
    """Columns ``first .. last`` of ``coarse`` (n, columns, bands) from ``fine`` (2 n + 6, width, bands), uint8.

    ``fine`` starts 3 rows above the first that is halved and ends 3 below the last; columns beyond its width repeat
    the last one. ``taps`` (8,) must be symmetric.
    """
    bands = fine.shape[2]
    ring = np.empty((8, (2 * (last - first) + 2 * HALO) * bands), dtype=np.float32)
    line = np.empty(ring.shape[1], dtype=np.float32)
    left = 2 * first - HALO
    for row in range(6):
        _load(fine[row], ring[row], left, to_light)
    for row in range(coarse.shape[0]):
        _load(fine[2 * row + 6], ring[(2 * row + 6) % 8], left, to_light)
        _load(fine[2 * row + 7], ring[(2 * row + 7) % 8], left, to_light)
        _weigh_rows(ring, 2 * row, line, taps)
        _weigh_columns(line, coarse[row, first:last], taps, to_code)
