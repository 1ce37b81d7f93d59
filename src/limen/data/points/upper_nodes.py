"""Nodes of level 4 and above, from the roots of chunks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.points.nodes import (
    ALL_AROUND,
    CHUNK_LEVEL,
    FAN,
    TOP,
    ChunkFrame,
    counts_of_levels,
    half_angle_deg,
    radius_of_code,
    unpacked_normal,
)
from limen.data.points.tree import pack_normals
from limen.data.store.resample import LINEAR_OF_SRGB, SRGB_OF_LINEAR
from limen.geometry import Floats

__all__ = ["tops_of"]

_SLACK = 1.0 + 1e-6


def tops_of(roots: NDArray[Any], frames: ChunkFrame, points: int, two_sided: bool) -> tuple[NDArray[Any], ...]:
    """Tops by level, from level 4 to the single root; contrasts above level 4 are still 0.

    ``roots`` (C,) of dtype `NODE` are the nodes of level 4 of all chunks, ``points`` how many there are.
    """
    counts = counts_of_levels(points)
    levels = [_first(roots, frames)]
    below = FAN**CHUNK_LEVEL
    while len(levels[-1]) > 1:
        held = np.minimum(below, points - below * np.arange(len(levels[-1])))
        levels.append(_above(levels[-1], held, two_sided))
        below *= FAN
    assert [len(level) for level in levels] == counts[CHUNK_LEVEL:]
    return tuple(levels)


def _first(roots: NDArray[Any], frames: ChunkFrame) -> NDArray[Any]:
    tops = np.zeros(len(roots), TOP)
    centres = frames.origin.astype(float) + roots["place"].astype(float) * frames.step.astype(float)[:, None]
    tops["place"] = centres
    moved = np.linalg.norm(centres - tops["place"].astype(float), axis=1)
    tops["radius"] = (radius_of_code(roots["radius"], frames.radius) + moved) * _SLACK
    for field in ("normal", "cone", "contrast", "rgb", "intensity"):
        tops[field] = roots[field]
    return tops


def _above(tops: NDArray[Any], held: NDArray[np.int64], two_sided: bool) -> NDArray[Any]:
    """The next level; ``held`` are the points below each node."""
    count = -(-len(tops) // FAN)
    # The last node may have fewer children: it has its last one again, which weighs nothing.
    numbers = np.arange(count * FAN).reshape(count, FAN)
    children = tops[np.minimum(numbers, len(tops) - 1)]
    weights = np.where(numbers < len(tops), held[np.minimum(numbers, len(tops) - 1)], 0).astype(float)
    nodes = np.zeros(count, TOP)
    _spheres(nodes, children)
    shares = weights / weights.sum(axis=1, keepdims=True)
    light = (LINEAR_OF_SRGB[children["rgb"]] * shares[..., None]).sum(axis=1)
    nodes["rgb"] = SRGB_OF_LINEAR[np.rint(65535 * np.minimum(light, 1.0)).astype(int)]
    nodes["intensity"] = np.rint((children["intensity"] * shares).sum(axis=1))
    _cones(nodes, children, shares, two_sided)
    return nodes


def _spheres(nodes: NDArray[Any], children: NDArray[Any]) -> None:
    places, radii = children["place"].astype(float), children["radius"].astype(float)
    low, high = (places - radii[..., None]).min(axis=1), (places + radii[..., None]).max(axis=1)
    nodes["place"] = (low + high) / 2
    apart = np.linalg.norm(places - nodes["place"].astype(float)[:, None], axis=2)
    nodes["radius"] = (apart + radii).max(axis=1) * _SLACK


def _cones(nodes: NDArray[Any], children: NDArray[Any], shares: Floats, two_sided: bool) -> None:
    normals = unpacked_normal(children["normal"])
    known = np.where(children["cone"] == ALL_AROUND, 0.0, shares)
    mean = np.zeros((len(nodes), 3))
    for child in range(FAN):  # one after the other: two-sided ones are turned to agree with those before
        along = (mean * normals[:, child]).sum(axis=1)
        sign = np.where(two_sided & (along < 0), -1.0, 1.0)
        mean += (sign * known[:, child])[:, None] * normals[:, child]
    size = np.abs(mean).sum(axis=1)
    lit = (2 * known.sum(axis=1) >= 1.0 - 1e-9) & (size > 1e-6)
    nodes["cone"], nodes["normal"] = ALL_AROUND, 0
    nodes["normal"][lit] = pack_normals(mean[lit])
    axes = unpacked_normal(nodes["normal"][lit])
    along = (axes[:, None] * normals[lit]).sum(axis=2)
    apart_deg = np.degrees(np.arccos(np.clip(np.abs(along) if two_sided else along, -1, 1)))
    widest_deg = np.where(known[lit] > 0, apart_deg + half_angle_deg(children["cone"][lit]), 0.0).max(axis=1)
    cones = np.ceil(widest_deg * (254 / 180) - 1e-6)
    nodes["cone"][lit] = np.where(cones >= (127 if two_sided else 254), 254, cones)
