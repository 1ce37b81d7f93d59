"""Loops over trees of points: which nodes are drawn as splats on a panel, and how often their order lets a budget draw.

A node is judged by ``k``: how many times larger it is than what is invisible there, so also how many times farther
away its viewer would have to be. Drawn are the first nodes from the root down with ``k <= limit``, and points.

Rows that all loops take, beside ``eyes`` and ``panel`` of `limen.layers.common.sphere_kernels`:

* ``place`` (3, 4): from the cloud's own coordinates to the way from the eye, metres; ``size``: metres of its unit.
* ``light`` (5,): toward the fixed light, 3; share of light from everywhere; 1 if splats are lit.
* ``mode``: 0 by pixels alone, 1 by what eyes see.
"""

from __future__ import annotations

import math

import numpy as np

from limen.compiled import compiled
from limen.data.points.nodes import ALL_AROUND, CHUNK_LEVEL, FAN, LEVEL_BEGIN
from limen.layers.common.sphere_kernels import (
    bin_of,
    code_of,
    contrast_of,
    diameter_px,
    is_outside,
    least_allowed_m,
    lit_range,
)

TOP_BIT = np.uint32(1 << 31)

_SKIP, _DRAW, _OPEN = 0, 1, 2
_HALF_ANGLE = math.pi / 254.0
_BEGIN = np.array(LEVEL_BEGIN, np.int64)


@compiled
def _lit_code(code, nx, ny, nz, half, toward, margin, light):
    """The contrast code of a node whose normals are lit differently: half by the fixed light, half by the viewer's."""
    direct = nx * light[0] + ny * light[1] + nz * light[2]
    sign = 1.0 if toward >= 0.0 else -1.0  # both sides are seen, each lit as the front
    low, high = lit_range(sign * direct, half, False)
    head_low, head_high = lit_range(toward, half + margin, True)
    share = light[3]
    least = share + (1.0 - share) * 0.5 * (low + head_low)
    most = share + (1.0 - share) * 0.5 * (high + head_high)
    contrast = contrast_of(code)
    if contrast >= 1.0:
        return 255
    ratio = (1.0 + contrast) / (1.0 - contrast) * most / max(least, 1e-6)
    combined = (ratio - 1.0) / (ratio + 1.0)
    return code_of(combined)


@compiled
def _normal(u, v):
    """Unit vector of an octahedral code, see `limen.data.points.nodes.unpacked_normal`."""
    x, y = u / 127.0, v / 127.0
    z = 1.0 - abs(x) - abs(y)
    under = max(-z, 0.0)
    x -= math.copysign(under, x)
    y -= math.copysign(under, y)
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@compiled
def judged(x, y, z, radius, u, v, cone, code, panel, eyes, place, size, light, shares, mode, two_sided):
    """Whether a sphere is to be skipped, and its ``k``; negative: it is skipped.

    ``x, y, z`` is the way from the eye and ``radius`` in metres, the normal in the cloud's own directions.
    """
    if is_outside(x, y, z, radius, panel):
        return -1.0
    pixels = diameter_px(x, y, z, radius, panel)
    away = math.sqrt(x * x + y * y + z * z)
    if cone != ALL_AROUND and away > radius:
        nx, ny, nz = _normal(u, v)
        rx = (place[0, 0] * nx + place[0, 1] * ny + place[0, 2] * nz) / size
        ry = (place[1, 0] * nx + place[1, 1] * ny + place[1, 2] * nz) / size
        rz = (place[2, 0] * nx + place[2, 1] * ny + place[2, 2] * nz) / size
        toward = -(rx * x + ry * y + rz * z) / away
        tilt = math.asin(min(max(toward, -1.0), 1.0))
        half, margin = cone * _HALF_ANGLE, math.asin(radius / away)
        if tilt < -(half + margin) and not two_sided:
            return -1.0
        if mode == 0:
            return pixels
        if abs(tilt) <= half + margin:
            code = 255
        elif light[4] != 0.0:
            code = _lit_code(code, rx, ry, rz, half, toward, margin, light)
    elif mode == 0:
        return pixels
    else:
        code = 255
    seen = 2.0 * radius * shares[code]
    if seen == 0.0:
        return 0.0
    allowed = least_allowed_m(x, y, z, radius, eyes)
    return pixels if allowed <= 0.0 else min(pixels, seen / allowed)


