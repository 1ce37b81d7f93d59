"""The selectors' hot loops. Each is tested against dense sampling in plain NumPy.

Arrays come panel by panel as in `limen.display.display.PanelArrays` and `limen.viewing.placement.PanelMaps`. Tolerances
are compared with a relative slack, so that single-precision arithmetic on a GPU never asks for a page that was left out
here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled
from limen.geometry import Floats

__all__ = ["Eyes", "Pages", "Panels", "eyes_on_panel", "flat_pairs", "is_drawn", "rect_tolerance"]

_SLACK = 1e-5
_EDGE_PX = 1e-4
_PARTS = 4


class Eyes(NamedTuple):
    """Who looks; see `limen.viewing.tolerance.Tolerance`."""

    position_m: Floats  # (E, 3)
    tan_angle: Floats  # (E,)
    gaze: Floats  # (E, 3)
    slack_deg: Floats  # (E,)
    per_deg: Floats  # (E,): growth of the tolerance with each degree from the gaze


class Panels(NamedTuple):
    """Where panels are, one row each; see `limen.display.display.PanelArrays`."""

    origin_m: Floats
    right: Floats
    down: Floats
    pitch_m: Floats
    size_px: NDArray[np.int64]
    sharpness: Floats  # (P,): the angles that stay invisible on this panel over those under standard light


class Pages(NamedTuple):
    """A pyramid's numbering, one entry a level, and its `limen.layers.common.page_detail.Detail`."""

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    first: NDArray[np.int64]
    tau: Floats  # one entry a page
    least: Floats
    begin: float  # where a page begins to be drawn, over its tau


@compiled(error_model="python")
def rect_tolerance(x0, y0, x1, y1, seen):
    """A lower and an upper bound of the tolerance over a rectangle of a panel's plane; corners in metres.

    ``seen`` holds the eyes in the panel's frame, see `eyes_on_panel`.
    """
    low, high = 0.0, 0.0
    for k in range(len(seen)):
        x, y, height, reach = seen[k, 0], seen[k, 1], seen[k, 2], seen[k, 3]
        near_x = max(0.0, max(x0 - x, x - x1))
        near_y = max(0.0, max(y0 - y, y - y1))
        far_x = max(abs(x0 - x), abs(x1 - x))
        far_y = max(abs(y0 - y), abs(y1 - y))
        near = reach * math.sqrt(height * height + near_x * near_x + near_y * near_y)
        far = reach * math.sqrt(height * height + far_x * far_x + far_y * far_y)
        if seen[k, 8] > 0.0:
            # All of the rectangle lies within `around` of the direction to its middle.
            mx, my = 0.5 * (x0 + x1) - x, 0.5 * (y0 + y1) - y
            distance = max(math.sqrt(mx * mx + my * my + height * height), 1e-9)
            ahead = (mx * seen[k, 4] + my * seen[k, 5] - height * seen[k, 6]) / distance
            beside = math.acos(min(max(ahead, -1.0), 1.0))
            reaching = 0.5 * math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2) / distance
            around = math.asin(reaching) if reaching < 1.0 else math.pi
            near *= 1.0 + seen[k, 8] * max(0.0, math.degrees(beside - around) - seen[k, 7])
            far *= 1.0 + seen[k, 8] * max(0.0, min(180.0, math.degrees(beside + around)) - seen[k, 7])
        if k == 0 or near < low:
            low = near
        if k == 0 or far < high:
            high = far
    return low * (1.0 - _SLACK), high * (1.0 + _SLACK)


@compiled(error_model="python")
def eyes_on_panel(p, panels, eyes, seen):
    """The eyes in the frame of panel ``p``, one a row.

    Foot point and height (m), pixels per metre of distance; the gaze along right, down and normal, its slack (deg),
    the growth of the tolerance (per degree).
    """
    right, down = panels.right[p], panels.down[p]
    nx = down[1] * right[2] - down[2] * right[1]
    ny = down[2] * right[0] - down[0] * right[2]
    nz = down[0] * right[1] - down[1] * right[0]
    for k in range(len(eyes.tan_angle)):
        rx = eyes.position_m[k, 0] - panels.origin_m[p, 0]
        ry = eyes.position_m[k, 1] - panels.origin_m[p, 1]
        rz = eyes.position_m[k, 2] - panels.origin_m[p, 2]
        gx, gy, gz = eyes.gaze[k, 0], eyes.gaze[k, 1], eyes.gaze[k, 2]
        seen[k, 0] = rx * right[0] + ry * right[1] + rz * right[2]
        seen[k, 1] = rx * down[0] + ry * down[1] + rz * down[2]
        seen[k, 2] = rx * nx + ry * ny + rz * nz
        seen[k, 3] = eyes.tan_angle[k] * panels.sharpness[p] / panels.pitch_m[p, 0]
        seen[k, 4] = gx * right[0] + gy * right[1] + gz * right[2]
        seen[k, 5] = gx * down[0] + gy * down[1] + gz * down[2]
        seen[k, 6] = gx * nx + gy * ny + gz * nz
        seen[k, 7] = eyes.slack_deg[k]
        seen[k, 8] = eyes.per_deg[k]


