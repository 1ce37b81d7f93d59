"""Boards of markers, one a panel: which marker lies where, and what the panel shows.

Everything follows from the display alone, so whoever has the display file knows the boards, and no file goes with
the pictures.

References
----------
Olson 2011, *AprilTag: A robust and flexible visual fiducial system*, ICRA (the family 36h11: 587 markers that stay
unlike each other when turned, or with up to 5 of 36 bits wrong).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from limen.calibrate.opencv import load
from limen.display.display import Display
from limen.display.panel import Panel
from limen.errors import DisplayError
from limen.geometry import Floats

__all__ = [
    "CELL_MODULES",
    "MARKERS",
    "MOST_PER_PANEL",
    "Board",
    "boards_of",
    "boards_of_part",
    "dictionary",
    "draw_board",
]

MARKERS = 587
"""Markers of the family 36h11: at least one for each panel."""

MOST_PER_PANEL = 12
"""More would be smaller, and so be lost in photographs from farther away, for little more precision."""

_MARKER_MODULES = 8
_QUIET_MODULES = 1
CELL_MODULES = _MARKER_MODULES + 2 * _QUIET_MODULES
"""Side of a marker with its white rim, in modules (the squares that carry a bit each)."""


@dataclass(frozen=True, slots=True)
class Board:
    """The markers of one panel: ``columns`` x ``rows`` of them, ids counting along rows.

    Parameters
    ----------
    panel
        Name of the panel that shows it.
    first_id
        Id of the marker at the top left.
    columns, rows
        How many markers.
    origin_px
        Where the top left corner of the first cell lies on the panel's pixel grid.
    module_px
        Side of a module in pixels of the panel, a whole number.
    """

    panel: str
    first_id: int
    columns: int
    rows: int
    origin_px: tuple[int, int]
    module_px: int

    @property
    def ids(self) -> range:
        return range(self.first_id, self.first_id + self.columns * self.rows)

    @property
    def corners_px(self) -> Floats:
        """Top left, top right, bottom right, bottom left of each marker on the pixel grid: shape (markers, 4, 2)."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        start = np.stack([column, row], axis=1) * CELL_MODULES + _QUIET_MODULES
        square = _MARKER_MODULES * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return np.asarray(np.array(self.origin_px) + self.module_px * (start[:, None, :] + square), dtype=float)


def boards_of(display: Display) -> tuple[Board, ...]:
    """A board for each panel, in the order of the panels, as large as fits inside its lit outline.

    Raises
    ------
    DisplayError
        If there are more panels than markers, or a panel is too small for a marker.
    """
    panels = display.panels
    if len(panels) > MARKERS:
        raise DisplayError(
            f"display '{display.name}' has {len(panels)} panels and there are {MARKERS} markers: "
            "calibrate it in parts that overlap, with --panels"
        )
    most = min(MOST_PER_PANEL, MARKERS // len(panels))
    boards: list[Board] = []
    for panel in panels:
        first_id = boards[-1].ids.stop if boards else 0
        columns, rows, left, top, cell = _arrangement(panel.size_px, panel.outline_px, most)
        module = int(cell / CELL_MODULES + 1e-6)
        if module < 1:
            raise DisplayError(
                f"panel '{panel.name}' of {panel.size_px[0]} x {panel.size_px[1]} px is too small for a marker of "
                f"{CELL_MODULES} px inside its outline: leave it out with --panels"
            )
        # What is left of the room after rounding to whole pixels goes to all sides.
        spare = (cell - module * CELL_MODULES) / 2
        origin = (round(left + columns * spare), round(top + rows * spare))
        boards.append(Board(panel.name, first_id, columns, rows, origin, module))
    return tuple(boards)


def boards_of_part(display: Display, part: Display) -> tuple[Board, ...]:
    """Boards of some of a display's panels: those of the whole display, or of the part alone if it is too large.

    So a display of up to 587 panels has one set of boards, whichever panels are asked for.

    Raises
    ------
    DisplayError
        See `boards_of`.
    """
    if len(display.panels) > MARKERS:
        return boards_of(part)
    by_name = {board.panel: board for board in boards_of(display)}
    return tuple(by_name[panel.name] for panel in part.panels)


@lru_cache(maxsize=1024)
def _arrangement(
    size_px: tuple[int, int], outline_px: tuple[tuple[float, float], ...], most: int
) -> tuple[int, int, float, float, float]:
    """Columns, rows, left, top and side of the square cells that cover the largest area of a convex outline.

    A rectangle lies inside a convex polygon if, for each edge, the corner that is farthest out does; so the largest
    one of given shape is a linear program in its place and its size. Ties go to more markers.
    """
    edges, limits = _half_planes(size_px, outline_px)
    outward = edges > 0
    best, best_area = (1, 1, 0.0, 0.0, 0.0), (-1.0, 0)
    for columns in range(1, most + 1):
        for rows in range(1, most // columns + 1):
            reach = (edges * outward) @ np.array([columns, rows])
            found = linprog([0, 0, -1], A_ub=np.column_stack([edges, reach]), b_ub=limits, bounds=[(0, None)] * 3)
            if found.x is None:  # an outline of a pixel or two holds nothing
                continue
            left, top, cell = np.asarray(found.x, dtype=float).tolist()
            area = (round(columns * rows * cell**2 / (size_px[0] * size_px[1]), 6), columns * rows)
            if area > best_area:
                best, best_area = (columns, rows, left, top, cell), area
    return best


def _half_planes(size_px: tuple[int, int], outline_px: tuple[tuple[float, float], ...]) -> tuple[Floats, Floats]:
    """Unit vectors (E, 2) and limits (E,) so that inside means ``edges @ position <= limits``: outline and grid."""
    width, height = size_px
    edges = np.array([[-1.0, 0], [1, 0], [0, -1], [0, 1]])
    limits = np.array([0.0, width, 0, height])
    if outline_px:
        corners = np.array(outline_px, dtype=float)
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        inward = np.sign(((corners.mean(axis=0) - corners) * normals).sum(axis=1, keepdims=True))
        normals = -inward * normals
        edges = np.concatenate([edges, normals])
        # Boards begin at whole pixels, so an edge must keep away by what rounding moves them.
        rounding = np.abs(normals).sum(axis=1) / 2
        limits = np.concatenate([limits, (normals * corners).sum(axis=1) - rounding])
    return edges, limits


def draw_board(board: Board, panel: Panel) -> NDArray[np.uint8]:
    """What the panel shows: uint8 (height, width, 3), black markers on white, at the panel's own pixels."""
    picture = np.full((panel.size_px[1], panel.size_px[0]), 255, dtype=np.uint8)
    side = _MARKER_MODULES * board.module_px
    for marker, corners in zip(board.ids, board.corners_px, strict=True):
        left, top = (int(value) for value in corners[0])
        picture[top : top + side, left : left + side] = np.kron(
            _bits(marker), np.ones((board.module_px, board.module_px), dtype=np.uint8)
        )
    return np.repeat(picture[:, :, None], 3, axis=2)


def dictionary() -> object:
    """OpenCV's table of the family 36h11."""
    cv2 = load()
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def _bits(marker: int) -> NDArray[np.uint8]:
    """The modules of one marker, 0 or 255, its black rim included: (8, 8)."""
    return np.asarray(load().aruco.generateImageMarker(dictionary(), marker, _MARKER_MODULES), dtype=np.uint8)