@compiled
def cut_tops(
    level_first, level_count, root, places, radii, small, panel, eyes, place, size, light, shares, mode, two_sided,
    limit, slots, drawn, opened, opened_k, wanted_k, histogram,
):  # fmt: skip
    """The part of the cut above chunks, on one panel.

    Parameters
    ----------
    level_first, level_count
        Where the tops of each level, 4 first, begin, and how many there are.
    places, radii, small
        (K, 3), (K,) and (K, 6) uint8 (two of normal as int8, cone, contrast, 2 spare), in the cloud's unit.
    slots
        (C,) of every chunk, -1 where it is not resident.
    drawn, opened, opened_k
        Filled with tops that are drawn (numbers in ``places``), and with chunks to go into and their ``k``.
    wanted_k
        (C,): raised to the ``k`` of chunks whose insides are wanted, resident or not.
    histogram
        (256,), or empty: counts what each bin of ``k`` adds when it is opened; see `cut_chunks`.

    Returns
    -------
    How many are drawn, how many opened, how many nodes were judged, the largest ``k`` drawn and the largest diameter,
    pixels.
    """
    counting = histogram.shape[0] > 0
    stack = np.empty(8 * 16 * FAN, np.int64)
    stack_level = np.empty(8 * 16 * FAN, np.int64)
    stack_k = np.empty(8 * 16 * FAN, np.float64)
    stack[0], stack_level[0], stack_k[0] = 0, root, math.inf
    depth, draws, opens, visits, largest, widest = 1, 0, 0, 0, 0.0, 0.0
    while depth > 0:
        depth -= 1
        index, level, above = stack[depth], stack_level[depth], stack_k[depth]
        row = level_first[level] + index
        px, py, pz = places[row, 0], places[row, 1], places[row, 2]
        x = place[0, 0] * px + place[0, 1] * py + place[0, 2] * pz + place[0, 3]
        y = place[1, 0] * px + place[1, 1] * py + place[1, 2] * pz + place[1, 3]
        z = place[2, 0] * px + place[2, 1] * py + place[2, 2] * pz + place[2, 3]
        u, v = np.int8(small[row, 0]), np.int8(small[row, 1])
        visits += 1
        k = judged(
            x, y, z, radii[row] * size, u, v, np.int64(small[row, 2]), np.int64(small[row, 3]), panel, eyes, place,
            size, light, shares, mode, two_sided,
        )  # fmt: skip
        if k < 0.0:
            if counting and above < math.inf:
                histogram[bin_of(above)] -= 1
            continue
        k = min(k, above)
        if not counting and k <= limit:
            drawn[draws] = row
            draws += 1
            largest = max(largest, k)
            widest = max(widest, diameter_px(x, y, z, radii[row] * size, panel))
            continue
        if level == 0:
            wanted_k[index] = max(wanted_k[index], k)
            if slots[index] < 0 and not counting:
                drawn[draws] = row
                draws += 1
                largest = max(largest, k)
                widest = max(widest, diameter_px(x, y, z, radii[row] * size, panel))
                continue
            opened[opens], opened_k[opens] = index, k
            opens += 1
            continue
        first, last = FAN * index, min(FAN * index + FAN, level_count[level - 1])
        if counting:
            histogram[bin_of(k)] += last - first - 1
        for child in range(last - 1, first - 1, -1):
            stack[depth], stack_level[depth], stack_k[depth] = child, level - 1, k
            depth += 1
    return draws, opens, visits, largest, widest


