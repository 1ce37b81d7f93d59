"""Which triangles touch which panels, by clipping every triangle against every panel in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROUNDING_PX = 0.02
"""How far inside its outline a pair has to be for the adapter to agree."""


def soup(rng: np.random.Generator, count: int, size_m: float, middle: Any, spread_m: float) -> tuple[Any, Any]:
    """Triangles of about one size, anywhere."""
    centres = rng.normal(middle, spread_m, (count, 1, 3))
    positions = (centres + rng.normal(0, size_m, (count, 3, 3))).reshape(-1, 3).astype(np.float32)
    return positions, np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)


def pairs(views: Any, ways: Floats, triangles: NDArray[Any], inset_px: float) -> set[tuple[int, int]]:
    """Pairs (triangle, panel) whose cones from the eye have more than a boundary in common.

    Parameters
    ----------
    views
        `limen.viewing.projection.PanelProjections` of one eye.
    ways
        From the eye to every vertex, shape (V, 3).
    inset_px
        How far inside the rim of their guard band panels begin: the guard's width is the outline itself.
    """
    corners = ways[triangles]
    found = set()
    for panel in np.flatnonzero(views.facing):
        depth = views.clip[panel, 2]
        edges = views.edges[panel, : views.corner_count[panel]] - inset_px * depth
        candidates = (corners @ depth > 0).any(axis=1)
        for edge in edges:
            candidates &= ~((corners @ edge <= 0) & (corners @ depth > 0)).all(axis=1)
        for triangle in np.flatnonzero(candidates):
            if _has_part(list(corners[triangle]), [depth, *edges]):
                found.add((int(triangle), int(panel)))
    return found


def _has_part(polygon: list[Floats], planes: list[Floats]) -> bool:
    """Sutherland, Hodgman 1974, on directions."""
    for plane in planes:
        kept = []
        for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            a, b = here @ plane, there @ plane
            if a > 0:
                kept.append(here)
            if (a > 0) != (b > 0):
                kept.append(here + (there - here) * (a / (a - b)))
        polygon = kept
        if len(polygon) < 3:
            return False
    return True
