"""Meshes as values: checked when made, deformed with normals computed anew."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from limen.data.mesh.mesh import smooth_normals, weld_numbers
from limen.errors import FormatError
from support.meshes import mesh_of


def plain_normals(positions: Any, triangles: Any, welds: Any) -> NDArray[np.float64]:
    """What the compiled loop must give, with NumPy's own sums."""
    a, b, c = (np.asarray(positions, np.float64)[triangles[:, corner]] for corner in range(3))
    total = np.zeros((len(positions), 3))
    for corner in range(3):
        np.add.at(total, welds[triangles[:, corner]], np.cross(b - a, c - a))
    total = total[welds]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
HALVES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


@given(
    arrays(np.float32, (9, 3), elements=st.integers(-8, 8).map(float)),
    arrays(np.uint32, (12, 3), elements=st.integers(0, 8)),
    arrays(np.uint32, 9, elements=st.integers(0, 3)),
)
@settings(max_examples=60, deadline=None)
def test_normals_equal_the_plain_ones(positions: Any, triangles: Any, welds: Any) -> None:
    found = smooth_normals(positions, triangles, welds)
    np.testing.assert_allclose(found, plain_normals(positions, triangles, welds), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)


@given(arrays(np.float32, (12, 2), elements=st.sampled_from([-1.0, -0.0, 0.0, 2.0])))
def test_welded_rows_are_those_that_are_equal(rows: Any) -> None:
    numbers = weld_numbers(rows)
    assert (rows[numbers] == rows).all()
    same = (rows[:, None] == rows[None]).all(axis=2)
    np.testing.assert_array_equal(same, numbers[:, None] == numbers[None])


def test_a_bent_square_gets_new_normals_and_shares_the_rest() -> None:
    flat = mesh_of(SQUARE, HALVES)
    turned = flat.deformed(SQUARE[:, [2, 0, 1]])
    np.testing.assert_allclose(turned.normals, [[1, 0, 0]] * 4, atol=1e-7)
    assert turned.colours is flat.colours
    assert turned.triangles is flat.triangles
    np.testing.assert_array_equal(flat.normals, [[0, 0, 1]] * 4)


def test_a_seam_stays_smooth_and_a_crease_stays_sharp() -> None:
    """Two faces of a box meet at vertices that exist twice: with one normal along a seam, with two along a crease."""
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 1, 0]], np.float32)
    faces = np.array([[0, 2, 1], [3, 5, 4]], np.uint32)
    half = np.sqrt(0.5)
    seam = mesh_of(places, faces, normals=[[half, half, 0]] * 6)
    np.testing.assert_allclose(seam.deformed(places).normals[[0, 2, 3, 4]], [[half, half, 0]] * 4, atol=1e-6)
    crease = mesh_of(places, faces, normals=[[0, 1, 0]] * 3 + [[1, 0, 0]] * 3)
    np.testing.assert_allclose(crease.deformed(places).normals, crease.normals, atol=1e-7)


def test_triangles_of_no_area_are_kept_and_do_no_harm() -> None:
    found = mesh_of(SQUARE, [[0, 1, 2], [3, 3, 3]]).deformed(SQUARE)
    assert found.size == 2
    np.testing.assert_array_equal(found.normals[3], [0, 0, 1])


def test_bounds_are_those_of_the_triangles() -> None:
    stray = np.concatenate([SQUARE, np.float32([[9, 9, 9]])])
    np.testing.assert_array_equal(mesh_of(stray, HALVES).bounds, [[0, 0, 0], [1, 1, 0]])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"positions": np.where(SQUARE == 1, np.nan, SQUARE)}, "3 of its 4 positions .* the first is vertex 1; repair"),
        ({"triangles": HALVES + 2}, "row 0 of its triangles names 4, but there are 4 vertices"),
        ({"triangles": np.zeros((0, 3))}, "no triangles: a point cloud"),
        ({"triangles": HALVES[:, :2]}, r"triangles must have the shape \(2, 3\), got \(2, 2\)"),
        ({"uv": np.zeros((3, 2))}, r"uv must have the shape \(4, 2\), got \(3, 2\)"),
        ({"layers": np.zeros(4)}, "row 0 of its layers names 0, but there are 0 textures"),
        ({"normals": np.ones((4, 3))}, "4 of its normals have no unit length, the first is 0"),
        (
            {"layers": [0, 0, 0, 1], "textures": np.zeros((2, 1, 1, 4))},
            "triangle 1 has corners of several textures",
        ),
    ],
)
def test_what_is_wrong_is_said(fields: dict[str, Any], message: str) -> None:
    good = mesh_of(SQUARE, HALVES)
    with pytest.raises(FormatError, match=f"^mesh: (it has )?{message}"):
        dataclasses.replace(good, **fields)


def test_a_deformation_must_fit() -> None:
    mesh = mesh_of(SQUARE, HALVES)
    with pytest.raises(FormatError, match=r"\(3, 3\) positions cannot move \(4, 3\)"):
        mesh.deformed(SQUARE[:3])
    with pytest.raises(FormatError, match="not finite"):
        mesh.deformed(np.where(SQUARE == 1, np.inf, SQUARE))
