"""Plain NumPy of what the kernels of points do, node by node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from limen.data.points.nodes import (
    CHUNK_LEVEL,
    FAN,
    LEVEL_BEGIN,
    counts_of_levels,
    half_angle_deg,
    radius_of_code,
    unpacked_normal,
)


class Level(NamedTuple):
    """All nodes of one level of a cloud, in order."""

    place: np.ndarray  # (N, 3) float64
    radius: np.ndarray
    rgb: np.ndarray
    normal: np.ndarray
    half_angle_deg: np.ndarray
    cone: np.ndarray
    contrast: np.ndarray
    intensity: np.ndarray


def levels_of(points) -> list[Level]:
    """What is stored of every level, the points first, as anyone reads it."""
    chunks = np.stack([points.read_chunk(chunk) for chunk in range(points.chunks)])
    frames = points.frames
    place = frames.origin.astype(float)[:, None] + chunks["place"] * frames.step.astype(float)[:, None, None]
    radius = radius_of_code(chunks["radius"], frames.radius[:, None])
    found = []
    for level, count in enumerate(counts_of_levels(points.size)):
        if level <= CHUNK_LEVEL:
            own = slice(LEVEL_BEGIN[level], LEVEL_BEGIN[level] + FAN ** (CHUNK_LEVEL - level))
            nodes, where, wide = (part[:, own].reshape(-1, *part.shape[2:])[:count] for part in (chunks, place, radius))
        else:
            nodes = points.tops[level - CHUNK_LEVEL]
            where, wide = nodes["place"].astype(float), nodes["radius"].astype(float)
        angle = half_angle_deg(nodes["cone"])
        normal = unpacked_normal(nodes["normal"])
        found.append(
            Level(where, wide, nodes["rgb"], normal, angle, nodes["cone"], nodes["contrast"], nodes["intensity"])
        )
    return found


def plain_radii(places: np.ndarray) -> np.ndarray:
    """Third distance to another place among sixteen, at most twice the squared mean root of the 64 around."""
    radii = np.zeros(len(places))
    for begin in range(0, len(places), 64):
        group = places[begin : begin + 64]
        own = np.zeros(len(group))
        for low in range(0, len(group), 16):
            block = group[low : low + 16]
            apart = np.linalg.norm(block[:, None] - block[None], axis=2)
            for i, row in enumerate(apart):
                near = np.sort(row[row > 0])[:3]
                own[low + i] = near[-1] if len(near) else 0.0
        radii[begin : begin + 64] = np.minimum(own, 2 * np.mean(np.sqrt(own)) ** 2)
    return radii
