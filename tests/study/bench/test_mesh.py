"""The benchmark of meshes: what a peer leaves alone scores 10, and what is folded is counted, measured and drawn."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from limen.data.mesh.opening import open_mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.samples.mesh import sample_mesh, torus_knot
from limen.layers.mesh.select import FoldTree
from limen.study.baselines import packages
from limen.study.bench import mesh as bench
from limen.study.bench.mesh_plot import mesh_picture
from limen.study.observer import missing_packages


def test_what_is_folded_uniformly_is_no_more_than_asked_and_as_near_as_its_displacements_say() -> None:
    knot = torus_knot(4000)
    foldable = FoldTree(build_vertex_tree(knot))
    far = []
    for most in (4000, 2500, 900):
        left = bench.folded_uniformly(knot, foldable, most)
        assert most - 4 <= left.size <= most
        assert (np.diff(np.sort(left.triangles, axis=1), axis=1) > 0).all()
        far.append(
            bench.surface_error(
                knot.positions.astype(float), knot.triangles, left.positions.astype(float), left.triangles
            )
        )
    assert far[0].rms < far[1].rms < far[2].rms


@pytest.mark.gpu
def test_every_row_is_a_figure_of_its_own_run(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    if missing_packages():
        pytest.skip(f"THE OBSERVER IS NOT INSTALLED: {missing_packages()}")
    sample_mesh(tmp_path / "knot.ply", 3000)
    knot = open_mesh(tmp_path / "knot.ply")
    monkeypatch.setattr(bench, "PEERS", {"idle": lambda mesh, most: mesh, "absent": lambda mesh, most: None})
    monkeypatch.setattr(packages, "MADE_BY", {"idle": "numpy", "absent": "no_such_package"})
    monkeypatch.setattr(bench, "_QUICK_VIEWS", 1)
    said: list[str] = []
    rows, seen = bench.compared(True, said.append, tmp_path / "knot.ply")
    assert any(text.startswith("absent: skipped, no_such_package") for text in said)
    value = {(row["what"].split(": ", 1)[1], row["peer"]): row["value"] for row in rows}
    most = int(0.43 * knot.size)
    drawn = f"{most:,} triangles, 1 views"
    assert value[(f"{drawn}: mean", "idle")] > 9.99 > value[(f"{drawn}: mean", "limen")] > 5
    assert (
        value[(f"{drawn}: silhouette that differs", "idle")]
        == 0
        < value[(f"{drawn}: silhouette that differs", "limen")]
    )
    assert value[(f"root mean square distance of {knot.size:,} triangles", "idle")] < 0.01
    assert all(rate > 0 for (what, _), rate in value.items() if "million" in what or "cut" in what)
    assert seen is not None
    picture = np.asarray(Picture.open(BytesIO(mesh_picture(seen, "png"))))
    assert picture[..., :3].std() > 20
