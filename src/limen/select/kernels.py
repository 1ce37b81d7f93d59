"""The selectors' hot loops. Each is tested against dense sampling in plain NumPy.

Arrays come panel by panel as in `limen.display.PanelArrays` and `limen.placement.PanelMaps`; a level's
pages are numbered row by row from ``first[level]``. Tolerances are compared with a relative slack, so that
single-precision arithmetic on a GPU never asks for a page that was left out here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from limen.geometry import Floats

__all__ = ["Pages", "Shape", "flat_pairs", "shape_pages"]

_SLACK = 1e-5
_EDGE_PX = 1e-4
_MIP_SLACK = 2e-2
_MIN_CELL_PX = 16.0
_FIRST_CELL_PX = 256.0
_STACK = 256
_ALMOST_ONE = 1.0 - 1e-12


@njit(cache=True, nogil=True)
def _rect_tolerance(x0, y0, x1, y1, eye_x, eye_y, height2, reach):
    """Smallest and (an upper bound of the) largest tolerance over a rectangle of a panel's plane, metres in."""
    low, high = 0.0, 0.0
    for k in range(len(reach)):
        near_x = max(0.0, max(x0 - eye_x[k], eye_x[k] - x1))
        near_y = max(0.0, max(y0 - eye_y[k], eye_y[k] - y1))
        far_x = max(abs(x0 - eye_x[k]), abs(x1 - eye_x[k]))
        far_y = max(abs(y0 - eye_y[k]), abs(y1 - eye_y[k]))
        near = reach[k] * math.sqrt(height2[k] + near_x * near_x + near_y * near_y)
        far = reach[k] * math.sqrt(height2[k] + far_x * far_x + far_y * far_y)
        if k == 0 or near < low:
            low = near
        if k == 0 or far < high:
            high = far
    return low * (1.0 - _SLACK), high * (1.0 + _SLACK)


@njit(cache=True, nogil=True)
def _hidden_levels(tolerance_px):
    """``floor(max(0, log2(tolerance)))``, exactly."""
    if tolerance_px < 2.0:
        return 0
    return math.frexp(tolerance_px)[1] - 1


@njit(cache=True, nogil=True)
def _eyes_on_panel(p, origin_m, right, down, pitch_m, eyes_m, tan_angle, eye_x, eye_y, height2, reach):
    """The eyes in the frame of panel ``p``; ``reach`` turns a distance into pixels."""
    for k in range(len(tan_angle)):
        rx = eyes_m[k, 0] - origin_m[p, 0]
        ry = eyes_m[k, 1] - origin_m[p, 1]
        rz = eyes_m[k, 2] - origin_m[p, 2]
        eye_x[k] = rx * right[p, 0] + ry * right[p, 1] + rz * right[p, 2]
        eye_y[k] = rx * down[p, 0] + ry * down[p, 1] + rz * down[p, 2]
        height2[k] = max(0.0, rx * rx + ry * ry + rz * rz - eye_x[k] ** 2 - eye_y[k] ** 2)
        reach[k] = tan_angle[k] / pitch_m[p, 0]


