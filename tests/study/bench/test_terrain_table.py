"""The paper's second table, with plain numbers beside it."""

from __future__ import annotations

import math

import pytest

from limen.display.display import Display
from limen.display.grid import Grid, panels_of_grid
from limen.study.bench.terrain_table import PAPER, at_wall_centre, on_column_centre, table2_rows
from limen.viewing.panel_demands import panel_demands
from limen.viewing.policy import Policy

WALL = Display.preset("rostock")
ROWS = table2_rows(WALL)


def test_the_papers_wall_has_panels_of_27_inches():
    wide, high = WALL.panels[0].size_m
    assert WALL.panels[0].pitch_m == (0.000303, 0.000303)
    assert math.hypot(wide, high) / 0.0254 == pytest.approx(27, abs=0.05)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['distance_m']} m")
def test_the_smallest_errors_are_the_papers_within_a_tenth(row):
    assert row["min_error_px"] == pytest.approx(row["paper_min_error_px"], rel=0.10)
    assert row["min_error_px"] < row["max_error_px"]


def test_the_numbers_of_active_panels():
    assert (
        [row["distance_m"] for row in ROWS] == [row.distance_m for row in PAPER] == [3.0, 2.5, 2.0, 1.5, 1.0, 0.5, 0.2]
    )
    assert [row["active_panels"] for row in ROWS] == [24, 24, 24, 24, 24, 8, 4]
    assert [row["active_panels_exact"] for row in ROWS] == [24, 24, 24, 24, 24, 16, 4]


def test_one_row_by_hand():
    """At 1 m a middle is 0.1818 m above where the user looks: 10.3 degrees and 1.016 m, 1.32 arcminutes, 1.29 px."""
    theta = math.radians((1 + 20 * (1 - 1 / math.hypot(1, 0.1818))) / 60)
    assert ROWS[4]["min_error_px"] == pytest.approx(2 * math.hypot(1, 0.1818) * math.tan(theta / 2) / 0.000303)


def test_neither_of_the_two_users_alone_makes_the_table():
    """As the docstring says."""
    scheel = Policy("scheel")
    centre = panel_demands(WALL, [at_wall_centre(WALL, 0.5)], scheel, rule="middle").allowed_px.min()
    assert centre == pytest.approx(2.62, abs=0.01)
    aside = panel_demands(WALL, [on_column_centre(WALL, 0.5)], scheel, rule="middle")
    assert (aside.allowed_px < math.inf).sum() == 12


def test_neither_the_place_nor_the_turn_of_the_wall_matters():
    grid = {"size_px": (1920, 1200), "pitch_mm": 0.303, "columns": 6, "rows": 4}
    turned = Display("t", tuple(panels_of_grid(Grid(name="w", centre_m=(3, 1, 2), facing=(1, 0, 0), **grid), 0.0)))
    for here, there in zip(ROWS, table2_rows(turned), strict=True):
        assert here["min_error_px"] == pytest.approx(there["min_error_px"])
        assert here["active_panels_exact"] == there["active_panels_exact"]
