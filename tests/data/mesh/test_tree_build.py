"""Vertex trees: what every one must hold, for meshes of any kind."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.data.mesh import tree_build
from limen.data.mesh.mesh import Mesh, smooth_normals
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.mesh.vertex_tree import VertexTree
from limen.data.store.resample import linear_of_srgb, srgb_of_linear
from limen.study.surfaces import distances, samples_of
from limen.vision.contrast_codes import CONTRAST_OF_CODE, FULL_CODE
from limen.vision.luminance import Photometry
from support.meshes import mesh_of


def proxies(tree: VertexTree, folded: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The node that stands for every vertex: the topmost folded one above it, or it itself; by walking up."""
    above = np.arange(tree.vertices)
    found = above.copy()
    while (above >= 0).any():
        inner = above >= tree.vertices
        hit = np.zeros(len(above), bool)
        hit[inner] = folded[above[inner] - tree.vertices]
        found[hit] = above[hit]
        above = np.where(above >= 0, tree.parent[np.maximum(above, 0)], -1)
    return found


def drawn(tree: VertexTree, folded: NDArray[np.bool_]) -> NDArray[np.int64]:
    corners = proxies(tree, folded)[tree.triangles]
    a, b, c = corners.T
    return corners[(a != b) & (b != c) & (c != a)]


def lattice(columns: int, rows: int, closed: bool = False) -> NDArray[np.int64]:
    """Triangles of squares between vertices in rows; closed both ways, or not."""
    i, k = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    if not closed:
        i, k = i[:-1, :-1], k[:-1, :-1]
    next_i, next_k = (i + 1) % columns, (k + 1) % rows
    a, b, c, d = (m * rows + n for m, n in ((i, k), (next_i, k), (next_i, next_k), (i, next_k)))
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def bumpy(columns: int, rows: int, seed: int = 0, closed: bool = False) -> Mesh:
    """A sheet with bumps, or a torus of one."""
    random = np.random.default_rng(seed)
    i, k = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    height = 0.05 * random.standard_normal(i.shape)
    if closed:
        turn, tilt = 2 * np.pi * i / columns, 2 * np.pi * k / rows
        wide = 2 + (0.7 + height) * np.cos(tilt)
        place = np.stack([wide * np.cos(turn), wide * np.sin(turn), (0.7 + height) * np.sin(tilt)], axis=-1)
    else:
        place = np.stack([i / columns, k / rows, height / 4], axis=-1)
    positions = place.reshape(-1, 3).astype(np.float32)
    triangles = lattice(columns, rows, closed).astype(np.uint32)
    welds = np.arange(len(positions), dtype=np.uint32)
    colours = random.integers(100, 156, (len(positions), 4), np.uint8)
    colours[:, 3] = 255
    return mesh_of(positions, triangles, normals=smooth_normals(positions, triangles, welds), colours=colours)


def cube(steps: int) -> Mesh:
    """Six squares of triangles whose vertices are their own, as in a file of a CAD program: only places join them."""
    i, k = np.meshgrid(np.arange(steps + 1) / steps, np.arange(steps + 1) / steps, indexing="ij")
    flat = np.stack([i, k, np.zeros_like(i)], axis=-1).reshape(-1, 3)
    square = lattice(steps + 1, steps + 1)
    positions, normals, triangles = [], [], []
    for axis in range(3):
        for side in (0.0, 1.0):
            face = np.roll(flat + np.array([0, 0, side]), axis + 1, axis=1)
            positions.append(face)
            normals.append(np.tile(np.roll([0, 0, 2 * side - 1], axis + 1), (len(face), 1)))
            triangles.append((square if side else square[:, ::-1]) + len(face) * len(triangles))
    joined = np.concatenate(positions), np.concatenate(triangles)
    return mesh_of(*joined, normals=np.concatenate(normals))


