"""Meshes become panels: every face a panel, in its place, seen from its side."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import limen
from limen.display.mesh import PolygonMesh, panels_of_mesh, room_from_mesh
from limen.display.shapes import cylinder, icosahedron
from limen.errors import DisplayError, FormatError, InputError, MissingFileError
from limen.geometry import signed_area

# A house without a floor: a triangle, quadrilaterals, and a concave wall of seven corners, which faces +z.
HOUSE = """\
# made by hand
v 0 0 0
v 2 0 0
v 2 1 0
v 1 2 0
v 0 1 0
v 0.75 0 0
v 1.25 0 0
v 1.25 0.8 0
v 0.75 0.8 0
v 0 0 -2
v 2 0 -2
v 2 1 -2
vt 0 0
f 1/1 6/1 9 8 7 2 3 4 5
f 2//1 11//1 12//1 3//1
f -12 -8 \\
  -3
"""


def _mesh(text: str, path: Path) -> Path:
    path.write_text(text)
    return path


@given(st.integers(0, 2**32), st.booleans())
def test_panels_lie_on_their_faces_and_are_seen_from_outside(seed: int, inward: bool) -> None:
    """Of a random convex solid, whose hull is the reference."""
    hull = ConvexHull(np.random.default_rng(seed).normal(size=(12, 3)))
    middle = hull.points[hull.vertices].mean(axis=0)
    faces = []
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = hull.points[simplex]
        outward = np.cross(b - a, c - a) @ equation[:3] > 0
        faces.append(tuple(int(k) for k in (simplex if outward else simplex[::-1])))
    panels = panels_of_mesh(PolygonMesh(hull.points, tuple(faces)), "hull", 0.01, inward=inward)
    assert sum(signed_area(panel.lit_outline_px) for panel in panels) * 1e-4 == pytest.approx(hull.area)
    for panel, face in zip(panels, faces, strict=True):
        expected = {tuple(corner) for corner in np.round(hull.points[list(face)], 6).tolist()}
        assert {tuple(corner) for corner in np.round(panel.outline_m, 6).tolist()} == expected
        away = float((panel.outline_m[0] - middle) @ panel.normal)
        assert (away < 0) == inward
        low, high = panel.lit_outline_px.min(axis=0), panel.lit_outline_px.max(axis=0)
        assert np.abs(low).max() < 1e-6
        assert (high <= np.array(panel.size_px) + 2e-3).all(), "the grid holds the outline"
        assert (high > np.array(panel.size_px) - 1 - 1e-6).all(), "and nothing that could be left away"
        assert panel.down[1] <= 1e-9 or abs(panel.normal[1]) > 0.999 or len(face) == 3


def test_upright_panels_hang_upright_and_panels_that_lie_have_their_top_away() -> None:
    for panel in panels_of_mesh(cylinder(), "c", 0.001):
        np.testing.assert_allclose(panel.down, (0, -1, 0), atol=1e-9)
    table = PolygonMesh(np.array([[0, 1, 0], [2, 1, 0], [2, 1, -1], [0, 1, -1.0]]), ((0, 1, 2, 3),))
    (panel,) = panels_of_mesh(table, "t", 0.01)
    np.testing.assert_allclose([panel.right, panel.down, panel.normal], [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)
    assert panel.size_px == (200, 100)


def test_a_frame_makes_the_lit_outline_smaller_on_every_side() -> None:
    (whole, *_), (framed, *_) = (panels_of_mesh(icosahedron(), "i", 0.001, bezel_m=b) for b in (0.0, 0.02))
    assert framed.bezel_m == 0.02
    middle = whole.outline_m.mean(axis=0)
    np.testing.assert_allclose(framed.outline_m.mean(axis=0), middle, atol=1e-9)

    def inradius(outline: np.ndarray) -> float:
        edges = np.roll(outline, -1, axis=0) - outline
        return float(np.linalg.norm(np.cross(edges, middle - outline), axis=1).min() / np.linalg.norm(edges[0]))

    assert inradius(whole.outline_m) - inradius(framed.outline_m) == pytest.approx(0.02)
    with pytest.raises(DisplayError, match=r"panel 'i/0' has no lit area left inside a frame of 200 mm"):
        panels_of_mesh(icosahedron(), "i", 0.001, bezel_m=0.2)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.01))
@example((0.0, -1.0, 1e-5))
@example((1e-9, -1.0, 0.0))
@example((0.0, -1.0, 1e-13))
def test_the_upward_direction_of_a_mesh_becomes_the_rooms(up: tuple[float, float, float]) -> None:
    mesh = PolygonMesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], np.array(up) / np.linalg.norm(up)]), ((0, 1, 2), (0, 1, 3))
    )
    placed = room_from_mesh(mesh, scale=2.0, up=up)
    np.testing.assert_allclose(placed.corners[3], [0, 2, 0], atol=1e-6)
    distances = [np.linalg.norm(m[:, None] - m[None], axis=2) for m in (2 * mesh.corners, placed.corners)]
    np.testing.assert_allclose(distances[1], distances[0], atol=1e-9)
    assert np.linalg.det(placed.corners[1:4]) == pytest.approx(8 * np.linalg.det(mesh.corners[1:4]), abs=1e-6)
    centred = room_from_mesh(mesh, centre_m=(1, 2, 3))
    np.testing.assert_allclose(centred.bounds.mean(axis=0), [1, 2, 3], atol=1e-12)


def test_an_image_lies_around_an_object_as_the_label_around_a_can() -> None:
    """Going to the right on the surface is going to the right around the object, as its viewer sees it."""
    for inward, inside in ((False, False), (True, True)):
        panels = panels_of_mesh(cylinder(), "c", 0.001, inward=inward)
        for panel in panels:
            beside = panel.surface_m[0] + panel.size_m[0]
            right_edge = panel.outline_m[:, :].mean(axis=0) + np.array(panel.right) * panel.size_m[0] / 2
            neighbours = [
                other for other in panels
                if abs(other.surface_m[0] - beside) < 0.005 and abs(other.surface_m[1] - panel.surface_m[1]) < 1e-6
            ]  # fmt: skip
            for other in neighbours:
                left_edge = other.outline_m.mean(axis=0) - np.array(other.right) * other.size_m[0] / 2
                np.testing.assert_allclose(left_edge, right_edge, atol=0.002)
        assert (float(np.dot(panels[0].normal, panels[0].outline_m[0])) < 0) == inside


def test_a_house_of_triangles_quadrilaterals_and_a_concave_wall(tmp_path: Path) -> None:
    house = limen.Display.from_mesh(_mesh(HOUSE, tmp_path / "house.obj"), ppi=25.4)
    names = [panel.name for panel in house.panels]
    assert names[-2:] == ["house/1", "house/2"]
    assert all(name.startswith("house/0.") for name in names[:-2])
    wall = [panel for panel in house.panels if panel.name.startswith("house/0.")]
    assert sum(signed_area(panel.lit_outline_px) for panel in wall) * 1e-6 == pytest.approx(3 - 0.5 * 0.8)
    assert {tuple(np.round(panel.normal, 9)) for panel in wall} == {(0.0, 0.0, 1.0)}
    np.testing.assert_allclose(house.panels[-2].normal, [1, 0, 0], atol=1e-12)
    mirrored = limen.Display.from_mesh(tmp_path / "house.obj", ppi=25.4, inward=True)
    np.testing.assert_allclose(mirrored.panels[-2].normal, [-1, 0, 0], atol=1e-12)


def test_polygons_stay_whole_in_every_format_that_has_them(tmp_path: Path) -> None:
    import trimesh

    obj = _mesh("v 0 0 0\nv 1 0 0\nv 1 1 0\nv .5 1.5 0\nv 0 1 0\nf 1 2 3 4 5\nf 5 4 3\n", tmp_path / "a.obj")
    off = _mesh(
        "OFF 5 2 0\n0 0 0\n1 0 0 # here\n\n1 1 0\n.5 1.5 0\n0 1 0\n5 0 1 2 3 4 255 0 0\n3 4 3 2\n", tmp_path / "a.off"
    )
    ply = _mesh(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n1 1 0\n.5 1.5 0\n0 1 0\n5 0 1 2 3 4\n3 4 3 2\n",
        tmp_path / "a.ply",
    )
    reference = limen.Display.from_mesh(obj, 50)
    assert [len(panel.outline_px) for panel in reference.panels] == [5, 3]
    for path in (off, ply):
        other = limen.Display.from_mesh(path, 50)
        assert [panel.outline_px for panel in other.panels] == [panel.outline_px for panel in reference.panels]
    box = trimesh.creation.box((1, 2, 3))
    for suffix in ("stl", "glb"):
        box.export(tmp_path / f"box.{suffix}")
        panels = limen.Display.from_mesh(tmp_path / f"box.{suffix}", 10).panels
        assert len(panels) == 12
        assert all(np.dot(panel.normal, panel.outline_m.mean(axis=0)) > 0 for panel in panels)


CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv nan 1 0\nv 1 1 .2\nv 9 9\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.obj", CORNERS[:32], "there are no faces"),
        ("a.obj", CORNERS, r"a\.obj:7: not OBJ: a corner needs three numbers"),
        ("a.obj", CORNERS[:-6] + "f 1 2 3\nf 1 2 5\n", r"a\.obj: face 1 has a corner \(4\) that is not finite"),
        ("a.obj", CORNERS[:-6] + "f 1 2 6 4\n", r"a\.obj: face 0 is not flat"),
        ("a.obj", CORNERS[:-6] + "f 1 2\n", r"a\.obj: face 0 has 2 corners"),
        ("a.obj", CORNERS[:-6] + "f 1 2 2\n", r"a\.obj: face 0 has two corners in one place"),
        ("a.obj", CORNERS[:-6] + "f 1 2 12\n", r"a\.obj: face 0 names corner 11 of 6"),
        ("a.obj", CORNERS[:-6] + "f 1 2 x\n", r"a\.obj:7: not OBJ"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n", r"a\.off: ends after line 3"),
        ("a.off", "OFF\n1 1 0\n0 0 0\n3 0\n", r"a\.off:4: not OFF: a face of 3 corners names 1"),
        ("a.off", "3 1 0\n0 0 0\n", r"a\.off:1: not OFF: it must begin with OFF"),
        ("a.ply", "solid", r"a\.ply: not PLY"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty int x\nend_header\n", "no element 'vertex' with"),
        ("a.glb", "garbage", r"a\.glb: cannot be read as a mesh"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_display_is_refused_with_its_place(tmp_path: Path, name: str, text: str, words: str) -> None:
    with pytest.raises((FormatError, DisplayError), match=words) as caught:
        limen.Display.from_mesh(_mesh(text, tmp_path / name), 50)
    assert "\n" not in str(caught.value)


def test_a_mesh_needs_a_resolution_and_a_display_has_its_own(tmp_path: Path) -> None:
    path = str(_mesh(HOUSE, tmp_path / "house.obj"))
    with pytest.raises(InputError, match="give --ppi"):
        limen.Display.named(path)
    with pytest.raises(InputError, match="pixels per inch must be above 0, got nan"):
        limen.Display.named(path, ppi=math.nan)
    with pytest.raises(InputError, match="is for mesh files"):
        limen.Display.named("cube", ppi=100)
    with pytest.raises(MissingFileError, match=r"gone\.obj: no such mesh file"):
        limen.Display.named(str(tmp_path / "gone.obj"), ppi=100)
    (tmp_path / "bytes.obj").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(FormatError, match="not a text file"):
        limen.Display.named(str(tmp_path / "bytes.obj"), ppi=100)
    half = limen.Display.named(path, ppi=100, scale=0.5)
    np.testing.assert_allclose(half.bounds_m * 2, limen.Display.named(path, ppi=100).bounds_m)


def test_display_files_hold_meshes_and_shapes(tmp_path: Path) -> None:
    _mesh(HOUSE, tmp_path / "house.obj")
    text = """name = "x"
