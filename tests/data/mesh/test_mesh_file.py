"""Meshes from files: every format, colour and texture, scene graphs, and what is wrong with a file."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image as Picture
from scipy.spatial import KDTree

import limen
from limen.data.mesh.mesh import NO_TEXTURE, Mesh
from limen.data.mesh.mesh_type import mesh_type
from limen.data.mesh.opening import open_mesh
from limen.data.mesh.textures import as_layers
from limen.data.samples.mesh import torus_knot
from limen.errors import FormatError, MissingFileError


@cache
def a_knot():
    return torus_knot(600)


PLACES = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV_UP = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def chequer(width: int, height: int, colour: tuple[int, int, int]) -> Picture.Image:
    """``colour`` in the top left quarter, black elsewhere."""
    texels = np.zeros((height, width, 3), np.uint8)
    texels[: height // 2, : width // 2] = colour
    return Picture.fromarray(texels)


def textured(picture: Picture.Image, **material: Any) -> trimesh.Trimesh:
    made = trimesh.visual.material.PBRMaterial(baseColorTexture=picture, **material)
    visual = trimesh.visual.TextureVisuals(uv=UV_UP, material=made)
    return trimesh.Trimesh(PLACES, FACES, visual=visual, process=False)


def corners_of(mesh: Mesh, known: Mesh) -> set[tuple[int, ...]]:
    """The triangles as numbers of the nearest vertices of ``known``, each beginning with its smallest."""
    distance, number = KDTree(known.positions).query(mesh.positions)
    assert distance.max() < 1e-4
    return {tuple(np.roll(corners, -corners.argmin()).tolist()) for corners in number[mesh.triangles]}


@pytest.mark.parametrize("kind", ["ply", "obj", "off", "stl", "glb", "3mf"])
def test_the_same_triangles_come_back_from_every_format(tmp_path: Path, kind: str) -> None:
    plain = trimesh.Trimesh(a_knot().positions, a_knot().triangles, process=False)
    path = write(tmp_path / f"a.{kind}", plain.export(file_type=kind))
    found = open_mesh(path)
    assert found.path == path
    assert found.size == a_knot().size
    assert corners_of(found, a_knot()) == corners_of(a_knot(), a_knot())
    np.testing.assert_allclose(found.bounds, a_knot().bounds, atol=1e-4)


_WITHOUT_EXTRA = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("lxml", "networkx"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from pathlib import Path
from limen.data.mesh.opening import open_mesh
from limen.display.meshfile import read_mesh
from limen.errors import FormatError
for path in map(Path, sys.argv[1:]):
    for read in (open_mesh, read_mesh):
        try:
            print(path.suffix, read(path) is not None)
        except FormatError as error:
            print(path.suffix, error)
"""


def test_without_the_extra_all_formats_but_3mf_are_read_and_3mf_says_what_to_install(tmp_path: Path) -> None:
    plain = trimesh.Trimesh(a_knot().positions, a_knot().triangles, process=False)
    kinds = ("ply", "obj", "off", "stl", "glb", "3mf")
    paths = [write(tmp_path / f"a.{kind}", plain.export(file_type=kind)) for kind in kinds]
    for name, content in trimesh.Scene(plain).export(file_type="gltf").items():
        write(tmp_path / name, content)
    paths.insert(0, (tmp_path / "model.gltf"))
    said = subprocess.check_output([sys.executable, "-c", _WITHOUT_EXTRA, *map(str, paths)], text=True).splitlines()
    assert said[:-2] == [f"{path.suffix} True" for path in paths[:-1] if path.suffix for _ in range(2)]
    for line in said[-2:]:
        assert line.startswith(f".3mf {paths[-1]}: ")
        assert line.endswith('pip install "limen[3mf]"')


@pytest.mark.parametrize("kind", ["ply", "stl"])
def test_normals_are_smooth_even_where_a_file_shares_no_vertices(tmp_path: Path, kind: str) -> None:
    plain = trimesh.Trimesh(a_knot().positions, a_knot().triangles, process=False)
    found = open_mesh(write(tmp_path / f"a.{kind}", plain.export(file_type=kind)))
    near = np.linalg.norm(found.positions[:, None] - a_knot().positions[None], axis=2).argmin(axis=1)
    np.testing.assert_allclose(found.normals, a_knot().normals[near], atol=2e-3)