def soup() -> Mesh:
    """What scans and exports are full of, in one file."""
    positions = np.random.default_rng(3).random((40, 3)).astype(np.float32)
    positions[30:34] = positions[:4]  # twins
    fan = [[0, 1, k] for k in range(2, 7)]  # five triangles at one edge
    bow = [[8, 9, 10], [8, 11, 12]]  # two surfaces that touch in a point
    flat = [[13, 13, 14], [15, 16, 16], [30, 0, 17], [18, 19, 18]]  # no triangles at all
    twice = [[20, 21, 22], [20, 21, 22], [22, 21, 20]]
    turned = [[23, 24, 25], [24, 23, 26], [23, 25, 26], [24, 25, 26]]  # a tetrahedron with one face turned over
    return mesh_of(positions, fan + bow + flat + twice + turned + [[30, 31, 35]])


MESHES = {
    "sheet": lambda: bumpy(13, 17),
    "torus": lambda: bumpy(16, 12, closed=True),
    "cube": lambda: cube(5),
    "two": lambda: mesh_of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [6, 0, 0], [5, 1, 0]], [[0, 1, 2], [3, 4, 5]]),
    "soup": soup,
    "one point": lambda: mesh_of(np.ones((9, 3)), np.arange(9).reshape(3, 3)),
    "far away": lambda: mesh_of(bumpy(9, 9).positions + np.float32(1e6), lattice(9, 9)),
}
ROOTS = {"two": 2, "soup": None}


@pytest.fixture(params=MESHES, scope="module")
def built(request: pytest.FixtureRequest) -> tuple[str, Mesh, VertexTree]:
    mesh = MESHES[request.param]()
    return request.param, mesh, build_vertex_tree(mesh)


def test_parents_come_after_their_children_and_a_part_has_one_root(built: tuple[str, Mesh, VertexTree]) -> None:
    name, mesh, tree = built
    numbers = np.arange(len(tree.parent))
    assert ((tree.parent > numbers) | (tree.parent == -1)).all()
    assert (tree.parent[tree.parent >= 0] >= tree.vertices).all()
    assert (np.bincount(tree.parent[tree.parent >= 0], minlength=len(numbers))[tree.vertices :] >= 2).all()
    assert len(tree.parent) < 2 * tree.vertices
    if (roots := ROOTS.get(name, 1)) is not None:
        assert (tree.parent == -1).sum() == roots
    np.testing.assert_array_equal(tree.position[: tree.vertices], mesh.positions)


def below(tree: VertexTree) -> list[NDArray[np.int64]]:
    """The vertices below each inner node."""
    sets: list[list[int]] = [[v] if v < tree.vertices else [] for v in range(len(tree.parent))]
    for node, parent in enumerate(tree.parent):
        if parent >= 0:
            sets[parent] += sets[node]
    return [np.array(each) for each in sets[tree.vertices :]]


def plain_cell(direction: Any) -> int:
    """Faces +x, -x, +y, -y, +z, -z; eight columns and rows along the other two axes."""
    axis = int(np.argmax(np.abs(direction)))
    face = 2 * axis + int(direction[axis] < 0)
    column, row = (min(int((each / abs(direction[axis]) + 1) * 4), 7) for each in np.delete(direction, axis))
    return 64 * face + 8 * row + column


def cells_of(mask: NDArray[np.uint64]) -> set[int]:
    return {64 * word + bit for word in range(6) for bit in range(64) if int(mask[word]) >> bit & 1}


def test_a_region_is_in_the_sphere_its_normals_in_the_mask_its_luminances_in_the_contrast(
    built: tuple[str, Mesh, VertexTree],
) -> None:
    _, mesh, tree = built
    corners = mesh.positions[mesh.triangles].astype(float)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = Photometry.srgb().luminance_cd_m2
    for number, vertices in enumerate(below(tree)):
        node = tree.vertices + number
        region = np.isin(mesh.triangles, vertices).any(axis=1)
        held = np.concatenate([mesh.positions[mesh.triangles[region]].reshape(-1, 3), tree.position[[node]]])
        far = np.linalg.norm(held - tree.middle[number].astype(float), axis=1)
        assert far.max() <= tree.radius[number] * (1 + 1e-6)
        assert tree.radius[number] <= 1.8 * far.max() + 1e-6
        normals = [*crossed[region][np.linalg.norm(crossed[region], axis=1) > 1e-9]]
        normals += [*mesh.normals[mesh.triangles[region]].reshape(-1, 3).astype(float)]
        assert {plain_cell(normal) for normal in normals} <= cells_of(tree.mask[number])
        touched = np.unique(np.append(mesh.triangles[region], vertices))
        shown, hidden = light(tree.colour[node, :3]), light(mesh.colours[touched, :3])
        assert (np.abs(shown - hidden) / (shown + hidden)).max() <= CONTRAST_OF_CODE[tree.contrast[number]] + 1e-12
    assert (np.abs(np.linalg.norm(tree.normal, axis=1) - 1) < 1e-5).all()


