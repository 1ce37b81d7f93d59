"""Putting the imaginary world together, one block of texels at a time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.samples.land import (
    CITY_CELL_PX,
    city_texel,
    field_texel,
    land_texel,
    mix,
    scaled,
    sea_texel,
    space_texel,
    tree_texel,
    unit,
)
from limen.data.samples.map_marks import chart_texel, city_bits, graticule_ink, label_ink, name_size_px
from limen.data.samples.noise import land_at, smooth_step, terrain_of_block

__all__ = ["paint_block"]

_NIGHT_FALLS, _NIGHT, _LIMB = 0.60, 0.70, 0.86
"""Where along the width dusk begins, where it is night, where the planet ends."""

_SLOPE = 0.9
_CITY_FIELDS = 6
_LABEL_REACH_PX = 240.0


@compiled
def _horizon(x: Any, y: Any, width: Any, height: Any) -> Any:
    """(night 0 .. 1, image heights beyond the planet's edge) of a texel."""
    bow = (y / height - 0.5) ** 2
    beyond = (x - _LIMB * width) / height + 0.35 * bow
    span = (_NIGHT - _NIGHT_FALLS) * width
    night = smooth_step(0.0, 1.0, (x + 0.25 * bow * height - _NIGHT_FALLS * width) / span)
    return night, beyond


@compiled
def _cities_near(seed: Any, x0: Any, y0: Any, width: Any, height: Any) -> Any:
    """(n, 6) of cities that may reach into a block: x, y, radius, angle, tag, dots of the name; on gentle land only."""
    found = np.empty((9, _CITY_FIELDS), dtype=np.float64)
    land = np.empty(5, dtype=np.float64)
    count = 0
    for k in range(9):
        ix, iy = x0 // CITY_CELL_PX + k % 3 - 1, y0 // CITY_CELL_PX + k // 3 - 1
        bits = city_bits(seed, ix, iy)
        x = (ix + 0.3 + 0.4 * unit(bits, 0)) * CITY_CELL_PX
        y = (iy + 0.3 + 0.4 * unit(bits, 12)) * CITY_CELL_PX
        land_at(seed, x, y, height, land)
        if _horizon(x, y, width, height)[1] > -0.1:
            continue
        if land[0] < 0.008 or land[0] > 0.20 or land[2] > 0.45 or unit(bits, 24) > 0.62:
            continue
        found[count, 0], found[count, 1] = x, y
        found[count, 2] = 150.0 + 480.0 * unit(bits, 36) * unit(bits, 36)
        found[count, 3] = 1.5708 * unit(bits, 44)
        found[count, 4] = float(bits & np.uint64(0xFFFF))
        found[count, 5] = name_size_px(bits)
        count += 1
    return found[:count]


@compiled
def _ground(seed: Any, x: Any, y: Any, at: Any, grain: Any, shade: Any, height: Any) -> Any:
    """Land without cities: soil, river, farmland, trees; ``at`` are the fields of the texel."""
    z, moisture, rough, river, fertile = at
    colour = scaled(land_texel(z, moisture, grain), shade * (1.0 + 0.05 * grain))
    wide = max(2.5, height / 2600.0) * 3.5 / height * (1.0 + 0.3 * grain)
    if abs(river) < wide and z < 0.30:
        return mix(colour, (0.16, 0.37, 0.50), smooth_step(wide, 0.6 * wide, abs(river)) if z > 0.004 else 1.0)
    gentle = z < 0.15 + 0.02 * grain and rough < 0.42 and abs(moisture + 0.02) < 0.42
    if gentle and fertile + 0.06 * grain > 0.02 and z > 0.012 and abs(river) > 1.6 * wide:
        return scaled(field_texel(seed, x, y, colour), 0.35 + 0.65 * shade)
    density = 0.85 * smooth_step(0.02, 0.40, moisture + 0.12 * grain) * (1.0 - smooth_step(0.26, 0.38, z))
    if density > 0.01 and z > 0.014:
        return tree_texel(seed + 3, x, y, density, colour)
    return colour


@compiled
def _with_cities(seed: Any, x: Any, y: Any, cities: Any, ground: Any) -> Any:
    """(colour, lamps at night) where a city covers the ground."""
    colour, lamps = ground, 0.0
    for k in range(cities.shape[0]):
        dx, dy = x - cities[k, 0], y - cities[k, 1]
        if dx * dx + dy * dy < (1.5 * cities[k, 2]) ** 2:
            colour, light = city_texel(seed, cities[k], x, y, colour)
            glow = math.exp(-2.2 * (dx * dx + dy * dy) / (cities[k, 2] * cities[k, 2]))
            lamps = max(lamps, light) + 0.22 * glow
    return colour, lamps


@compiled
def _lettered(x: Any, y: Any, cities: Any, seed: Any, colour: Any) -> Any:
    """Names over cities, light with a dark shadow."""
    for k in range(cities.shape[0]):
        dx, dy = x - cities[k, 0], y - cities[k, 1]
        if abs(dx) < _LABEL_REACH_PX and abs(dy) < 40.0:
            ix, iy = np.int64(cities[k, 0] // CITY_CELL_PX), np.int64(cities[k, 1] // CITY_CELL_PX)
            bits = city_bits(seed, ix, iy)
            dot = cities[k, 5]
            shadow, _ = label_ink(bits, dx - 0.6 * dot, dy - 0.6 * dot, dot)
            ink, plate = label_ink(bits, dx, dy, dot)
            colour = mix(colour, (0.08, 0.08, 0.10), 0.22 * plate)
            colour = mix(mix(colour, (0.05, 0.05, 0.08), 0.75 * shadow), (1.0, 0.98, 0.90), ink)
    return colour


@compiled
def _evening(colour: Any, lamps: Any, night: Any) -> Any:
    """Daylight turned to dusk (orange) and night (blue, lamps lit)."""
    if night <= 0.0:
        return colour
    dusk = 4.0 * night * (1.0 - night)
    day = 1.0 - 0.86 * night
    warm = (1.0 + 0.16 * dusk, 1.0 - 0.10 * dusk, 1.0 - 0.30 * dusk)
    r, g, b = colour[0] * day * warm[0], colour[1] * day * warm[1], colour[2] * day * warm[2]
    glow = lamps * night
    r += 0.010 * night + 1.00 * glow
    g += 0.024 * night + 0.78 * glow
    b += 0.065 * night + 0.42 * glow
    return (min(r, 1.0), min(g, 1.0), min(b, 1.0))


@compiled
def _chart_place(width: Any, height: Any) -> Any:
    """(left, top, width, height) of the reading chart, which hangs on the day side."""
    wide = np.int64(min(max(0.36 * height, 200.0), 4096.0, 0.3 * width))
    high = np.int64(1.25 * wide)
    left, top = np.int64(0.30 * width - 0.5 * wide), np.int64(0.55 * (height - high))
    return left, top, wide, high


@compiled
def _planet_texel(seed: Any, x: Any, y: Any, at: Any, grain: Any, slope: Any, cities: Any, height: Any) -> Any:
    """(colour by day, lamps by night)."""
    if at[0] <= 0.0:
        return sea_texel(-at[0], grain), 0.0
    shade = (1.0 + 0.34 * (slope[0] + slope[1])) / math.sqrt(1.0 + 0.16 * (slope[0] ** 2 + slope[1] ** 2))
    shade = min(max(shade, 0.42), 1.45)
    colour = _ground(seed, x, y, at, grain, shade, height)
    if cities.shape[0] == 0 or at[0] < 0.004:
        return colour, 0.0
    return _with_cities(seed, x, y, cities, colour)


@compiled
def _texel(seed: Any, x: Any, y: Any, terrain: Any, j: Any, i: Any, cities: Any, width: Any, height: Any) -> Any:
    night, beyond = _horizon(x, y, width, height)
    at = (terrain[0, j, i], terrain[1, j, i], terrain[2, j, i], terrain[3, j, i], terrain[4, j, i])
    grain = terrain[5, j, i]
    if beyond > 0.0:
        colour = space_texel(seed, x, y, at[1], at[3], grain)
        if beyond > 0.4:
            return colour
        air = math.exp(-beyond * 26.0)
        rim = math.exp(-beyond * 160.0)
        return mix(mix(colour, (0.16, 0.42, 0.80), 0.85 * air), (0.80, 0.93, 1.0), 0.85 * rim)
    to_slope = 0.5 * height / _SLOPE
    slope = (
        (terrain[0, j, i + 1] - terrain[0, j, i - 1]) * to_slope,
        (terrain[0, j + 1, i] - terrain[0, j - 1, i]) * to_slope,
    )
    colour, lamps = _planet_texel(seed, x, y, at, grain, slope, cities, height)
    colour = _evening(colour, lamps, night)
    if beyond > -0.25:
        colour = mix(colour, (0.30, 0.55, 0.85), 0.5 * math.exp(beyond * 30.0))
    return mix(colour, (1.0, 1.0, 1.0), graticule_ink(x, y) * (1.0 - 0.65 * night))


@compiled
def paint_block(seed: Any, x0: Any, y0: Any, width: Any, height: Any, out: Any) -> None:
    """sRGB texels of the block at (x0, y0), multiples of 256, into ``out`` (<= 256, <= 256, 3) uint8."""
    terrain = terrain_of_block(seed, x0, y0, height)
    cities = _cities_near(seed, x0, y0, width, float(height))
    left, top, wide, high = _chart_place(width, height)
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            x, y = x0 + i, y0 + j
            if left <= x < left + wide and top <= y < top + high:
                colour = chart_texel(seed, x - left, y - top, wide, high)
            else:
                colour = _texel(seed, x, y, terrain, j + 1, i + 1, cities, width, height)
                if cities.shape[0]:
                    colour = _lettered(x, y, cities, seed, colour)
            for band in range(3):
                out[j, i, band] = np.uint8(min(max(colour[band], 0.0), 1.0) * 255.0 + 0.5)
