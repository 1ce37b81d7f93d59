"""Nodes of a chunk from its points: spheres that hold spheres, mean colours and normals, cones.

Everything above the points is made of what is stored, after it was rounded, so that what holds for the numbers in
the file holds for what is drawn.

A level is made at once from the one below it, whose nodes come **side by side**: first the first children of all nodes,
then the second ones, and so on. The loops over nodes then run in wide registers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.cone_kernels import WIDTH, cones, mean_normals, unpack_normals
from limen.data.points.hilbert_kernels import box_of
from limen.data.points.nodes import ALL_AROUND, CHUNK_LEVEL, CHUNK_NODES, CHUNK_POINTS, FAN, LEVEL_BEGIN

__all__ = ["RADIUS_STEPS", "build_chunks"]

RADIUS_STEPS = 12
"""Codes of radii in an octave."""

_BEGIN = LEVEL_BEGIN
_SLACK = 1.0 + 1e-6
"""Radii are kept in float32, and so are the frames that places are read with."""

_CENTRE_STEPS = 4

_STEPS_OF_FRACTION = np.ceil(np.log2(1.0 + np.arange(1, 257) / 256.0) * RADIUS_STEPS - 1e-9).astype(np.int64)
"""Codes from a power of two to a fraction above it, by the fraction's first eight bits, rounded up."""

_RADIANS_A_CONE = np.float32(np.pi / 254.0)


@compiled(error_model="python")
def _frame(words: Any, begin: int, end: int, step: float, low: Any, frame: Any, at: Any) -> None:
    """Where the chunk's codes begin and how long a step is, into ``frame`` (5,); codes of the points' places into rows
    0, 1, 2 of ``at``.

    ``low`` (3,) is where the lattice begins, from the cloud's origin.
    """
    box = np.empty((2, 3), np.uint32)
    box_of(words[begin:end], box)
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
        for i in range(end - begin):
            code = np.int32(np.int32(words[begin + i, a]) * scale + offset)
            at[a, i] = np.float32(np.int32(0) if code < 0 else np.int32(65535) if code > 65535 else code)


@compiled(error_model="python")
def _code_of(share: float) -> int:
    """The smallest code that stands for no less than a share of the largest radius; 0 for none.

    Logarithms are looked up by the upper eight bits of the fraction, so one in fifteen is a code larger.
    """
    if share <= np.float32(0.0):
        return 0
    bits = np.float32(share).view(np.int32)
    octave, part = (bits >> 23) - 127, (bits >> 15) & 255
    return int(min(max(255 + octave * RADIUS_STEPS + _STEPS_OF_FRACTION[part], 1), 255))


