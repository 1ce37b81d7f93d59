"""The selectors' hot loops where an image is bent: on shapes in the room, and behind lenses.

A panel is cut into cells until each lies in one page, or nearly, and one level; every cell is asked at nine places.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled
from limen.geometry import Floats
from limen.layers.image.kernels import eyes_on_panel, is_drawn, rect_tolerance
from limen.layers.image.lens_kernels import seen_through, smallest_reach

__all__ = ["SURFACE", "Shape", "Ways", "shape_pages"]

_MIP_SLACK = 2e-2
_MIN_CELL_PX = 16.0
_STACK = 256
_ALMOST_ONE = 1.0 - 1e-12

SURFACE = 3
"""The kind of an image on the display's surface that is seen through lenses."""

_LENS_CELL_PX, _CELLS_A_RADIUS = 32.0, 32.0
"""Cells that lenses reach into are cut until they are as small, in pixels or beside the smallest of these lenses: nine
places tell how they bend then."""


class Ways(NamedTuple):
    """Where the first corner of every panel lies, and where a pixel leads to the right and down, (P, 3) each.

    In the room; of an image on the surface, in its texels without lenses (and 0).
    """

    origin: Floats
    across: Floats
    below: Floats


class Shape(NamedTuple):
    """An image on a plane (0), cylinder (1) or ellipsoid (2) as one eye sees it, see `limen.viewing.placement.OnShape`;
    or on the surface (3), through lenses."""

    kind: int
    local: Floats  # 4 x 4, from the room to the frame in which the shape has size one
    eye: Floats  # the eye point in that frame
    turn: float  # radians of the circle that the image's width covers
    image_px: NDArray[np.int64]
    period: float  # the image's width where it closes on itself, else 0
    lenses: Floats  # of `limen.viewing.lens.rows_of`
    tables: Floats


@compiled(error_model="python")
def _shape_texel(shape, x, y, z):
    """The texel behind a room position: (hit, u, v)."""
    if shape.kind == SURFACE:
        u, v = seen_through(shape.lenses, shape.tables, x, y)
        return 0.0 <= u < shape.image_px[0] and 0.0 <= v < shape.image_px[1], u, v
    local, eye = shape.local, shape.eye
    ex, ey, ez = eye[0], eye[1], eye[2]
    dx = local[0, 0] * x + local[0, 1] * y + local[0, 2] * z + local[0, 3] - ex
    dy = local[1, 0] * x + local[1, 1] * y + local[1, 2] * z + local[1, 3] - ey
    dz = local[2, 0] * x + local[2, 1] * y + local[2, 2] * z + local[2, 3] - ez
    if shape.kind == 0:
        t = -ez / dz if dz != 0.0 else -1.0
        u, v = ex + t * dx, ey + t * dy
    else:
        round_y = 1.0 if shape.kind == 2 else 0.0
        a = dx * dx + dz * dz + round_y * dy * dy
        b = ex * dx + ez * dz + round_y * ey * dy
        root = b * b - a * (ex * ex + ez * ez + round_y * ey * ey - 1.0)
        if a == 0.0 or root < 0.0:
            return False, 0.0, 0.0
        t = (-b - math.sqrt(root)) / a
        if t <= 0.0:
            t = (-b + math.sqrt(root)) / a
        hy = ey + t * dy
        u = 0.5 + math.atan2(ex + t * dx, ez + t * dz) / shape.turn
        v = 0.5 + (0.5 * hy if shape.kind == 1 else math.asin(min(max(hy, -1.0), 1.0)) / math.pi)
        # A closed shape has no edge: what lies exactly behind, or at a pole, must not fall off the image.
        if shape.period > 0.0:
            u = min(u, _ALMOST_ONE)
        if shape.kind == 2:
            v = min(v, _ALMOST_ONE)
    hit = t > 0.0 and 0.0 <= u < 1.0 and 0.0 <= v < 1.0
    return hit, u * shape.image_px[0], v * shape.image_px[1]


