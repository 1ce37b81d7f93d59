"""Nodes of a chunk from its points: spheres that hold spheres, mean colours and normals, cones.

Everything above the points is made of what is stored, after it was rounded, so that what holds for the numbers in
the file holds for what is drawn.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from limen.data.hilbert_kernels import box_of
from limen.data.point_nodes import ALL_AROUND, CHUNK_LEVEL, CHUNK_NODES, CHUNK_POINTS, FAN, LEVEL_BEGIN

__all__ = ["NO_NORMAL", "RADIUS_STEPS", "build_chunks", "pack_normal", "pack_normals_into"]

NO_NORMAL = -128
"""In place of an octahedral code, where nothing is known."""

RADIUS_STEPS = 12
"""Codes of radii in an octave."""

_BEGIN = LEVEL_BEGIN
_SLACK = 1.0 + 1e-6
"""Radii are kept in float32, and so are the frames that places are read with."""

_CENTRE_STEPS = 4

_STEPS_OF_FRACTION = np.ceil(np.log2(1.0 + np.arange(1, 257) / 256.0) * RADIUS_STEPS - 1e-9).astype(np.int64)
"""Codes from a power of two to a fraction above it, by the fraction's first eight bits, rounded up."""

_CONES_A_RADIAN = 254.0 / np.pi
_BLIND = 254.0
"""Cone of a node that has a mean normal, and may face any way."""


@njit(cache=True, nogil=True)
def _frame(places: Any, begin: int, end: int, step: float, low: Any, frame: Any, at: Any, codes: Any) -> None:
    """Where the chunk's codes begin and how long a step is, into ``frame`` (5,); codes of the points' places.

    ``low`` (3,) is where the lattice begins, from the cloud's origin.
    """
    box = np.empty((2, 3), np.int32)
    box_of(places[begin:end], box)
    widest = 0.0
    for a in range(3):
        first = low[a] + box[0, a] * step
        kept = np.float32(first)
        if kept > first:
            kept = np.float32(first - abs(first) * 1.2e-7 - 1e-37)
        frame[a] = kept
        widest = max(widest, low[a] + box[1, a] * step - np.float64(kept))
    # A little longer than it has to be: kept in float32, it may have been rounded down.
    frame[3] = np.float32(widest / 65535.0 * 1.0000002) if widest > 0.0 else np.float32(1.0)
    per_step = 1.0 / np.float64(frame[3])
    for a in range(3):
        scale, offset = step * per_step, (low[a] - np.float64(frame[a])) * per_step + 0.5
        for i in range(begin, end):
            code = np.int32(places[i, a] * scale + offset)
            code = np.int32(0) if code < 0 else np.int32(65535) if code > 65535 else code
            codes[_BEGIN[0] + i - begin, a] = code
            at[_BEGIN[0] + i - begin, a] = np.float32(code)


@njit(cache=True, nogil=True)
def _code_of(share: float) -> int:
    """The smallest code that stands for no less than a share of the largest radius; 0 for none.

    Logarithms are looked up by the upper eight bits of the fraction, so one in fifteen is a code larger.
    """
    if share <= np.float32(0.0):
        return 0
    bits = np.float32(share).view(np.int32)
    octave, part = (bits >> 23) - 127, (bits >> 15) & 255
    return int(min(max(255 + octave * RADIUS_STEPS + _STEPS_OF_FRACTION[part], 1), 255))


@njit(cache=True, nogil=True)
def _farthest(at: Any, radius: Any, first: int, last: int, x: float, y: float, z: float) -> Any:
    """How far spheres reach from a place, and which reaches farthest."""
    reach, which = np.float32(-1.0), first
    for i in range(first, last):
        dx, dy, dz = at[i, 0] - x, at[i, 1] - y, at[i, 2] - z
        own = np.sqrt(dx * dx + dy * dy + dz * dz) + radius[i]
        if own > reach:
            reach, which = own, i
    return reach, which


