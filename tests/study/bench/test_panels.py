"""The benchmark of panels on points small enough for a test."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from limen.study.bench import panels as bench_panels
from limen.study.bench.panels import Budget, Point, aims, measure, points
from limen.study.bench.panels_displays import DISPLAYS, stage
from limen.study.bench.panels_plot import panels_picture
from limen.study.bench.table import Row

pytestmark = pytest.mark.drawing

METHODS = ("limen", "paper", "hierarchy", "per-panel")


@pytest.mark.parametrize(("name", "panels"), [("icosahedron", 20), ("120", 120), ("icosphere", 1_280)])
def test_a_stage_has_a_quilt_of_about_the_size_asked_for(name: str, panels: int) -> None:
    scenery = stage(name, 1_000_000)
    assert len(scenery.windows.quilt.panels) == panels
    assert math.prod(scenery.windows.quilt.size_px) == pytest.approx(1_000_000, rel=0.5)
    eyes = np.concatenate(list(scenery.eyes_m(6)))
    assert np.linalg.norm(eyes, axis=1) == pytest.approx(scenery.eye_m)
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).min() > 0.2
    assert scenery.scene_m < scenery.eye_m / 2


def test_the_points_are_the_papers() -> None:
    full = points(quick=False)
    assert {point.figure for point in full} == {18, 20, 21}
    shown = [point for point in full if point.figure == 18]
    assert {point.display for point in shown} == set(DISPLAYS)
    assert {point.triangles for point in shown} == {69_716}
    assert all(point.methods == METHODS for point in shown)
    assert sorted({p.quilt_px for p in full if p.figure == 20}) == [2**18, 2**20, 2**22, 2**24, 2**26]
    assert {6_000, 871_000} <= {point.triangles for point in full if point.figure == 21}
    assert len(points(quick=True)) < len(full)


@pytest.mark.gpu
def test_a_point_is_measured_every_way(device: Any) -> None:
    point = Point(18, "120", 1_000, 200_000, METHODS)
    rows, parts = measure(device, point, frames=2, budget=Budget(30.0))
    assert [row["method"] for row in rows] == list(METHODS)
    for row in rows:
        assert (row["panels"], row["frames"], row["note"]) == (120, 2, "")
        assert 0 < row["sort_ms"] < row["frame_ms"]
        assert row["draw_ms"] == pytest.approx(row["frame_ms"] - row["sort_ms"], rel=0.5)
        assert 0 < row["sort_cpu_ms"] < row["frame_cpu_ms"]
    pairs = {row["method"]: row["pairs"] for row in rows}
    assert 0 < pairs["paper"] <= pairs["limen"] < pairs["hierarchy"] < pairs["per-panel"]
    assert {row["method"] for row in parts} == {"limen", "paper"}
    paper = {row["part"]: row["ms"] for row in parts if row["method"] == "paper"}
    assert list(paper) == [
        "processor", "first pass", "second pass", "split and warp", "drawing", "depth by fragments",
    ]  # fmt: skip
    assert paper["second pass"] > 0


@pytest.mark.gpu
def test_what_would_take_too_long_is_not_begun_and_says_so(device: Any) -> None:
    budget = Budget(1.0, {"paper": 1.0})
    point = Point(20, "icosahedron", 500, 100_000, ("limen", "paper"))
    (limen, paper), parts = measure(device, point, frames=1, budget=budget)
    assert limen["frame_ms"] is not None
    assert (paper.get("frame_ms"), paper["frames"]) == (None, 0)
    assert paper["note"].startswith("not measured: a frame would take about")
    assert budget.predicted_s("limen", 20, limen["triangles"]) == pytest.approx(limen["frame_ms"] / 1e3)
    assert parts == []


def row(method: str, sort: float, frame: float, display: str = "icosphere") -> Row:
    return {
        "figure": 18, "display": display, "panels": 1_280, "triangles": 1, "quilt_px": 1 << 20, "method": method,
        "sort_ms": sort, "draw_ms": frame - sort, "frame_ms": frame, "sort_cpu_ms": sort, "frame_cpu_ms": frame,
        "frames": 1,
    }  # fmt: skip


def test_aims_are_ratios_of_the_rows() -> None:
    rows = [row("limen", 10, 50), row("limen", 30, 60, "knot"), row("paper", 80, 110), row("per-panel", 1, 500)]
    share, sorting, frame = aims(rows)
    assert "20% to 50%" in share
    assert "8.0 (aim: at least 5)" in sorting
    assert "10.0 (aim: at least 8)" in frame
    assert aims([]) == []
    # On a graphics adapter there is the clock alone.
    by_clock = [{**one, "sort_cpu_ms": None, "frame_cpu_ms": None} for one in rows]
    assert aims(by_clock) == aims(rows)


def test_the_picture_shows_what_was_measured() -> None:
    rows = [row("limen", 10, 50), row("limen", 30, 60, "knot"), row("paper", 80, 110)]
    pictures = [
        panels_picture(rows, [{**one, "part": part, "ms": ms} for one in rows for part, ms in parts.items()], "png")
        for parts in [{"first pass": 3.0, "drawing": drawing} for drawing in (40.0, 40.0, 20.0)]
    ]
    assert pictures[0] == pictures[1] != pictures[2]


@pytest.mark.gpu
def test_the_command(monkeypatch: Any, capsys: Any) -> None:
    from limen.cli.app import main

    monkeypatch.setattr(bench_panels, "points", lambda quick: [Point(20, "icosahedron", 300, 60_000, METHODS[:1])])
    with pytest.raises(SystemExit) as ended:
        main(["bench", "panels", "--quick", "--json"])
    assert ended.value.code in (0, None)
    out, err = capsys.readouterr()
    report = msgspec.json.decode(out)
    assert [found["method"] for found in report["rows"]] == ["limen"]
    assert {"panels", "triangles", "quilt_px", "method", "sort_ms", "draw_ms", "frame_ms"} <= set(report["rows"][0])
    assert "on " in err
    assert "aim" in err
