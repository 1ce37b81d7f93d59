"""What stands on the imaginary world: trees, fields, cities, waterlines, a night side and the stars beyond.

Every function answers for a single texel from the seed and its position; colours are sRGB, 0 .. 1.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.samples.noise import noise, random_at, smooth_step

__all__ = ["city_texel", "field_texel", "land_texel", "sea_texel", "space_texel", "tree_texel"]

CITY_CELL_PX = 1664
"""Texels between the places where a city may stand."""


@compiled
def unit(bits: Any, shift: Any) -> Any:
    """12 of the random bits as 0 .. 1."""
    return np.float64((bits >> np.uint64(shift)) & np.uint64(0xFFF)) / 4096.0


@compiled
def mix(a: Any, b: Any, t: Any) -> Any:
    return (a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t)


@compiled
def scaled(a: Any, t: Any) -> Any:
    return (a[0] * t, a[1] * t, a[2] * t)


@compiled
def sea_texel(depth: Any, grain: Any) -> Any:
    """Water by depth (0 at the shore, in image heights), with engraver's waterlines along the coast."""
    colour = mix((0.035, 0.115, 0.235), (0.085, 0.30, 0.46), math.exp(-depth * 9.0))
    if depth < 0.2:
        colour = mix(colour, (0.42, 0.72, 0.70), math.exp(-depth * 42.0))
    if depth > 0.07:
        return colour
    # Lines at depths in geometric order lie ever farther apart; they fade where they would crowd.
    line = math.log(depth * 90.0 + 1.0) * 7.0
    gap = abs(line - math.floor(line) - 0.5)
    ink = smooth_step(0.41, 0.49, gap) * smooth_step(0.002, 0.006, depth) * (1.0 - smooth_step(0.02, 0.07, depth))
    colour = mix(colour, (0.78, 0.90, 0.88), 0.30 * ink)
    if depth > 0.004:
        return colour
    foam = 1.0 - smooth_step(0.0, 0.0022 + 0.0010 * grain, depth)
    return mix(colour, (0.90, 0.95, 0.93), 0.75 * foam)


@compiled
def land_texel(height: Any, moisture: Any, grain: Any) -> Any:
    """Colour of the ground by height (0 at the shore), moisture (-1 .. 1) and fine noise."""
    wet = smooth_step(-0.40, 0.35, moisture + 0.10 * grain)
    low = mix((0.80, 0.69, 0.47), (0.29, 0.45, 0.20), wet)
    middle = mix((0.70, 0.53, 0.34), (0.19, 0.33, 0.15), wet)
    high = mix((0.58, 0.45, 0.36), (0.42, 0.41, 0.33), wet)
    rock = mix((0.56, 0.50, 0.46), (0.50, 0.49, 0.49), wet)
    z = height + 0.018 * grain
    colour = mix((0.88, 0.81, 0.62), low, smooth_step(0.004, 0.016, z))
    colour = mix(colour, middle, smooth_step(0.06, 0.20, z))
    colour = mix(colour, high, smooth_step(0.22, 0.36, z))
    colour = mix(colour, rock, smooth_step(0.36, 0.48, z))
    snow = smooth_step(0.47, 0.56, z + 0.05 * wet)
    return mix(colour, (0.95, 0.97, 1.0), snow)