def test_a_file_is_known_by_its_content(tmp_path: Path) -> None:
    plain = trimesh.Trimesh(PLACES, FACES, process=False)
    for kind in ("ply", "off", "stl", "glb"):
        assert mesh_type(write(tmp_path / "nameless.bin", plain.export(file_type=kind))) == kind
    assert mesh_type(write(tmp_path / "a.obj", plain.export(file_type="obj"))) == "obj"
    assert mesh_type(write(tmp_path / "a.txt", "ply is a word")) is None


def test_limen_open_tells_meshes_from_images(tmp_path: Path) -> None:
    mesh = write(tmp_path / "a.ply", trimesh.Trimesh(PLACES, FACES, process=False).export(file_type="ply"))
    Picture.new("RGB", (20, 10)).save(tmp_path / "b.png")
    opened = limen.open(mesh)
    assert isinstance(opened, limen.Mesh)
    assert (opened.kind, opened.size, opened.info().levels) == ("mesh", 2, [2])
    with limen.open(tmp_path / "b.png") as image:
        assert image.info().kind == "image"


def test_normals_of_the_file_keep_creases(tmp_path: Path) -> None:
    lines = ["v 0 0 0", "v 1 0 0", "v 0 0 1", "v 0 1 0", "vn 0 1 0", "vn 2 0 0", "f 1//1 3//1 2//1", "f 1//2 4//2 3//2"]
    found = open_mesh(write(tmp_path / "a.obj", "\n".join(lines)))
    np.testing.assert_allclose(found.normals[found.triangles[0]], [[0, 1, 0]] * 3, atol=1e-6)
    np.testing.assert_allclose(found.normals[found.triangles[1]], [[1, 0, 0]] * 3, atol=1e-6)  # made unit


def test_colours_of_vertices_and_of_faces(tmp_path: Path) -> None:
    colours = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]], np.uint8)
    mesh = trimesh.Trimesh(PLACES, FACES, vertex_colors=colours, process=False)
    found = open_mesh(write(tmp_path / "a.ply", mesh.export(file_type="ply")))
    np.testing.assert_array_equal(found.colours, colours)
    faces = trimesh.Trimesh(PLACES, FACES, face_colors=colours[:2], process=False)
    found = open_mesh(write(tmp_path / "b.ply", faces.export(file_type="ply")))
    np.testing.assert_array_equal(found.colours[found.triangles[0]], [colours[0]] * 3)
    np.testing.assert_array_equal(found.colours[found.triangles[1]], [colours[1]] * 3)
    np.testing.assert_allclose(found.normals, [[0, 0, 1]] * 6, atol=1e-6)


def test_a_texture_lies_the_right_way_up(tmp_path: Path) -> None:
    """The picture's first row is at the top, where y is 1: v = 0 there."""
    found = open_mesh(write(tmp_path / "a.glb", textured(chequer(8, 4, (200, 10, 10))).export(file_type="glb")))
    assert found.textures.shape == (1, 4, 8, 4)
    corner = np.argmin(np.linalg.norm(found.positions - [0, 1, 0], axis=1))
    np.testing.assert_allclose(found.uv[corner], [0, 0], atol=1e-6)
    np.testing.assert_array_equal(found.textures[0, 0, 0], [200, 10, 10, 255])
    np.testing.assert_array_equal(found.textures[0, 3, 7], [0, 0, 0, 255])
    np.testing.assert_array_equal(found.layers, 0)


