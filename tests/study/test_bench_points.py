"""The benchmark of points: every row is a figure of its own run."""

import numpy as np

from limen.data import sample_points
from limen.study import bench_points as bench


def test_rows_are_of_what_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "_QUICK_POINTS", 30_000)
    sample_points(tmp_path / "own.ply", 6000)
    said = []
    rows = bench.bench_points(True, said.append, tmp_path / "own.ply")
    assert {"QSplat: skipped, qsplat_make is not installed", "own.ply made ready"} <= set(said)
    assert all(np.isfinite(row.value) and row.value > 0 for row in rows)
    found = {row.what: row for row in rows}
    parts = [row.value for what, row in found.items() if what.startswith("build, normals given: ")]
    assert np.isclose(1e3 / sum(parts), found["build in memory, normals given"].value)
    assert found["own.ply: stored"].value * 6000 > 6000 * 8
    assert {row.peer for row in rows} == {"limen", "numpy argsort", "scipy cKDTree"}
    assert all(len(row.cells()) == len(row.columns) for row in rows)