def test_only_rims_and_what_is_no_surface_have_full_masks() -> None:
    torus, sheet = build_vertex_tree(bumpy(24, 20, closed=True)), build_vertex_tree(bumpy(12, 12))
    full = np.uint64(2**64 - 1)
    assert not (torus.mask == full).all(axis=1)[:300].any()
    at_rim = np.array(
        [np.isin(np.arange(144).reshape(12, 12)[1:-1, 1:-1].ravel(), v).sum() < len(v) for v in below(sheet)]
    )
    assert (sheet.mask[at_rim] == full).all()
    assert not (sheet.mask[~at_rim] == full).all(axis=1).any()


def test_normals_and_colours_are_means_weighted_by_area() -> None:
    mesh = bumpy(10, 8, closed=True)
    tree = build_vertex_tree(mesh)
    corners = mesh.positions[mesh.triangles].astype(float)
    area = np.zeros(tree.vertices)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.add.at(area, mesh.triangles, (np.linalg.norm(crossed, axis=1) / 6)[:, None])
    for number, vertices in enumerate(below(tree)):
        weight = area[vertices, None]
        normal = (mesh.normals[vertices] * weight).sum(axis=0)
        linear = (linear_of_srgb(mesh.colours[vertices, :3] / 255) * weight).sum(axis=0) / weight.sum()
        node = tree.vertices + number
        np.testing.assert_allclose(tree.normal[node], normal / np.linalg.norm(normal), atol=1e-5)
        np.testing.assert_allclose(tree.colour[node, :3], 255 * srgb_of_linear(linear), atol=0.51)


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_a_cut_draws_triangles_of_three_nodes(data: Any) -> None:
    mesh = bumpy(7, 8, closed=data.draw(st.booleans()))
    tree = build_vertex_tree(mesh)
    inner = len(tree.radius)
    folded = np.array(data.draw(st.lists(st.booleans(), min_size=inner, max_size=inner)), bool)
    corners = drawn(tree, folded)
    assert (np.sort(corners, axis=1)[:, 1:] > np.sort(corners, axis=1)[:, :-1]).all()
    assert len(drawn(tree, np.zeros(inner, bool))) == mesh.size
    assert len(drawn(tree, np.ones(inner, bool))) == 0


RARE = 0.001
"""Bounds are of a collapse with what had collapsed before it around; a cut may leave that unfolded, or fold more."""


def folds(tree: VertexTree) -> Iterator[NDArray[np.bool_]]:
    """Cuts by displacement, and random ones."""
    steps = np.quantile(tree.displacement, [0.1, 0.3, 0.5, 0.7, 0.85, 0.95])
    yield from (tree.displacement <= step for step in steps)
    random = np.random.default_rng(1)
    for share in (0.02, 0.1, 0.3, 0.6):
        yield random.random(len(tree.radius)) < share


@pytest.mark.parametrize("closed", [False, True])
def test_hardly_any_place_moves_farther_than_the_displacements_of_what_is_folded(closed: bool) -> None:
    mesh = bumpy(31, 26, closed=closed)
    tree = build_vertex_tree(mesh)
    own = mesh.positions.astype(float)
    points, triangle = samples_of(own, mesh.triangles.astype(np.int64), 4000)
    moved = np.concatenate([np.zeros(tree.vertices), tree.displacement])
    for folded in folds(tree):
        corners = drawn(tree, folded)
        if len(corners):
            allowed = moved[proxies(tree, folded)[mesh.triangles[triangle]]].max(axis=1)
            far = distances(points, tree.position.astype(float), corners)
            back_points, drawn_triangle = samples_of(tree.position.astype(float), corners, 4000)
            back = distances(back_points, own, mesh.triangles.astype(np.int64))
            back_allowed = moved[corners[drawn_triangle]].max(axis=1)
            assert (far > allowed + 1e-6).mean() <= RARE
            assert (back > back_allowed + 1e-6).mean() <= RARE
    joined = np.flatnonzero(tree.parent[tree.vertices :] >= 0)
    above = tree.parent[tree.vertices :][joined] - tree.vertices
    assert (tree.displacement[above] >= tree.displacement[joined]).all()