def test_obj_with_two_materials_and_pictures(tmp_path: Path) -> None:
    chequer(4, 4, (255, 0, 0)).save(tmp_path / "red.png")
    chequer(30, 4, (0, 255, 0)).save(tmp_path / "green.png")
    mtl = "newmtl one\nmap_Kd red.png\nnewmtl two\nKd 0.2 0.4 0.6\nmap_Kd green.png\nnewmtl three\nKd 0.2 0.4 0.6\n"
    write(tmp_path / "a.mtl", mtl)
    places = [f"v {x} {y} {z}" for x, y, z in PLACES]
    uv = [f"vt {u} {v}" for u, v in UV_UP]
    faces = ["usemtl one", "f 1/1 2/2 3/3", "usemtl two", "f 1/1 3/3 4/4", "usemtl three", "f 2/2 3/3 4/4"]
    found = open_mesh(write(tmp_path / "a.obj", "\n".join(["mtllib a.mtl", *places, *uv, *faces])))
    assert found.textures.shape == (2, 4, 32, 4)
    layer = found.layers[found.triangles[:, 0]]
    assert sorted(layer.tolist()) == [0, 1, NO_TEXTURE]
    colour = {
        int(number): found.colours[corner].tolist() for number, corner in zip(layer, found.triangles[:, 0], strict=True)
    }
    plain = [51, 102, 153, 255]
    red = next(number for number in (0, 1) if found.textures[number, 0, 0, 0] == 255)
    assert colour == {red: [255] * 4, 1 - red: plain, NO_TEXTURE: plain}  # without a Kd nothing dims the picture
    assert found.textures[1 - red, 0, 0, 1] == 255


def test_factors_of_gltf_are_linear_light(tmp_path: Path) -> None:
    """0.2140 of the light is code 0.5 in sRGB (IEC 61966-2-1)."""
    mesh = textured(chequer(4, 4, (255, 255, 255)), baseColorFactor=[0.214, 1.0, 0.0, 0.5], alphaMode="BLEND")
    found = open_mesh(write(tmp_path / "a.glb", mesh.export(file_type="glb")))
    np.testing.assert_allclose(found.colours[0].astype(int), [128, 255, 0, 128], atol=1)
    mesh = textured(chequer(4, 4, (255, 255, 255)), baseColorFactor=[1.0, 1.0, 1.0, 0.5])
    found = open_mesh(write(tmp_path / "b.glb", mesh.export(file_type="glb")))
    assert found.colours[0, 3] == 255  # glTF 2.0, 3.9.4: OPAQUE ignores opacity


def test_a_scene_is_flattened_with_its_transforms(tmp_path: Path) -> None:
    one, two = textured(chequer(4, 4, (9, 9, 9))), textured(chequer(4, 4, (9, 9, 9)))
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0], [0, 0, 0])
    mirror = np.diag([1.0, 1.0, -2.0, 1.0])
    mirror[:3, 3] = [10, 0, 5]
    scene.add_geometry(one, node_name="one", geom_name="one", transform=turn)
    scene.add_geometry(two, node_name="two", geom_name="two", transform=mirror)
    found = open_mesh(write(tmp_path / "a.glb", scene.export(file_type="glb")))
    assert found.size == 4
    assert len(found.textures) == 1  # the same picture twice is stored once
    np.testing.assert_allclose(found.bounds, [[0, 0, -2], [12, 1, 5]], atol=1e-6)
    corners = found.positions[found.triangles].astype(float)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    # Triangles and normals agree also where the graph mirrors.
    np.testing.assert_allclose(found.normals[found.triangles[:, 0]], faces, atol=1e-6)
    turned = corners[:, 0, 0] < 1e-6
    np.testing.assert_allclose(faces[turned & (corners[:, 1, 0] < 1e-6)], [[1, 0, 0]] * 2, atol=1e-6)


def test_pictures_become_layers_of_one_size() -> None:
    wide = np.full((5, 3000, 4), 255, np.uint8)
    wide[..., :3] = (10, 100, 200)
    clear = np.zeros((64, 2, 4), np.uint8)
    clear[:, :, 0] = 255
    layers = as_layers([wide, clear])
    assert layers.shape == (2, 64, 2048, 4)
    np.testing.assert_allclose(layers[0].astype(int).reshape(-1, 4), [[10, 100, 200, 255]] * 64 * 2048, atol=1)
    assert layers[1, ..., 3].max() == 0
    stripes = np.full((8, 4096, 4), 255, np.uint8)
    stripes[:, ::2, :3] = 0
    middle = as_layers([stripes])[0, 4, 1024, 0]
    assert abs(int(middle) - 188) <= 2  # half the light is code 188, not 128