@njit(cache=True, nogil=True)
def _sphere(at: Any, radius: Any, first: int, last: int, node: int, codes: Any) -> float:
    """Centre of a sphere around those of the children ``first:last``, at a code; returns the radius it needs.

    From the middle of their box a few steps towards whichever reaches farthest (Badoiu, Clarkson 2003, *Smaller
    core-sets for balls*, shortened ever more); the best is kept.
    """
    place, best = np.empty(3, np.float32), np.empty(3, np.float32)
    for a in range(3):
        least, most = at[first, a] - radius[first], at[first, a] + radius[first]
        for i in range(first + 1, last):
            least = min(least, at[i, a] - radius[i])
            most = max(most, at[i, a] + radius[i])
        place[a] = (least + most) * np.float32(0.5)
        best[a] = place[a]
    needed, which = _farthest(at, radius, first, last, place[0], place[1], place[2])
    share = np.float32(0.15)
    for _ in range(_CENTRE_STEPS):
        for a in range(3):
            place[a] += share * (at[which, a] - place[a])
        reach, which = _farthest(at, radius, first, last, place[0], place[1], place[2])
        if reach < needed:
            needed = reach
            best[:] = place
        share *= np.float32(0.75)
    for a in range(3):
        code = min(max(best[a] + np.float32(0.5), np.float32(0.0)), np.float32(65535.0))
        codes[node, a] = np.uint16(code)
        at[node, a] = np.float32(codes[node, a])
    return np.float64(_farthest(at, radius, first, last, at[node, 0], at[node, 1], at[node, 2])[0])


@njit(cache=True, nogil=True)
def _spheres(radii: Any, begin: int, counts: Any, frame: Any, at: Any, codes: Any, scale: Any, bytes_out: Any) -> None:
    """Places and radii of all nodes, bottom up; radii are rounded up to codes. ``scale`` (256,) is overwritten."""
    step = np.float64(frame[3])
    radius = np.zeros(CHUNK_NODES, np.float32)  # in steps
    code_of = np.zeros(CHUNK_NODES, np.int64)
    largest = np.float32(0.0)
    for i in range(counts[0]):
        largest = max(largest, radii[begin + i])
    # No sphere is wider than twice what holds all points: this is code 255 until the largest is known.
    bound = 2.0 * (65535.0 * 1.75 * step + np.float64(largest))
    for code in range(1, 256):
        scale[code] = np.float32(bound * 2.0 ** ((code - 255) / RADIUS_STEPS) / step * _SLACK)
    top = 0
    for i in range(counts[0]):
        code = _code_of(radii[begin + i] * np.float32(_SLACK / bound))
        code_of[_BEGIN[0] + i] = code
        radius[_BEGIN[0] + i] = scale[code]
    for level in range(1, CHUNK_LEVEL + 1):
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            first = _BEGIN[level - 1] + FAN * i
            last = _BEGIN[level - 1] + min(FAN * i + FAN, counts[level - 1])
            code = _code_of(np.float32(_sphere(at, radius, first, last, node, codes) * step * _SLACK / bound))
            code_of[node] = code
            radius[node] = scale[code]
            top = max(top, code)
    frame[4] = np.float32(bound * 2.0 ** ((top - 255) / RADIUS_STEPS)) if top > 0 else np.float32(0.0)
    for level in range(CHUNK_LEVEL + 1):
        for node in range(_BEGIN[level], _BEGIN[level] + counts[level]):
            if code_of[node] > 0:
                bytes_out[node, 6] = 255 - (top - code_of[node])


