"""The contrast of nodes to all that their spheres meet, over a whole cloud.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 4.1: a splat may hide
whatever intersects its sphere, whether it lies below the node or not.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.point_contrast_kernels import MOST_NEAR, chunk_contrasts, decode_chunk, luminance_ranges, top_contrasts
from limen.data.point_nodes import CHUNK_LEVEL, CHUNK_NODES, CHUNK_POINTS, FAN, LEVEL_BEGIN, ChunkFrame, radius_of_code
from limen.geometry import Floats
from limen.vision.grades import CONTRAST_OF_CODE
from limen.vision.luminance import Photometry

__all__ = ["ChunkContrasts", "Neighbourhood", "chunk_counts", "ranges_of"]

_INNER = LEVEL_BEGIN[0]
_SCALE = radius_of_code(np.arange(256, dtype=np.uint8), 1.0).astype(np.float32)
_SLOTS = 2 * MOST_NEAR
"""Chunks that stay decoded, 28 MB a thread."""

_ROUNDING = 1e-6
"""Of the distances at hand: more than what float32 does to them."""


def chunk_counts(points: int, chunk: int) -> NDArray[np.int64]:
    """Nodes of levels 0 to 4 in a chunk of a cloud of so many points, (5,)."""
    counts = [min(CHUNK_POINTS, points - chunk * CHUNK_POINTS)]
    for _ in range(CHUNK_LEVEL):
        counts.append(-(-counts[-1] // FAN))
    return np.array(counts, np.int64)


def ranges_of(nodes: NDArray[Any], points: int, photometry: Photometry) -> NDArray[np.float32]:
    """Lowest and highest luminance of the points below inner nodes, (C, 585, 2) in cd/m2.

    ``nodes`` (C, 4681, 16) uint8 are consecutive chunks that hold ``points`` points.
    """
    ranges = np.empty((len(nodes), _INNER, 2), np.float32)
    channels = photometry.channels_cd_m2.astype(np.float32)
    for chunk in range(len(nodes)):
        counts = chunk_counts(points, chunk)
        luminance_ranges(nodes[chunk], counts, channels, photometry.dark_cd_m2, ranges[chunk])
    return ranges


class Neighbourhood:
    """What meets what: tops at once, the nodes of a chunk when it is asked for.

    Parameters
    ----------
    nodes
        (C, 4681, 16) uint8, of all chunks.
    ranges
        (C, 585, 2) float32, of `ranges_of`.
    frames
        Of all chunks.
    tops
        By level; those above level 4 get their contrasts here.
    """

    def __init__(
        self, nodes: NDArray[np.uint8], ranges: NDArray[np.float32], frames: ChunkFrame, tops: tuple[NDArray[Any], ...],
        points: int, photometry: Photometry,
    ) -> None:  # fmt: skip
        self._nodes, self._ranges, self._frames = nodes, ranges, frames
        self._points, self._photometry = points, photometry
        sizes = [len(level) for level in tops]
        begin = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        every = np.concatenate(tops)
        places, radii = every["place"].astype(float), every["radius"].astype(float)
        self._spheres = np.column_stack([places, radii, _ranges_of_tops(ranges, sizes)])
        self._lists = np.zeros((len(every), MOST_NEAR), np.int32)
        self._lengths = np.zeros(len(every), np.int32)
        codes = np.zeros(len(every), np.uint8)
        shown = photometry.luminance_cd_m2(every["rgb"])
        top_contrasts(self._spheres, shown, begin, CONTRAST_OF_CODE, self._lists, self._lengths, codes)
        for k, level in enumerate(tops[1:], 1):
            level["contrast"] = codes[begin[k] : begin[k + 1]]

    def reader(self) -> ChunkContrasts:
        """What tells the contrasts in chunks; each thread wants its own."""
        return ChunkContrasts(self)


class ChunkContrasts:
    """Contrasts in one chunk after the other: neighbours stay decoded, so consecutive ones are the fastest."""

    def __init__(self, all_: Neighbourhood) -> None:
        self._all = all_
        self._channels = all_._photometry.channels_cd_m2.astype(np.float32)
        self._origins = all_._frames.origin.astype(float)
        self._met = np.empty((CHUNK_LEVEL + 1, 6, FAN * MOST_NEAR), np.float32)
        self._points = np.empty((5, FAN * FAN * MOST_NEAR), np.float32)
        self._arena = np.empty((_SLOTS, 6, CHUNK_NODES), np.float32)
        self._slots: OrderedDict[int, int] = OrderedDict()

    def of(self, chunk: int) -> NDArray[np.uint8]:
        """Codes of a chunk's inner nodes, (585,)."""
        all_ = self._all
        met = all_._lists[chunk, : all_._lengths[chunk]].astype(np.int64)
        met = np.concatenate([[chunk], met[met != chunk]])
        is_chunk = met < len(all_._nodes)
        near = met[is_chunk]
        ids = np.empty(MOST_NEAR, np.int64)
        ids[: len(met)] = np.concatenate([CHUNK_NODES * np.arange(len(near)), -1 - np.arange(len(met) - len(near))])
        origins = self._origins
        relative = all_._spheres[np.concatenate([near, met[~is_chunk]])]
        relative[:, :3] -= origins[chunk]
        spheres = np.empty((6, MOST_NEAR), np.float32)
        spheres[:, : len(met)] = relative.T
        offsets = (origins[near] - origins[chunk]).astype(np.float32)
        slack = _ROUNDING * np.abs(relative[:, :4]).sum(axis=1).max()
        codes = np.zeros(_INNER, np.uint8)
        counts = chunk_counts(all_._points, chunk)
        chunk_contrasts(
            counts, len(met), ids, spheres, self._arena, self._decoded(near), offsets, slack, all_._nodes[chunk],
            self._channels, all_._photometry.dark_cd_m2, CONTRAST_OF_CODE, self._met, self._points, codes,
        )  # fmt: skip
        return codes

    def _decoded(self, chunks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Slots of chunks, decoded where they were not."""
        all_ = self._all
        for chunk in chunks.tolist():
            if chunk in self._slots:
                self._slots.move_to_end(chunk)
        slots = np.empty(len(chunks), np.int64)
        for k, chunk in enumerate(chunks.tolist()):
            if chunk not in self._slots:
                free = len(self._slots) if len(self._slots) < _SLOTS else self._slots.popitem(last=False)[1]
                nodes = all_._nodes[chunk]
                decode_chunk(
                    nodes.view(np.uint16), nodes, chunk_counts(all_._points, chunk), all_._frames.step[chunk],
                    all_._frames.radius[chunk], _SCALE, self._channels, all_._photometry.dark_cd_m2,
                    all_._ranges[chunk], self._arena[free],
                )  # fmt: skip
                self._slots[chunk] = free
            slots[k] = self._slots[chunk]
        return slots


def _ranges_of_tops(ranges: NDArray[np.float32], sizes: list[int]) -> Floats:
    """Lowest and highest luminance below all tops, level by level: (N, 2)."""
    levels = [np.array(ranges[:, LEVEL_BEGIN[CHUNK_LEVEL]], dtype=float)]
    for size in sizes[1:]:
        starts = FAN * np.arange(size)
        low = np.minimum.reduceat(levels[-1][:, 0], starts)
        levels.append(np.stack([low, np.maximum.reduceat(levels[-1][:, 1], starts)], axis=1))
    return np.concatenate(levels)