@compiled(error_model="python")
def is_drawn(pages, level, column, row, finest, low, high):
    """Whether some pixel draws a page, where the tolerance lies from ``low`` to ``high`` texels of full resolution.

    ``finest`` is the finest level that the pixels can show.
    """
    top = len(pages.columns) - 1
    if level < top:
        parent = pages.first[level + 1] + (row >> 1) * pages.columns[level + 1] + (column >> 1)
        if low >= pages.tau[parent]:
            return False
    own = pages.tau[pages.first[level] + row * pages.columns[level] + column]
    return level <= finest or own == 0.0 or high > own * pages.begin


@compiled(error_model="python")
def _drawn_in(rect, pages, level, column, row, finest, texels, seen):
    """Whether some pixel in a rectangle of the panel (metres) draws a page.

    The bounds of the tolerance over all of it may be wide, so where they alone say yes its sixteen parts are asked.
    """
    x0, y0, x1, y1 = rect
    least, most = rect_tolerance(x0, y0, x1, y1, seen)
    if not is_drawn(pages, level, column, row, finest, least * texels, most * texels):
        return False
    if is_drawn(pages, level, column, row, finest, most * texels, least * texels):
        return True  # all of its pixels do
    dx, dy = (x1 - x0) / _PARTS, (y1 - y0) / _PARTS
    for part in range(_PARTS * _PARTS):
        left, above = x0 + dx * (part % _PARTS), y0 + dy * (part // _PARTS)
        least, most = rect_tolerance(left, above, left + dx, above + dy, seen)
        if is_drawn(pages, level, column, row, finest, least * texels, most * texels):
            return True
    return False


@compiled(error_model="python")
def flat_pairs(panels, scale, offset, mip, eyes, pages, image_px, bias, panel_out, page_out, area_out):
    """Every (panel, page) that some pixel needs, for images on the display's surface.

    The pixels that draw a page have tolerances in an interval, so whether there is one is asked of the least and the
    largest tolerance over the part of the panel that the page covers.

    Returns the number of pairs; if it exceeds the room in the outputs, only those that fit were written.
    """
    seen = np.empty((len(eyes.tan_angle), 9))
    top = len(pages.columns) - 1
    count = 0
    for p in range(len(panels.origin_m)):
        eyes_on_panel(p, panels, eyes, seen)
        px, py = panels.pitch_m[p, 0], panels.pitch_m[p, 1]
        width, height = panels.size_px[p, 0], panels.size_px[p, 1]
        sx, sy, ox, oy = scale[p, 0], scale[p, 1], offset[p, 0], offset[p, 1]
        u0, u1 = max(sx * 0.5 + ox, 0.0), min(sx * (width - 0.5) + ox, image_px[0] - 1e-6)
        v0, v1 = max(sy * 0.5 + oy, 0.0), min(sy * (height - 0.5) + oy, image_px[1] - 1e-6)
        if u0 > u1 or v0 > v1:
            continue
        texels = max(abs(sx), abs(sy)) * 2.0**bias
        finest = min(max(mip[p] + bias, 0), top)
        low, high = rect_tolerance(0.5 * px, 0.5 * py, (width - 0.5) * px, (height - 0.5) * py, seen)
        low, high = low * texels, high * texels
        for level in range(finest, top + 1):
            if level < top and low >= 2.0 ** (level + 3):
                continue  # no page's tau exceeds 4 * 2 ** level
            if level > finest and pages.least[level] > 0.0 and high <= pages.least[level] * pages.begin:
                continue
            span = 256.0 * 2.0**level
            c0, c1 = int(u0 // span), min(int(u1 // span), pages.columns[level] - 1)
            r0, r1 = int(v0 // span), min(int(v1 // span), pages.rows[level] - 1)
            for r in range(r0, r1 + 1):
                # First and last pixel whose centre lies in the page (and in the image).
                j0 = max(0, math.ceil((max(r * span, 0.0) - oy) / sy - 0.5 - _EDGE_PX))
                j1 = min(height, math.ceil((min((r + 1) * span, image_px[1]) - oy) / sy - 0.5 + _EDGE_PX)) - 1
                if j0 > j1:
                    continue
                for c in range(c0, c1 + 1):
                    if not is_drawn(pages, level, c, r, finest, low, high):
                        continue
                    i0 = max(0, math.ceil((max(c * span, 0.0) - ox) / sx - 0.5 - _EDGE_PX))
                    i1 = min(width, math.ceil((min((c + 1) * span, image_px[0]) - ox) / sx - 0.5 + _EDGE_PX)) - 1
                    if i0 > i1:
                        continue
                    rect = ((i0 + 0.5) * px, (j0 + 0.5) * py, (i1 + 0.5) * px, (j1 + 0.5) * py)
                    if len(seen) and not _drawn_in(rect, pages, level, c, r, finest, texels, seen):
                        continue
                    if count < len(panel_out):
                        panel_out[count] = p
                        page_out[count] = pages.first[level] + r * pages.columns[level] + c
                        area_out[count] = (i1 - i0 + 1.0) * (j1 - j0 + 1.0)
                    count += 1
    return count