@compiled
def tree_texel(seed: Any, x: Any, y: Any, density: Any, ground: Any) -> Any:
    """Ground under single trees: each has a crown lit from the north-west and throws a shadow."""
    cell = 9.0
    best = ground
    for side in range(2):
        # Two grids, turned against each other and against the texels, so that no rows of trees show.
        c, s = (0.927, 0.375) if side == 0 else (0.575, -0.818)
        ox, oy = c * x + s * y, c * y - s * x
        ix, iy = math.floor(ox / cell), math.floor(oy / cell)
        h = random_at(seed + side, ix, iy)
        if unit(h, 0) > density:
            continue
        radius = 1.8 + 1.9 * unit(h, 12)
        room = cell - 2.0 * radius - 0.6
        dx = ox - ix * cell - 0.5 * cell - room * (unit(h, 24) - 0.5)
        dy = oy - iy * cell - 0.5 * cell - room * (unit(h, 36) - 0.5)
        crown = radius - math.sqrt(dx * dx + dy * dy)
        sx, sy = 1.3 * (c + s), 1.3 * (c - s)  # towards the south-east
        shade = radius - math.sqrt((dx - sx) * (dx - sx) + (dy - sy) * (dy - sy))
        if shade > 0.0 and crown <= 0.0:
            best = scaled(best, 1.0 - 0.35 * min(shade, 1.0))
        if crown > 0.0:
            light = 0.75 - 0.22 * (dx * sx + dy * sy) / radius
            green = (0.13 + 0.10 * unit(h, 48), 0.26 + 0.10 * unit(h, 40), 0.10)
            best = mix(best, scaled(green, light * 1.25), min(crown, 1.0))
    return best


@compiled
def field_texel(seed: Any, x: Any, y: Any, ground: Any) -> Any:
    """Farmland: parishes of one direction each, strips between hedges, furrows a few texels apart, round fields."""
    size = 1024
    wobble = 46.0 * math.sin(y * 0.0062 + seed) + 30.0 * math.sin(y * 0.0171 + 2.0)
    px, py = (x + wobble) / size, (y + 52.0 * math.sin(x * 0.0053)) / size
    parish = random_at(seed + 1, math.floor(px), math.floor(py))
    angle = 3.14159 * unit(parish, 0)
    c, s = math.cos(angle), math.sin(angle)
    u, v = c * x + s * y, c * y - s * x
    long, wide = 120.0 + 160.0 * unit(parish, 12), 44.0 + 60.0 * unit(parish, 24)
    row = math.floor(v / wide)
    u += long * unit(random_at(seed + 2, row, parish & np.uint64(255)), 0)
    column = math.floor(u / long)
    lot = random_at(seed + 3, column * 7919 + np.int64(parish & np.uint64(1023)), row)
    fu, fv = u - column * long, v - row * wide
    kind = unit(lot, 0)
    colour = (0.76, 0.66, 0.33)
    if kind < 0.30:
        colour = (0.40, 0.53, 0.22)
    elif kind < 0.52:
        colour = (0.52, 0.60, 0.28)
    elif kind < 0.68:
        colour = (0.55, 0.40, 0.26)
    elif kind < 0.76:
        colour = (0.82, 0.76, 0.52)
    elif kind > 0.96:
        colour = (0.66, 0.55, 0.72)
    period = 3.0 + math.floor(7.0 * unit(lot, 12))
    across = fu if unit(lot, 24) < 0.3 else fv
    colour = scaled(colour, 0.93 + 0.09 * math.sin(6.2831853 * across / period) + 0.08 * (unit(lot, 36) - 0.5))
    hedge = min(min(fu, long - fu), min(fv, wide - fv))
    if hedge < 2.2:
        colour = mix(colour, (0.17, 0.28, 0.12), 0.8 * (1.0 - smooth_step(1.2, 2.2, hedge)))
    track = min(abs(px - math.floor(px + 0.5)), abs(py - math.floor(py + 0.5))) * size
    if track < 3.5:
        colour = mix(colour, (0.80, 0.75, 0.64), 1.0 - smooth_step(2.0, 3.5, track))
    return mix(ground, colour, 0.86)


@compiled
def _roof(lot: Any, fu: Any, fv: Any, wide: Any, long: Any) -> Any:
    """A house seen from above: two slopes, a ridge, a yard around it and a shadow to the south-east."""
    margin = 1.0 + 2.0 * unit(lot, 0)
    inside = min(min(fu - margin, wide - margin - fu), min(fv - margin, long - margin - fv))
    if inside < 0.0:
        shadow = fu > wide - margin or fv > long - margin
        yard = (0.42, 0.50, 0.32) if unit(lot, 12) < 0.6 else (0.62, 0.60, 0.56)
        return scaled(yard, 0.62) if shadow else yard
    kind = unit(lot, 24)
    roof = (0.66, 0.36, 0.26)
    if kind < 0.25:
        roof = (0.56, 0.54, 0.54)
    elif kind < 0.40:
        roof = (0.84, 0.80, 0.74)
    elif kind < 0.55:
        roof = (0.47, 0.33, 0.28)
    slope = 1.12 if fu < wide * 0.5 else 0.84
    if kind < 0.40:
        slope = 0.92 + 0.16 * (math.floor(fu * 0.5) % 2 == 0 and inside > 2.0)
    return scaled(roof, slope * (0.88 + 0.24 * unit(lot, 36)))


