"""How far triangulations lie from the posts that they were made from: the one rasteriser that judges all of them.

A triangle is three post numbers, ``row * columns + column``; its corners have the heights of those posts.
"""

from __future__ import annotations

from typing import Any

from limen.compiled import compiled

__all__ = ["fan_out", "measure_residuals"]


@compiled(error_model="python")
def _span(at: Any, step: Any, first: Any, last: Any) -> Any:
    """Columns ``first ... last`` in which ``at + column * step >= 0``."""
    if step > 0:
        first = max(first, -(at // step))
    elif step < 0:
        last = min(last, at // -step)
    elif at < 0:
        last = first - 1
    return first, last


@compiled(error_model="python")
def measure_residuals(heights: Any, triangles: Any, residuals: Any) -> None:
    """Surface less height at every post that a triangle holds, its edges included; where several do, the worst.

    ``residuals`` (rows, columns) float32 keeps what it held where nothing is covered, and is to begin with NaN. Whether
    a post lies inside is decided in integers, and exactly.
    """
    columns = heights.shape[1]
    for number in range(triangles.shape[0]):
        a, b, c = triangles[number, 0], triangles[number, 1], triangles[number, 2]
        ax, ay, bx, by, cx, cy = a % columns, a // columns, b % columns, b // columns, c % columns, c // columns
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area < 0:
            bx, by, cx, cy, area = cx, cy, bx, by, -area
        if area == 0:
            continue
        height = float(heights[ay, ax])
        to_b, to_c = float(heights[by, bx]) - height, float(heights[cy, cx]) - height
        per_column = (to_b * (cy - ay) - to_c * (by - ay)) / area
        per_row = (to_c * (bx - ax) - to_b * (cx - ax)) / area
        for y in range(min(ay, by, cy), max(ay, by, cy) + 1):
            first, last = min(ax, bx, cx), max(ax, bx, cx)
            first, last = _span((bx - ax) * (y - ay) + (by - ay) * ax, ay - by, first, last)
            first, last = _span((cx - bx) * (y - by) + (cy - by) * bx, by - cy, first, last)
            first, last = _span((ax - cx) * (y - cy) + (ay - cy) * cx, cy - ay, first, last)
            for x in range(first, last + 1):
                residual = height + per_column * (x - ax) + per_row * (y - ay) - heights[y, x]
                if not abs(residual) <= abs(residuals[y, x]):
                    residuals[y, x] = residual


@compiled(error_model="python")
def fan_out(rims: Any, on_border: Any, triangles: Any) -> int:
    """Rims (apex, a, b) with all vertices that lie on their edges, as fans about their apexes; how many these are.

    Edges lie along rows or columns. ``on_border`` (rows, columns) is True at vertices on borders. What does not fit in
    ``triangles`` is counted only.
    """
    columns, count = on_border.shape[1], 0
    for number in range(rims.shape[0]):
        apex, a, b = rims[number, 0], rims[number, 1], rims[number, 2]
        step = columns if a % columns == b % columns else 1
        step = step if b > a else -step
        before = a
        while before != b:
            at = before + step
            while at != b and not on_border[at // columns, at % columns]:
                at += step
            if count < triangles.shape[0]:
                triangles[count, 0], triangles[count, 1], triangles[count, 2] = apex, before, at
            count += 1
            before = at
    return count