def test_what_is_flat_folds_without_moving_to_as_little_as_there_may_be() -> None:
    mesh = cube(12)
    tree = build_vertex_tree(mesh)
    left = drawn(tree, tree.displacement < 1e-5)
    a, b, c = (tree.position[left[:, corner]].astype(float) for corner in range(3))
    assert len(left) <= 60 < mesh.size / 20
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(6, abs=1e-3)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(1, abs=1e-3)


def test_a_straight_rim_stays_where_it_is() -> None:
    flat = bumpy(14, 11)
    positions = flat.positions * np.array([1, 1, 0], np.float32)
    tree = build_vertex_tree(mesh_of(positions, flat.triangles))
    left = drawn(tree, tree.displacement < 1e-5)
    a, b, c = (tree.position[left[:, corner]].astype(float) for corner in range(3))
    assert len(left) <= 6
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(
        positions[:, 0].max() * positions[:, 1].max(), rel=1e-4
    )


def test_vertices_where_textures_meet_keep_their_places_whatever_is_folded() -> None:
    sheet = bumpy(12, 12)
    left = np.isin(sheet.triangles, np.flatnonzero(np.arange(144) // 12 < 6)).any(axis=1)
    twins = np.flatnonzero(np.arange(144) // 12 == 6)  # where both halves meet: each has its own
    other = np.arange(144)
    other[twins] = 144 + np.arange(12)
    triangles = np.where(left[:, None], sheet.triangles, other[sheet.triangles])
    take = np.append(np.arange(144), twins)
    uv = np.append(np.zeros(144), np.ones(12)).astype(np.float32)[:, None].repeat(2, axis=1)
    uv[:144, 0] = np.arange(144) % 12
    mesh = mesh_of(
        sheet.positions[take], triangles, uv=uv, layers=np.zeros(156), textures=np.zeros((1, 2, 2, 4), np.uint8)
    )
    tree = build_vertex_tree(mesh)
    seam = np.append(twins, 144 + np.arange(12))
    assert (tree.parent == -1).sum() == 24 + 2  # of either half, what is beside the seam
    for share in (0.3, 1.0):
        folded = np.random.default_rng(0).random(len(tree.radius)) <= share
        np.testing.assert_array_equal(tree.position[proxies(tree, folded)[seam]], mesh.positions[seam])
    assert (tree.contrast == FULL_CODE).all()


def test_what_is_cut_out_has_the_largest_contrast() -> None:
    sheet = bumpy(9, 9)
    colours = np.full((81, 4), 255, np.uint8)
    colours[40, 3] = 0
    tree = build_vertex_tree(mesh_of(sheet.positions, sheet.triangles, colours=colours))
    held = np.array(
        [np.isin(sheet.triangles, v).any(axis=1) @ (sheet.triangles == 40).any(axis=1) for v in below(tree)]
    )
    np.testing.assert_array_equal(tree.contrast == FULL_CODE, held)


def test_a_full_queue_is_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = build_vertex_tree(bumpy(30, 30, closed=True))
    monkeypatch.setattr(tree_build, "_EDGES_A_TRIANGLE", 2)
    again = build_vertex_tree(bumpy(30, 30, closed=True))
    assert (again.parent == -1).sum() == 1
    assert len(again.parent) == len(whole.parent)


def test_the_same_mesh_makes_the_same_tree() -> None:
    one, other = (build_vertex_tree(bumpy(15, 15)) for _ in range(2))
    for ours, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(ours, theirs)
