"""The contrast of nodes to all that their spheres meet, over a whole cloud.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 4.1: a splat may hide
whatever intersects its sphere, whether it lies below the node or not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.points.contrast_kernels import chunk_contrasts
from limen.data.points.decode_kernels import GROUP, GROUP_NUMBERS, INNER
from limen.data.points.light_kernels import luminance_ranges
from limen.data.points.near_kernels import MOST_NEAR, top_contrasts
from limen.data.points.nodes import FAN, ChunkFrame, radius_of_code
from limen.geometry import Floats
from limen.vision.luminance import Photometry

__all__ = ["ChunkContrasts", "Neighbourhood", "ranges_of"]

_SCALE = radius_of_code(np.arange(256, dtype=np.uint8), 1.0).astype(np.float32)
_SLOTS = 2 * MOST_NEAR
"""Chunks that stay decoded, 25 MB a thread."""


def ranges_of(nodes: NDArray[np.uint8], points: int, photometry: Photometry) -> NDArray[np.float32]:
    """Lowest and highest luminance of the points of chunks, (C, 2) in cd/m2.

    ``nodes`` (C, 4681, 16) are consecutive chunks that hold ``points`` points.
    """
    ranges = np.empty((len(nodes), 2), np.float32)
    luminance_ranges(nodes, points, photometry.channels_cd_m2.astype(np.float32), photometry.dark_cd_m2, ranges)
    return ranges


class Neighbourhood:
    """What meets what: tops at once, the nodes of a chunk when it is asked for.

    Parameters
    ----------
    nodes
        (C, 4681, 16) uint8, of all chunks.
    ranges
        (C, 2) float32, of `ranges_of`.
    frames
        Of all chunks.
    tops
        By level; those above level 4 get their contrasts here.
    """

    def __init__(
        self, nodes: NDArray[np.uint8], ranges: NDArray[np.float32], frames: ChunkFrame, tops: tuple[NDArray[Any], ...],
        points: int, photometry: Photometry,
    ) -> None:  # fmt: skip
        self._nodes, self._points, self._photometry = nodes, points, photometry
        self._frames = np.column_stack([frames.origin, frames.step, frames.radius])
        self._channels = photometry.channels_cd_m2.astype(np.float32)
        sizes = [len(level) for level in tops]
        begin = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        every = np.concatenate(tops)
        places, radii = every["place"].astype(float), every["radius"].astype(float)
        self._spheres = np.column_stack([places, radii, _ranges_of_tops(ranges, sizes)])
        self._lists = np.zeros((len(every), MOST_NEAR), np.int32)
        self._lengths = np.zeros(len(every), np.int32)
        codes = np.zeros(len(every), np.uint8)
        shown = photometry.luminance_cd_m2(every["rgb"])
        top_contrasts(self._spheres, shown, begin, self._lists, self._lengths, codes)
        for k, level in enumerate(tops[1:], 1):
            level["contrast"] = codes[begin[k] : begin[k + 1]]

    def reader(self) -> ChunkContrasts:
        """What tells the contrasts in chunks; each thread wants its own."""
        return ChunkContrasts(self)


class ChunkContrasts:
    """Contrasts in one chunk after the other: neighbours stay decoded, so consecutive ones are the fastest."""

    def __init__(self, all_: Neighbourhood) -> None:
        self._all = all_
        slots = min(_SLOTS, len(all_._nodes))
        self._cache = (
            np.empty((slots, 6, INNER), np.float32),
            np.empty(slots * GROUP * GROUP_NUMBERS, np.float32),
            np.full(slots, -1, np.int64),
            np.zeros(slots, np.int64),
            np.full(len(all_._nodes), -1, np.int32),
        )

    def of(self, begin: int, end: int) -> NDArray[np.uint8]:
        """Codes of the inner nodes of chunks ``begin`` to ``end``, (end - begin, 585)."""
        all_ = self._all
        codes = np.zeros((end - begin, INNER), np.uint8)
        cloud = all_._nodes, all_._nodes.view(np.uint16), all_._points, all_._frames
        light = all_._channels, all_._photometry.dark_cd_m2
        chunk_contrasts(begin, cloud, all_._spheres, all_._lists, all_._lengths, _SCALE, light, self._cache, codes)
        return codes


def _ranges_of_tops(ranges: NDArray[np.float32], sizes: list[int]) -> Floats:
    """Lowest and highest luminance below all tops, level by level: (N, 2)."""
    levels = [np.array(ranges, dtype=float)]
    for size in sizes[1:]:
        starts = FAN * np.arange(size)
        low = np.minimum.reduceat(levels[-1][:, 0], starts)
        levels.append(np.stack([low, np.maximum.reduceat(levels[-1][:, 1], starts)], axis=1))
    return np.concatenate(levels)
