"""Which pages of an image a frame needs.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, sections 3.2 and 4 (level, importance).

Where they add ``floor(log2 A)`` and ``floor(log2 (D / Dopt))``, a pixel's footprint in texels and what distance hides,
here both are added first: the coarsest texel that is still no larger than the tolerance is one number, and rounding
twice would lose up to a level. Texel for pixel (A = 1) it is their formula.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.display.display import Display
from limen.geometry import Floats, Vec3
from limen.layers.common.page_detail import BLEND_LEVELS, Detail, level_shares, plain_detail
from limen.layers.image import kernels, shape_kernels
from limen.layers.image.cut import PageCut
from limen.layers.image.lens_cells import LensCells, lens_cells
from limen.viewing.lens import rows_of
from limen.viewing.placement import OnShape, OnSurface, PanelMaps, Placement
from limen.viewing.tolerance import Tolerance
from limen.vision.acuity import GAZE_PER_DEG
from limen.vision.resolution import luminance_scale

__all__ = [
    "ImageOnDisplay",
    "Pairs",
    "flat_pairs",
    "levels_at",
    "select",
    "select_bent",
    "select_flat",
    "shape_kind",
    "shares_at",
    "view_of",
]

_NONE = np.empty(0, dtype=np.int64)
_TILE_PX = 256
_KINDS = ("plane", "cylinder", "ellipsoid")


class ImageOnDisplay(NamedTuple):
    """An image on a display: all that a selector and a drawing pass need to know of it, fixed while both stay."""

    display: Display
    pyramid: Pyramid
    placement: Placement
    maps: PanelMaps | None  # for images on the surface
    cells: LensCells | None  # where lenses are looked through, if they reach anything
    detail: Detail
    sharpness: Floats  # (P,): angles that stay invisible on each panel, over those under standard light


def view_of(display: Display, pyramid: Pyramid, placement: Placement, detail: Detail | None = None) -> ImageOnDisplay:
    """``detail`` tells where finer pages are seen; by default wherever the tolerance is finer than a page's texels."""
    maps, cells = None, None
    if isinstance(placement, OnSurface):
        maps = placement.panel_maps(display, pyramid.size_px)
        reached = lens_cells(display, maps, placement.lenses)
        cells = reached if len(reached.panel) else None
    sharpness = 1 / luminance_scale([panel.luminance_cd_m2 for panel in display.panels])
    return ImageOnDisplay(display, pyramid, placement, maps, cells, detail or plain_detail(pyramid), sharpness)


def shape_kind(placement: OnShape) -> int:
    """The number that kernels and shaders know a shape by."""
    return _KINDS.index(placement.kind)


def select(
    view: ImageOnDisplay,
    tolerance: Tolerance,
    *,
    budget: int | None = None,
    eye_m: Vec3 | None = None,
) -> PageCut:
    """The pages that every pixel's level asks for.

    Parameters
    ----------
    view
        The image on the display.
    tolerance
        What cannot be seen; see `limen.viewing.tolerance.tolerance_of`.
    budget
        Most pages allowed. Where more are wanted, all levels are coarsened by one until they fit.
    eye_m
        The eye point of an image on a shape, unless the shape fixes it.

    Returns
    -------
    PageCut
        Pages by importance; ``cut.error_px`` never exceeds what the tolerance allows while ``cut.bias`` is 0.
    """
    wanted = _select_at(view, tolerance, 0, eye_m)
    cut, bias = wanted, 0
    while budget is not None and len(cut) > budget and bias < len(view.pyramid.levels) - 1:
        bias += 1
        cut = _select_at(view, tolerance, bias, eye_m)
    if bias == 0:
        return cut
    return replace(cut, bias=bias, denied=len(wanted) - len(cut))


def _select_at(view: ImageOnDisplay, tolerance: Tolerance, bias: int, eye_m: Vec3 | None) -> PageCut:
    if isinstance(view.placement, OnShape):
        return select_bent(view, tolerance, bias, eye_m)
    return select_flat(view, tolerance, bias)


class Pairs(NamedTuple):
    """Which page is needed on which panel, shape (M,) each, in no order that matters."""

    panel: NDArray[np.int64]
    page: NDArray[np.int64]
    area_px: NDArray[np.float64]


