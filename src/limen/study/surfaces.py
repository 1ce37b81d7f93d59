"""How far two surfaces of triangles are from each other.

References
----------
Cignoni, Rocchini, Scopigno 1998, *Metro: Measuring Error on Simplified Surfaces*: distances of samples of each surface
from the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from limen.geometry import Floats
from limen.study.surface_kernels import nearest_squared

__all__ = ["SurfaceError", "distances", "samples_of", "surface_error"]

_CANDIDATES = 8

Triangles = NDArray[np.integer]


class SurfaceError(NamedTuple):
    """In the unit of the coordinates; both ways."""

    rms: float
    largest: float


def samples_of(places: Floats, triangles: Triangles, count: int, seed: int = 0) -> tuple[Floats, NDArray[np.int64]]:
    """Places spread evenly over a surface by area, (count, 3), and the triangle of each."""
    random = np.random.default_rng(seed)
    a, b, c = (places[triangles[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = np.searchsorted(np.cumsum(area), random.random(count) * area.sum()).clip(0, len(area) - 1)
    share = random.random((count, 2))
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    return a[chosen] + share[:, :1] * (b - a)[chosen] + share[:, 1:] * (c - a)[chosen], chosen


def distances(points: Floats, places: Floats, triangles: Triangles) -> Floats:
    """Of points (P, 3) from a surface: exact to the nearest of eight triangles whose samples lie next to each point.

    Never too small; too large only where a triangle without a near sample is nearer.
    """
    spread, chosen = samples_of(places, triangles, max(200_000, 2 * len(triangles)))
    seeds = np.concatenate([spread, places[triangles].mean(axis=1)])
    owner = np.concatenate([chosen, np.arange(len(triangles))])
    _, near = KDTree(seeds).query(points, k=_CANDIDATES)
    found = np.empty(len(points))
    nearest_squared(points, owner[near], places, np.ascontiguousarray(triangles, np.int64), found)
    return np.sqrt(found)


def surface_error(
    places: Floats, triangles: Triangles, other_places: Floats, other_triangles: Triangles, samples: int = 100_000
) -> SurfaceError:
    """Root mean square and largest distance of samples of each of two surfaces from the other."""
    both = (places, triangles), (other_places, other_triangles)
    found = np.concatenate(
        [distances(samples_of(*one, samples, seed)[0], *two) for seed, (one, two) in enumerate((both, both[::-1]))]
    )
    return SurfaceError(float(np.sqrt(np.mean(found**2))), float(found.max()))
