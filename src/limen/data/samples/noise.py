"""The imaginary world of ``limen sample image``: noise and the shape of the land, texel by texel.

Everything is a pure function of (seed, x, y): a block of texels comes out the same whatever is drawn around it, in
whatever order and by however many threads. Large shapes (wavelengths from several image heights down to 48 texels)
are evaluated on nodes 8 texels apart and interpolated by a cubic; smaller ones at every texel. Gradient noise after
K. Perlin 2002, "Improving noise", SIGGRAPH; amplitudes that follow the height reached so far after F. K. Musgrave
et al. 1989, "The synthesis and rendering of eroded fractal terrains", SIGGRAPH.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = ["BLOCK", "FIELDS", "NODE_STEP", "land_at", "random_at", "smooth_step", "terrain_of_block"]

BLOCK = 256
"""Texels along the edge of a block that is drawn at once; blocks lie on multiples of it."""

NODE_STEP = 8
"""Texels between the nodes on which large shapes are evaluated."""

FIELDS = 5
"""Height (0 = shore), moisture, roughness, river (0 = its middle), fertility."""

_SMALLEST_COARSE_PX = 48.0
_SLOPE = 0.9
"""Height gained per image height by one octave: the same at all scales, so that relief is seen at every distance."""


@compiled
def random_at(seed: Any, x: Any, y: Any) -> Any:
    """64 well-mixed bits for a lattice point (the finaliser of MurmurHash3)."""
    h = np.uint64(x) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(y) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= np.uint64(seed) * np.uint64(0x165667B19E3779F9)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xFF51AFD7ED558CCD)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xC4CEB9FE1A85EC53)
    return h ^ (h >> np.uint64(33))


@compiled
def smooth_step(low: Any, high: Any, value: Any) -> Any:
    t = min(max((value - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@compiled
def _corner(seed: Any, ix: Any, iy: Any, fx: Any, fy: Any) -> Any:
    h = random_at(seed, ix, iy)
    gx = np.float64(h & np.uint64(0xFFFF)) / 32768.0 - 1.0
    gy = np.float64((h >> np.uint64(16)) & np.uint64(0xFFFF)) / 32768.0 - 1.0
    return gx * fx + gy * fy


@compiled
def noise(seed: Any, x: Any, y: Any) -> Any:
    """Gradient noise of wavelength 1, about -1 .. 1."""
    ix, iy = np.int64(np.floor(x)), np.int64(np.floor(y))
    fx, fy = x - ix, y - iy
    sx = fx * fx * fx * (fx * (fx * 6.0 - 15.0) + 10.0)
    sy = fy * fy * fy * (fy * (fy * 6.0 - 15.0) + 10.0)
    a, b = _corner(seed, ix, iy, fx, fy), _corner(seed, ix + 1, iy, fx - 1.0, fy)
    c, d = _corner(seed, ix, iy + 1, fx, fy - 1.0), _corner(seed, ix + 1, iy + 1, fx - 1.0, fy - 1.0)
    top, bottom = a + sx * (b - a), c + sx * (d - c)
    return 1.4 * (top + sy * (bottom - top))


@compiled
def _fractal(seed: Any, x: Any, y: Any, octaves: Any) -> Any:
    total, size = 0.0, 1.0
    for k in range(octaves):
        total += size * noise(seed + k, x, y)
        x, y, size = x * 2.0 + 17.3, y * 2.0 - 9.1, size * 0.5
    return total


@compiled
def land_at(seed: Any, x: Any, y: Any, height: Any, out: Any) -> None:
    """The :data:`FIELDS` at texel (x, y) of an image ``height`` texels high, without wavelengths below 48 texels."""
    u, v = x / height, y / height
    warp_x = 0.30 * _fractal(seed + 100, u * 1.3, v * 1.3, 4)
    warp_y = 0.30 * _fractal(seed + 110, u * 1.3 + 5.2, v * 1.3 + 1.3, 4)
    wide = 0.30 * noise(seed + 120, u * 0.31 + 0.5 * warp_x, v * 0.31 + 0.4)
    shape = -0.03 + wide + 0.55 * noise(seed + 121, u * 0.95 + warp_x, v * 0.95 + warp_y)
    ranges = noise(seed + 122, u * 0.7 - warp_y, v * 0.9 + warp_x) + 0.25
    mountain = smooth_step(0.0, 0.8, ranges) * smooth_step(-0.05, 0.3, shape)
    frequency, value, ridge = 1.9, shape, 0.0
    keep = 1.0
    octave = 0
    while height / frequency >= _SMALLEST_COARSE_PX:
        size = _SLOPE / (2.0 * frequency)
        n = noise(seed + 130 + octave, (u + 0.4 * warp_x) * frequency + 3.7 * octave, (v + 0.4 * warp_y) * frequency)
        value += 0.62 * size * n * min(max(0.52 + 1.6 * value, 0.10), 1.0)
        sharp = 1.0 - min(abs(n) * 1.6, 1.0)
        ridge += size * 1.5 * sharp * sharp * keep
        keep = min(max(sharp * 1.6, 0.15), 1.0)
        frequency, octave = frequency * 2.0, octave + 1
    out[0] = value + mountain * ridge * 0.9
    out[1] = 0.9 * _fractal(seed + 200, u * 1.1 + 0.6 * warp_y, v * 1.6 - 0.5 * warp_x, 6) - 0.25 * value
    out[2] = 0.18 + 0.82 * mountain
    out[3] = _fractal(seed + 210, u * 2.3 + 0.9 * warp_x, v * 2.3 + 0.9 * warp_y, 6)
    out[4] = _fractal(seed + 220, u * 2.9, v * 2.9, 3)


@compiled
def _nodes(seed: Any, x0: Any, y0: Any, height: Any, count: Any) -> Any:
    nodes = np.empty((FIELDS, count, count), dtype=np.float32)
    at = np.empty(FIELDS, dtype=np.float64)
    for j in range(count):
        for i in range(count):
            land_at(seed, float(x0 + (i - 2) * NODE_STEP), float(y0 + (j - 2) * NODE_STEP), float(height), at)
            for field in range(FIELDS):
                nodes[field, j, i] = at[field]
    return nodes


@compiled
def _cubic(nodes: Any, edge: Any) -> Any:
    """Catmull-Rom between nodes, for texels -1 .. edge - 2 of the block."""
    weigh = np.empty((NODE_STEP, 4), dtype=np.float32)
    for phase in range(NODE_STEP):
        t = phase / NODE_STEP
        weigh[phase, 0] = -0.5 * t + t * t - 0.5 * t * t * t
        weigh[phase, 1] = 1.0 - 2.5 * t * t + 1.5 * t * t * t
        weigh[phase, 2] = 0.5 * t + 2.0 * t * t - 1.5 * t * t * t
        weigh[phase, 3] = -0.5 * t * t + 0.5 * t * t * t
    count = nodes.shape[0]
    tall = np.empty((edge, count), dtype=np.float32)
    for j in range(edge):
        at = j - 1 + NODE_STEP
        w, k = weigh[at % NODE_STEP], at // NODE_STEP
        for i in range(count):
            tall[j, i] = w[0] * nodes[k, i] + w[1] * nodes[k + 1, i] + w[2] * nodes[k + 2, i] + w[3] * nodes[k + 3, i]
    out = np.empty((edge, edge), dtype=np.float32)
    for j in range(edge):
        for i in range(edge):
            at = i - 1 + NODE_STEP
            w, k = weigh[at % NODE_STEP], at // NODE_STEP
            out[j, i] = w[0] * tall[j, k] + w[1] * tall[j, k + 1] + w[2] * tall[j, k + 2] + w[3] * tall[j, k + 3]
    return out


@compiled
def _add_octave(seed: Any, x0: Any, y0: Any, wave_px: Any, size: Any, out: Any) -> None:
    """Add gradient noise of a whole wavelength to texels -1 .. of the block; gradients are hashed once each."""
    edge = out.shape[0]
    first_x, first_y = (x0 - 1) // wave_px, (y0 - 1) // wave_px
    count = edge // wave_px + 3
    gradient = np.empty((count, count, 2), dtype=np.float32)
    for j in range(count):
        for i in range(count):
            h = random_at(seed, first_x + i, first_y + j)
            low, high = h & np.uint64(0xFFFF), (h >> np.uint64(16)) & np.uint64(0xFFFF)
            gradient[j, i, 0] = np.float32(low) / np.float32(32768.0) - np.float32(1.0)
            gradient[j, i, 1] = np.float32(high) / np.float32(32768.0) - np.float32(1.0)
    place = (np.arange(wave_px) / wave_px).astype(np.float32)
    fade = place * place * place * (place * (place * np.float32(6) - np.float32(15)) + np.float32(10))
    one, amount = np.float32(1.0), np.float32(1.4 * size)
    for j in range(edge):
        y = y0 - 1 + j
        gj, py = y // wave_px - first_y, y % wave_px
        fy, sy = place[py], fade[py]
        for i in range(edge):
            x = x0 - 1 + i
            gi, px = x // wave_px - first_x, x % wave_px
            fx, sx = place[px], fade[px]
            a = gradient[gj, gi, 0] * fx + gradient[gj, gi, 1] * fy
            b = gradient[gj, gi + 1, 0] * (fx - one) + gradient[gj, gi + 1, 1] * fy
            c = gradient[gj + 1, gi, 0] * fx + gradient[gj + 1, gi, 1] * (fy - one)
            d = gradient[gj + 1, gi + 1, 0] * (fx - one) + gradient[gj + 1, gi + 1, 1] * (fy - one)
            top, bottom = a + sx * (b - a), c + sx * (d - c)
            out[j, i] += amount * (top + sy * (bottom - top))


@compiled
def terrain_of_block(seed: Any, x0: Any, y0: Any, height: Any) -> Any:
    """(FIELDS + 1, 258, 258) float32 of a block with one texel around it; the last is fine noise, -1 .. 1."""
    edge = BLOCK + 2
    nodes = _nodes(seed, x0, y0, height, BLOCK // NODE_STEP + 6)
    out = np.zeros((FIELDS + 1, edge, edge), dtype=np.float32)
    for field in range(FIELDS):
        out[field] = _cubic(nodes[field], edge)
    wave_px, size = 32, 1.0
    while wave_px >= 2:
        _add_octave(seed + 300 + wave_px, x0, y0, wave_px, size, out[FIELDS])
        wave_px, size = wave_px // 2, size * 0.5
    fine = np.float32(0.62 * _SLOPE * 0.5 * 32.0 / height)
    for j in range(edge):
        for i in range(edge):
            z = out[0, j, i]
            calm = min(max((z + 0.05) * 20.0, 0.0), 1.0)
            out[0, j, i] = z + fine * out[FIELDS, j, i] * calm * (out[2, j, i] * 1.3)
    return out