def flat_pairs(view: ImageOnDisplay, tolerance: Tolerance, bias: int = 0) -> Pairs:
    """What `select_flat` chooses from, before pages that several panels share are put together."""
    assert view.maps is not None
    maps = view.maps
    fixed = (_panels(view.display.arrays.origin_m, view), maps.scale, maps.offset, maps.mip_level)
    eyes, pages = _eyes(tolerance), _pages(view)
    image_px = np.array(view.pyramid.size_px, dtype=np.int64)
    room = 8192
    while True:
        panel, page, area = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room)
        count = kernels.flat_pairs(*fixed, eyes, pages, image_px, bias, panel, page, area)
        if count <= room:
            return Pairs(panel[:count], page[:count], area[:count])
        room = count


def select_flat(view: ImageOnDisplay, tolerance: Tolerance, bias: int = 0) -> PageCut:
    """`select` for images on the surface: pairs of panel and page by interval tests on rings of distance.

    Pairs leave out what is looked at through lenses alone; pages are those of both.
    """
    panel, page, area = flat_pairs(view, tolerance, bias)
    assert view.maps is not None
    if view.cells is None:
        pages, inverse = np.unique(page, return_inverse=True)
        importance = np.bincount(inverse, weights=area, minlength=len(pages)).astype(np.float64)
        return _cut(view, pages, importance, panel, page, float(view.maps.footprint.min()))
    kept = view.cells.without(view.pyramid, panel, page)
    panel, page, area = panel[kept], page[kept], area[kept]
    coverage = np.bincount(page, weights=area, minlength=view.pyramid.page_count).astype(np.float64)
    _add_behind_lenses(view, view.maps, view.cells, tolerance, bias, coverage)
    pages = np.flatnonzero(coverage)
    cut = _cut(view, pages, coverage[pages], panel, page, 1.0)
    # Through lenses, nothing is coarser for its pixels than beside them.
    beside_px = float(view.detail.tau[page].max(initial=0.0)) / float(view.maps.footprint.min())
    return replace(cut, error_px=beside_px) if len(page) else cut


def _add_behind_lenses(
    view: ImageOnDisplay, maps: PanelMaps, cells: LensCells, tolerance: Tolerance, bias: int, coverage: Floats
) -> None:
    assert isinstance(view.placement, OnSurface)
    image_px = np.array(view.pyramid.size_px, dtype=np.int64)
    shape = shape_kernels.Shape(
        shape_kernels.SURFACE, np.eye(4), np.zeros(3), 0.0, image_px, 0.0, *rows_of(view.placement.lenses)
    )
    # Texels of every panel's corner, and of a pixel to the right and down.
    ways = (maps.offset, maps.scale * [1.0, 0.0], maps.scale * [0.0, 1.0])
    shape_kernels.shape_pages(
        _panels(view.display.arrays.origin_m, view),
        shape_kernels.Ways(*(np.pad(way, ((0, 0), (0, 1))) for way in ways)),
        shape, _pages(view), _eyes(tolerance), np.column_stack([cells.panel, cells.rect_px]), bias, coverage,
    )  # fmt: skip


def select_bent(view: ImageOnDisplay, tolerance: Tolerance, bias: int = 0, eye_m: Vec3 | None = None) -> PageCut:
    """`select` for images on a plane, cylinder or ellipsoid in the room.

    Raises
    ------
    InputError
        If neither the placement nor the caller tells the eye point.
    """
    placement, arrays = view.placement, view.display.arrays
    assert isinstance(placement, OnShape)
    image_px = np.array(view.pyramid.size_px, dtype=np.int64)
    closed = placement.kind != "plane" and placement.turn_deg == 360
    shape = shape_kernels.Shape(
        shape_kind(placement), placement.local_from_room(), placement.local_eye(eye_m),
        math.radians(placement.turn_deg), image_px, float(image_px[0]) if closed else 0.0, *rows_of(()),
    )  # fmt: skip
    origin = view.display.nudged_origin_m
    ways = shape_kernels.Ways(origin, arrays.right * arrays.pitch_m[:, :1], arrays.down * arrays.pitch_m[:, 1:])
    coverage = np.zeros(view.pyramid.page_count)
    shape_kernels.shape_pages(
        _panels(origin, view), ways, shape, _pages(view), _eyes(tolerance), _tiles(arrays.size_px), bias, coverage
    )
    pages = np.flatnonzero(coverage)
    return _cut(view, pages, coverage[pages], _NONE, _NONE, 1.0)


