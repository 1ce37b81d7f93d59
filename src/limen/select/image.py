"""Which pages of an image a frame needs.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, sections 3.2 and 4 (level, importance).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.display.display import Display
from limen.geometry import Floats
from limen.placement import OnShape, OnSurface, PanelMaps, Placement
from limen.select import kernels
from limen.select.cut import Cut
from limen.tolerance import Tolerance
from limen.vision.acuity import hidden_levels

__all__ = [
    "Pairs",
    "View",
    "flat_pairs",
    "levels_at",
    "select",
    "select_flat",
    "select_on_shape",
    "shape_kind",
    "view_of",
]

_NONE = np.empty(0, dtype=np.int64)
_KINDS = ("plane", "cylinder", "ellipsoid")


class View(NamedTuple):
    """An image on a display: all that a selector and a drawing pass need to know of it, fixed while both stay."""

    display: Display
    pyramid: Pyramid
    placement: Placement
    maps: PanelMaps | None  # for images on the surface


def view_of(display: Display, pyramid: Pyramid, placement: Placement) -> View:
    maps = placement.panel_maps(display, pyramid.size_px) if isinstance(placement, OnSurface) else None
    return View(display, pyramid, placement, maps)


def shape_kind(placement: OnShape) -> int:
    """The number that kernels and shaders know a shape by."""
    return _KINDS.index(placement.kind)


def select(
    view: View, tolerance: Tolerance, *, budget: int | None = None, eye_m: tuple[float, float, float] | None = None
) -> Cut:
    """The pages that every pixel's level asks for.

    Parameters
    ----------
    view
        The image on the display.
    tolerance
        What cannot be seen; see `limen.tolerance.tolerance_of`.
    budget
        Most pages allowed. Where more are wanted, all levels are coarsened by one until they fit.
    eye_m
        The eye point of an image on a shape, unless the shape fixes it.

    Returns
    -------
    Cut
        Pages by importance; ``cut.error_px`` never exceeds what the tolerance allows while ``cut.bias`` is 0.
    """
    wanted = _select_at(view, tolerance, 0, eye_m)
    cut, bias = wanted, 0
    while budget is not None and len(cut) > budget and bias < len(view.pyramid.levels) - 1:
        bias += 1
        cut = _select_at(view, tolerance, bias, eye_m)
    if bias == 0:
        return cut
    return Cut(cut.pages, cut.importance, cut.pair_panel, cut.pair_page, cut.error_px, bias, len(wanted) - len(cut))


def _select_at(view: View, tolerance: Tolerance, bias: int, eye_m: tuple[float, float, float] | None) -> Cut:
    if isinstance(view.placement, OnSurface):
        return select_flat(view, tolerance, bias)
    return select_on_shape(view, tolerance, bias, eye_m)


class Pairs(NamedTuple):
    """Which page is needed on which panel, shape (M,) each, in no order that matters."""

    panel: NDArray[np.int64]
    page: NDArray[np.int64]
    area_px: NDArray[np.float64]


def flat_pairs(view: View, tolerance: Tolerance, bias: int = 0) -> Pairs:
    """What `select_flat` chooses from, before pages that several panels share are put together."""
    assert view.maps is not None
    arrays, maps = view.display.arrays, view.maps
    pages_of = _level_arrays(view.pyramid)
    room = 8192
    while True:
        panel, page, area = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room)
        count = kernels.flat_pairs(
            arrays.origin_m, arrays.right, arrays.down, arrays.pitch_m, arrays.size_px,
            maps.scale, maps.offset, maps.mip_level, tolerance.eyes_m, tolerance.tan_angle,
            *pages_of, np.array(view.pyramid.size_px, dtype=np.int64), bias, panel, page, area,
        )  # fmt: skip
        if count <= room:
            return Pairs(panel[:count], page[:count], area[:count])
        room = count


def select_flat(view: View, tolerance: Tolerance, bias: int = 0) -> Cut:
    """`select` for images on the surface: pairs of panel and page by interval tests on rings of distance."""
    panel, page, area = flat_pairs(view, tolerance, bias)
    assert view.maps is not None
    pages, inverse = np.unique(page, return_inverse=True)
    importance = np.bincount(inverse, weights=area, minlength=len(pages)).astype(np.float64)
    return _cut(view.pyramid, pages, importance, panel, page, float(np.abs(view.maps.scale).max(axis=1).min()))


def select_on_shape(
    view: View, tolerance: Tolerance, bias: int = 0, eye_m: tuple[float, float, float] | None = None
) -> Cut:
    """`select` for images on a plane, cylinder or ellipsoid in the room.

    Raises
    ------
    InputError
        If neither the placement nor the caller tells the eye point.
    """
    placement = view.placement
    assert isinstance(placement, OnShape)
    arrays = view.display.arrays
    local = placement.local_from_room()
    closed = placement.kind != "plane" and placement.turn_deg == 360
    shape = kernels.Shape(
        shape_kind(placement),
        local,
        placement.local_eye(eye_m),
        math.radians(placement.turn_deg),
        np.array(view.pyramid.size_px, dtype=np.int64),
        float(view.pyramid.size_px[0]) if closed else 0.0,
    )
    coverage = np.zeros(view.pyramid.page_count)
    kernels.shape_pages(
        view.display.nudged_origin_m, arrays.right, arrays.down, arrays.pitch_m, arrays.size_px,
        shape, _level_arrays(view.pyramid), tolerance.eyes_m, tolerance.tan_angle, bias, coverage,
    )  # fmt: skip
    pages = np.flatnonzero(coverage)
    return _cut(view.pyramid, pages, coverage[pages], _NONE, _NONE, 1.0)


def _level_arrays(pyramid: Pyramid) -> kernels.Pages:
    levels = pyramid.levels
    return kernels.Pages(
        np.array([level.columns for level in levels], dtype=np.int64),
        np.array([level.rows for level in levels], dtype=np.int64),
        np.array([level.first_page for level in levels], dtype=np.int64),
    )


def _cut(
    pyramid: Pyramid,
    pages: NDArray[np.int64],
    importance: NDArray[np.float64],
    panel: NDArray[np.int64],
    page: NDArray[np.int64],
    texels_per_px: float,
) -> Cut:
    order = np.argsort(-importance, kind="stable")
    pages = pages[order]
    firsts = np.array([level.first_page for level in pyramid.levels])
    coarsest = int(np.searchsorted(firsts, pages, side="right").max(initial=1)) - 1
    error_px = 2.0**coarsest / texels_per_px if coarsest else 0.0
    return Cut(pages, importance[order], panel, page, error_px)


def levels_at(view: View, tolerance: Tolerance, panel: int, position_px: Floats) -> NDArray[np.int64]:
    """The level drawn at places of a panel, for an image on the surface: (..., 2) pixels to (...) levels; -1 outside.

    The formula itself (Papadopoulos, Kaufman 2013, section 3.2), pixel by pixel: for maps of levels and for tests.
    """
    assert view.maps is not None
    chosen = view.display.panels[panel]
    hidden = hidden_levels(tolerance.allowed_px(chosen.position_m(position_px), chosen.pitch_m[0]))
    texel = position_px * view.maps.scale[panel] + view.maps.offset[panel]
    inside = ((texel >= 0) & (texel < np.array(view.pyramid.size_px))).all(axis=-1)
    levels = np.clip(view.maps.mip_level[panel] + hidden, 0, len(view.pyramid.levels) - 1)
    return np.where(inside, levels, -1)