@njit(cache=True, nogil=True)
def flat_pairs(origin_m, right, down, pitch_m, size_px, scale, offset, mip, eyes_m, tan_angle,
               columns, rows, first, image_px, bias, panel_out, page_out, area_out):  # fmt: skip
    """Every (panel, page) that some pixel needs, for images on the display's surface.

    The pixels of a level lie in a ring around the eye's foot point, so 'does a pixel of this page need this
    level' is an interval test on the distances to a rectangle.

    Returns the number of pairs; if it exceeds the room in the outputs, only those that fit were written.
    """
    eyes = len(tan_angle)
    eye_x, eye_y, height2, reach = np.empty(eyes), np.empty(eyes), np.empty(eyes), np.empty(eyes)
    top = len(columns) - 1
    count = 0
    for p in range(len(origin_m)):
        _eyes_on_panel(p, origin_m, right, down, pitch_m, eyes_m, tan_angle, eye_x, eye_y, height2, reach)
        px, py = pitch_m[p, 0], pitch_m[p, 1]
        width, height = size_px[p, 0], size_px[p, 1]
        low, high = _rect_tolerance(
            0.5 * px, 0.5 * py, (width - 0.5) * px, (height - 0.5) * py, eye_x, eye_y, height2, reach
        )
        base = mip[p] + bias
        finest = min(max(base + _hidden_levels(low), 0), top)
        coarsest = min(max(base + _hidden_levels(high), 0), top)
        sx, sy, ox, oy = scale[p, 0], scale[p, 1], offset[p, 0], offset[p, 1]
        u0, u1 = max(sx * 0.5 + ox, 0.0), min(sx * (width - 0.5) + ox, image_px[0] - 1e-6)
        v0, v1 = max(sy * 0.5 + oy, 0.0), min(sy * (height - 0.5) + oy, image_px[1] - 1e-6)
        if u0 > u1 or v0 > v1:
            continue
        for level in range(finest, coarsest + 1):
            # The tolerances at which this level is drawn: the ends of the pyramid take what lies beyond.
            least = 0.0 if level == 0 or level <= base else 2.0 ** (level - base)
            most = math.inf if level == top else 2.0 ** (level - base + 1)
            span = 256.0 * 2.0**level
            c0, c1 = int(u0 // span), min(int(u1 // span), columns[level] - 1)
            r0, r1 = int(v0 // span), min(int(v1 // span), rows[level] - 1)
            for r in range(r0, r1 + 1):
                # First and last pixel whose centre lies in the page (and in the image).
                j0 = max(0, math.ceil((max(r * span, 0.0) - oy) / sy - 0.5 - _EDGE_PX))
                j1 = min(height, math.ceil((min((r + 1) * span, image_px[1]) - oy) / sy - 0.5 + _EDGE_PX)) - 1
                if j0 > j1:
                    continue
                for c in range(c0, c1 + 1):
                    i0 = max(0, math.ceil((max(c * span, 0.0) - ox) / sx - 0.5 - _EDGE_PX))
                    i1 = min(width, math.ceil((min((c + 1) * span, image_px[0]) - ox) / sx - 0.5 + _EDGE_PX)) - 1
                    if i0 > i1:
                        continue
                    if eyes:
                        low, high = _rect_tolerance(
                            (i0 + 0.5) * px,
                            (j0 + 0.5) * py,
                            (i1 + 0.5) * px,
                            (j1 + 0.5) * py,
                            eye_x,
                            eye_y,
                            height2,
                            reach,
                        )
                        if high < least or low >= most:
                            continue
                    if count < len(panel_out):
                        panel_out[count] = p
                        page_out[count] = first[level] + r * columns[level] + c
                        area_out[count] = (i1 - i0 + 1.0) * (j1 - j0 + 1.0)
                    count += 1
    return count


class Shape(NamedTuple):
    """An image on a plane (0), cylinder (1) or ellipsoid (2) as one eye sees it; see `limen.placement.OnShape`."""

    kind: int
    local: Floats  # 4 x 4, from the room to the frame in which the shape has size one
    eye: Floats  # the eye point in that frame
    turn: float  # radians of the circle that the image's width covers
    image_px: NDArray[np.int64]
    period: float  # the image's width where it closes on itself, else 0


class Pages(NamedTuple):
    """A pyramid's numbering, one entry a level."""

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    first: NDArray[np.int64]


@njit(cache=True, nogil=True)
def _shape_texel(shape, x, y, z):
    """The texel behind a room position: (hit, u, v)."""
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


@njit(cache=True, nogil=True)
def _wrapped(difference, period):
    return difference - period * round(difference / period) if period > 0.0 else difference


@njit(cache=True, nogil=True)
def _footprint_level(shape, position, across, below, u, v):
    """``log2 A`` at a room position, by the differences to the pixels to the right and below."""
    _, u1, v1 = _shape_texel(shape, position[0] + across[0], position[1] + across[1], position[2] + across[2])
    _, u2, v2 = _shape_texel(shape, position[0] + below[0], position[1] + below[1], position[2] + below[2])
    a = math.hypot(_wrapped(u1 - u, shape.period), v1 - v)
    b = math.hypot(_wrapped(u2 - u, shape.period), v2 - v)
    return math.log2(max(max(a, b), 1e-30)) + 1e-3


@njit(cache=True, nogil=True)
def _survey(shape, origin, across, below, x0, y0, x1, y1):
    """Nine pixels of a cell: hits, the range of mip levels, and the box of texels (u relative to an anchor)."""
    hits, finest, coarsest = 0, 1 << 30, -(1 << 30)
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
        finest = min(finest, math.floor(mip - _MIP_SLACK))
        coarsest = max(coarsest, math.floor(mip + _MIP_SLACK))
        if hits == 0:
            anchor, v_low, v_high = u, v, v
        step = _wrapped(u - anchor, shape.period)
        u_low, u_high = min(u_low, step), max(u_high, step)
        v_low, v_high = min(v_low, v), max(v_high, v)
        hits += 1
    return hits, finest, coarsest, anchor + u_low, anchor + u_high, v_low, v_high


@njit(cache=True, nogil=True)
def _add_box(shape, pages, level, u_low, u_high, v_low, v_high, area, coverage):
    """Count ``area`` pixels for every page of a level that a box of texels touches."""
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
            coverage[pages.first[level] + r * columns + c % columns] += area


@njit(cache=True, nogil=True)
def _visit(shape, pages, origin, across, below, cell, pitch, eye_x, eye_y, height2, reach, bias, coverage):
    """Count a cell's pages, or say False: it must be cut."""
    x0, y0, x1, y1 = cell[0], cell[1], cell[2], cell[3]
    hits, finest_mip, coarsest_mip, u_low, u_high, v_low, v_high = _survey(shape, origin, across, below, x0, y0, x1, y1)
    smallest = max(x1 - x0, y1 - y0) <= _MIN_CELL_PX
    if hits == 0:
        return smallest
    low, high = 0.0, 0.0
    if len(reach):
        low, high = _rect_tolerance((x0 + 0.5) * pitch[0], (y0 + 0.5) * pitch[1], (x1 - 0.5) * pitch[0],
                                    (y1 - 0.5) * pitch[1], eye_x, eye_y, height2, reach)  # fmt: skip
    top = len(pages.columns) - 1
    finest = min(max(finest_mip + _hidden_levels(low) + bias, 0), top)
    coarsest = min(max(coarsest_mip + _hidden_levels(high) + bias, 0), top)
    if not smallest:
        span = 256.0 * 2.0**finest
        extent = max(u_high - u_low, v_high - v_low)
        one_page = math.floor(u_low / span) == math.floor(u_high / span) and math.floor(v_low / span) == math.floor(
            v_high / span
        )
        if hits < 9 or finest != coarsest or not (one_page or extent <= span / 4):
            return False
    for level in range(finest, coarsest + 1):
        _add_box(shape, pages, level, u_low, u_high, v_low, v_high, (x1 - x0) * (y1 - y0), coverage)
    return True


@njit(cache=True, nogil=True)
def shape_pages(origin_m, right, down, pitch_m, size_px, shape, pages, eyes_m, tan_angle, bias, coverage):
    """Adds to ``coverage`` (one entry a page) the pixels that need each page of an image on a shape.

    A panel is cut into cells until a cell lies in one page, or within a quarter of a page, of one level, or is
    16 pixels wide; all pages that a cell's box of texels touches are counted, so the answer errs toward too many.
    """
    eyes = len(tan_angle)
    eye_x, eye_y, height2, reach = np.empty(eyes), np.empty(eyes), np.empty(eyes), np.empty(eyes)
    stack = np.empty((_STACK, 4))
    for p in range(len(origin_m)):
        _eyes_on_panel(p, origin_m, right, down, pitch_m, eyes_m, tan_angle, eye_x, eye_y, height2, reach)
        across, below = right[p] * pitch_m[p, 0], down[p] * pitch_m[p, 1]
        for start in range(math.ceil(size_px[p, 0] / _FIRST_CELL_PX) * math.ceil(size_px[p, 1] / _FIRST_CELL_PX)):
            columns = math.ceil(size_px[p, 0] / _FIRST_CELL_PX)
            x, y = (start % columns) * _FIRST_CELL_PX, (start // columns) * _FIRST_CELL_PX
            stack[0, 0], stack[0, 1] = x, y
            stack[0, 2], stack[0, 3] = min(x + _FIRST_CELL_PX, size_px[p, 0]), min(y + _FIRST_CELL_PX, size_px[p, 1])
            depth = 1
            while depth:
                depth -= 1
                cell = (stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3])
                if not _visit(shape, pages, origin_m[p], across, below, cell, pitch_m[p],
                              eye_x, eye_y, height2, reach, bias, coverage):  # fmt: skip
                    depth = _cut_cell(cell, stack, depth)


@njit(cache=True, nogil=True)
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
