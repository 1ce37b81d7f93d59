"""Boards: inside the outline, of whole pixels, every marker once, and readable."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import limen
from limen.calibrate.boards import CELL_MODULES, MARKERS, MOST_PER_PANEL, boards_of, draw_board
from limen.display.panel import Panel
from limen.errors import DisplayError
from support import photographs

pytest.importorskip("cv2")


def panel_of(size_px, outline_px=(), name="p"):
    return Panel(name, size_px, (0, 0, 0), (1, 0, 0), (0, -1, 0), (0.001, 0.001), outline_px=outline_px)


def regular(corners, centre, radius, start):
    angles = start + 2 * np.pi * np.arange(corners) / corners
    return tuple((float(centre[0] + radius * np.cos(a)), float(centre[1] + radius * np.sin(a))) for a in angles)


def inside(places, outline_px):
    corners = np.array(outline_px)
    along = np.roll(corners, -1, axis=0) - corners
    turn = along[:, 0, None] * (places[:, 1] - corners[:, 1, None]) - along[:, 1, None] * (
        places[:, 0] - corners[:, 0, None]
    )
    return (turn >= -1e-6).all() or (turn <= 1e-6).all()


def cell_corners(board):
    rim = board.module_px
    span = np.array([board.columns, board.rows]) * CELL_MODULES * rim
    return np.array(board.origin_px) + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * span


@settings(max_examples=12, deadline=None)
@example(3, 1.8125, 348.0)
@given(st.integers(3, 8), st.floats(0, 6.3), st.floats(250, 480))
def test_a_board_lies_inside_any_convex_outline_and_is_large(corners, start, radius):
    outline = regular(corners, (500, 500), radius, start)
    (board,) = boards_of(limen.Display("d", (panel_of((1000, 1000), outline),)))
    cells = cell_corners(board)
    assert inside(cells, outline)
    area = np.prod(cells[2] - cells[0])
    x, y = np.array(outline).T
    whole = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    # The largest rectangle in a triangle is half of it; upright, it may be less, and modules are whole pixels.
    assert area > 0.28 * whole


@pytest.mark.parametrize(("size_px", "covered"), [((1024, 1024), 0.95), ((1920, 1080), 0.85), ((2560, 1600), 0.85)])
def test_a_board_covers_most_of_a_rectangle(size_px, covered):
    (board,) = boards_of(limen.Display("d", (panel_of(size_px),)))
    cells = cell_corners(board)
    assert (cells >= 0).all()
    assert (cells <= size_px).all()
    assert np.prod(cells[2] - cells[0]) > covered * np.prod(size_px)
    assert 4 <= len(board.ids) <= MOST_PER_PANEL


def test_every_marker_belongs_to_one_panel():
    boards = boards_of(limen.Display.preset("reality-deck"))
    ids = [marker for board in boards for marker in board.ids]
    assert ids == list(range(len(ids)))
    assert len(ids) <= MARKERS
    assert len(boards) == 416


def test_too_many_panels_are_refused_with_a_way_out():
    panels = tuple(panel_of((100, 100), name=f"p{n}") for n in range(MARKERS + 1))
    with pytest.raises(DisplayError, match="--panels"):
        boards_of(limen.Display("d", panels))
    assert len(boards_of(limen.Display("d", panels[:MARKERS]))) == MARKERS


@pytest.mark.parametrize("outline_px", [(), regular(5, (4, 4), 1.0, 0.0)])
def test_a_panel_smaller_than_a_marker_is_refused_by_name(outline_px):
    with pytest.raises(DisplayError, match="'small'"):
        boards_of(limen.Display("d", (panel_of((9, 500), outline_px, name="small"),)))


@pytest.mark.parametrize("display", [photographs.wall(), photographs.triangle()], ids=lambda d: d.name)
def test_what_is_drawn_is_found_where_it_was_drawn(display):
    from limen.calibrate.detect import detect

    for board, panel in zip(boards_of(display), display.panels, strict=True):
        picture = np.pad(draw_board(board, panel)[..., 0], 8, constant_values=255)
        ids, corners_px = detect(picture)
        order = np.argsort(ids)
        assert ids[order].tolist() == list(board.ids)
        # The first pixel's centre is (0, 0) to the detector, its corner is (0, 0) to the panel.
        assert corners_px[order] == pytest.approx(board.corners_px + 8 - 0.5, abs=0.02)
