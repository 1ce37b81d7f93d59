"""Chunks as contrasts are found in them: side by side, in float32.

Inner nodes are six rows of 585 (x, y, z from the chunk's origin, radius, lowest and highest luminance below), and each
**group** of 64 points, that of a node of level 2, is five rows of 64 (x, y, z, radius, luminance). Within a chunk, node
``n`` has the children ``8 n + 1`` to ``8 n + 8``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.light_kernels import light_of
from limen.data.points.nodes import CHUNK_POINTS, FAN, LEVEL_BEGIN

__all__ = ["FAR", "GROUP", "GROUP_NUMBERS", "INNER", "decoded"]

INNER = LEVEL_BEGIN[0]
"""Nodes of a chunk above its points."""

GROUP = FAN * FAN
GROUP_NUMBERS = 5 * GROUP
FAR = np.float32(1e30)

_BEGIN = LEVEL_BEGIN


@compiled(error_model="python")
def _decode(cloud: Any, chunk: int, scale: Any, light: Any, inner: Any, groups: Any, slot: int) -> None:
    """A chunk into ``inner`` (S, 6, 585) and ``groups`` (S * 64 * 320,); far away where there is no node."""
    nodes, places, points, frames = cloud
    channels, dark = light
    count = min(CHUNK_POINTS, points - chunk * CHUNK_POINTS)
    step, largest = np.float32(frames[chunk, 3]), np.float32(frames[chunk, 4])
    node: Any
    for node in range(INNER):
        for axis in range(3):
            inner[slot, axis, node] = np.float32(places[chunk, node, axis]) * step
        inner[slot, 3, node] = scale[nodes[chunk, node, 6]] * largest
        inner[slot, 4, node], inner[slot, 5, node] = FAR, np.float32(0.0)
    for i in range(CHUNK_POINTS):
        at: Any = np.uint64((slot * GROUP + i // GROUP) * GROUP_NUMBERS + i % GROUP)
        if i >= count:
            groups[at], groups[at + np.uint64(3 * GROUP)] = FAR, np.float32(0.0)
            continue
        node, above = np.uint64(_BEGIN[0] + i), np.uint64(_BEGIN[1] + i // FAN)
        shown = light_of(nodes, chunk, node, channels, dark)
        groups[at] = np.float32(places[chunk, node, 0]) * step
        groups[at + np.uint64(GROUP)] = np.float32(places[chunk, node, 1]) * step
        groups[at + np.uint64(2 * GROUP)] = np.float32(places[chunk, node, 2]) * step
        groups[at + np.uint64(3 * GROUP)] = scale[nodes[chunk, node, 6]] * largest
        groups[at + np.uint64(4 * GROUP)] = shown
        inner[slot, 4, above] = min(inner[slot, 4, above], shown)
        inner[slot, 5, above] = max(inner[slot, 5, above], shown)
    for node in range(INNER - 1, 0, -1):
        above = (node - 1) // FAN
        inner[slot, 4, above] = min(inner[slot, 4, above], inner[slot, 4, node])
        inner[slot, 5, above] = max(inner[slot, 5, above], inner[slot, 5, node])
        if inner[slot, 5, node] < inner[slot, 4, node]:
            inner[slot, 0, node] = FAR


@compiled(error_model="python")
def decoded(near_chunks: Any, count: int, cloud: Any, scale: Any, light: Any, cache: Any, slots: Any) -> None:
    """Slots (K,) of chunks, decoded where they were not, in the place of those that were not wanted for longest.

    ``cloud`` and ``cache`` are as `limen.data.points.contrast_kernels.chunk_contrasts` takes them.
    """
    inner, groups, owners, used, slot_of = cache
    now = used.max() + 1
    for k in range(count):
        if slot_of[near_chunks[k]] >= 0:
            used[slot_of[near_chunks[k]]] = now
    for k in range(count):
        chunk = near_chunks[k]
        slot: Any = np.int64(slot_of[chunk])
        if slot < 0:
            slot = 0
            for other in range(1, used.shape[0]):
                if used[other] < used[slot]:
                    slot = other
            if owners[slot] >= 0:
                slot_of[owners[slot]] = -1
            owners[slot], slot_of[chunk], used[slot] = chunk, slot, now
            _decode(cloud, chunk, scale, light, inner, groups, slot)
        slots[k] = slot