def point_cloud() -> bytes:
    return bytes(trimesh.PointCloud(PLACES).export(file_type="ply"))


def with_nan() -> bytes:
    places = PLACES.copy()
    places[2, 1] = np.nan
    return bytes(trimesh.Trimesh(places, FACES, process=False).export(file_type="ply"))


def cut(kind: str) -> bytes:
    whole = trimesh.Trimesh(a_knot().positions, a_knot().triangles, process=False).export(file_type=kind)
    return bytes(whole[: len(whole) * 2 // 3])


def out_of_range() -> bytes:
    content = trimesh.Trimesh(PLACES, FACES, process=False).export(file_type="ply")
    return bytes(content[:-4] + struct.pack("<i", 77))


def draco() -> bytes:
    header = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "accessors": [
            {"componentType": 5126, "count": 3, "type": "VEC3"},
            {"componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 4}],
        "buffers": [{"byteLength": 4}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0},
                        "indices": 1,
                        "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}},
                    }
                ]
            }
        ],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + 4
    return (
        struct.pack("<4sII", b"glTF", 2, length)
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", 4, b"BIN\0")
        + b"\0\0\0\0"
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", point_cloud(), "has no triangles: a point cloud or lines are no mesh"),
        ("a.obj", "v 0 0 0\nv 1 0 0\n", "has no triangles"),
        ("a.ply", with_nan(), "1 of its 4 positions hold numbers that are not finite, the first is vertex 2; repair"),
        ("a.ply", out_of_range(), "a triangle names a vertex that is not there"),
        ("a.ply", cut("ply"), "cannot be read as ply"),
        ("a.glb", cut("glb"), "ends after .* bytes; copy it again"),
        ("a.3mf", cut("3mf"), "is no 3MF"),
        ("a.stl", cut("stl"), "ends after .* bytes; copy it again"),
        ("a.off", "OFF\n4 2 0\n0 0", "cannot be read as off"),
        ("a.obj", b"\0\1\2\3" * 100, "has no triangles|cannot be read as obj"),
        ("a.glb", draco(), "in one point; if it is compressed"),
        ("a.ply", b"", "is empty"),
        ("a.zzz", b"some text that is no mesh", "is no mesh"),
    ],
    ids=lambda value: value if isinstance(value, str) and len(value) < 6 else "",
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path: Path, name: str, content: Any, message: str) -> None:
    path = write(tmp_path / name, content)
    with pytest.raises(FormatError, match=message) as caught:
        open_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        limen.open("nowhere.ply")


@pytest.mark.data
def test_the_bunny(data_dir: Path) -> None:
    found = limen.open(data_dir / "mesh/bunny.ply")
    assert isinstance(found, limen.Mesh)
    assert (found.size, len(found.positions)) == (69_451, 35_947)
    corners = found.positions[found.triangles].astype(float)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.einsum("ij,ij->i", faces, found.normals[found.triangles[:, 0]].astype(float))
    assert (along > 0).mean() > 0.999


def whole_files() -> dict[str, bytes]:
    """Small sound files of each kind; the GLB has a texture."""
    plain = trimesh.Trimesh(PLACES, FACES, process=False)
    files = {kind: plain.export(file_type=kind) for kind in ("ply", "obj", "off", "stl")}
    files["glb"] = textured(chequer(8, 4, (200, 10, 10))).export(file_type="glb")
    return {kind: content.encode() if isinstance(content, str) else bytes(content) for kind, content in files.items()}


_WHOLE = whole_files()


@given(st.sampled_from(sorted(_WHOLE)), st.data())
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_refused_but_never_breaks(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    content = bytearray(_WHOLE[kind])
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=20)):
        content[place] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(1, len(content)))]
    path = write(tmp_path / f"a.{kind}", bytes(content))
    try:
        told = open_mesh(path).info().path
    except FormatError as error:
        told = str(error)
    assert told.startswith(str(path))
    assert "\n" not in told