@compiled
def city_texel(seed: Any, city: Any, x: Any, y: Any, ground: Any) -> Any:
    """(colour, light at night) near a city = (x, y, radius, angle, bits as float): streets, blocks, houses, parks."""
    dx, dy = x - city[0], y - city[1]
    c, s = math.cos(city[3]), math.sin(city[3])
    u, v = c * dx + s * dy, c * dy - s * dx
    reach = math.sqrt(dx * dx + dy * dy) / city[2] + 0.30 * noise(seed + 7, x / 260.0, y / 260.0)
    if reach > 1.15:
        return ground, 0.0
    tag = np.int64(city[4])
    ring = abs(reach - 0.52) * city[2]
    if ring < 5.0 and reach < 1.0:
        return (0.87, 0.85, 0.80) if ring > 0.8 else (0.95, 0.82, 0.35), 1.0
    avenue = min(abs(u - math.floor(u / 144.0 + 0.5) * 144.0), abs(v - math.floor(v / 176.0 + 0.5) * 176.0))
    if avenue < 4.0:
        lamp = (np.int64(math.floor(u + v)) % 14) < 3
        return (0.80, 0.78, 0.73) if avenue > 0.6 else (0.93, 0.91, 0.86), 0.95 if lamp else 0.35
    wide, long = 36.0, 44.0
    column, row = math.floor(u / wide), math.floor(v / long)
    fu, fv = u - column * wide, v - row * long
    block = random_at(seed + 8, column + tag, row)
    if unit(block, 0) < smooth_step(0.35, 1.12, reach):
        return ground, 0.0
    if min(min(fu, wide - fu), min(fv, long - fv)) < 1.6:
        lamp = (np.int64(math.floor(u)) % 9 == 0) or (np.int64(math.floor(v)) % 9 == 0)
        return (0.74, 0.72, 0.68), 0.8 if lamp else 0.12
    if unit(block, 12) < 0.09:
        return tree_texel(seed + 9, np.int64(x), np.int64(y), 0.7, (0.42, 0.56, 0.30)), 0.0
    if unit(block, 12) > 0.93 and reach < 0.5:  # a tower block with a lit grid of windows
        window = (np.int64(fu) % 3 != 0) and (np.int64(fv) % 3 != 0)
        return ((0.62, 0.68, 0.72) if window else (0.38, 0.42, 0.46)), 0.85 if window else 0.05
    part_u, part_v = (
        (wide - 4.0) / (2.0 + (unit(block, 24) > 0.4)),
        (long - 4.0) / (2.0 + 2.0 * (unit(block, 36) > 0.5)),
    )
    iu, iv = math.floor((fu - 2.0) / part_u), math.floor((fv - 2.0) / part_v)
    lot = random_at(seed + 10, np.int64(block & np.uint64(0xFFFFFF)) + iu, iv)
    lit = 0.55 if unit(lot, 48) > 0.8 and (np.int64(fu) % 4 == 0) and (np.int64(fv) % 4 == 0) else 0.0
    return _roof(lot, fu - 2.0 - iu * part_u, fv - 2.0 - iv * part_v, part_u, part_v), lit