@njit(cache=True, nogil=True)
def _colours(rows: Any, begin: int, counts: Any, light: Any, codes_of_light: Any, out: Any) -> None:
    """Mean colours in linear light, and mean intensities, into bytes 11 ... 15 of nodes."""
    total = np.zeros((CHUNK_NODES - CHUNK_POINTS, 4), np.float32)
    for i in range(counts[0]):
        node, group = _BEGIN[0] + i, _BEGIN[1] + i // FAN
        for c in range(3):
            out[node, 12 + c] = rows[begin + i, c]
            total[group, c] += light[rows[begin + i, c]]
        out[node, 11] = rows[begin + i, 3]
        total[group, 3] += np.float32(rows[begin + i, 3])
    for level in range(1, CHUNK_LEVEL + 1):
        below = FAN**level
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            share = np.float32(1.0) / np.float32(min(below, counts[0] - below * i))
            for c in range(3):
                mean = min(total[node, c] * share, np.float32(1.0))
                out[node, 12 + c] = codes_of_light[int(mean * np.float32(65535.0) + np.float32(0.5))]
            out[node, 11] = np.uint8(total[node, 3] * share + np.float32(0.5))
            if level < CHUNK_LEVEL:
                for c in range(4):
                    total[_BEGIN[level + 1] + i // FAN, c] += total[node, c]


@njit(cache=True, nogil=True)
def _unpack(u: int, v: int, normal: Any) -> None:
    x, y = u / 127.0, v / 127.0
    z = 1.0 - abs(x) - abs(y)
    if z < 0.0:
        x, y = x + (z if x >= 0.0 else -z), y + (z if y >= 0.0 else -z)
    length = np.sqrt(x * x + y * y + z * z)
    normal[0], normal[1], normal[2] = x / length, y / length, z / length


@njit(cache=True, nogil=True)
def pack_normal(x: float, y: float, z: float, out: Any) -> None:
    """The octahedral code of a vector of any length but zero."""
    scale = 1.0 / (abs(x) + abs(y) + abs(z))
    x, y, z = x * scale, y * scale, z * scale
    if z < 0.0:
        x, y = (1.0 - abs(y)) * (1.0 if x >= 0.0 else -1.0), (1.0 - abs(x)) * (1.0 if y >= 0.0 else -1.0)
    out[0], out[1] = np.int8(np.rint(x * 127.0)), np.int8(np.rint(y * 127.0))


@njit(cache=True, nogil=True)
def pack_normals_into(normals: Any, codes: Any) -> None:
    """Octahedral codes (N, 2) int8 of vectors (N, 3) of any length; `NO_NORMAL` where one is zero or not finite."""
    for i in range(normals.shape[0]):
        x, y, z = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
        size = abs(x) + abs(y) + abs(z)
        if np.isfinite(size) and size > 0.0:
            pack_normal(x, y, z, codes[i])
        else:
            codes[i, 0], codes[i, 1] = NO_NORMAL, NO_NORMAL


@njit(cache=True, nogil=True)
def _mean_normal(normal: Any, weight: Any, first: int, last: int, two_sided: bool, mean: Any) -> float:
    """The sum of children's normals into ``mean``, and how many points had one; two-sided ones turned to agree."""
    known = 0.0
    mean[:] = 0.0
    for i in range(first, last):
        along = mean[0] * normal[i, 0] + mean[1] * normal[i, 1] + mean[2] * normal[i, 2]
        weighted = -weight[i] if two_sided and along < 0.0 else weight[i]
        known += weight[i]
        for a in range(3):
            mean[a] += weighted * normal[i, a]
    return known


@njit(cache=True, nogil=True)
def _half_angle(normal: Any, cone: Any, weight: Any, first: int, last: int, axis: Any, two_sided: bool) -> float:
    """Of a cone about ``axis`` that holds those of the children that have one: unknown normals have no say."""
    widest, least = 0.0, 1.0
    for i in range(first, last):
        if weight[i] > 0.0:
            along = axis[0] * normal[i, 0] + axis[1] * normal[i, 1] + axis[2] * normal[i, 2]
            along = abs(along) if two_sided else along
            if cone[i] > 0.0:
                widest = max(widest, np.arccos(min(max(along, -1.0), 1.0)) + cone[i])
            else:
                least = min(least, along)
    return float(max(widest, np.arccos(max(least, -1.0))))


@njit(cache=True, nogil=True)
def _cones(counts: Any, two_sided: bool, octahedral: Any, out: Any) -> None:
    """Normals and cones above points whose normals are in ``octahedral`` (nodes, 2) int8, and in ``out`` as bytes."""
    normal = np.zeros((CHUNK_NODES, 3), np.float64)
    cone = np.zeros(CHUNK_NODES, np.float64)
    weight = np.zeros(CHUNK_NODES, np.float64)
    mean = np.zeros(3, np.float64)
    for node in range(_BEGIN[0], _BEGIN[0] + counts[0]):
        if out[node, 10] != ALL_AROUND:
            _unpack(octahedral[node, 0], octahedral[node, 1], normal[node])
            weight[node] = 1.0
    for level in range(1, CHUNK_LEVEL + 1):
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            first = _BEGIN[level - 1] + FAN * i
            last = _BEGIN[level - 1] + min(FAN * i + FAN, counts[level - 1])
            out[node, 10] = ALL_AROUND
            known = _mean_normal(normal, weight, first, last, two_sided, mean)
            below = min(FAN**level, counts[0] - FAN**level * i)
            if known * 2.0 < below or abs(mean[0]) + abs(mean[1]) + abs(mean[2]) < 1e-6 * known:
                continue
            pack_normal(mean[0], mean[1], mean[2], octahedral[node])
            _unpack(octahedral[node, 0], octahedral[node, 1], normal[node])
            weight[node] = known
            code = np.ceil(
                _half_angle(normal, cone, weight, first, last, normal[node], two_sided) * _CONES_A_RADIAN - 1e-6
            )
            if code >= (127.0 if two_sided else 254.0):
                code = _BLIND
            out[node, 10] = np.uint8(code)
            cone[node] = code / _CONES_A_RADIAN


@njit(cache=True, nogil=True)
def build_chunks(
    places: Any, rows: Any, radii: Any, step: float, low: Any, two_sided: bool, light: Any, codes_of_light: Any,
    codes: Any, octahedral: Any, out: Any, frames: Any,
) -> None:  # fmt: skip
    """All nodes of consecutive chunks.

    ``places`` (N, 3) int32 on a lattice of ``step`` metres that begins at ``low`` (3,) from the cloud's origin;
    ``rows`` (N, 8) uint8: red, green, blue, intensity, octahedral normal; ``radii`` (N,) in metres. ``codes``
    (C, 4681, 8) uint16, ``octahedral`` (C, 4681, 2) int8 (bytes 8 and 9) and ``out`` (C, 4681, 16) uint8 are the same
    zeroed nodes; ``frames`` is (C, 5) float32: origin, step, largest radius. Contrasts are left at 0.
    """
    at = np.zeros((CHUNK_NODES, 3), np.float32)
    scale = np.zeros(256, np.float32)
    counts = np.zeros(CHUNK_LEVEL + 1, np.int64)
    for chunk in range(out.shape[0]):
        begin = chunk * CHUNK_POINTS
        end = min(begin + CHUNK_POINTS, places.shape[0])
        counts[0] = end - begin
        for level in range(1, CHUNK_LEVEL + 1):
            counts[level] = (counts[level - 1] + FAN - 1) // FAN
        for level in range(CHUNK_LEVEL + 1):
            for node in range(_BEGIN[level], _BEGIN[level] + counts[level]):
                out[chunk, node, 10] = ALL_AROUND
        _frame(places, begin, end, step, low, frames[chunk], at, codes[chunk])
        _spheres(radii, begin, counts, frames[chunk], at, codes[chunk], scale, out[chunk])
        _colours(rows, begin, counts, light, codes_of_light, out[chunk])
        known = False
        for i in range(counts[0]):
            node = _BEGIN[0] + i
            if rows[begin + i, 4] != 128:  # as int8, `NO_NORMAL`
                out[chunk, node, 8], out[chunk, node, 9] = rows[begin + i, 4], rows[begin + i, 5]
                out[chunk, node, 10] = 0
                known = True
        if known:
            _cones(counts, two_sided, octahedral[chunk], out[chunk])
