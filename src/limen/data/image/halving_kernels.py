"""Halving image rows in linear light: the one hot loop of building pyramids."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["HALO", "halve_rows"]

HALO = 5
"""Fine rows (and columns) needed on either side of those that are halved: three, and two for a coarse neighbour."""


@compiled(error_model="python")
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


@compiled(error_model="python")
def _weigh_rows(ring: Any, first: int, line: Any, taps: Any) -> None:
    """The vertical half: contiguous, so that the compiler vectorises it."""
    r0, r1, r2, r3 = ring[first % 8], ring[(first + 1) % 8], ring[(first + 2) % 8], ring[(first + 3) % 8]
    r4, r5, r6, r7 = ring[(first + 4) % 8], ring[(first + 5) % 8], ring[(first + 6) % 8], ring[(first + 7) % 8]
    t0, t1, t2, t3 = taps[0], taps[1], taps[2], taps[3]
    for i in range(line.shape[0]):
        line[i] = t0 * (r0[i] + r7[i]) + t1 * (r1[i] + r6[i]) + t2 * (r2[i] + r5[i]) + t3 * (r3[i] + r4[i])


@compiled(error_model="python")
def _weigh_columns(line: Any, light: Any, excess: Any, taps: Any, bands: Any) -> Any:
    """The horizontal half: what a display can show of it, and what not. Returns whether there is any of the latter.

    Light is at least none and at most all, in as far as the texel is opaque.
    """
    t0, t1, t2, t3 = taps[0], taps[1], taps[2], taps[3]
    none, found = np.float32(0.0), False
    for x in range(light.shape[0] // bands):
        most = np.float32(1.0)
        for back in range(bands):
            band = bands - 1 - back  # opacity first
            p = 2 * x * bands + band
            value = (
                t0 * (line[p] + line[p + 7 * bands])
                + t1 * (line[p + bands] + line[p + 6 * bands])
                + t2 * (line[p + 2 * bands] + line[p + 5 * bands])
                + t3 * (line[p + 3 * bands] + line[p + 4 * bands])
            )
            shown = min(max(value, none), most)
            light[x * bands + band], excess[x * bands + band] = shown, value - shown
            found |= shown != value
            if band == 3:
                most = shown
    return found


@compiled(error_model="python")
def _give_back(light: Any, above: Any, own: Any, below: Any, bands: Any) -> None:
    """Light less (or more) a quarter of what was cut off at each of the four neighbours, but for the ends' texels."""
    quarter = np.float32(0.25)
    for i in range(bands, light.shape[0] - bands):
        light[i] += quarter * (above[i] + below[i] + own[i - bands] + own[i + bands])


@compiled(error_model="python")
def _code(light: Any, out: Any, to_code: Any) -> None:
    """8-bit codes of a row of light, (columns, bands), but for the texel at either end."""
    columns, bands = out.shape
    top, half, one = np.float32(65535.0), np.float32(0.5), np.float32(1.0)
    for x in range(columns):
        weight = one
        for back in range(bands):
            band = bands - 1 - back
            value = light[(x + 1) * bands + band]
            if band == 3:
                opacity = min(max(value, np.float32(0.0)), one)
                out[x, 3] = np.uint8(opacity * np.float32(255.0) + half)
                weight = one / max(opacity, np.float32(1e-6))
            else:
                out[x, band] = to_code[np.int32(min(max(value * weight * top + half, half), top))]


@compiled(error_model="python")
def halve_rows(fine: Any, coarse: Any, first: int, last: int, taps: Any, to_light: Any, to_code: Any) -> None:
    """Columns ``first .. last`` of ``coarse`` (n, columns, bands) from ``fine`` (2 n + 2 HALO, width, bands), uint8.

    ``fine`` starts `HALO` rows above the first that is halved and ends as many below the last; columns beyond its
    width repeat the last one. ``taps`` (8,) must be symmetric.

    Beside a bright speck on black the kernel asks for less than no light, and a display shows none: a star would gain a
    fifth of its light with every level, which an eye sees long after it has lost the star's shape. What cannot be shown
    is therefore taken from (or added to) the neighbours.
    """
    bands, rows = fine.shape[2], coarse.shape[0]
    count = last - first + 2
    ring = np.empty((8, (2 * count + 6) * bands), dtype=np.float32)
    line = np.empty(ring.shape[1], dtype=np.float32)
    light = np.empty((3, count * bands), dtype=np.float32)
    excess = np.empty((3, count * bands), dtype=np.float32)
    cut = np.zeros(3, dtype=np.bool_)
    left = 2 * (first - 1) - 3
    for row in range(6):
        _load(fine[row], ring[row], left, to_light)
    for row in range(rows + 2):  # and one above and below, for what they give
        _load(fine[2 * row + 6], ring[(2 * row + 6) % 8], left, to_light)
        _load(fine[2 * row + 7], ring[(2 * row + 7) % 8], left, to_light)
        _weigh_rows(ring, 2 * row, line, taps)
        cut[row % 3] = _weigh_columns(line, light[row % 3], excess[row % 3], taps, bands)
        if row >= 2:
            above, own, below = (row - 2) % 3, (row - 1) % 3, row % 3
            if cut.any():
                _give_back(light[own], excess[above], excess[own], excess[below], bands)
            _code(light[own], coarse[row - 2, first:last], to_code)
