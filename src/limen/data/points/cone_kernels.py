"""Octahedral normals, and the mean normals and cones of nodes from those of their children.

A level is worked on at once: what belongs to the k-th child of a node lies in row k, one node beside the other, so that
the loops over nodes run in wide registers.

References
----------
Cigolle et al. 2014, see `limen.data.points.nodes.unpacked_normal`.
Abramowitz, Stegun 1964, *Handbook of Mathematical Functions*, equation 4.4.45 (the arc cosine).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.nodes import CHUNK_POINTS, FAN

__all__ = [
    "NO_NORMAL",
    "WIDTH",
    "cones",
    "mean_normals",
    "pack_normal",
    "pack_normals_into",
    "pack_words",
    "unpack_normals",
]

NO_NORMAL = -128
"""In place of an octahedral code, where nothing is known."""

_BLIND = 254
"""Cone of a node that has a mean normal, and may face any way."""

WIDTH = CHUNK_POINTS // FAN
"""Room for the nodes of a level above the points."""

_ONE = np.float32(1.0)
_CONES_A_RADIAN = np.float32(254.0 / np.pi)
_RADIANS_A_CONE = np.float32(np.pi / 254.0)
_PI = np.float32(np.pi)
_SAME = np.float32(1.0 - 4e-6)
"""Codes of different normals are at least 0.4 degrees apart, a cosine of 1 - 3e-5: anything beyond this is rounding."""


@compiled(error_model="python")
def pack_normal(x: float, y: float, z: float, out: Any) -> None:
    """The octahedral code of a vector of any length but zero."""
    scale = 1.0 / (abs(x) + abs(y) + abs(z))
    x, y, z = x * scale, y * scale, z * scale
    if z < 0.0:
        x, y = (1.0 - abs(y)) * (1.0 if x >= 0.0 else -1.0), (1.0 - abs(x)) * (1.0 if y >= 0.0 else -1.0)
    out[0], out[1] = np.int8(np.rint(x * 127.0)), np.int8(np.rint(y * 127.0))


@compiled(error_model="python")
def pack_normals_into(normals: Any, codes: Any) -> None:
    """Octahedral codes (N, 2) int8 of vectors (N, 3) of any length; `NO_NORMAL` where one is zero or not finite."""
    for i in range(normals.shape[0]):
        x, y, z = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
        size = abs(x) + abs(y) + abs(z)
        if np.isfinite(size) and size > 0.0:
            pack_normal(x, y, z, codes[i])
        else:
            codes[i, 0], codes[i, 1] = NO_NORMAL, NO_NORMAL


@compiled(error_model="python")
def pack_words(places: Any, rgb: Any, intensity: Any, normals: Any, words: Any) -> None:
    """Points as words (N, 5) uint32: ``places`` (N, 3) int32, ``rgb`` (N, 3) and ``intensity`` (N,) bytes, octahedral
    ``normals`` (N, 2) int8. Where a table is empty, the intensity is 0, and no normal is known.
    """
    unknown = np.uint32(NO_NORMAL & 255)
    for i in range(places.shape[0]):
        for axis in range(3):
            words[i, axis] = np.uint32(places[i, axis])
        look = np.uint32(rgb[i, 0]) | np.uint32(rgb[i, 1]) << np.uint32(8) | np.uint32(rgb[i, 2]) << np.uint32(16)
        if intensity.shape[0] > 0:
            look |= np.uint32(intensity[i]) << np.uint32(24)
        words[i, 3] = look
        u, v = unknown, unknown
        if normals.shape[0] > 0:
            u, v = np.uint32(normals[i, 0]) & np.uint32(255), np.uint32(normals[i, 1]) & np.uint32(255)
        words[i, 4] = u | v << np.uint32(8)


@compiled
def unpack_normals(codes: Any, count: int, normals: Any) -> None:
    """Unit vectors, rows 0, 1, 2 of ``normals``, of octahedral codes in rows 0 and 1 of ``codes``, float32."""
    for i in range(count):
        x, y = codes[0, i] * np.float32(1.0 / 127.0), codes[1, i] * np.float32(1.0 / 127.0)
        z = _ONE - abs(x) - abs(y)
        under = max(-z, np.float32(0.0))
        x, y = x - (under if x >= 0 else -under), y - (under if y >= 0 else -under)
        scale = _ONE / np.sqrt(x * x + y * y + z * z)
        normals[0, i], normals[1, i], normals[2, i] = x * scale, y * scale, z * scale


@compiled(error_model="python")
def _angle(cosine: Any) -> Any:
    """Radians, never less than the arc cosine; 0 for a normal and itself."""
    x = min(abs(cosine), _ONE)
    series = np.float32(1.5707288) + x * (
        np.float32(-0.2121144) + x * (np.float32(0.0742610) - x * np.float32(0.0187293))
    )
    acute = np.sqrt(_ONE - x) * series
    # The formula is off by 7e-5 at most, and the cosine by a few 1e-7.
    angle = (acute if cosine >= 0 else _PI - acute) + np.float32(2e-4)
    return np.float32(0.0) if cosine > _SAME else angle


@compiled
def mean_normals(beside: Any, nodes: int, held: Any, two_sided: bool, codes: Any) -> None:
    """Octahedral codes of the mean normals of nodes, rows 0 and 1 of ``codes`` (3, N) float32; row 2 is how many points
    below have one, or 0 where these are less than half, or cancel each other out.

    ``beside`` are the children's normals (three rows), weights and half angles in radians, side by side; ``held`` (N,)
    the points below each node. Normals of two-sided ones are turned to agree with those before.
    """
    turned = np.float32(-1.0) if two_sided else np.float32(1.0)
    for i in range(nodes):
        x, y, z, known = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for child in range(FAN):
            k = child * WIDTH + i
            along = x * beside[k] + y * beside[CHUNK_POINTS + k] + z * beside[2 * CHUNK_POINTS + k]
            weight = beside[3 * CHUNK_POINTS + k]
            known += weight
            weight *= turned if along < 0 else _ONE
            x, y = x + weight * beside[k], y + weight * beside[CHUNK_POINTS + k]
            z += weight * beside[2 * CHUNK_POINTS + k]
        size = abs(x) + abs(y) + abs(z)
        scale = np.float32(127.0) / max(size, np.float32(1e-30))
        x, y = x * scale, y * scale
        over_x, over_y = np.float32(127.0) - abs(y), np.float32(127.0) - abs(x)
        folded_x, folded_y = over_x if x >= 0 else -over_x, over_y if y >= 0 else -over_y
        codes[0, i] = np.float32(np.int32((x if z >= 0 else folded_x) + np.float32(128.5))) - np.float32(128.0)
        codes[1, i] = np.float32(np.int32((y if z >= 0 else folded_y) + np.float32(128.5))) - np.float32(128.0)
        fit = (known + known >= held[i]) & (size >= np.float32(1e-6) * known) & (known > 0)
        codes[2, i] = known if fit else np.float32(0.0)


@compiled(error_model="python")
def cones(beside: Any, axes: Any, nodes: int, two_sided: bool, out: Any) -> None:
    """Codes (N,) float32 of cones about ``axes`` (3, N) that hold those of the children ``beside``.

    Children without a normal have no say.
    """
    most = np.float32(127.0) if two_sided else np.float32(254.0)
    for i in range(nodes):
        widest = np.float32(0.0)
        for child in range(FAN):
            k = child * WIDTH + i
            along = (
                axes[0, i] * beside[k]
                + axes[1, i] * beside[CHUNK_POINTS + k]
                + axes[2, i] * beside[2 * CHUNK_POINTS + k]
            )
            half = _angle(abs(along) if two_sided else along) + beside[4 * CHUNK_POINTS + k]
            widest = max(widest, half if beside[3 * CHUNK_POINTS + k] > 0 else np.float32(0.0))
        steps = widest * _CONES_A_RADIAN
        code = np.float32(np.int32(steps))
        code = code + _ONE if code < steps else code
        out[i] = np.float32(_BLIND) if code >= most else code
