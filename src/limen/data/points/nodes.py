"""A cloud of points as one implicit tree: points in the order of a curve that fills space, eight to a node, and so on.

Node ``i`` of level ``l`` stands for the points ``8**l * i`` up to ``8**l * (i + 1)``: nothing says who is whose child
but the numbers. Level 0 are the points themselves. 4096 consecutive points and all nodes above them, up to the one of
level 4 that they all hang from, are a **chunk**: what is stored, read and evicted as one. All chunks but the last are
full. Nodes of level 4 and above are few; as **tops** they are always in memory.

Every node is a sphere that holds those of its children; a mean colour and normal; the half angle of a cone about that
normal that holds those of its children, as far as they have one; and the contrast of its luminance to that of
everything its sphere meets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats

__all__ = [
    "ALL_AROUND", "CHUNK_LEVEL", "CHUNK_NODES", "CHUNK_POINTS", "FAN", "LEVEL_BEGIN", "NODE", "TOP", "ChunkFrame",
    "counts_of_levels", "half_angle_deg", "radius_of_code", "unpacked_normal",
]  # fmt: skip

FAN = 8
CHUNK_LEVEL = 4
CHUNK_POINTS = FAN**CHUNK_LEVEL  # 4096

LEVEL_BEGIN = (585, 73, 9, 1, 0)
"""Where the nodes of level 0, 1, 2, 3, 4 begin in a chunk: the one of level 4 first, the points last."""

CHUNK_NODES = LEVEL_BEGIN[0] + CHUNK_POINTS  # 4681

NODE = np.dtype(
    [
        ("place", "<u2", 3),  # in steps of the chunk's frame
        ("radius", "u1"),  # see `radius_of_code`
        ("contrast", "u1"),  # see `limen.vision.contrast_codes`; of a point 0
        ("normal", "i1", 2),  # octahedral: see `unpacked_normal`
        ("cone", "u1"),  # half angle in steps of 180 / 254 degrees, rounded up; `ALL_AROUND` where nothing is known
        ("intensity", "u1"),
        ("rgb", "u1", 3),  # sRGB
        ("spare", "u1"),
    ]
)
"""A node in a chunk, 16 bytes: also what a shader reads, as four little-endian words."""

ALL_AROUND = 255
"""Cone of a node most of whose points have no known normal: it is neither front nor back, and drawn unlit. A node that
has a mean normal, but may face any way, has 254 and is lit.
"""

TOP = np.dtype(
    [
        ("place", "<f4", 3),  # metres (the file's unit), from the cloud's origin
        ("radius", "<f4"),
        ("normal", "i1", 2),
        ("cone", "u1"),
        ("contrast", "u1"),
        ("rgb", "u1", 3),
        ("intensity", "u1"),
    ]
)
"""A node of level 4 or above, 24 bytes."""

_RADIUS_STEPS_PER_OCTAVE = 12


class ChunkFrame(NamedTuple):
    """What a chunk's numbers are measured in, one row a chunk; from the cloud's origin, in the file's unit."""

    origin: NDArray[np.float32]  # (C, 3)
    step: NDArray[np.float32]  # (C,): of a place
    radius: NDArray[np.float32]  # (C,): the largest radius in the chunk, code 255


def counts_of_levels(points: int) -> list[int]:
    """How many nodes each level has, from the points to the single root.

    >>> counts_of_levels(5000)
    [5000, 625, 79, 10, 2, 1]
    """
    counts = [points]
    while counts[-1] > 1 or len(counts) <= CHUNK_LEVEL:
        counts.append(-(-counts[-1] // FAN))
    return counts


def radius_of_code(code: NDArray[np.uint8], largest: NDArray[np.float32] | float) -> Floats:
    """Radii of codes: the largest times ``2 ** ((code - 255) / 12)``; code 0 is a radius of 0."""
    octaves = (np.asarray(code, dtype=float) - 255.0) / _RADIUS_STEPS_PER_OCTAVE
    return np.where(np.asarray(code) == 0, 0.0, np.asarray(largest, dtype=float) * np.exp2(octaves))


def unpacked_normal(packed: NDArray[np.int8]) -> Floats:
    """Unit vectors (..., 3) of octahedral codes (..., 2), each ``round(127 x)``.

    References
    ----------
    Cigolle, Donow, Evangelakos, Mara, McGuire, Meyer 2014, *A Survey of Efficient Representations for Independent Unit
    Vectors*, Journal of Computer Graphics Techniques 3(2).
    """
    x, y = (np.asarray(packed[..., axis], dtype=float) / 127.0 for axis in (0, 1))
    z = 1 - np.abs(x) - np.abs(y)
    under = np.maximum(-z, 0)
    vectors = np.stack([x - np.copysign(under, x), y - np.copysign(under, y), z], axis=-1)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def half_angle_deg(cone: NDArray[np.uint8]) -> Floats:
    """Half angles of cones in degrees; 180 for `ALL_AROUND`."""
    return np.minimum(np.asarray(cone, dtype=float) * (180.0 / 254.0), 180.0)
