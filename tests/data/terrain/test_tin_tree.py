"""The tree of triangulations: every cut of it is whole, keeps its error, and needs few triangles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.data.terrain.model import Patch
from limen.data.terrain.tin_tree import exact_patch
from support import terrains
from support.trees import Block, build_tree, refine

LADDER = [64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0]
ORIGIN = (1000, 300)
ROUNDING_M = 1e-6


def heights_of(kind: str) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    heights_m = terrains.hills(81, 65, relief_m=40.0)
    if kind == "half flat":
        heights_m[:, 30:] = 7.0
    void = None
    if kind == "voids":
        void = np.zeros(heights_m.shape, bool)
        void[30:70, 20:60] = void[0:9, 60:65] = True
        heights_m[30:70, 20:60] = 50.0
    if kind == "noise":
        heights_m = np.random.default_rng(3).normal(0, 10, (33, 50)).astype(np.float32)
    return heights_m, void


@cache
def block_of(kind: str) -> Block:
    heights_m, void = heights_of(kind)
    return build_tree(heights_m, void, LADDER, origin=ORIGIN, leaf=16, max_triangles=100)


KINDS = ("hills", "half flat", "voids", "noise")


def patch_of(block: Block, heights_m: NDArray[np.float32], number: int) -> Patch:
    patch = block.contents[number]
    if patch is not None:
        return patch
    left, top, right, bottom = block.nodes.rect[block.patches.node[number]]
    own = np.s_[top - ORIGIN[1] : bottom - ORIGIN[1] + 1, left - ORIGIN[0] : right - ORIGIN[0] + 1]
    return exact_patch(heights_m[own], (left, top, right, bottom))


@settings(max_examples=12, deadline=None)
@given(st.data())
def test_every_cut_is_whole_and_keeps_the_error_of_each_patch(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(KINDS))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    heights_m, void = heights_of(kind)
    block = block_of(kind)
    cut, todo = [], [0]
    while todo:
        node = todo.pop()
        first, last = block.nodes.first_patch[node : node + 2]
        children = [child for child in block.nodes.children[node] if child >= 0]
        if children and rng.random() < 0.7:
            todo += children
        else:
            cut.append(int(rng.integers(first, last)))
    patches = [patch_of(block, heights_m, number) for number in cut]
    border = terrains.side_posts(patches)
    triangles = []
    for number, patch in zip(cut, patches, strict=True):
        own = terrains.fanned(patch, border)
        triangles += own
        errors_m = terrains.vertical_errors_m(heights_m, own, ORIGIN)
        counted = errors_m if void is None else np.where(void, 0.0, errors_m)
        assert counted.max() <= block.patches.error_m[number] + ROUNDING_M
        if void is None:
            at = [tuple((x - ORIGIN[0], y - ORIGIN[1]) for x, y in triangle) for triangle in own]
            between_m = terrains.errors_between_posts_m(heights_m, at)
            assert between_m.max() <= block.patches.error_m[number] + ROUNDING_M
        left, top, right, bottom = block.nodes.rect[block.patches.node[number]] - np.array(ORIGIN * 2)
        assert (errors_m[top : bottom + 1, left : right + 1] >= 0.0).all()
    rows, columns = heights_m.shape
    areas = [terrains.twice_area(triangle) for triangle in triangles]
    assert min(areas) > 0
    assert sum(areas) == 2 * (rows - 1) * (columns - 1)
    for a, b in terrains.open_edges(triangles):
        x, y = np.array([a, b]).T - np.array(ORIGIN)[:, None]
        assert any((line == at).all() for line, at in ((x, 0), (x, columns - 1), (y, 0), (y, rows - 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_tables_say_what_the_patches_are(kind: str) -> None:
    heights_m, _ = heights_of(kind)
    nodes, table, contents = block = block_of(kind)
    assert len(contents) == len(table.node) == nodes.first_patch[-1]
    assert (table.node == np.repeat(np.arange(len(nodes.rect)), np.diff(nodes.first_patch))).all()
    for number, content in enumerate(contents):
        patch, node = patch_of(block, heights_m, number), table.node[number]
        left, top, right, bottom = nodes.rect[node]
        assert patch.core.dtype == patch.rims.dtype == patch.sides[0].dtype == np.uint16
        assert len(patch.posts) == table.vertices[number]
        assert len(patch.core) + len(patch.rims) == table.triangles[number]
        assert (patch.posts.min(axis=0) == [left, top]).all()
        assert (patch.posts.max(axis=0) == [right, bottom]).all()
        at = patch.posts - np.array(ORIGIN)
        assert (patch.heights_m == heights_m[at[:, 1], at[:, 0]]).all()
        low, high = nodes.low_high_m[node]
        own = heights_m[top - ORIGIN[1] : bottom - ORIGIN[1] + 1, left - ORIGIN[0] : right - ORIGIN[0] + 1]
        assert (low, high) == (own.min(), own.max())
        exact = nodes.is_leaf[node] and number == nodes.first_patch[node + 1] - 1
        assert (content is None) == exact == (table.error_m[number] == 0.0 and exact)
        if not nodes.is_leaf[node] and number > nodes.first_patch[node]:
            assert table.triangles[number] <= 100


@pytest.mark.parametrize("kind", KINDS)
def test_children_lie_in_their_parent_and_are_no_coarser(kind: str) -> None:
    nodes, table, _ = block_of(kind)
    for node, children in enumerate(nodes.children):
        first, last = nodes.first_patch[node : node + 2]
        stored = table.error_m[first : last - 1 if nodes.is_leaf[node] else last]
        assert (np.diff(stored) < 0).all()
        assert table.error_m[last - 1] <= stored[-1]
        left, top, right, bottom = nodes.rect[node]
        inside = [child for child in children if child >= 0]
        for child in inside:
            assert child > node
            assert table.error_m[nodes.first_patch[child]] <= table.error_m[last - 1]
            corner = nodes.rect[child, :2] - np.array(ORIGIN)
            assert (corner % 16 == 0).all()
        if inside:
            sizes = nodes.rect[inside, 2:] - nodes.rect[inside, :2]
            assert sizes.prod(axis=1).sum() == (right - left) * (bottom - top)
        else:
            assert max(right - left, bottom - top) <= 16


def test_threads_change_nothing() -> None:
    heights_m, void = heights_of("voids")
    alone = build_tree(heights_m, void, LADDER, origin=ORIGIN, leaf=16, max_triangles=100, threads=1)
    for one, other in zip(alone.contents, block_of("voids").contents, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert (one.posts == other.posts).all()
            assert (one.core == other.core).all()


def test_a_terrain_of_four_posts() -> None:
    block = build_tree(np.array([[0, 1], [2, 5]], np.float32), None, [10.0])
    assert block.nodes.rect.tolist() == [[0, 0, 1, 1]]
    assert block.patches.triangles.tolist() == [2, 2]


def test_a_tree_needs_few_more_triangles_than_one_triangulation() -> None:
    """The price of nodes that can be drawn at any fineness beside each other."""
    heights_m = terrains.hills(257, 257, seed=2)
    block = build_tree(heights_m, None, LADDER, leaf=64, max_triangles=2000)
    for error_m, whole in zip(LADDER[2:5], refine(heights_m, None, LADDER)[2:5], strict=True):
        count, todo = 0, [0]
        while todo:
            node = todo.pop()
            own = np.arange(*block.nodes.first_patch[node : node + 2])
            fine = own[block.patches.error_m[own] <= error_m]
            count += int(block.patches.triangles[fine[0]]) if len(fine) else 0
            todo += [] if len(fine) else [child for child in block.nodes.children[node] if child >= 0]
        assert count < 1.25 * (len(whole.core) + len(whole.rims))