luminance_cd_m2 = 300
[[mesh]]
name = "home"
file = "house.obj"
pitch_mm = 5
centre_m = [1, 2, 3]
gain = 0.5
[[mesh]]
name = "ball"
shape = "sphere"
parameters = { columns = 6, rows = 4, radius_m = 1 }
ppi = 10
facing = "in"
bezel_mm = 20
[[adjust]]
panels = "ball/*"
node = "pc"
"""
    path = _mesh(text, tmp_path / "x.toml")
    display = limen.Display.load(path)
    grids = display.grids()
    assert [(panel.gain, panel.luminance_cd_m2, panel.node) for panel in grids["home"]] == [(0.5, 300, "")] * len(
        grids["home"]
    )
    assert len(grids["ball"]) == 24
    for panel in grids["ball"]:
        assert (panel.node, panel.bezel_m) == ("pc", 0.02)
        assert float(np.dot(panel.normal, panel.outline_m[0])) < 0
    home = np.concatenate([panel.outline_m for panel in grids["home"]])
    np.testing.assert_allclose((home.min(axis=0) + home.max(axis=0)) / 2, [1, 2, 3])
    for wrong, words in {
        'file = "house.obj"': "mesh 'home': give a file or a shape",
        "pitch_mm = 5": "mesh 'home': give its resolution",
    }.items():
        with pytest.raises(DisplayError, match=words):
            limen.Display.load(_mesh(text.replace(wrong, ""), path))
    with pytest.raises(FormatError, match=r"x\.toml:13: .*> 0"):
        limen.Display.load(_mesh(text.replace("ppi = 10", "ppi = -1"), path))
    with pytest.raises(MissingFileError, match=r"other\.obj"):
        limen.Display.load(_mesh(text.replace("house.obj", "other.obj"), path))
