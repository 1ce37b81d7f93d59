"""How a panel sees a terrain: linear forms of (column, row, height), and how far an error in height reaches on it.

What is drawn at a place of the terrain and what is true there differ by ``e`` metres of height at most. With
quilt-pixel forms ``X``, ``Y`` and ``W`` (so that a place is drawn at ``x = X / W``, ``y = Y / W``) and with ``u`` the
way in the room of one metre of height, a place at ``(x, y)`` and ``w`` that moves by ``s`` metres of height goes to
``(X + s X.u) / (w + s W.u)``, that is by ``s (X.u - x W.u) / (w + s W.u)`` pixels, and likewise in y. So

    error_px <= e K / (w - e |W.u|),    K = largest |(X.u - x W.u, Y.u - y W.u)| over the panel.

The norm of a form that is affine in (x, y) is convex, so K is reached at a corner of the panel. Of ``w`` the smallest
over all that the panel sees of a node is taken; see `limen.layers.terrain.kernels.nearest_w`. The place that moves
stays inside the node's box too, so the divisor need not be less than the smallest ``w`` of the whole box either.

For textures the opposite is asked: how many texels (posts) a pixel covers at least. A plane piece of ground has one
level direction, whatever its slope. One post along it moves the picture by a vector ``k``; if ``b1`` and ``b2`` are the
sides of the pixel's footprint in posts, that post is ``k_x b1 + k_y b2``, so ``1 <= (|k_x| + |k_y|) max(|b1|, |b2|)``:

    larger side >= w / L,    L = largest |X.t - x W.t| + |Y.t - y W.t| over level unit vectors t and the panel.

With ``H`` the matrix of the steps along columns and rows, ``L`` is the larger of ``|H^T (1, 1)|`` and
``|H^T (1, -1)|``, again convex in (x, y). The larger side of the footprint is what Heckbert 1983 (*Texture Mapping
Polygons in Perspective*) takes a level by.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.errors import InputError
from limen.geometry import Floats
from limen.viewing.projection import PanelProjections

__all__ = ["TerrainForms", "terrain_forms"]

_RIGHT_ANGLE = 1e-6  # cosine


class TerrainForms(NamedTuple):
    """One row a panel; forms are of (column, row, height in metres, 1)."""

    edges: Floats  # (N, 8, 4): not negative inside an edge
    edge_count: NDArray[np.int64]  # (N,)
    w: Floats  # (N, 4), room metres
    near: Floats  # (N,): the smallest w drawn
    cosine: Floats  # (N,): the smallest w / distance of what a panel sees
    px_per_m: Floats  # (N,): K, pixels times w a metre of height
    w_per_m: Floats  # (N,): |W.u|
    px_per_post: Floats  # (N,): L, pixels times w a post
    eye: Floats  # (3,): column, row, height
    step_m: Floats  # (3,): room metres of a column, a row, and a metre of height


def terrain_forms(views: PanelProjections, quilt_size_px: tuple[int, int], room_from_posts: Floats) -> TerrainForms:
    """The forms of all panels of an eye.

    Parameters
    ----------
    quilt_size_px
        Width and height of all that the clip space of ``views`` spans, copies included.
    room_from_posts
        Affine map of shape (4, 4): (column, row, height in metres) to room metres.

    Raises
    ------
    InputError
        If columns, rows and height are not at right angles in the room: distances are counted along them.
    """
    matrix = np.asarray(room_from_posts, dtype=float)
    _check_axes(matrix)
    way = matrix[:3] - np.column_stack([np.zeros((3, 3)), views.eye_m])
    half = np.array([quilt_size_px[0] / 2, quilt_size_px[1] / 2, 1.0])
    clip = (views.clip * half[None, :, None]) @ way
    corners = np.einsum("nij,nkj->nki", views.clip * half[None, :, None], views.corners)
    # What is said of panels that the eye is not in front of is never asked for, and only has to be a number.
    place = corners[..., :2] / np.where(corners[..., 2:] > 0, corners[..., 2:], 1.0)
    used = np.arange(place.shape[1]) < views.corner_count[:, None]
    # (N, 8, 2, 3): pixels times w that a column, a row and a metre of height move a place at a corner.
    moved = clip[:, None, :2, :3] - place[..., None] * clip[:, None, 2:, :3]
    across, along = moved[..., 0, :2], moved[..., 1, :2]
    per_post = np.maximum(np.linalg.norm(across + along, axis=2), np.linalg.norm(across - along, axis=2))
    step_m = np.linalg.norm(matrix[:3, :3], axis=0)
    return TerrainForms(
        np.ascontiguousarray(views.edges @ way),
        np.asarray(views.corner_count, dtype=np.int64),
        np.ascontiguousarray(clip[:, 2]),
        np.asarray(views.near, dtype=float),
        np.where(used, corners[..., 2], np.inf).min(axis=1),
        _largest(np.linalg.norm(moved[..., 2], axis=2), used),
        np.abs(clip[:, 2, 2]),
        _largest(per_post, used),
        np.linalg.solve(matrix[:3, :3], views.eye_m - matrix[:3, 3]),
        step_m,
    )


def _largest(values: Floats, used: NDArray[np.bool_]) -> Floats:
    return np.asarray(np.where(used, values, 0.0).max(axis=1))


def _check_axes(matrix: Floats) -> None:
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise InputError(f"room_from_posts must be a finite matrix of shape (4, 4), got shape {matrix.shape}")
    axes = matrix[:3, :3]
    length = np.linalg.norm(axes, axis=0)
    if not (length > 0).all():
        raise InputError("room_from_posts maps columns, rows or heights to nothing: give spacings above 0")
    cosines = np.abs((axes / length).T @ (axes / length))[np.triu_indices(3, 1)]
    if cosines.max() > _RIGHT_ANGLE:
        raise InputError(
            "room_from_posts must keep columns, rows and heights at right angles: do not shear the terrain"
        )
