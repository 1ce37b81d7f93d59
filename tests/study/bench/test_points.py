"""The benchmark of points: every row is a figure of its own run."""

import numpy as np

from limen.data import sample_points
from limen.study.bench import points as bench


def test_rows_are_of_what_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "_QUICK_POINTS", 30_000)
    sample_points(tmp_path / "own.ply", 6000)
    said = []
    (table,) = bench.bench_points(True, said.append, tmp_path / "own.ply")
    assert {"QSplat: skipped, qsplat_make is not installed", "own.ply made ready"} <= set(said)
    assert all(np.isfinite(row["value"]) and row["value"] > 0 for row in table.rows)
    found = {row["what"]: row["value"] for row in table.rows}
    parts = [value for what, value in found.items() if what.startswith("build, normals given: ")]
    assert np.isclose(1e3 / sum(parts), found["build in memory, normals given"])
    assert found["own.ply: stored"] * 6000 > 6000 * 8
    assert {row["peer"] for row in table.rows} == {"limen", "numpy argsort", "scipy cKDTree"}
    assert all(len(cells) == len(table.headings) == 4 for cells in table.cells)