@compiled(error_model="python")
def _wrapped(difference, period):
    return difference - period * round(difference / period) if period > 0.0 else difference


@compiled(error_model="python")
def _footprint_level(shape, position, across, below, u, v):
    """``log2 A`` at a room position, by the differences to the pixels to the right and below."""
    _, u1, v1 = _shape_texel(shape, position[0] + across[0], position[1] + across[1], position[2] + across[2])
    _, u2, v2 = _shape_texel(shape, position[0] + below[0], position[1] + below[1], position[2] + below[2])
    a = math.hypot(_wrapped(u1 - u, shape.period), v1 - v)
    b = math.hypot(_wrapped(u2 - u, shape.period), v2 - v)
    return math.log2(max(max(a, b), 1e-30)) + 1e-3


@compiled(error_model="python")
def _survey(shape, origin, across, below, x0, y0, x1, y1):
    """Nine pixels of a cell: hits, the range of log2 A, and the box of texels (u relative to an anchor)."""
    hits, finest, coarsest = 0, math.inf, -math.inf
    anchor, u_low, u_high, v_low, v_high = 0.0, 0.0, 0.0, 0.0, 0.0
    for sample in range(9):
        x = x0 + 0.5 + (x1 - x0 - 1.0) * 0.5 * (sample % 3)
        y = y0 + 0.5 + (y1 - y0 - 1.0) * 0.5 * (sample // 3)
        position = (
            origin[0] + across[0] * x + below[0] * y,
            origin[1] + across[1] * x + below[1] * y,
            origin[2] + across[2] * x + below[2] * y,
        )
        hit, u, v = _shape_texel(shape, position[0], position[1], position[2])
        if not hit:
            continue
        mip = _footprint_level(shape, position, across, below, u, v)
        finest, coarsest = min(finest, mip - _MIP_SLACK), max(coarsest, mip + _MIP_SLACK)
        if hits == 0:
            anchor, v_low, v_high = u, v, v
        step = _wrapped(u - anchor, shape.period)
        u_low, u_high = min(u_low, step), max(u_high, step)
        v_low, v_high = min(v_low, v), max(v_high, v)
        hits += 1
    return hits, finest, coarsest, anchor + u_low, anchor + u_high, v_low, v_high


@compiled(error_model="python")
def _add_box(shape, pages, level, box, area, finest, low, high, coverage):
    """Count ``area`` pixels for every page of a level that a box of texels touches and that is drawn."""
    u_low, u_high, v_low, v_high = box
    span = 256.0 * 2.0**level
    columns = pages.columns[level]
    slop = 0.02 * max(u_high - u_low, v_high - v_low) + 0.01
    c0, c1 = math.floor((u_low - slop) / span), math.floor((u_high + slop) / span)
    if shape.period > 0.0:
        # The last column may be narrow, so 'one past the end' is found by wrapping texels, not columns.
        if u_high + slop >= shape.period:
            c1 = columns + int((u_high + slop - shape.period) / span)
        if u_low - slop < 0.0:
            c0 = int((u_low - slop + shape.period) / span) - columns
    else:
        c0, c1 = max(c0, 0), min(c1, columns - 1)
    r0 = max(math.floor((v_low - slop) / span), 0)
    r1 = min(math.floor((v_high + slop) / span), pages.rows[level] - 1)
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            if is_drawn(pages, level, c % columns, r, finest, low, high):
                coverage[pages.first[level] + r * columns + c % columns] += area


@compiled(error_model="python")
def _visit(shape, pages, origin, across, below, cell, pitch, seen, bias, coverage):
    """Count a cell's pages, or say False: it must be cut."""
    x0, y0, x1, y1 = cell[0], cell[1], cell[2], cell[3]
    if shape.kind == SURFACE and max(x1 - x0, y1 - y0) > _LENS_CELL_PX:
        left, top = origin[0] + across[0] * x0, origin[1] + below[1] * y0
        reach = smallest_reach(shape.lenses, left, top, origin[0] + across[0] * x1, origin[1] + below[1] * y1)
        if max(x1 - x0, y1 - y0) * across[0] * _CELLS_A_RADIUS > reach:
            return False
    hits, fine_mip, coarse_mip, u_low, u_high, v_low, v_high = _survey(shape, origin, across, below, x0, y0, x1, y1)
    smallest = max(x1 - x0, y1 - y0) <= _MIN_CELL_PX
    if hits == 0:
        return smallest
    low, high = 0.0, 0.0
    if len(seen):
        low, high = rect_tolerance((x0 + 0.5) * pitch[0], (y0 + 0.5) * pitch[1], (x1 - 0.5) * pitch[0],
                                    (y1 - 0.5) * pitch[1], seen)  # fmt: skip
        low, high = low * 2.0 ** (fine_mip + bias), high * 2.0 ** (coarse_mip + bias)
    top = len(pages.columns) - 1
    finest = min(max(math.floor(fine_mip) + bias, 0), top)
    coarsest = min(max(math.floor(coarse_mip) + bias, 0), top)
    if not smallest:
        span = 256.0 * 2.0 ** max(finest, min(_floor_log2(low), top))
        extent = max(u_high - u_low, v_high - v_low)
        one_page = math.floor(u_low / span) == math.floor(u_high / span) and math.floor(v_low / span) == math.floor(
            v_high / span
        )
        one_level = max(finest, _floor_log2(low)) == max(coarsest, _floor_log2(high))
        if hits < 9 or not one_level or not (one_page or extent <= span / 4):
            return False
    for level in range(finest, top + 1):
        # Where the cell spans levels of pixels, each may be the finest that some pixel shows.
        _add_box(shape, pages, level, (u_low, u_high, v_low, v_high), (x1 - x0) * (y1 - y0),
                 coarsest if level <= coarsest else finest, low, high, coverage)  # fmt: skip
    return True


@compiled(error_model="python")
def _floor_log2(value):
    """The exponent of a tolerance; 0 below 1."""
    return math.frexp(value)[1] - 1 if value >= 1.0 else 0


@compiled(error_model="python")
def shape_pages(panels, ways, shape, pages, eyes, places, bias, coverage):
    """Adds to ``coverage`` (one entry a page) the pixels that need each page of a bent image.

    ``places`` are a panel and the pixels from left, top to right, bottom, (N, 5), panel by panel. Each is cut into
    cells until a cell lies in one page, or within a quarter of a page, of one level, or is 16 pixels wide; all pages
    that a cell's box of texels touches are counted, so the answer errs toward too many.
    """
    seen = np.empty((len(eyes.tan_angle), 9))
    stack = np.empty((_STACK, 4))
    for n in range(len(places)):
        p = places[n, 0]
        if n == 0 or p != places[n - 1, 0]:
            eyes_on_panel(p, panels, eyes, seen)
        pitch = panels.pitch_m[p]
        origin, across, below = ways.origin[p], ways.across[p], ways.below[p]
        for side in range(4):
            stack[0, side] = places[n, 1 + side]
        depth = 1
        while depth:
            depth -= 1
            cell = (stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3])
            if not _visit(shape, pages, origin, across, below, cell, pitch, seen, bias, coverage):
                depth = _cut_cell(cell, stack, depth)


@compiled(error_model="python")
def _cut_cell(cell, stack, depth):
    """Push a cell's halves (or quarters) on the stack; returns the new depth."""
    x0, y0, x1, y1 = cell
    half_x = x0 + math.floor((x1 - x0) / 2) if x1 - x0 > _MIN_CELL_PX else x1
    half_y = y0 + math.floor((y1 - y0) / 2) if y1 - y0 > _MIN_CELL_PX else y1
    for quarter in range(4):
        left, right = (x0, half_x) if quarter % 2 == 0 else (half_x, x1)
        above, below = (y0, half_y) if quarter // 2 == 0 else (half_y, y1)
        if left < right and above < below:
            stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3] = left, above, right, below
            depth += 1
    return depth
