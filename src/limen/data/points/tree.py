"""From points to chunks and tops: ordered along a curve, split, and summed up, all in memory.

Places are whole numbers on a **lattice**: a cube of ``2**30`` steps an edge around the cloud.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.cone_kernels import pack_normals_into, pack_words
from limen.data.points.group_kernels import arrange
from limen.data.points.hilbert_kernels import (
    DIGIT_BITS,
    KEY_LEVELS,
    LATTICE_BITS,
    NUMBER_BITS,
    box_of,
    crowded,
    hilbert_keys,
    numbered,
    round_to_lattice,
    sort_digit,
)
from limen.data.points.node_kernels import build_chunks
from limen.data.points.nodes import CHUNK_NODES, CHUNK_POINTS, NODE, ChunkFrame
from limen.data.points.normal_kernels import estimate_normals
from limen.data.store.resample import LINEAR_OF_SRGB, SRGB_OF_LINEAR
from limen.geometry import Floats

__all__ = [
    "NEUTRAL",
    "POINT",
    "Chunks",
    "Lattice",
    "arranged",
    "chunks_of",
    "hilbert_order",
    "pack_normals",
    "pack_points",
]

POINT = np.dtype(
    [
        ("place", "<i4", 3),  # on the lattice
        ("rgb", "u1", 3),
        ("intensity", "u1"),
        ("normal", "i1", 2),  # octahedral; `NO_NORMAL` twice where nothing is known
        ("spare", "u1", 2),
    ]
)
"""A point on its way, 20 bytes."""

NEUTRAL = 204
"""Grey of points whose source says nothing about colour."""

_SORTED_LEVELS = 11
_LONG_RUN = 32


class Lattice(NamedTuple):
    """Where whole numbers lie: ``low + step * place``, in the file's coordinates and unit."""

    low: Floats  # (3,)
    step: float

    @classmethod
    def holding(cls, positions: Floats) -> tuple[Lattice, Floats]:
        """The lattice of positions (N, 3), and their lowest and highest coordinates, (2, 3)."""
        box = np.empty((2, 3))
        box_of(positions, box)
        return cls.around(*box), box

    @classmethod
    def around(cls, least: Floats, most: Floats) -> Lattice:
        """The lattice of a box, both corners (3,)."""
        widest = float((most - least).max())
        return cls(np.asarray(least, dtype=float), widest / ((1 << LATTICE_BITS) - 1) if widest > 0.0 else 1.0)

    def places_of(self, positions: Floats) -> NDArray[np.int32]:
        """The nearest places of positions (N, 3); what lies outside is moved to the border."""
        places = np.empty(positions.shape, np.int32)
        round_to_lattice(np.asarray(positions, dtype=float), self.low, self.step, places)
        return places


class Chunks(NamedTuple):
    """Consecutive chunks: nodes (C, 4681), zeros beyond the last point, and their frames."""

    nodes: NDArray[Any]
    frames: ChunkFrame

    @property
    def stored(self) -> NDArray[np.uint8]:
        """The same nodes as bytes, (C, 4681, 16)."""
        return self.nodes.view(np.uint8).reshape(len(self.nodes), CHUNK_NODES, NODE.itemsize)


def pack_normals(normals: NDArray[Any]) -> NDArray[np.int8]:
    """Octahedral codes (N, 2) of vectors (N, 3) of any length; `NO_NORMAL` where one is zero or not finite.

    References
    ----------
    Cigolle et al. 2014, see `limen.data.points.nodes.unpacked_normal`.
    """
    codes = np.empty((len(normals), 2), np.int8)
    pack_normals_into(np.ascontiguousarray(normals, dtype=float), codes)
    return codes