@compiled
def cut_chunks(
    chunks, chunk_k, begin, end, slots, points, origins, steps, largest_radii, radius_of_code, words, panel, eyes,
    place, size, light, shares, mode, two_sided, limit, drawn, histogram,
):  # fmt: skip
    """The part of the cut inside chunks ``begin`` to ``end`` of a list, on one panel; counts on where there is no room.

    Parameters
    ----------
    chunks, chunk_k
        (M,): as `cut_tops` opened them.
    points
        How many points the whole cloud has.
    origins, steps, largest_radii
        Of `limen.data.points.nodes.ChunkFrame`; ``radius_of_code`` (256,) are the shares of codes.
    words
        (S, 4681, 4) uint32: the nodes of resident chunks.
    histogram
        (256,): where not empty nothing is drawn, but every node's children, less the node, are added to the bin of the
        smallest ``k`` from the root down to it. So 1 and the sum of all bins above a limit is how many splats that
        limit draws; chunks that are not resident count as their tops.

    Returns
    -------
    How many are (or were to be) drawn, how many nodes were judged, the largest ``k`` and diameter of inner nodes drawn.
    """
    counting = histogram.shape[0] > 0
    room = drawn.shape[0]
    stack = np.empty(8 * FAN, np.int64)
    stack_level = np.empty(8 * FAN, np.int64)
    stack_k = np.empty(8 * FAN, np.float64)
    draws, visits, largest, thickest = 0, 0, 0.0, 0.0
    for entry in range(begin, end):
        chunk = chunks[entry]
        slot = slots[chunk]
        if slot < 0:
            continue
        held = min(points - chunk * FAN**CHUNK_LEVEL, FAN**CHUNK_LEVEL)
        ox, oy, oz = origins[chunk, 0], origins[chunk, 1], origins[chunk, 2]
        bx = place[0, 0] * ox + place[0, 1] * oy + place[0, 2] * oz + place[0, 3]
        by = place[1, 0] * ox + place[1, 1] * oy + place[1, 2] * oz + place[1, 3]
        bz = place[2, 0] * ox + place[2, 1] * oy + place[2, 2] * oz + place[2, 3]
        step, widest = steps[chunk], largest_radii[chunk] * size
        depth = 0
        above, level = chunk_k[entry], CHUNK_LEVEL - 1
        count = (held + FAN**level - 1) // FAN**level
        if counting:
            histogram[bin_of(above)] += count - 1
        for child in range(count - 1, -1, -1):
            stack[depth], stack_level[depth], stack_k[depth] = child, level, above
            depth += 1
        while depth > 0:
            depth -= 1
            index, level, above = stack[depth], stack_level[depth], stack_k[depth]
            node = _BEGIN[level] + index
            first, second = np.int64(words[slot, node, 0]), np.int64(words[slot, node, 1])
            third = np.int64(words[slot, node, 2])
            px, py, pz = (first & 0xFFFF) * step, (first >> 16) * step, (second & 0xFFFF) * step
            x = bx + place[0, 0] * px + place[0, 1] * py + place[0, 2] * pz
            y = by + place[1, 0] * px + place[1, 1] * py + place[1, 2] * pz
            z = bz + place[2, 0] * px + place[2, 1] * py + place[2, 2] * pz
            radius = radius_of_code[(second >> 16) & 0xFF] * widest
            visits += 1
            k = judged(
                x, y, z, radius, np.int8(third & 0xFF),
                np.int8((third >> 8) & 0xFF), (third >> 16) & 0xFF, second >> 24, panel, eyes, place, size, light,
                shares, mode, two_sided,
            )  # fmt: skip
            if k < 0.0:
                if counting:
                    histogram[bin_of(above)] -= 1
                continue
            k = min(k, above)
            if not counting and (level == 0 or k <= limit):
                if draws < room:
                    drawn[draws] = slot * (_BEGIN[0] + FAN**CHUNK_LEVEL) + node
                draws += 1
                if level > 0:
                    largest = max(largest, k)
                    thickest = max(thickest, diameter_px(x, y, z, radius, panel))
                continue
            if level == 0:
                continue
            begin_child = FAN * index
            below = (held + FAN ** (level - 1) - 1) // FAN ** (level - 1)
            end_child = min(begin_child + FAN, below)
            if counting:
                histogram[bin_of(k)] += end_child - begin_child - 1
            for child in range(end_child - 1, begin_child - 1, -1):
                stack[depth], stack_level[depth], stack_k[depth] = child, level - 1, k
                depth += 1
    return draws, visits, largest, thickest
