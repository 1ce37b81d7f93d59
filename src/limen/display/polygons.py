"""Plane polygons as panels need them: flat, simple, convex, of at most eight corners.

References
----------
Chazelle, Dobkin 1985, *Optimal convex decompositions*: cuts from a reflex corner suffice to make all parts convex.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from limen.display.panel import MAX_OUTLINE_CORNERS
from limen.errors import DisplayError
from limen.geometry import Floats, signed_area

__all__ = ["FLAT", "STRAIGHT", "are_outlines", "convex_parts", "flattened"]

FLAT = 1e-3
"""How far a corner may lie off its face's plane, as a share of the face's largest extent: 0.5 mm on half a metre."""

STRAIGHT = 1e-6
"""A corner that lies nearer to the line through its neighbours, as a share of the extent, is no corner."""

_Index = NDArray[np.intp]


def flattened(corners_m: Floats, name: Callable[[int], str]) -> tuple[Floats, Floats]:
    """Faces with their corners moved into their planes, and their unit normals by the right-hand rule.

    Parameters
    ----------
    corners_m
        Faces of equally many corners, three or more: shape (F, K, 3).
    name
        How errors call the face of a row.

    Returns
    -------
    corners, shape (F, K, 3), and normals, shape (F, 3)

    Raises
    ------
    DisplayError
        If a face has a corner that is repeated, no area, or is not flat (see `FLAT`).
    """
    relative = corners_m - corners_m.mean(axis=1, keepdims=True)
    extent = np.linalg.norm(np.ptp(relative, axis=1), axis=1)
    lengths = np.linalg.norm(np.roll(relative, -1, axis=1) - relative, axis=2)
    area = np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1) / 2  # Newell's normal, as long as the area
    size = np.linalg.norm(area, axis=1)
    normal = area / np.maximum(size, np.finfo(float).tiny)[:, None]
    height = (relative @ normal[:, :, None])[..., 0]
    off_plane = np.ptp(height, axis=1) / np.maximum(extent, np.finfo(float).tiny)
    _refuse(lengths.min(axis=1) <= STRAIGHT * extent, name, "has two corners in one place: merge them, or remove it")
    _refuse(size <= STRAIGHT * extent**2, name, "has no area: remove it")
    _refuse(
        off_plane > FLAT,
        name,
        f"is not flat: its corners lie up to {off_plane.max():.2%} of its extent off one plane, where {FLAT:.1%} is "
        "allowed; split it into triangles",
    )
    return corners_m - height[..., None] * normal[:, None], normal


def _refuse(wrong: NDArray[np.bool_], name: Callable[[int], str], why: str) -> None:
    if wrong.any():
        more = f" (and {wrong.sum() - 1} more faces)" if wrong.sum() > 1 else ""
        raise DisplayError(f"{name(int(np.argmax(wrong)))} {why}{more}")


def are_outlines(polygons: Floats) -> NDArray[np.bool_]:
    """Which polygons of shape (F, K, 2) are convex, have no straight corner, and not more than eight."""
    if polygons.shape[1] > MAX_OUTLINE_CORNERS:
        return np.zeros(len(polygons), dtype=bool)
    steps = np.roll(polygons, -1, axis=1) - polygons
    before = np.roll(steps, 1, axis=1)
    turns = _cross(before, steps)
    turns *= np.sign(turns.sum(axis=1, keepdims=True))
    lengths = np.linalg.norm(steps, axis=2)
    bent = (turns > STRAIGHT * lengths * np.roll(lengths, 1, axis=1)).all(axis=1)
    # All turns the same way, and once around: a pentagram turns twice.
    around = np.arctan2(turns, (before * steps).sum(axis=2)).sum(axis=1) < 3 * np.pi
    return np.asarray(bent & around)


def convex_parts(polygon: Floats, what: str) -> list[_Index]:
    """A simple polygon as convex ones of at most eight corners.

    Corners in the middle of a straight edge are dropped (neighbours of a finer mesh leave such).

    Parameters
    ----------
    polygon
        Shape (K, 2), in either order.
    what
        How errors call it.

    Returns
    -------
    Indices of each part's corners, in the polygon's order.

    Raises
    ------
    DisplayError
        If its edges cross or touch each other.
    """
    forward = np.asarray(polygon, dtype=float)
    if signed_area(forward) < 0:
        forward = forward * [1, -1]  # the same polygon in a mirror, so that left turns are convex
    corners = _true_corners(forward)
    if _crosses(forward[corners]):
        raise DisplayError(f"{what} crosses or touches itself: split it where its edges meet")
    return _split(forward, corners, what)


def _split(polygon: Floats, part: _Index, what: str) -> list[_Index]:
    turns = _turns(polygon[part])
    if (turns > 0).all():
        if len(part) <= MAX_OUTLINE_CORNERS:
            return [part]
        cuts = [(0, len(part) // 2)]
    else:
        cuts = _cuts(polygon[part], int(np.argmin(turns)))
    if not cuts:
        raise DisplayError(f"{what} crosses or touches itself: split it where its edges meet")
    parts = [(part[first : last + 1], np.concatenate([part[last:], part[: first + 1]])) for first, last in cuts]
    # The cut that leaves the fewest reflex corners, and then the most even one.
    best = min(parts, key=lambda pair: (sum(_reflex(polygon[p]) for p in pair), abs(len(pair[0]) - len(pair[1]))))
    return _split(polygon, best[0], what) + _split(polygon, best[1], what)


def _cuts(polygon: Floats, corner: int) -> list[tuple[int, int]]:
    """Diagonals from a corner that lie inside the polygon, as ordered pairs of corners."""
    count = len(polygon)
    cuts = []
    for other in range(count):
        if other in (corner, (corner + 1) % count, (corner - 1) % count):
            continue
        if _inside_corner(polygon, corner, other) and _inside_corner(polygon, other, corner):
            edges = [(k, (k + 1) % count) for k in range(count) if not {k, (k + 1) % count} & {corner, other}]
            if not any(_meet(polygon[corner], polygon[other], polygon[a], polygon[b]) for a, b in edges):
                cuts.append((min(corner, other), max(corner, other)))
    return cuts


def _inside_corner(polygon: Floats, corner: int, other: int) -> bool:
    """Whether the way to ``other`` starts between the two edges of ``corner``, on the inner side."""
    here, before, after = polygon[corner], polygon[corner - 1], polygon[(corner + 1) % len(polygon)]
    target = polygon[other]
    left_of_in, left_of_out = _cross(here - before, target - here), _cross(after - here, target - here)
    if _cross(here - before, after - here) > 0:
        return bool(left_of_in > 0 and left_of_out > 0)
    return bool(left_of_in > 0 or left_of_out > 0)


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Whether two segments have a point in common."""
    sides = _cross(b - a, c - a), _cross(b - a, d - a), _cross(d - c, a - c), _cross(d - c, b - c)
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return True
    on = ((sides[0], c, a, b), (sides[1], d, a, b), (sides[2], a, c, d), (sides[3], b, c, d))
    return any(side == 0 and bool((p - e) @ (p - f) <= 0) for side, p, e, f in on)


