"""The floor in front of a display: where a person can stand, and the way from one place to another.

Seen from above, x to the right and z downward (toward the viewer of a wall that faces +z).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import ConvexHull

from limen.errors import DisplayError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from limen.display.display import Display
    from limen.geometry import Floats

__all__ = ["CELLS", "Room", "Rows", "room_of"]

CELLS = (160, 100)
"""Cells of the heat map along the longer and the shorter side of the floor (the paper's)."""

BODY_M = 0.35
"""Nobody's eyes come closer to a wall than this: the body is in the way."""

_STEEP = 0.7  # a panel whose normal leans more than this up or down is a floor, a table or a ceiling
_FEW_ROWS = 64  # more walls than this, on an object, are taken for their outer edge
_STEP_M = 0.02  # a line of sight is tried every so often


class Rows(NamedTuple):
    """Panels seen from above: segments of wall with the side that they are seen from, and table tops."""

    start: Floats  # (W, 2)
    along: Floats  # (W, 2) unit
    length_m: Floats  # (W,)
    facing: Floats  # (W, 2) unit, toward the viewers
    tables: Floats  # (T, 2, 2): smallest and largest corner


@dataclass(frozen=True)
class Room:
    """Where people can be in front of a display.

    Parameters
    ----------
    low, high
        Corners of the floor's rectangle, (x, z) metres.
    rows
        The panels from above.
    around
        The display is looked at from outside, by people who walk around it.
    top_m
        Eyes are not imagined above this: the walls' upper edge, or 0.3 m above the highest table top.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    rows: Rows
    around: bool
    top_m: float

    @property
    def size_m(self) -> tuple[float, float]:
        return (self.high[0] - self.low[0], self.high[1] - self.low[1])

    @property
    def cells(self) -> tuple[int, int]:
        """Columns along x and rows along z of the heat map."""
        return CELLS if self.size_m[0] >= self.size_m[1] else (CELLS[1], CELLS[0])

    @cached_property
    def cell_centres_m(self) -> Floats:
        """(rows, columns, 2): x and z."""
        axes = [
            low + (np.arange(count) + 0.5) * size / count
            for low, size, count in zip(self.low, self.size_m, self.cells, strict=True)
        ]
        return np.stack(np.meshgrid(*axes), axis=-1)

    def wall_distance_m(self, places: Floats) -> tuple[Floats, Floats]:
        """Distance to the nearest wall and the unit vector toward it: (N, 2) to (N,) and (N, 2).

        Without walls (a floor alone) the distance is infinite and the vector zero.
        """
        distance = np.full(len(places), np.inf)
        toward = np.zeros((len(places), 2))
        for start, along, length in zip(self.rows.start, self.rows.along, self.rows.length_m, strict=True):
            step = start + np.clip((places - start) @ along, 0, length)[:, None] * along - places
            near = np.hypot(step[:, 0], step[:, 1])
            closer = near < distance
            distance[closer] = near[closer]
            toward[closer] = step[closer] / np.maximum(near[closer, None], 1e-9)
        return distance, toward

    def walkable(self, places: Floats) -> NDArray[np.bool_]:
        """Where a person can stand: on the floor, a body's depth from every panel, on its lit side.

        In a room that is in front of every wall; around a display that is looked at from outside, in front of
        at least one. Shapes: (N, 2) to (N,).
        """
        allowed = ((places >= self.low) & (places <= self.high)).all(axis=1)
        ahead = (places @ self.rows.facing.T) - (self.rows.start * self.rows.facing).sum(axis=1)
        if len(self.rows.start) and self.around:
            allowed &= (ahead > 0).any(axis=1) & (self.wall_distance_m(places)[0] >= BODY_M)
        else:
            allowed &= (ahead >= BODY_M - 1e-9).all(axis=1)
        for table_low, table_high in self.rows.tables:
            allowed &= ~((places > table_low - BODY_M) & (places < table_high + BODY_M)).all(axis=1)
        return np.asarray(allowed)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Cells that can be walked to from one another, (rows, columns): the largest connected part."""
        centres = self.cell_centres_m
        labels, count = ndimage.label(self.walkable(centres.reshape(-1, 2)).reshape(centres.shape[:2]))
        if not count:
            return np.zeros(labels.shape, dtype=bool)
        return np.asarray(labels == 1 + np.bincount(labels.ravel())[1:].argmax())

    def nearest_cell(self, place: Floats) -> Floats:
        """Centre of the walkable cell closest to a place, (2,)."""
        centres = self.cell_centres_m[self.mask]
        return np.asarray(centres[((centres - place) ** 2).sum(axis=1).argmin()])

    def sees(self, start: Floats, end: Floats) -> bool:
        """Whether one can walk straight from one place to the other."""
        count = 2 + int(np.linalg.norm(end - start) / _STEP_M)
        return bool(self.walkable(start + np.linspace(0, 1, count)[:, None] * (end - start)).all())

    def way(self, start: Floats, end: Floats) -> Floats:
        """Corners of a short walk between two walkable cells' centres, both included, (N, 2).

        A straight line where nothing is in the way (always, in a convex room); else the shortest way over the
        cells, pulled tight.
        """
        if self.sees(start, end):
            return np.stack([start, end])
        cells = self._way_over_cells(start, end)
        corners = [cells[0]]
        at = 0
        while at < len(cells) - 1:
            ahead = (i for i in range(len(cells) - 1, at + 1, -1) if self.sees(cells[at], cells[i]))
            at = next(ahead, at + 1)
            corners.append(cells[at])
        return np.stack(corners)

    def _way_over_cells(self, start: Floats, end: Floats) -> Floats:
        centres = self.cell_centres_m[self.mask]
        first, last = (int(((centres - place) ** 2).sum(axis=1).argmin()) for place in (start, end))
        before = dijkstra(self._neighbours, directed=False, indices=[first], return_predecessors=True)[1][0]
        way = [last]
        while way[-1] != first:
            way.append(int(before[way[-1]]))
        return np.asarray(centres[way[::-1]])

    @cached_property
    def _neighbours(self) -> csr_array[np.float64]:
        """Lengths of the steps between walkable cells that touch."""
        number = np.full(self.mask.shape, -1)
        number[self.mask] = np.arange(self.mask.sum())
        wide, deep = (size / count for size, count in zip(self.size_m, self.cells, strict=True))
        columns, rows = self.cells
        edges: list[tuple[Floats, NDArray[np.int64], NDArray[np.int64]]] = []
        for right, down in ((1, 0), (0, 1), (1, 1), (-1, 1)):
            left = slice(max(0, -right), columns - max(0, right))
            a = number[: rows - down, left]
            b = number[down:, left.start + right : left.stop + right]
            both = (a >= 0) & (b >= 0)
            length = math.hypot(right * wide, down * deep)
            edges.append((np.full(int(both.sum()), length), a[both], b[both]))
        lengths, tails, heads = (np.concatenate(parts) for parts in zip(*edges, strict=True))
        count = int(self.mask.sum())
        return csr_array((lengths, (tails, heads)), shape=(count, count))


def room_of(display: Display) -> Room:
    """The floor that a display encloses or faces, or the floor around it.

    A closed or open room of walls is the floor in front of all of them. A single wall, or walls that face one
    way, is seen from a floor as deep as the display is wide, at least 2.5 m and at most 6 m. Where no place is
    in front of all walls, the display is looked at from outside: the floor around it, 2 m wide.

    Raises
    ------
    DisplayError
        If a person can stand nowhere: the walls leave no room.
    """
    rows = _rows(display)
    footprint = np.concatenate([panel.outline_m[:, [0, 2]] for panel in display.panels])
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    top_m = _top_m(display)
    facing = (rows.facing * rows.length_m[:, None]).sum(axis=0)
    open_side = not len(rows.start) or np.linalg.norm(facing) > 0.2 * rows.length_m.sum()
    low, high = (low - 0.5, high + 0.5) if open_side else (low, high)
    if open_side and len(rows.start):
        forward = facing / np.linalg.norm(facing)
        span = np.ptp(footprint @ forward)
        depth = max(0.0, float(np.clip(np.ptp(footprint, axis=0).max(), 2.5, 6.0) - span))
        low, high = np.minimum(low, low + depth * forward), np.maximum(high, high + depth * forward)
    inside = _room(low, high, rows, False, top_m)
    if _area_m2(inside) >= 0.5:
        return inside
    around = _room(footprint.min(axis=0) - 2.0, footprint.max(axis=0) + 2.0, _outer(rows, footprint), True, top_m)
    if _area_m2(around) < 0.5:
        raise DisplayError(f"display '{display.name}': there is no floor to stand on in front of its panels")
    return around


def _outer(rows: Rows, footprint: Floats) -> Rows:
    """Of many panels, the edges of the convex hull that a person walks around: a sphere has hundreds in its inside."""
    if len(rows.start) <= _FEW_ROWS:
        return rows
    hull = np.unique(footprint.round(3), axis=0)
    corners = hull[ConvexHull(hull).vertices]  # counter-clockwise in (x, z)
    steps = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(steps, axis=1)
    along = steps / length[:, None]
    facing = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return Rows(corners, along, length, facing, np.zeros((0, 2, 2)))  # what lies inside of it is not walked on anyway


def _top_m(display: Display) -> float:
    walls = [float(panel.corners_m[:, 1].max()) for panel in display.panels if abs(panel.normal[1]) <= _STEEP]
    tables = [float(panel.centre_m[1]) + 0.3 for panel in display.panels if panel.normal[1] > _STEEP]
    return max(walls + tables) if walls else math.inf


def _room(low: Floats, high: Floats, rows: Rows, around: bool, top_m: float) -> Room:
    return Room((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), rows, around, top_m)


def _area_m2(room: Room) -> float:
    cell = room.size_m[0] * room.size_m[1] / (CELLS[0] * CELLS[1])
    return float(room.mask.sum()) * cell


def _rows(display: Display) -> Rows:
    segments: dict[tuple[float, ...], None] = {}  # panels above one another are one segment
    tables: list[Floats] = []
    for panel in display.panels:
        corners, normal = panel.corners_m[:, [0, 2]], np.array(panel.normal)
        if abs(normal[1]) <= _STEEP:
            facing = normal[[0, 2]] / np.hypot(normal[0], normal[2])
            along = np.array([-facing[1], facing[0]])
            reach = corners @ along
            # The foot of a leaning panel is its part that reaches farthest into the room.
            start = along * reach.min() + facing * (corners @ facing).max()
            key = (*start, *along, np.ptp(reach), *facing)
            segments.setdefault(tuple(round(float(value), 6) + 0.0 for value in key))
        elif normal[1] > 0 and 0.3 < panel.centre_m[1] < 2.0:
            tables.append(np.stack([corners.min(axis=0), corners.max(axis=0)]))
    values = np.array(list(segments), dtype=float).reshape(-1, 7)
    table_array = np.array(tables, dtype=float).reshape(-1, 2, 2)
    return Rows(values[:, :2], values[:, 2:4], values[:, 4], values[:, 5:], table_array)
