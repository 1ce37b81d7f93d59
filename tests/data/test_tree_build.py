"""Vertex trees: what every one must hold, for meshes of any kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_mesh import mesh_of

from limen.data.mesh import Mesh, smooth_normals
from limen.data.tree_build import build_vertex_tree
from limen.data.vertex_tree import VertexTree


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


def bumpy(columns: int, rows: int, seed: int = 0, closed: bool = False) -> Mesh:
    """A sheet with bumps, or a torus of one."""
    random = np.random.default_rng(seed)
    i, k = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    height = 0.05 * random.standard_normal(i.shape)
    if closed:
        turn, tilt = 2 * np.pi * i / columns, 2 * np.pi * k / rows
        wide = 2 + (0.7 + height) * np.cos(tilt)
        place = np.stack([wide * np.cos(turn), wide * np.sin(turn), (0.7 + height) * np.sin(tilt)], axis=-1)
        next_i, next_k = (i + 1) % columns, (k + 1) % rows
    else:
        place = np.stack([i / columns, k / rows, height / 4], axis=-1)
        i, k = i[:-1, :-1], k[:-1, :-1]
        next_i, next_k = i + 1, k + 1
    a, b, c, d = (m * rows + n for m, n in ((i, k), (next_i, k), (next_i, next_k), (i, next_k)))
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    positions = place.reshape(-1, 3).astype(np.float32)
    triangles = triangles.astype(np.uint32)
    welds = np.arange(len(positions), dtype=np.uint32)
    colours = random.integers(100, 156, (len(positions), 4), np.uint8)
    colours[:, 3] = 255
    return mesh_of(positions, triangles, normals=smooth_normals(positions, triangles, welds), colours=colours)


MESHES = {
    "sheet": lambda: bumpy(13, 17),
    "torus": lambda: bumpy(16, 12, closed=True),
}


@pytest.fixture(params=MESHES, scope="module")
def built(request: pytest.FixtureRequest) -> tuple[Mesh, VertexTree]:
    mesh = MESHES[request.param]()
    return mesh, build_vertex_tree(mesh)


def test_parents_come_after_their_children_and_a_part_has_one_root(built: tuple[Mesh, VertexTree]) -> None:
    _, tree = built
    numbers = np.arange(len(tree.parent))
    assert ((tree.parent > numbers) | (tree.parent == -1)).all()
    assert (tree.parent[tree.parent >= 0] >= tree.vertices).all()
    assert (np.bincount(tree.parent[tree.parent >= 0], minlength=len(numbers))[tree.vertices :] >= 2).all()
    assert (tree.parent == -1).sum() == 1


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_a_cut_draws_triangles_of_three_nodes(data: Any) -> None:
    mesh = bumpy(7, 8, closed=data.draw(st.booleans()))
    tree = build_vertex_tree(mesh)
    inner = len(tree.radius)
    folded = np.array(data.draw(st.lists(st.booleans(), min_size=inner, max_size=inner)), bool)
    found = proxies(tree, folded)
    assert (tree.parent[found] == -1).any() or len(np.unique(found)) > 1
    corners = drawn(tree, folded)
    assert (np.sort(corners, axis=1)[:, 1:] > np.sort(corners, axis=1)[:, :-1]).all()
    assert len(drawn(tree, np.zeros(inner, bool))) == mesh.size
    assert len(drawn(tree, np.ones(inner, bool))) == 0
