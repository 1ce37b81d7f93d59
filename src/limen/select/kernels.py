"""The selectors' hot loops. Each is tested against dense sampling in plain NumPy.

Arrays come panel by panel as in `limen.display.PanelArrays` and `limen.placement.PanelMaps`; a level's
pages are numbered row by row from ``first[level]``. Tolerances are compared with a relative slack, so that
single-precision arithmetic on a GPU never asks for a page that was left out here.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["flat_pairs", "shape_pages"]

_SLACK = 1e-5
_EDGE_PX = 1e-4
_MIN_CELL_PX = 8.0
_FIRST_CELL_PX = 256.0
_STACK = 256


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
        low, high = _rect_tolerance(0.5 * px, 0.5 * py, (width - 0.5) * px, (height - 0.5) * py, eye_x, eye_y, height2, reach)
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
            least = 0.0 if level == 0 or level == base else 2.0 ** (level - base)
            if level <= base:
                least = 0.0
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
                            (i0 + 0.5) * px, (j0 + 0.5) * py, (i1 + 0.5) * px, (j1 + 0.5) * py, eye_x, eye_y, height2, reach
                        )
                        if high < least or low >= most:
                            continue
                    if count < len(panel_out):
                        panel_out[count] = p
                        page_out[count] = first[level] + r * columns[level] + c
                        area_out[count] = (i1 - i0 + 1.0) * (j1 - j0 + 1.0)
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _shape_texel(kind, local, turn, image_px, ex, ey, ez, x, y, z, out):
    """The texel behind a room position as the eye sees it (eye in the shape's frame); False where there is none."""
    qx = local[0, 0] * x + local[0, 1] * y + local[0, 2] * z + local[0, 3]
    qy = local[1, 0] * x + local[1, 1] * y + local[1, 2] * z + local[1, 3]
    qz = local[2, 0] * x + local[2, 1] * y + local[2, 2] * z + local[2, 3]
    dx, dy, dz = qx - ex, qy - ey, qz - ez
    if kind == 0:
        if dz == 0.0:
            return False
        t = -ez / dz
        if t <= 0.0:
            return False
        u, v = ex + t * dx, ey + t * dy
    else:
        round_y = 1.0 if kind == 2 else 0.0
        a = dx * dx + dz * dz + round_y * dy * dy
        b = ex * dx + ez * dz + round_y * ey * dy
        c = ex * ex + ez * ez + round_y * ey * ey - 1.0
        root = b * b - a * c
        if a == 0.0 or root < 0.0:
            return False
        root = math.sqrt(root)
        t = (-b - root) / a
        if t <= 0.0:
            t = (-b + root) / a
        if t <= 0.0:
            return False
        hx, hy, hz = ex + t * dx, ey + t * dy, ez + t * dz
        u = 0.5 + math.atan2(hx, hz) / turn
        if kind == 1:
            v = 0.5 + 0.5 * hy
        else:
            v = 0.5 + math.asin(min(max(hy, -1.0), 1.0)) / math.pi
    out[0], out[1] = u * image_px[0], v * image_px[1]
    return 0.0 <= u < 1.0 and 0.0 <= v < 1.0


@njit(cache=True, nogil=True)
def _wrapped(difference, period):
    return difference - period * round(difference / period) if period > 0.0 else difference


@njit(cache=True, nogil=True)
def shape_pages(origin_m, right, down, pitch_m, size_px, kind, local, turn, eye_local,
                eyes_m, tan_angle, columns, rows, first, image_px, bias, coverage):  # fmt: skip
    """Adds to ``coverage`` (one entry a page) the pixels that need each page of an image on a shape.

    A panel is cut into cells until a cell lies within a quarter of a page of one level, or is 8 pixels wide;
    all pages that a cell's bounding box touches are counted, so the answer errs toward too many.
    """
    eyes = len(tan_angle)
    eye_x, eye_y, height2, reach = np.empty(eyes), np.empty(eyes), np.empty(eyes), np.empty(eyes)
    top = len(columns) - 1
    full_turn = kind != 0 and turn > 2 * math.pi - 1e-9
    period = float(image_px[0]) if full_turn else 0.0
    stack = np.empty((_STACK, 4))
    here, beside, below = np.empty(2), np.empty(2), np.empty(2)
    ex, ey, ez = eye_local[0], eye_local[1], eye_local[2]
    for p in range(len(origin_m)):
        _eyes_on_panel(p, origin_m, right, down, pitch_m, eyes_m, tan_angle, eye_x, eye_y, height2, reach)
        px, py = pitch_m[p, 0], pitch_m[p, 1]
        for start_y in range(0, size_px[p, 1], int(_FIRST_CELL_PX)):
            for start_x in range(0, size_px[p, 0], int(_FIRST_CELL_PX)):
                stack[0, 0], stack[0, 1] = start_x, start_y
                stack[0, 2] = min(start_x + _FIRST_CELL_PX, size_px[p, 0])
                stack[0, 3] = min(start_y + _FIRST_CELL_PX, size_px[p, 1])
                depth = 1
                while depth:
                    depth -= 1
                    x0, y0, x1, y1 = stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3]
                    hits, finest_mip, coarsest_mip = 0, 1 << 30, -(1 << 30)
                    anchor_u, u_low, u_high, v_low, v_high = 0.0, 0.0, 0.0, 0.0, 0.0
                    for sample in range(9):
                        # The pixel centres at the cell's edges, halves and middle.
                        x = x0 + 0.5 + (x1 - x0 - 1.0) * 0.5 * (sample % 3)
                        y = y0 + 0.5 + (y1 - y0 - 1.0) * 0.5 * (sample // 3)
                        ox = origin_m[p, 0] + right[p, 0] * x * px + down[p, 0] * y * py
                        oy = origin_m[p, 1] + right[p, 1] * x * px + down[p, 1] * y * py
                        oz = origin_m[p, 2] + right[p, 2] * x * px + down[p, 2] * y * py
                        inside = _shape_texel(kind, local, turn, image_px, ex, ey, ez, ox, oy, oz, here)
                        if not inside:
                            continue
                        _shape_texel(kind, local, turn, image_px, ex, ey, ez,
                                     ox + right[p, 0] * px, oy + right[p, 1] * px, oz + right[p, 2] * px, beside)  # fmt: skip
                        _shape_texel(kind, local, turn, image_px, ex, ey, ez,
                                     ox + down[p, 0] * py, oy + down[p, 1] * py, oz + down[p, 2] * py, below)  # fmt: skip
                        a = math.hypot(_wrapped(beside[0] - here[0], period), beside[1] - here[1])
                        b = math.hypot(_wrapped(below[0] - here[0], period), below[1] - here[1])
                        mip = math.log2(max(max(a, b), 1e-30)) + 1e-3
                        finest_mip = min(finest_mip, int(math.floor(mip - 2e-2)))
                        coarsest_mip = max(coarsest_mip, int(math.floor(mip + 2e-2)))
                        if hits == 0:
                            anchor_u = here[0]
                            u_low, u_high, v_low, v_high = 0.0, 0.0, here[1], here[1]
                        u = _wrapped(here[0] - anchor_u, period)
                        u_low, u_high = min(u_low, u), max(u_high, u)
                        v_low, v_high = min(v_low, here[1]), max(v_high, here[1])
                        hits += 1
                    smallest = max(x1 - x0, y1 - y0) <= _MIN_CELL_PX
                    if hits == 0 and max(x1 - x0, y1 - y0) <= 4 * _MIN_CELL_PX:
                        continue
                    done = False
                    if hits:
                        low, high = 0.0, 0.0
                        if eyes:
                            low, high = _rect_tolerance((x0 + 0.5) * px, (y0 + 0.5) * py, (x1 - 0.5) * px, (y1 - 0.5) * py,
                                                        eye_x, eye_y, height2, reach)  # fmt: skip
                        finest = min(max(finest_mip + _hidden_levels(low) + bias, 0), top)
                        coarsest = min(max(coarsest_mip + _hidden_levels(high) + bias, 0), top)
                        extent = max(u_high - u_low, v_high - v_low) / 2.0**finest
                        span = 256.0 * 2.0**finest
                        one_page = math.floor((anchor_u + u_low) / span) == math.floor((anchor_u + u_high) / span) and math.floor(v_low / span) == math.floor(v_high / span)
                        done = smallest or (hits == 9 and finest == coarsest and (extent <= 64.0 or one_page))
                    if done:
                        slop = 0.02 * max(u_high - u_low, v_high - v_low) + 0.01
                        for level in range(finest, coarsest + 1):
                            span = 256.0 * 2.0**level
                            r0 = max(int(math.floor((v_low - slop) / span)), 0)
                            r1 = min(int(math.floor((v_high + slop) / span)), rows[level] - 1)
                            # Level by level, because with a wrapped image column -1 is the last one.
                            c0 = int(math.floor((anchor_u + u_low - slop) / span))
                            c1 = int(math.floor((anchor_u + u_high + slop) / span))
                            if full_turn and anchor_u + u_high + slop >= image_px[0]:
                                c1 = max(c1, columns[level])
                            for r in range(r0, r1 + 1):
                                for c in range(c0, c1 + 1):
                                    if full_turn:
                                        column = c % columns[level]
                                    elif 0 <= c < columns[level]:
                                        column = c
                                    else:
                                        continue
                                    coverage[first[level] + r * columns[level] + column] += (x1 - x0) * (y1 - y0)
                    elif not smallest:
                        half_x = x0 + max(1.0, math.floor((x1 - x0) / 2)) if x1 - x0 > _MIN_CELL_PX else x1
                        half_y = y0 + max(1.0, math.floor((y1 - y0) / 2)) if y1 - y0 > _MIN_CELL_PX else y1
                        for quarter in range(4):
                            cx0, cx1 = (x0, half_x) if quarter % 2 == 0 else (half_x, x1)
                            cy0, cy1 = (y0, half_y) if quarter // 2 == 0 else (half_y, y1)
                            if cx0 < cx1 and cy0 < cy1:
                                stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3] = cx0, cy0, cx1, cy1
                                depth += 1