def _crosses(polygon: Floats) -> bool:
    count = len(polygon)
    edges = [(polygon[k], polygon[(k + 1) % count]) for k in range(count)]
    apart = ((i, j) for i in range(count) for j in range(i + 2, count) if (i, j) != (0, count - 1))
    return any(_meet(*edges[i], *edges[j]) for i, j in apart)


def _turns(polygon: Floats) -> Floats:
    """Twice the area of the triangle at each corner: positive where a counter-clockwise polygon is convex."""
    return _cross(polygon - np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0) - polygon)


def _reflex(polygon: Floats) -> int:
    return int((_turns(polygon) <= 0).sum())


def _true_corners(polygon: Floats) -> _Index:
    """Corners that do not lie on the line through those kept before and the next."""
    extent = float(np.linalg.norm(np.ptp(polygon, axis=0)))
    kept = list(range(len(polygon)))
    k = 0
    while k < len(kept):
        before, here, after = (polygon[kept[n % len(kept)]] for n in (k - 1, k, k + 1))
        across = float(np.linalg.norm(after - before))
        if (
            abs(_cross(here - before, after - here)) <= STRAIGHT * extent * across
            and (here - before) @ (after - here) > 0
        ):
            del kept[k]
        else:
            k += 1
    return np.array(kept)


def _cross(a: Floats, b: Floats) -> Floats:
    """The third component of the product of plane vectors, shape (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