@compiled
def _stars(seed: Any, x: Any, y: Any, cell: Any, chance: Any, radius: Any, spikes: Any) -> Any:
    """Light of the star that may stand in a cell of the sky, and its warmth."""
    ix, iy = x // cell, y // cell
    h = random_at(seed, ix, iy)
    if unit(h, 0) > chance:
        return 0.0, 0.0
    margin = 3.0 * radius
    dx = x - ix * cell - margin - (cell - 2.0 * margin) * unit(h, 12)
    dy = y - iy * cell - margin - (cell - 2.0 * margin) * unit(h, 24)
    bright = 0.25 + 0.75 * unit(h, 36) * unit(h, 36)
    size = radius * (0.6 + 0.6 * bright)
    light = 1.6 * bright * math.exp(-(dx * dx + dy * dy) / (size * size))
    if spikes:
        edge = min(ix * cell + cell - x, x - ix * cell + 1, iy * cell + cell - y, y - iy * cell + 1)
        fade = min(edge / (0.2 * cell), 1.0)
        reach = cell * 0.16 * bright
        cross = math.exp(-abs(dx) / reach) * math.exp(-dy * dy / 1.4) + math.exp(-abs(dy) / reach) * math.exp(
            -dx * dx / 1.4
        )
        glow = 0.22 * math.exp(-math.sqrt(dx * dx + dy * dy) / (radius * 4.0))
        light += (0.55 * cross + glow) * bright * fade
    return light, unit(h, 48)


@compiled
def _galaxy(seed: Any, x: Any, y: Any) -> Any:
    """A spiral galaxy in some cells of the sky."""
    cell = 1408
    ix, iy = x // cell, y // cell
    h = random_at(seed, ix, iy)
    if unit(h, 0) > 0.45:
        return 0.0
    radius = 60.0 + 150.0 * unit(h, 12)
    dx = x - (ix + 0.35 + 0.3 * unit(h, 24)) * cell
    dy = y - (iy + 0.35 + 0.3 * unit(h, 36)) * cell
    angle = 6.2831853 * unit(h, 48)
    c, s = math.cos(angle), math.sin(angle)
    u, v = c * dx + s * dy, (c * dy - s * dx) / (0.3 + 0.6 * unit(h, 6))
    far = math.sqrt(u * u + v * v) / radius
    if far > 2.2:
        return 0.0
    arm = 0.5 + 0.5 * math.cos(2.0 * (math.atan2(v, u) - 3.1 * math.log(far + 0.05)))
    return (0.75 * math.exp(-far * far * 30.0) + math.exp(-far * 2.6) * (0.12 + 0.62 * arm * arm)) * (
        1.0 - smooth_step(1.2, 2.2, far)
    )


@compiled
def space_texel(seed: Any, x: Any, y: Any, cloud: Any, dust: Any, grain: Any) -> Any:
    """The sky: nebula from two smooth fields, three classes of stars, spiral galaxies."""
    body = smooth_step(-0.25, 0.75, cloud + 0.10 * grain)
    gas = smooth_step(-0.5, 0.6, dust)
    colour = (
        0.012 + 0.20 * body * gas + 0.03 * body,
        0.014 + 0.075 * body + 0.05 * body * (1.0 - gas),
        0.030 + 0.21 * body,
    )
    core = smooth_step(0.35, 0.95, cloud + 0.14 * grain)
    colour = mix(colour, (0.98, 0.70, 0.55), 0.45 * core * core)
    total = (0.0, 0.0, 0.0)
    for rank in range(3):
        cell, chance, radius = (14, 0.10 + 0.35 * body, 0.75)
        if rank == 1:
            cell, chance, radius = (72, 0.45, 1.5)
        elif rank == 2:
            cell, chance, radius = (620, 0.5, 3.4)
        light, warmth = _stars(seed + 20 + rank, x, y, cell, chance, radius, rank == 2)
        if light > 0.001:
            tint = mix((0.72, 0.82, 1.0), (1.0, 0.80, 0.58), warmth)
            total = (total[0] + light * tint[0], total[1] + light * tint[1], total[2] + light * tint[2])
    spiral = _galaxy(seed + 30, x, y) * (0.9 + 0.2 * grain)
    return (
        min(colour[0] + total[0] + spiral, 1.0),
        min(colour[1] + total[1] + 0.9 * spiral, 1.0),
        min(colour[2] + total[2] + 0.85 * spiral, 1.0),
    )
