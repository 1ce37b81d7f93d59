"""The displays that limen makes itself: as many panels as in the literature, flat, closed, seen from outside."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import limen
from limen.display.mesh import PolygonMesh, panels_of_mesh
from limen.display.packing import pack_outlines
from limen.display.shapes import SHAPES, desk, knot, shape, sphere, spring
from limen.display.teapot import teapot
from limen.errors import DisplayError
from limen.geometry import signed_area

COUNTS = {
    "icosahedron": 20, "120": 120, "cylinder": 216, "desk": 816, "sphere-840": 840, "spring": 902, "teapot": 1024,
    "knot": 1200, "sphere": 1620, "cube": 5,
}  # fmt: skip


def _fan(mesh: PolygonMesh) -> np.ndarray:
    """Triangles that make up the faces, shape (N, 3, 3)."""
    return np.array([
        mesh.corners[[face[0], face[k], face[k + 1]]] for face in mesh.faces for k in range(1, len(face) - 1)
    ])  # fmt: skip


def _volume(mesh: PolygonMesh) -> float:
    return float(np.linalg.det(_fan(mesh)).sum() / 6)


def _area(mesh: PolygonMesh) -> float:
    a, b, c = _fan(mesh).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _edges(mesh: PolygonMesh) -> Counter[tuple[int, int]]:
    return Counter((a, b) for face in mesh.faces for a, b in zip(face, face[1:] + face[:1], strict=True))


def _off_plane(mesh: PolygonMesh) -> float:
    worst = 0.0
    for face in mesh.faces:
        corners = mesh.corners[list(face)] - mesh.corners[list(face)].mean(axis=0)
        worst = max(worst, float(np.linalg.svd(corners)[1][2] / np.linalg.norm(corners)))
    return worst


@pytest.mark.parametrize("name", COUNTS)
def test_presets_have_the_literatures_panels_for_a_person_to_walk_around(name: str) -> None:
    display = limen.Display.preset(name)
    assert len(display.panels) == COUNTS[name]
    low, high = display.bounds_m
    assert 0.3 <= np.ptp(display.bounds_m, axis=0).max() <= 1.61
    assert 0.5 < low[1] < high[1] < 1.9
    (quilt,) = pack_outlines(display, max_size_px=8192, max_px=2**26)
    assert len(quilt.panels) == len(display.panels)
    assert min(abs(signed_area(panel.lit_outline_px)) for panel in display.panels) > 50, "pixels of the smallest"


@pytest.mark.parametrize("name", SHAPES)
def test_panels_are_exactly_flat_and_none_was_split(name: str) -> None:
    mesh = shape(name)
    assert _off_plane(mesh) < 1e-10
    panels = panels_of_mesh(mesh, "p", 0.001)
    assert [panel.name for panel in panels] == [f"p/{k}" for k in range(len(mesh.faces))]
    lit = sum(signed_area(panel.lit_outline_px) for panel in panels) * 1e-6
    assert lit == pytest.approx(_area(mesh), rel=1e-9)


@pytest.mark.parametrize("name", ["icosahedron", "disdyakis-triacontahedron", "sphere", "spring", "knot"])
def test_closed_shapes_are_closed_and_inside_out(name: str) -> None:
    mesh = shape(name)
    edges = _edges(mesh)
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges), "every edge is shared by two faces that run along it both ways"
    assert _volume(mesh) > 0


def test_solids_have_the_size_that_geometry_says() -> None:
    icosahedron = shape("icosahedron", radius_m=1)
    edge = 1 / math.sin(2 * math.pi / 5)
    assert _area(icosahedron) == pytest.approx(5 * math.sqrt(3) * edge**2)
    solid = shape("disdyakis-triacontahedron", radius_m=1)
    normals = [np.cross(b - a, c - a) for a, b, c in _fan(solid)]
    heights = [float(n @ t[0] / np.linalg.norm(n)) for n, t in zip(normals, _fan(solid), strict=True)]
    assert np.ptp(heights) < 1e-12, "all faces touch one sphere"
    assert np.ptp([np.linalg.norm(n) for n in normals]) < 1e-12, "and are equal"
    assert np.linalg.norm(solid.corners, axis=1).max() == pytest.approx(1)
    assert len({round(float(np.linalg.norm(corner)), 9) for corner in solid.corners}) == 3


@given(st.integers(3, 40), st.integers(2, 30))
@settings(max_examples=25)
def test_a_sphere_of_any_mesh_has_corners_on_it_and_approaches_it(columns: int, rows: int) -> None:
    mesh = sphere(radius_m=1.0, columns=columns, rows=rows)
    assert len(mesh.faces) == columns * rows
    np.testing.assert_allclose(np.linalg.norm(mesh.corners, axis=1), 1, atol=1e-12)
    assert _off_plane(mesh) < 1e-10
    # Frustums between two parallels: the exact area of the polyhedron, from slant heights.
    radii = np.cos(np.linspace(-math.pi / 2, math.pi / 2, rows + 1))
    widths = 2 * radii * math.sin(math.pi / columns)
    drop = np.diff(np.sin(np.linspace(-math.pi / 2, math.pi / 2, rows + 1)))
    slant = np.hypot(np.diff(radii) * math.cos(math.pi / columns), drop)
    assert _area(mesh) == pytest.approx(float(columns * ((widths[:-1] + widths[1:]) / 2 * slant).sum()))


def test_a_desk_faces_its_user() -> None:
    eye = np.array([0, 0.5, 0])
    for panel in panels_of_mesh(desk(), "d", 0.001):
        assert float((eye - panel.outline_m.mean(axis=0)) @ panel.normal) > 0


@given(st.integers(3, 9), st.integers(120, 200))
@settings(max_examples=8, deadline=None)
def test_a_knot_of_any_mesh_closes_without_a_twist(columns: int, rows: int) -> None:
    mesh = knot(columns=columns, rows=rows)
    assert len(mesh.faces) == columns * rows
    assert _off_plane(mesh) < 1e-9
    edges = _edges(mesh)
    assert all((b, a) in edges for a, b in edges)
    # A tube's volume is its length times its section's area (Pappus, as nearly as its joints are straight).
    length = np.linalg.norm(np.diff(mesh.corners.reshape(rows, columns, 3).mean(axis=1), axis=0), axis=1).sum()
    section = columns / 2 * math.sin(2 * math.pi / columns) * 0.09**2
    assert _volume(mesh) == pytest.approx(length * section * rows / (rows - 1), rel=0.02)


def test_a_spring_is_a_tube_with_two_lids() -> None:
    mesh = spring()
    assert sorted(len(face) for face in mesh.faces) == [4] * 900 + [6] * 2
    length = np.linalg.norm(np.diff(mesh.corners.reshape(151, 6, 3).mean(axis=1), axis=0), axis=1).sum()
    assert length == pytest.approx(math.hypot(5 * 2 * math.pi * 0.3, 0.8), rel=0.01)
    assert _volume(mesh) == pytest.approx(length * 3 * math.sin(math.pi / 3) * 0.06**2, rel=0.02)


def test_every_triangle_of_the_teapot_looks_outward() -> None:
    """Away from the axis for the body, up for the lid, down for the bottom, away from its middle line for a tube."""
    mesh = teapot(width_m=6.525)  # in Newell's units
    triangles = _fan(mesh)
    middles = triangles.mean(axis=1)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert np.linalg.norm(normals, axis=1).min() > 1e-4, "none without area"
    patch = np.arange(1024) // 32
    side = (patch >= 4) & (patch < 12)
    assert ((middles * normals)[side][:, [0, 2]].sum(axis=1) > 0).all()
    assert (normals[(patch >= 16) & (patch < 20), 1] > 0).all(), "the lid"
    assert (normals[(patch >= 20) & (patch < 24), 1] < 0).all(), "the bottom"
    for first in (24, 26, 28, 30):  # two halves each of the handle and the spout
        both = (patch == first) | (patch == first + 1)
        rows = middles[both].reshape(2, 4, 8, 3)  # halves, rows along the tube, triangles
        centre = rows.mean(axis=(0, 2))
        outward = ((rows - centre[None, :, None]) * normals[both].reshape(2, 4, 8, 3)).sum(axis=3) > 0
        assert outward[:, :2].mean() > 0.9
        # The spout's end turns over the lip and goes on inside, where outward is toward the middle line.
        assert outward[:, 2:].mean() < 0.1 if first == 30 else outward[:, 2:].mean() > 0.9
    edges = _edges(mesh)
    assert set(edges.values()) == {1}, "no two triangles run along an edge the same way"
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx([6.525, 3.15, 4.0], abs=0.1)


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("spere", {}, "no shape is named 'spere': there are cylinder"),
        ("sphere", {"colums": 3}, "no parameter 'colums': it has radius_m, columns, rows"),
        ("sphere", {"columns": 3.5}, "columns must be a whole number"),
        ("sphere", {"columns": 2}, "at least 3 columns"),
        ("cylinder", {"radius_m": -1}, "radius_m must be above 0"),
        ("spring", {"rows": 9}, "bends by more than a right angle"),
        ("knot", {"columns": 2}, "at least 3 columns"),
        ("knot", {"rows": 4}, "bends by more than a right angle"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(name: str, parameters: dict[str, float], words: str) -> None:
    with pytest.raises(DisplayError, match=words):
        shape(name, **parameters)
