"""What is seen through lenses at one place: the loop's twin of `limen.viewing.lens.source_of`, tested against it.

Rows and tables are those of `limen.viewing.lens.rows_of`.
"""

from __future__ import annotations

import math

from limen.compiled import compiled
from limen.viewing.lens import RIM, STEEP, TO_RIM

__all__ = ["seen_through", "smallest_reach"]


@compiled(error_model="python")
def _drop_off(distance, focus, how):
    u = min(max((distance - focus) / (1.0 - focus), 0.0), 1.0)
    if how == 0:
        return 1.0 - u
    if how == 1:
        return 0.5 + 0.5 * math.cos(math.pi * u)
    if how == 2:
        return 1.0 - 2.0 * u * u if u < 0.5 else 2.0 * (1.0 - u) ** 2
    return (math.exp(-STEEP * u * u) - RIM) / (1.0 - RIM)


@compiled(error_model="python")
def _cubic(t, tap):
    """The weight of the tap-th of four knots around a place that lies ``t`` behind the second."""
    if tap == 0:
        return (1.0 - t) ** 3 / 6.0
    if tap == 1:
        return (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
    if tap == 2:
        return (4.0 - 6.0 * (1.0 - t) ** 2 + 3.0 * (1.0 - t) ** 3) / 6.0
    return t * t * t / 6.0


@compiled(error_model="python")
def _of_table(row, tables, x, y):
    begin, columns, lines = int(row[8]), int(row[9]), int(row[10])
    at_x, at_y = (x + 1.0) / 2.0 * (columns - 1), (y + 1.0) / 2.0 * (lines - 1)
    first_x, first_y = math.floor(at_x), math.floor(at_y)
    total = 0.0
    for down in range(4):
        line = min(max(int(first_y) + down - 1, 0), lines - 1)
        across_line = 0.0
        for across in range(4):
            column = min(max(int(first_x) + across - 1, 0), columns - 1)
            across_line += _cubic(at_x - first_x, across) * tables[begin + line * columns + column]
        total += _cubic(at_y - first_y, down) * across_line
    return total * _drop_off(max(abs(x), abs(y)), TO_RIM, 1)


@compiled(error_model="python")
def seen_through(rows, tables, x, y):
    """The texel seen at a place of the display, through all lenses."""
    for k in range(rows.shape[0] - 1, -1, -1):
        row = rows[k]
        way_x, way_y = (x - row[0]) * row[2], (y - row[1]) * row[3]
        if max(abs(way_x), abs(way_y)) >= 1.0:
            continue
        if row[7] == 2.0:
            falls = _of_table(row, tables, way_x, way_y)
        elif row[7] == 1.0:
            falls = _drop_off(abs(way_x), row[5], row[6]) * _drop_off(abs(way_y), row[5], row[6])
        else:
            falls = _drop_off(math.hypot(way_x, way_y), row[5], row[6])
        x, y = x - row[4] * falls * (x - row[0]), y - row[4] * falls * (y - row[1])
    return x, y


@compiled(error_model="python")
def smallest_reach(rows, x0, y0, x1, y1):
    """The smallest radius of all lenses that reach into a rectangle of the display; infinite if none does."""
    smallest = math.inf
    for k in range(rows.shape[0]):
        across, down = 1.0 / rows[k, 2], 1.0 / rows[k, 3]
        if x0 < rows[k, 0] + across and x1 > rows[k, 0] - across and y0 < rows[k, 1] + down and y1 > rows[k, 1] - down:
            smallest = min(smallest, across, down)
    return smallest