def pack_points(
    lattice: Lattice,
    positions: Floats,
    rgb: NDArray[np.uint8],
    intensity: NDArray[np.uint8] | None = None,
    normals: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Points (N,) of dtype `POINT`: positions (N, 3) in the file's coordinates, sRGB (N, 3), normals (N, 3)."""
    points = np.empty(len(positions), POINT)
    grey = np.empty(0, np.uint8) if intensity is None else intensity
    codes = np.empty((0, 2), np.int8) if normals is None else pack_normals(normals)
    pack_words(
        lattice.places_of(positions), np.ascontiguousarray(rgb), np.ascontiguousarray(grey), codes, _words(points)
    )
    return points


def hilbert_order(places: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Numbers (N,) of places (N, 3) along Hilbert's curve.

    Eleven levels below the smallest cell that holds all are looked at, and all others where points are much denser
    somewhere than elsewhere.
    """
    box = np.empty((2, 3), np.int32)
    box_of(places, box)
    shared = LATTICE_BITS - int(np.bitwise_or.reduce(box[0] ^ box[1])).bit_length()
    levels = min(shared + _SORTED_LEVELS, KEY_LEVELS)
    words = _sorted(places, levels)
    if levels < KEY_LEVELS and crowded(words, _LONG_RUN) > 0.01 * len(words):
        words = _sorted(places, KEY_LEVELS)
    return words.astype(np.uint32) & np.uint32((1 << NUMBER_BITS) - 1)


def _sorted(places: NDArray[np.int32], levels: int) -> NDArray[np.uint64]:
    """Points' numbers behind their keys of so many levels, in order; of all levels, behind the upper half of the key.

    A word has room for eleven levels: more are sorted twice, by the lower ones first.
    """
    keys = np.empty(len(places), np.uint64)
    hilbert_keys(places, levels, keys)
    order = np.arange(len(keys), dtype=np.uint32)
    words, spare = np.empty_like(keys), np.empty_like(keys)
    counts = np.empty((3, 1 << DIGIT_BITS), np.int64)
    upper = 3 * max(levels - _SORTED_LEVELS, 0)
    for shift in [0, upper] if levels == KEY_LEVELS else [0]:
        numbered(keys, order, shift, words, counts)
        for digit in range(3):
            sort_digit(words, digit, counts, spare)
            words, spare = spare, words
        order = words.astype(np.uint32) & np.uint32((1 << NUMBER_BITS) - 1)
    return words


def _words(points: NDArray[Any]) -> NDArray[np.uint32]:
    """Points as words (N, 5): places, colour and intensity, normal."""
    return points.view(np.uint32).reshape(len(points), -1)


def arranged(
    points: NDArray[Any], order: NDArray[np.uint32], step: float, *, estimate: bool
) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Points in ``order`` (N,), each 64 of them split into eights, and their radii (N,) in the unit of ``step``.

    With ``estimate`` their normals are made of their neighbours.
    """
    tidy, radii = np.empty(len(order), points.dtype), np.empty(len(order), np.float32)
    arrange(_words(points), order, step, _words(tidy), radii)
    if estimate:
        estimate_normals(tidy["place"], radii, step, tidy["normal"])
    return tidy, radii


def chunks_of(
    points: NDArray[Any], radii: NDArray[np.float32], lattice: Lattice, origin: Floats, two_sided: bool
) -> Chunks:
    """Chunks of arranged points (N,), every 4096 of them; contrasts are still 0.

    ``origin`` (3,) is the cloud's; ``two_sided``: normals may point to either side.
    """
    count = -(-len(points) // CHUNK_POINTS)
    nodes = np.zeros((count, CHUNK_NODES), NODE)
    frames = np.zeros((count, 5), np.float32)
    build_chunks(
        _words(points),
        radii,
        lattice.step,
        np.asarray(lattice.low - origin, dtype=float),
        two_sided,
        LINEAR_OF_SRGB,
        SRGB_OF_LINEAR,
        nodes.view(np.uint32).reshape(count, CHUNK_NODES, -1),
        frames,
    )
    return Chunks(nodes, ChunkFrame(frames[:, :3].copy(), frames[:, 3].copy(), frames[:, 4].copy()))
