"""Which pages of a terrain's textures (relief, heights, a draped image) a cut needs.

A pixel covers ``A`` texels of full resolution along the larger side of its footprint (Heckbert 1983), and is drawn from
level ``floor(log2(A t))``, where ``t`` is how many pixels large a texel may be without being noticed, 1 at least.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import PAGE, Pyramid
from limen.data.terrain.model import Nodes, PatchTable
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.common.page_detail import KEPT, Detail
from limen.layers.terrain import kernels
from limen.layers.terrain.forms import terrain_forms
from limen.layers.terrain.select import TerrainCut
from limen.viewing.projection import PanelProjections

__all__ = ["OWN_TEXEL_FROM_POST", "Faint", "NeededPages", "pages_for_terrain", "texel_tolerance_px"]

OWN_TEXEL_FROM_POST = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]])


class NeededPages(NamedTuple):
    """Pages that a cut of a terrain needs, the most important first."""

    pages: NDArray[np.int64]  # (K,): distinct page numbers
    importance: Floats  # (K,): how many times too large texels are while a page is missing; never more below it


class Faint(NamedTuple):
    """What is too faint to be seen, and where it may be left out."""

    detail: Detail
    panels: NDArray[np.bool_]  # (N,)


def texel_tolerance_px(allowed_px: Floats, kept: float = KEPT) -> Floats:
    """How large a texel may be on each panel, pixels: what the shader's level is taken by."""
    return np.asarray(np.maximum(1.0, np.asarray(allowed_px, dtype=float) * kept))


def pages_for_terrain(
    cut: TerrainCut,
    nodes: Nodes,
    patches: PatchTable,
    pyramid: Pyramid,
    views: PanelProjections,
    quilt_size_px: tuple[int, int],
    room_from_posts: Floats,
    allowed_px: Floats,
    kept: float = KEPT,
    *,
    texel_from_post: Floats | None = None,
    faint: Faint | None = None,
) -> NeededPages:
    """The pages of a texture laid over the terrain that the panels' pixels ask for.

    For every pixel that shows a place of the cut, the page of its level at that place is among them, and all coarser
    ones there: what a pixel falls back to, and what levels are blended with. Where the finer detail of a page is too
    faint to be seen, the pages below it are left out, and pixels fall back to it.

    Parameters
    ----------
    views, quilt_size_px, room_from_posts, allowed_px
        As the cut was selected with.
    kept
        What is left of a texel's fineness when it is drawn; see `limen.layers.common.page_detail.KEPT`.
    texel_from_post
        Affine map of shape (2, 3) from column and row to texels of full resolution, texel (i, j) from i to i + 1 and j
        to j + 1. By default that of the terrain's own textures, whose texel (i, j) has its centre on post (i, j).
    faint
        With it never more pages are chosen than without.

    Raises
    ------
    InputError
        If the map is of another shape, or columns and rows of terrain or texture are not at right angles in the room.
    """
    place = OWN_TEXEL_FROM_POST if texel_from_post is None else np.asarray(texel_from_post, dtype=float)
    if place.shape != (2, 3):
        raise InputError(f"texel_from_post must be of shape (2, 3), got {place.shape}")
    texels = np.eye(4)
    texels[:2, :2], texels[:2, 3] = place[:, :2], place[:, 2]
    node = patches.node[cut.pair_patch]
    corners = nodes.rect[node][:, [0, 1, 2, 1, 0, 3, 2, 3]].reshape(-1, 4, 2) @ place[:, :2].T + place[:, 2]
    low_high = nodes.low_high_m[node].astype(float)
    box = np.column_stack([corners.min(axis=1), low_high[:, :1], corners.max(axis=1), low_high[:, 1:]])
    levels = pyramid.levels
    grid = kernels.PageNumbering(
        np.array([level.columns for level in levels], dtype=np.int64),
        np.array([level.rows for level in levels], dtype=np.int64),
        np.array([level.first_page for level in levels], dtype=np.int64),
    )
    importance = np.zeros(pyramid.page_count)
    if faint is None:
        hides, tau = np.zeros(len(views.facing), dtype=bool), np.zeros(0)
    else:
        hides, tau = faint.panels, faint.detail.tau
    kernels.wanted_pages(
        cut.pair_panel,
        np.ascontiguousarray(box),
        terrain_forms(views, quilt_size_px, room_from_posts @ np.linalg.inv(texels)),
        grid,
        PAGE,
        texel_tolerance_px(allowed_px, kept),
        np.asarray(allowed_px, dtype=float),
        hides,
        tau,
        importance,
    )
    wanted = np.flatnonzero(importance)
    wanted = wanted[np.argsort(-importance[wanted], kind="stable")]
    return NeededPages(wanted, importance[wanted])