@compiled(error_model="python")
def _beside(own: Any, first: int, count: int, rows: int, out: Any) -> None:
    """Children from the ``first`` on side by side, a row after the other; the last one stands in for those missing."""
    for row in range(rows):
        for i in range(count // FAN):
            for child in range(FAN):
                out[row * CHUNK_POINTS + child * WIDTH + i] = own[row, first + FAN * i + child]
        if count % FAN > 0:
            i = count // FAN
            for child in range(FAN):
                out[row * CHUNK_POINTS + child * WIDTH + i] = own[row, first + min(FAN * i + child, count - 1)]


@compiled(error_model="python")
def _middles(beside: Any, nodes: int, state: Any) -> None:
    """The middle of the box of children's spheres, rows 0, 1, 2 of ``state``."""
    half = np.float32(0.5)
    for i in range(nodes):
        x, y, z, r = beside[i], beside[1 * CHUNK_POINTS + i], beside[2 * CHUNK_POINTS + i], beside[3 * CHUNK_POINTS + i]
        x0, y0, z0, x1, y1, z1 = x - r, y - r, z - r, x + r, y + r, z + r
        for child in range(1, FAN):
            k = child * WIDTH + i
            x, y, z, r = (
                beside[k],
                beside[1 * CHUNK_POINTS + k],
                beside[2 * CHUNK_POINTS + k],
                beside[3 * CHUNK_POINTS + k],
            )
            x0, y0, z0 = min(x0, x - r), min(y0, y - r), min(z0, z - r)
            x1, y1, z1 = max(x1, x + r), max(y1, y + r), max(z1, z + r)
        state[i], state[1 * WIDTH + i], state[2 * WIDTH + i] = (x0 + x1) * half, (y0 + y1) * half, (z0 + z1) * half
        state[6 * WIDTH + i] = np.float32(1e30)


@compiled(error_model="python")
def _reach(beside: Any, nodes: int, share: float, state: Any) -> None:
    """How far children reach from rows 0, 1, 2 of ``state``; the best place and its reach are kept in rows 3 ... 6.

    Then it moves by a share of the way towards whichever reaches farthest.
    """
    for i in range(nodes):
        x, y, z = state[i], state[1 * WIDTH + i], state[2 * WIDTH + i]
        reach, far_x, far_y, far_z = np.float32(-1.0), x, y, z
        for child in range(FAN):
            k = child * WIDTH + i
            px, py, pz = beside[k], beside[1 * CHUNK_POINTS + k], beside[2 * CHUNK_POINTS + k]
            dx, dy, dz = px - x, py - y, pz - z
            own = np.sqrt(dx * dx + dy * dy + dz * dz) + beside[3 * CHUNK_POINTS + k]
            farther = own > reach
            reach = own if farther else reach
            far_x, far_y, far_z = px if farther else far_x, py if farther else far_y, pz if farther else far_z
        better = reach < state[6 * WIDTH + i]
        state[6 * WIDTH + i] = reach if better else state[6 * WIDTH + i]
        state[3 * WIDTH + i] = x if better else state[3 * WIDTH + i]
        state[4 * WIDTH + i] = y if better else state[4 * WIDTH + i]
        state[5 * WIDTH + i] = z if better else state[5 * WIDTH + i]
        state[i], state[1 * WIDTH + i], state[2 * WIDTH + i] = (
            x + share * (far_x - x),
            y + share * (far_y - y),
            z + share * (far_z - z),
        )


@compiled(error_model="python")
def _centres(beside: Any, nodes: int, state: Any) -> None:
    """Places of nodes, whole codes, and how far their children reach from there, in steps: rows 3 ... 6 of ``state``.

    From the middle of the children's box a few steps towards whichever reaches farthest (Badoiu, Clarkson 2003,
    *Smaller core-sets for balls*, shortened ever more); the best is kept, and rounded. ``beside`` are the children's
    spheres.
    """
    _middles(beside, nodes, state)
    share = np.float32(0.15)
    for _ in range(_CENTRE_STEPS + 1):
        _reach(beside, nodes, share, state)
        share *= np.float32(0.75)
    for a in range(3):
        for i in range(nodes):
            code = np.float32(np.int32(state[(3 + a) * WIDTH + i] + np.float32(0.5)))
            state[a * WIDTH + i] = min(max(code, np.float32(0.0)), np.float32(65535.0))
    for i in range(nodes):
        state[6 * WIDTH + i] = np.float32(1e30)
    _reach(beside, nodes, np.float32(0.0), state)


@compiled(error_model="python")
def _spheres(radii: Any, begin: int, counts: Any, frame: Any, spheres: Any, codes: Any, scale: Any, beside: Any,
             state: Any) -> None:  # fmt: skip
    """Spheres (4, 4681) of all nodes in steps, bottom up from the points' places, and codes (4681,) of their radii.

    ``scale`` (256,), ``beside`` and ``state`` are overwritten.
    """
    step, points = np.float64(frame[3]), _BEGIN[0]
    largest = np.float32(0.0)
    for i in range(counts[0]):
        largest = max(largest, radii[begin + i])
    # No sphere is wider than twice what holds all points: this is code 255 until the largest is known.
    bound = 2.0 * (65535.0 * 1.75 * step + np.float64(largest))
    for code in range(1, 256):
        scale[code] = np.float32(bound * 2.0 ** ((code - 255) / RADIUS_STEPS) / step * _SLACK)
    top, share = 0, np.float32(_SLACK / bound)
    for i in range(counts[0]):
        code = _code_of(radii[begin + i] * share)
        codes[points + i], spheres[3, points + i] = code, scale[code]
    share = np.float32(step * _SLACK / bound)
    for level in range(1, CHUNK_LEVEL + 1):
        _beside(spheres, _BEGIN[level - 1], counts[level - 1], 4, beside)
        _centres(beside, counts[level], state)
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            code = _code_of(state[6 * WIDTH + i] * share)
            for a in range(3):
                spheres[a, node] = state[(3 + a) * WIDTH + i]
            codes[node], spheres[3, node] = code, scale[code]
            top = max(top, code)
    frame[4] = np.float32(bound * 2.0 ** ((top - 255) / RADIUS_STEPS)) if top > 0 else np.float32(0.0)
    for level in range(CHUNK_LEVEL + 1):
        for node in range(_BEGIN[level], _BEGIN[level] + counts[level]):
            codes[node] = codes[node] + (255 - top) if codes[node] > 0 else 0


@compiled(error_model="python")
def _colours(words: Any, begin: int, counts: Any, light: Any, codes_of_light: Any, looks: Any) -> None:
    """Colours and intensities as a word of a node, red the lowest byte: ``looks`` (4681,) uint32, means of light."""
    total = np.zeros((CHUNK_NODES - CHUNK_POINTS, 4), np.float32)
    for i in range(counts[0]):
        word, group = words[begin + i, 3], _BEGIN[1] + i // FAN
        looks[_BEGIN[0] + i] = word
        total[group, 0] += light[word & np.uint32(255)]
        total[group, 1] += light[word >> np.uint32(8) & np.uint32(255)]
        total[group, 2] += light[word >> np.uint32(16) & np.uint32(255)]
        total[group, 3] += np.float32(word >> np.uint32(24))
    for level in range(1, CHUNK_LEVEL + 1):
        below = FAN**level
        for i in range(counts[level]):
            node = _BEGIN[level] + i
            share = np.float32(1.0) / np.float32(min(below, counts[0] - below * i))
            word = np.uint32(total[node, 3] * share + np.float32(0.5)) << np.uint32(24)
            for c in range(3):
                mean = min(total[node, c] * share, np.float32(1.0))
                code = codes_of_light[np.int32(mean * np.float32(65535.0) + np.float32(0.5))]
                word |= np.uint32(code) << np.uint32(8 * c)
            looks[node] = word
            if level < CHUNK_LEVEL:
                for c in range(4):
                    total[(node - 1) // FAN, c] += total[node, c]


@compiled(error_model="python")
def _normals(words: Any, begin: int, counts: Any, two_sided: bool, faces: Any, beside: Any, state: Any) -> None:
    """Octahedral normals and cones as a word of a node, of 24 bits: ``faces`` (4681,) uint32.

    ``beside`` and ``state`` are overwritten.
    """
    # Rows: unit normal, weight, half angle in radians.
    own, codes = np.empty((5, CHUNK_POINTS), np.float32), np.empty((3, CHUNK_POINTS), np.float32)
    held, known = np.empty(CHUNK_POINTS // FAN, np.float32), np.uint32(0)
    for i in range(counts[0]):
        word = words[begin + i, 4]
        u, v = np.int8(word & np.uint32(255)), np.int8(word >> np.uint32(8) & np.uint32(255))
        codes[0, i], codes[1, i] = np.float32(u), np.float32(v)
        has = u != np.int8(-128)
        own[3, i], own[4, i] = np.float32(has), np.float32(0.0)
        faces[_BEGIN[0] + i] = word & np.uint32(0xFFFF) if has else np.uint32(ALL_AROUND << 16)
        known |= np.uint32(has)
    if known == 0:
        for node in range(_BEGIN[0]):
            faces[node] = np.uint32(ALL_AROUND << 16)
        return
    unpack_normals(codes, counts[0], own)
    for level in range(1, CHUNK_LEVEL + 1):
        nodes = counts[level]
        _beside(own, 0, counts[level - 1], 5, beside)
        for k in range(counts[level - 1], FAN * nodes):
            beside[3 * CHUNK_POINTS + (k % FAN) * WIDTH + k // FAN] = np.float32(0.0)
        for i in range(nodes):
            held[i] = np.float32(min(FAN**level, counts[0] - FAN**level * i))
        mean_normals(beside, nodes, held, two_sided, codes)
        unpack_normals(codes, nodes, own)
        cones(beside, own, nodes, two_sided, state)
        for i in range(nodes):
            fit = codes[2, i] > np.float32(0.0)
            face = np.uint32(np.int32(codes[0, i])) & np.uint32(255) | (
                np.uint32(np.int32(codes[1, i])) & np.uint32(255)
            ) << np.uint32(8)
            face |= np.uint32(state[i]) << np.uint32(16)
            faces[_BEGIN[level] + i] = face if fit else np.uint32(ALL_AROUND << 16)
            own[3, i], own[4, i] = codes[2, i], state[i] * _RADIANS_A_CONE if fit else np.float32(0.0)


@compiled(error_model="python")
def build_chunks(
    words: Any, radii: Any, step: float, low: Any, two_sided: bool, light: Any, codes_of_light: Any, out: Any,
    frames: Any,
) -> None:  # fmt: skip
    """All nodes of consecutive chunks.

    ``words`` (N, 5) uint32 are points: places on a lattice of ``step`` metres that begins at ``low`` (3,) from the
    cloud's origin; red, green, blue, intensity; octahedral normal. ``radii`` (N,) in metres. ``out`` (C, 4681, 4)
    uint32 are zeroed nodes; ``frames`` is (C, 5) float32: origin, step, largest radius. Contrasts are left at 0.
    """
    spheres, codes = np.empty((4, CHUNK_NODES), np.float32), np.zeros(CHUNK_NODES, np.int32)
    looks, faces = np.empty(CHUNK_NODES, np.uint32), np.empty(CHUNK_NODES, np.uint32)
    beside, state = np.empty(5 * CHUNK_POINTS, np.float32), np.empty(7 * WIDTH, np.float32)
    scale, counts = np.zeros(256, np.float32), np.zeros(CHUNK_LEVEL + 1, np.int64)
    for chunk in range(out.shape[0]):
        begin = chunk * CHUNK_POINTS
        end = min(begin + CHUNK_POINTS, words.shape[0])
        counts[0] = end - begin
        for level in range(1, CHUNK_LEVEL + 1):
            counts[level] = (counts[level - 1] + FAN - 1) // FAN
        _frame(words, begin, end, step, low, frames[chunk], spheres[:, _BEGIN[0] :])
        _spheres(radii, begin, counts, frames[chunk], spheres, codes, scale, beside, state)
        _colours(words, begin, counts, light, codes_of_light, looks)
        _normals(words, begin, counts, two_sided, faces, beside, state)
        for level in range(CHUNK_LEVEL + 1):
            for node in range(_BEGIN[level], _BEGIN[level] + counts[level]):
                x, y, z = np.uint32(spheres[0, node]), np.uint32(spheres[1, node]), np.uint32(spheres[2, node])
                look = looks[node]
                out[chunk, node, 0] = x | y << np.uint32(16)
                out[chunk, node, 1] = z | np.uint32(codes[node]) << np.uint32(16)
                out[chunk, node, 2] = faces[node] | look & np.uint32(0xFF000000)
                out[chunk, node, 3] = look & np.uint32(0x00FFFFFF)
