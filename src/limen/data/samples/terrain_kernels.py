"""Heights of the imaginary mountains of ``limen sample terrain``, post by post.

Everything is a pure function of (seed, column, row): a block comes out the same whatever is made around it, in whatever
order and by however many threads. Mountains are a ridged multifractal (Ebert et al. 2003, Texturing and modeling,
ch. 16) of long wavelengths. Into it gullies are cut: waves that run across the slope found so far, so that their
crests and troughs run downhill and each octave branches off the one before, as in C. John's shader Eroded Terrain
Noise. Valleys are filled by a smooth maximum, lakes to one level. Wavelengths down to 20 posts are evaluated on nodes
4 posts apart and interpolated by a cubic, smaller ones at every post.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.samples.noise import random_at, smooth_step

__all__ = ["NODE_STEP", "heights_of_block"]

NODE_STEP = 4
"""Posts between nodes; blocks begin on multiples of it."""

_FIELDS = 4  # height in metres, its slopes east and south, height of the valley floor

_RIDGES_M, _RIDGES = 15_000.0, 4
_GULLIES_M, _COARSE, _GULLIES = 2_400.0, 2, 4
_GENTLE = 0.06
"""Slopes well below have no gullies."""
_DEPTH = 0.2
_CELL_REACH2 = 1.1 * 1.1
_WATER_M = 560.0


@compiled
def _corner(seed: Any, ix: Any, iy: Any) -> Any:
    """A gradient, each component in -1 ... 1."""
    h = random_at(seed, ix, iy)
    return np.float64(h & np.uint64(0xFFFF)) / 32768.0 - 1.0, np.float64(
        (h >> np.uint64(16)) & np.uint64(0xFFFF)
    ) / 32768.0 - 1.0


@compiled
def _noise(seed: Any, x: Any, y: Any) -> Any:
    """Gradient noise of wavelength 1, about -1 ... 1 (Perlin 2002), and its derivatives along x and y."""
    ix, iy = np.int64(np.floor(x)), np.int64(np.floor(y))
    fx, fy = x - ix, y - iy
    sx, sy = fx * fx * fx * (fx * (fx * 6.0 - 15.0) + 10.0), fy * fy * fy * (fy * (fy * 6.0 - 15.0) + 10.0)
    tx, ty = 30.0 * fx * fx * (fx - 1.0) * (fx - 1.0), 30.0 * fy * fy * (fy - 1.0) * (fy - 1.0)
    ax, ay = _corner(seed, ix, iy)
    bx, by = _corner(seed, ix + 1, iy)
    cx, cy = _corner(seed, ix, iy + 1)
    dx, dy = _corner(seed, ix + 1, iy + 1)
    a, b = ax * fx + ay * fy, bx * (fx - 1.0) + by * fy
    c, d = cx * fx + cy * (fy - 1.0), dx * (fx - 1.0) + dy * (fy - 1.0)
    k = a - b - c + d
    value = a + sx * (b - a) + sy * (c - a) + sx * sy * k
    east = ax + sx * (bx - ax) + sy * (cx - ax) + sx * sy * (ax - bx - cx + dx) + tx * (b - a + sy * k)
    south = ay + sx * (by - ay) + sy * (cy - ay) + sx * sy * (ay - by - cy + dy) + ty * (c - a + sx * k)
    return 1.4 * value, 1.4 * east, 1.4 * south


@compiled
def _gullies(seed: Any, k: Any, x: Any, y: Any, state: Any) -> None:
    """Cut octave ``k`` of gullies at (x, y) metres into the ``state``: waves across the slope, a point a cell."""
    length_m = _GULLIES_M * 0.5**k
    # Each octave's cells are turned by another angle (3-4-5 triangles), so that no direction stands out.
    turn, side = (0.8, 0.6) if k % 2 == 0 else (0.6, -0.8)
    east, south = turn * state[1] + side * state[2], turn * state[2] - side * state[1]
    steep2 = east * east + south * south
    across = 1.0 / np.sqrt(steep2 + _GENTLE * _GENTLE)
    wave_x, wave_y = -south * across, east * across
    u, v = (turn * x + side * y) / length_m + 7.3 * k, (turn * y - side * x) / length_m - 3.1 * k
    ix, iy = np.int64(np.floor(u)), np.int64(np.floor(v))
    total, level, rise = 0.002, 0.0, 0.0
    for j in range(iy - 1, iy + 2):
        for i in range(ix - 1, ix + 2):
            h = random_at(seed + k, i, j)
            px = u - i - 0.1 - np.float64(h & np.uint64(0xFFFF)) / 81920.0
            py = v - j - 0.1 - np.float64((h >> np.uint64(16)) & np.uint64(0xFFFF)) / 81920.0
            near = 1.0 - (px * px + py * py) / _CELL_REACH2
            if near > 0.0:
                weight = near * near * near * near
                t = px * wave_x + py * wave_y
                t -= np.floor(t + 0.5)
                # In place of a cosine, a cubic that is as smooth where crests meet troughs.
                level += weight * (1.0 - 24.0 * t * t + 32.0 * abs(t) * t * t)
                rise += weight * (96.0 * abs(t) - 48.0) * t
                total += weight
    slope = np.sqrt(steep2)
    size = _DEPTH * slope / (1.0 + slope) * steep2 / (steep2 + _GENTLE * _GENTLE)
    state[0] += size * length_m * (level / total - 0.4)
    state[1] += size * rise / total * (turn * wave_x - side * wave_y)
    state[2] += size * rise / total * (side * wave_x + turn * wave_y)


@compiled
def _land_at(seed: Any, x: Any, y: Any, state: Any) -> None:
    """All that nodes carry, at (x, y) metres."""
    warp_x, _, _ = _noise(seed + 51, x / 23_000.0, y / 23_000.0)
    warp_y, _, _ = _noise(seed + 52, x / 23_000.0 + 5.2, y / 23_000.0 + 1.3)
    wide, wide_x, wide_y = _noise(seed + 53, x / 170_000.0, y / 170_000.0)
    ranges, _, _ = _noise(seed + 54, x / 64_000.0 + 0.3, y / 64_000.0 - 0.4)
    region = smooth_step(-0.6, 0.6, 0.5 * wide + 0.8 * ranges + 0.05)
    high, weight = 0.12 + 0.88 * region, 1.0
    state[0] = 400.0 + 700.0 * region + 450.0 * wide
    state[1], state[2] = 450.0 * wide_x / 170_000.0, 450.0 * wide_y / 170_000.0
    state[3] = state[0] - 120.0 - 420.0 * region
    for k in range(_RIDGES):
        turn, side = (0.8, 0.6) if k % 2 == 0 else (0.6, -0.8)
        scale = 2.0**k / _RIDGES_M
        wx, wy = x + 3_000.0 * warp_x, y + 3_000.0 * warp_y
        n, east, south = _noise(seed + k, (turn * wx + side * wy) * scale + 11.7 * k, (turn * wy - side * wx) * scale)
        # A smooth absolute value: crests are round for a sixteenth of the wavelength.
        soft = np.sqrt(n * n + 0.006)
        ridge = 1.0 - 1.25 * soft
        size_m = 2100.0 * high * 0.48**k * weight
        bend = -1.25 * n / soft * size_m * scale
        state[0] += size_m * (ridge - 0.35)
        state[1] += bend * (turn * east - side * south)
        state[2] += bend * (side * east + turn * south)
        weight = min(max(0.25 + 1.1 * weight * ridge, 0.2), 1.0)
    for k in range(_COARSE):
        _gullies(seed + 70, k, x, y, state)


@compiled
def _weights(t: Any, out: Any) -> None:
    """Catmull-Rom."""
    out[0] = 0.5 * t * (t * (2.0 - t) - 1.0)
    out[1] = 0.5 * (t * t * (3.0 * t - 5.0) + 2.0)
    out[2] = 0.5 * t * (t * (4.0 - 3.0 * t) + 1.0)
    out[3] = 0.5 * t * t * (t - 1.0)


@compiled
def heights_of_block(seed: Any, column: Any, row: Any, spacing_m: Any, heights_m: Any) -> None:
    """Fill float32 (rows, columns) ``heights_m`` that begins at post (column, row), both multiples of `NODE_STEP`."""
    rows, columns = heights_m.shape
    down, across = (rows - 1) // NODE_STEP + 4, (columns - 1) // NODE_STEP + 4
    nodes = np.empty((down, across, _FIELDS), dtype=np.float64)
    for j in range(down):
        for i in range(across):
            x = (column + (i - 1) * NODE_STEP) * spacing_m
            y = (row + (j - 1) * NODE_STEP) * spacing_m
            _land_at(seed, x, y, nodes[j, i])
    state, wx, wy = np.empty(_FIELDS), np.empty(4), np.empty(4)
    for j in range(rows):
        _weights((j % NODE_STEP) / NODE_STEP, wy)
        for i in range(columns):
            _weights((i % NODE_STEP) / NODE_STEP, wx)
            for field in range(_FIELDS):
                total = 0.0
                for q in range(4):
                    at = nodes[j // NODE_STEP + q]
                    n = i // NODE_STEP
                    total += wy[q] * (
                        wx[0] * at[n, field]
                        + wx[1] * at[n + 1, field]
                        + wx[2] * at[n + 2, field]
                        + wx[3] * at[n + 3, field]
                    )
                state[field] = total
            x, y = (column + i) * spacing_m, (row + j) * spacing_m
            for k in range(_COARSE, _GULLIES):
                _gullies(seed + 70, k, x, y, state)
            above = state[0] - state[3]
            # A smooth maximum with the valley's floor, rounded over 80 m.
            filled = state[3] + 0.5 * (above + np.sqrt(above * above + 6400.0))
            heights_m[j, i] = max(filled, _WATER_M)