def _tiles(size_px: NDArray[np.int64]) -> NDArray[np.int64]:
    """All pixels of all panels, cut into squares: panel, left, top, right, bottom, (N, 5), panel by panel."""
    columns, rows = -(-size_px // _TILE_PX).T
    panel = np.repeat(np.arange(len(size_px)), columns * rows)
    place = np.arange(len(panel)) - (np.cumsum(columns * rows) - columns * rows)[panel]
    first = np.stack([place % columns[panel], place // columns[panel]], axis=1) * _TILE_PX
    return np.column_stack([panel, first, np.minimum(first + _TILE_PX, size_px[panel])])


def _panels(origin_m: Floats, view: ImageOnDisplay) -> kernels.Panels:
    arrays = view.display.arrays
    return kernels.Panels(origin_m, arrays.right, arrays.down, arrays.pitch_m, arrays.size_px, view.sharpness)


def _eyes(tolerance: Tolerance) -> kernels.Eyes:
    per_deg = np.where(tolerance.gaze.any(axis=1), GAZE_PER_DEG, 0.0)
    return kernels.Eyes(tolerance.eyes_m, tolerance.tan_angle, tolerance.gaze, tolerance.slack_deg, per_deg)


def _pages(view: ImageOnDisplay) -> kernels.Pages:
    levels = view.pyramid.levels
    return kernels.Pages(
        np.array([level.columns for level in levels], dtype=np.int64),
        np.array([level.rows for level in levels], dtype=np.int64),
        np.array([level.first_page for level in levels], dtype=np.int64),
        *view.detail,
        2.0**-BLEND_LEVELS,
    )


def _cut(
    view: ImageOnDisplay,
    pages: NDArray[np.int64],
    importance: NDArray[np.float64],
    panel: NDArray[np.int64],
    page: NDArray[np.int64],
    texels_per_px: float,
) -> PageCut:
    order = np.argsort(-importance, kind="stable")
    pages = pages[order]
    error_px = float(view.detail.tau[pages].max(initial=0.0)) / texels_per_px
    return PageCut(pages, importance[order], panel, page, error_px, view.detail)


def shares_at(view: ImageOnDisplay, tolerance: Tolerance, panel: int, position_px: Floats) -> Floats:
    """How much of each level is drawn at places of a panel, for an image on the surface: the definition.

    Parameters
    ----------
    position_px
        Shape (..., 2).

    Returns
    -------
    Shape (levels, ...): shares that sum to 1 inside the image, and to 0 outside.
    """
    assert view.maps is not None
    chosen = view.display.panels[panel]
    texel = position_px * view.maps.scale[panel] + view.maps.offset[panel]
    inside = ((texel >= 0) & (texel < np.array(view.pyramid.size_px))).all(axis=-1)
    allowed = tolerance.allowed_px(chosen.position_m(position_px), chosen.pitch_m[0])
    allowed = allowed * (view.sharpness[panel] * view.maps.footprint[panel])
    shares = level_shares(view.pyramid, view.detail, np.where(inside[..., None], texel, 0.0), allowed)
    finest = min(max(int(view.maps.mip_level[panel]), 0), len(shares) - 1)
    shares[finest] += shares[:finest].sum(axis=0)
    shares[:finest] = 0.0
    return np.where(inside, shares, 0.0)


def levels_at(view: ImageOnDisplay, tolerance: Tolerance, panel: int, position_px: Floats) -> NDArray[np.int64]:
    """The level that prevails at places of a panel: half of what is drawn there is as fine or finer.

    For an image on the surface; (..., 2) pixels to (...) levels, -1 outside. For maps of levels and for tests.
    """
    shares = shares_at(view, tolerance, panel, position_px)
    return np.where(shares.any(axis=0), (shares.cumsum(axis=0) > 0.5).argmax(axis=0), -1)
