"""The sample mesh: closed, of the size asked for, the same on every run, and readable by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.mesh.opening import open_mesh
from limen.data.samples.mesh import KNOT_TRIANGLES, ripple, sample_mesh, torus_knot
from limen.errors import InputError


def solid(mesh: object) -> trimesh.Trimesh:
    """With vertices at one place merged, as a check for holes wants them."""
    return trimesh.Trimesh(mesh.positions, mesh.triangles, process=True)  # type: ignore[attr-defined]


def test_the_default_has_the_size_of_the_literature() -> None:
    assert torus_knot().size == KNOT_TRIANGLES == 69_716


@given(st.integers(300, 20_000), st.integers(0, 1000), st.booleans())
@settings(max_examples=12, deadline=None)
def test_a_knot_is_closed_faces_outward_and_is_about_as_large_as_asked(size: int, seed: int, textured: bool) -> None:
    knot = torus_knot(size, seed, textured=textured)
    assert abs(knot.size / size - 1) < 0.1
    body = solid(knot)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume > 0
    assert body.euler_number == 0  # of a torus, however knotted
    assert np.linalg.norm(knot.positions, axis=1).max() == pytest.approx(1, abs=1e-6)


def test_colours_tell_places_and_seeds_tell_knots() -> None:
    knot = torus_knot(6000)
    for axis in range(3):
        assert np.corrcoef(knot.colours[:, axis], knot.positions[:, axis])[0, 1] > 0.7
    assert np.abs(torus_knot(6000, 1).positions - knot.positions).max() > 0.01


@pytest.mark.parametrize("name", ["a.ply", "a.glb"])
def test_what_is_written_is_read_back_and_is_the_same_twice(tmp_path: Path, name: str) -> None:
    report = sample_mesh(tmp_path / name, 2000, seed=3)
    sample_mesh(tmp_path / f"again-{name}", 2000, seed=3)
    assert (tmp_path / name).read_bytes() == (tmp_path / f"again-{name}").read_bytes()
    found, made = open_mesh(tmp_path / name), torus_knot(2000, 3, textured=name == "a.glb")
    assert (report.size, report.facts["vertices"]) == (found.size, len(found.positions))
    assert report.bytes == (tmp_path / name).stat().st_size
    for field in ("positions", "normals", "uv"):
        np.testing.assert_allclose(getattr(found, field), getattr(made, field), atol=1e-6)
    for field in ("triangles", "colours", "layers", "textures"):
        np.testing.assert_array_equal(getattr(found, field), getattr(made, field))


@given(st.floats(0, 10))
@settings(max_examples=10, deadline=None)
def test_a_ripple_moves_but_opens_nothing(time_s: float) -> None:
    rest = torus_knot(2000, textured=True)
    moved = ripple(rest, time_s, amplitude=0.05)
    shift = np.linalg.norm(moved.positions - rest.positions, axis=1)
    radius = np.linalg.norm(rest.bounds[1] - rest.bounds[0]) / 2
    assert 0.01 * radius < shift.max() <= 0.05 * radius * 1.001
    assert solid(moved).is_watertight
    np.testing.assert_allclose(ripple(rest, time_s + 2.0, amplitude=0.05).positions, moved.positions, atol=1e-4)


def test_what_cannot_be_made_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.ply or \.glb"):
        sample_mesh(tmp_path / "a.obj")
    with pytest.raises(InputError, match="48 to 20,000,000 triangles, not 3"):
        sample_mesh(tmp_path / "a.ply", 3)
    with pytest.raises(InputError, match="seed -1"):
        sample_mesh(tmp_path / "a.ply", seed=-1)
    assert not list(tmp_path.iterdir())
