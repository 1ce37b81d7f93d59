"""Corners of markers to a few hundredths of a pixel: where the curves along their four edges meet.

Around one corner alone, blur rounds it off and pulls every estimate inward. Along an edge blur is the same to both
sides, so the edge stays where it is; and a corner is where two edges meet. Edges are parabolas, because a lens bends
them.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from limen.geometry import Floats

__all__ = ["refine"]

_PLACES = 24
"""Profiles across each edge."""

_PROFILE = 17
"""Samples of a profile."""

_REACHES_PX = (8.0, 4.0, 4.0, 4.0)
"""How far profiles reach to both sides, in turn: detected corners are up to some pixels off, refined ones are not."""

_REACH_MODULES = 0.7
"""They must not reach beyond the black rim and the white rim, which are one module wide."""

_MODULES = 8
_LEAST_CONTRAST = 0.4
_LEAST_PLACES = 12
_SETTLED_PX = 0.1
_STRAIGHT_PX = 0.3
_BEND_SHARE = 0.015
"""Lenses bend less: how far the middle of an edge may lie from the line between its ends, as a share of its length."""


def refine(photo: Floats, corners_px: Floats) -> Floats:
    """Refined corners of markers, (M, 4, 2) to (M, 4, 2); NaN where a marker's edges are not clear.

    Parameters
    ----------
    photo
        Grey levels (height, width); the centre of the first pixel is (0, 0).
    corners_px
        About where the corners are: each corner follows its neighbour around the marker, whose edge is from dark
        (inside) to bright.
    """
    if not len(corners_px):
        return corners_px
    before = corners_px
    for reach_px in _REACHES_PX:
        before, corners_px = corners_px, _meet(*_curves(photo, corners_px, reach_px))
    # Where an edge is hidden, or bits are as close as the edge, there is nothing that the passes settle on.
    settled = np.abs(corners_px - before).max(axis=(1, 2), initial=0) < _SETTLED_PX
    return np.where(settled[:, None, None], corners_px, np.nan)


def _curves(photo: Floats, corners_px: Floats, reach_px: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Start (M, 4, 2), direction (M, 4, 2), normal (M, 4, 2) and offset along it (M, 4, 3) of each edge.

    The offset is a polynomial in the share t of the edge: ``start + t direction + (a + b t + c t^2) normal``.
    """
    along = np.roll(corners_px, -1, axis=1) - corners_px
    length = np.linalg.norm(along, axis=2, keepdims=True)
    normal = np.stack([-along[..., 1], along[..., 0]], axis=2) / length
    # How far the opposite edge is: seen at an angle, markers are much narrower than their edges are long.
    across = np.roll(corners_px, -2, axis=1) - corners_px
    height = np.abs((across * normal).sum(axis=2)) / 2 + np.abs((np.roll(across, -1, axis=1) * normal).sum(axis=2)) / 2
    reach = np.minimum(_REACH_MODULES / _MODULES * height, reach_px)
    share = np.linspace(0.04, 0.96, _PLACES)
    steps = np.linspace(-1, 1, _PROFILE)
    depth = steps * reach[..., None]  # (M, 4, S)
    places = (
        corners_px[:, :, None, None]
        + share[:, None, None] * along[:, :, None, None]
        + depth[:, :, None, :, None] * normal[:, :, None, None]
    )
    grey = map_coordinates(photo, [places[..., 1], places[..., 0]], order=1, mode="nearest")
    slope = np.diff(grey, axis=-1)
    middle = (depth[..., 1:] + depth[..., :-1]) / 2
    # Only what rises as the edge as a whole does: the sign tells on which side the dark is.
    slope = np.maximum(slope * np.sign(slope.sum(axis=(1, 2, 3), keepdims=True)), 0)
    contrast = slope.sum(axis=-1)
    offset = (slope * middle[:, :, None]).sum(axis=-1) / np.maximum(contrast, 1e-9)
    clear = contrast > _LEAST_CONTRAST * np.median(contrast, axis=(1, 2), keepdims=True)
    parabolas = _parabolas(share, offset, clear)
    parabolas[np.abs(parabolas[..., 2]) / 4 > _BEND_SHARE * length[..., 0]] = np.nan
    return corners_px, along, normal, parabolas


def _parabolas(share: Floats, offset: Floats, clear: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Floats:
    """Coefficients (M, 4, 3) of offsets (M, 4, K) at ``share`` (K,); those far from the others are left out."""
    powers = share[:, None] ** np.arange(3)
    weights = clear.astype(float)
    for _ in range(2):
        normal = np.einsum("mek,ki,kj->meij", weights, powers, powers) + 1e-9 * np.eye(3)
        right = np.einsum("mek,mek,ki->mei", weights, offset, powers)
        found = np.linalg.solve(normal, right[..., None])[..., 0]
        away = np.abs(offset - found @ powers.T)
        usual = np.median(away, axis=2, keepdims=True)
        weights = (clear & (away <= 4 * usual + 0.02)).astype(float)
    found[(weights.sum(axis=2) < _LEAST_PLACES) | (usual[..., 0] > _STRAIGHT_PX)] = np.nan
    return np.asarray(found)


def _meet(start: Floats, along: Floats, normal: Floats, offset: Floats) -> Floats:
    """Where each edge's curve meets the one before it, by Newton's method: (M, 4, 2)."""
    before = [np.roll(each, 1, axis=1) for each in (start, along, normal, offset)]

    def at(curve: list[Floats], t: Floats) -> tuple[Floats, Floats]:
        s, a, n, (c0, c1, c2) = curve[0], curve[1], curve[2], np.moveaxis(curve[3], -1, 0)
        place = s + t[..., None] * a + (c0 + c1 * t + c2 * t * t)[..., None] * n
        return place, a + (c1 + 2 * c2 * t)[..., None] * n

    own = [start, along, normal, offset]
    t, u = np.zeros(start.shape[:2]), np.ones(start.shape[:2])
    for _ in range(4):
        (p, dp), (q, dq) = at(own, t), at(before, u)
        gap = q - p
        area = dp[..., 0] * dq[..., 1] - dp[..., 1] * dq[..., 0]
        t = t + (gap[..., 0] * dq[..., 1] - gap[..., 1] * dq[..., 0]) / area
        u = u + (gap[..., 0] * dp[..., 1] - gap[..., 1] * dp[..., 0]) / area
    return at(own, t)[0]
