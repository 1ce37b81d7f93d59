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

from limen.geometry import Floats
from limen.study.surface_kernels import fill_grid, nearest_squared

__all__ = ["SurfaceError", "distances", "samples_of", "surface_error"]

_MOST_CELLS = 256  # along the longest side

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
    """Of points (P, 3) from a surface, (P,): the nearest triangle's, found in a grid."""
    points, places = np.ascontiguousarray(points, float), np.ascontiguousarray(places, float)
    triangles = np.ascontiguousarray(triangles, np.int64)
    used = places[triangles.ravel()]
    low, size = used.min(axis=0), np.ptp(used, axis=0)
    cell = float(max(size.max() / _MOST_CELLS, np.ptp(places[triangles], axis=1).max(axis=1).mean(), 1e-300))
    count = (size / cell).astype(np.int64) + 1
    starts = np.zeros(int(count.prod()) + 1, np.int64)
    fill_grid(places, triangles, low, cell, count, starts, np.empty(0, np.int64))
    members = np.empty(starts[-1], np.int64)
    fill_grid(places, triangles, low, cell, count, starts, members)
    found = np.empty(len(points))
    nearest_squared(points, places, triangles, low, cell, count, starts, members, found)
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
