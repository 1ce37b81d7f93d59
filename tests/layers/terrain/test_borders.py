"""Borders: no crack wherever patches of any fineness meet, and the kernel against the rule in plain Python."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.terrain.model import Patch
from limen.errors import InputError
from limen.layers.terrain.borders import BorderPool
from support.made_up_patches import Rect, made_up_patch, twice_area, uneven_tiling

SEEDS = st.integers(0, 100_000)


class World:
    """Panels with tilings of their own; patches in one vertex buffer, in an order that is not theirs."""

    def __init__(self, seed: int, panels: int = 2, size: int = 24, smallest: int = 3, kept: float = 0.85) -> None:
        random = np.random.default_rng(seed)
        self.rects: list[Rect] = []
        self.cuts: list[list[int]] = []
        for _ in range(panels):
            cut = []
            for rect in uneven_tiling(random, size, smallest, kept):
                cut.append(len(self.rects))
                self.rects.append(rect)
            self.cuts.append(cut)
        self.patches = [
            made_up_patch(random, rect, random.choice([0.0, 0.2, 0.6, 1.0]), int(random.integers(0, 12)))
            for rect in self.rects
        ]
        self.first_vertex: dict[int, int] = {}
        self.post_of = np.zeros((0, 2), np.int32)
        self.pool = BorderPool()
        for number in random.permutation(len(self.patches)):
            self.add(int(number))

    def add(self, number: int) -> None:
        self.first_vertex[number] = len(self.post_of)
        self.post_of = np.concatenate([self.post_of, self.patches[number].posts])
        self.pool.add(number, self.patches[number], self.first_vertex[number])

    def pairs(self) -> tuple[Any, Any]:
        panel = np.repeat(np.arange(len(self.cuts)), [len(cut) for cut in self.cuts])
        return panel, np.array([number for cut in self.cuts for number in cut], np.int64)

    def fans_of(self) -> list[list[Any]]:
        """Of every panel its rim triangles, as posts."""
        fans = self.pool.fans(*self.pairs(), len(self.cuts))
        assert fans.triangles.dtype == np.uint32
        assert fans.panel_first[-1] == len(fans.triangles)
        posts = self.post_of[fans.triangles].tolist()
        bounds = fans.panel_first.tolist()
        return [posts[begin:end] for begin, end in pairwise(bounds)]


def plain_fans(patches: list[Patch]) -> list[Any]:
    """The rule: every rim takes the vertices that other patches have on its edge, whoever they are."""
    found = []
    for patch in patches:
        for (apex, a, b), side in zip(patch.rims, patch.rim_side, strict=True):
            along, across = side % 2, 1 - side % 2
            low, high = sorted((int(patch.posts[a, along]), int(patch.posts[b, along])))
            line = patch.posts[a, across]
            between = set()
            for other in patches:
                # Its opposite border: bottom meets top, left meets right.
                facing = other.posts[other.sides[(side + 2) % 4].astype(int)]
                if facing[0, across] == line:
                    between |= {int(place) for place in facing[:, along] if low < place < high}
            places = sorted({low, high} | between)
            if patch.posts[a, along] > patch.posts[b, along]:
                places = places[::-1]
            ends = [(place, int(line)) if along == 0 else (int(line), place) for place in places]
            centre = tuple(patch.posts[apex].tolist())
            found += [(centre, one, two) for one, two in pairwise(ends)]
    return found


def as_tuples(triangles: list[Any]) -> list[Any]:
    return sorted(tuple(tuple(post) for post in triangle) for triangle in triangles)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_every_edge_inside_the_terrain_is_shared_by_two_triangles(seed: int) -> None:
    world = World(seed)
    for cut, fans in zip(world.cuts, world.fans_of(), strict=True):
        triangles = as_tuples(fans)
        for number in cut:
            triangles += as_tuples(world.patches[number].posts[world.patches[number].core].tolist())
        areas = [twice_area(*triangle) for triangle in triangles]
        assert min(areas, default=1) > 0
        rects = np.array([world.rects[number] for number in cut]).reshape(-1, 4)
        assert sum(areas) == 2 * ((rects[:, 2] - rects[:, 0]) * (rects[:, 3] - rects[:, 1])).sum()
        edges = Counter(edge for a, b, c in triangles for edge in ((a, b), (b, c), (c, a)))
        assert set(edges.values()) <= {1}
        alone = np.array([edge for edge in edges if edge[::-1] not in edges], dtype=float).reshape(-1, 2, 2)
        # Nobody is on the other side, which is to the right of an edge that runs counter-clockwise.
        step = np.sign(alone[:, 1] - alone[:, 0])
        beyond = alone.mean(axis=1) + np.column_stack([-step[:, 1], step[:, 0]]) * 0.25
        assert not ((beyond[:, None] > rects[:, :2]) & (beyond[:, None] < rects[:, 2:])).all(axis=2).any()


@settings(max_examples=12, deadline=None)
@given(seed=SEEDS)
def test_the_kernel_follows_the_rule(seed: int) -> None:
    world = World(seed)
    for cut, fans in zip(world.cuts, world.fans_of(), strict=True):
        assert as_tuples(fans) == sorted(plain_fans([world.patches[number] for number in cut]))


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_patches_may_come_and_go(seed: int) -> None:
    world, random = World(seed, panels=2), np.random.default_rng(seed)
    before = [as_tuples(fans) for fans in world.fans_of()]
    sizes = [world.pool.nbytes]
    for _ in range(8):
        gone = random.choice(len(world.patches), len(world.patches) // 2, replace=False).tolist()
        for number in gone:
            world.pool.remove(number)
            assert number not in world.pool
        assert len(world.pool) == len(world.patches) - len(gone)
        for number in gone[::-1]:
            world.add(number)
        assert [as_tuples(fans) for fans in world.fans_of()] == before
        sizes.append(world.pool.nbytes)
    assert max(sizes) <= 3.5 * sizes[0]  # what was freed is used again
    for number in range(len(world.patches)):
        world.pool.remove(number)
    assert len(world.pool) == 0
    assert all(kept.free for kept in (world.pool._slots, world.pool._rims, world.pool._border))


def test_own_vertices_alone_where_nobody_is_on_the_other_side() -> None:
    random = np.random.default_rng(1)
    patch = made_up_patch(random, (0, 0, 8, 8), 0.3, 3)
    pool = BorderPool()
    pool.add(5, patch, 1000)
    fans = pool.fans(np.array([1]), np.array([5]), 3)
    np.testing.assert_array_equal(fans.panel_first, [0, 0, len(patch.rims), len(patch.rims)])
    assert set(map(tuple, fans.triangles.tolist())) == set(map(tuple, (patch.rims.astype(int) + 1000).tolist()))


def test_a_patch_of_every_post_has_no_rims_and_still_cuts_its_neighbours() -> None:
    random = np.random.default_rng(2)
    fine, coarse = made_up_patch(random, (0, 0, 8, 8), 1.0, 3), made_up_patch(random, (8, 0, 16, 8), 0.0, 3)
    assert len(fine.rims) == 0
    pool = BorderPool()
    pool.add(0, fine, 0)
    pool.add(1, coarse, len(fine.posts))
    fans = pool.fans(np.zeros(2, np.int64), np.arange(2), 1)
    assert len(fans.triangles) == len(coarse.rims) + 7  # of the eight edges on the common border
    pool.remove(0)
    pool.remove(1)
    assert len(pool) == 0


def test_no_pairs_make_no_triangles() -> None:
    fans = BorderPool().fans(np.empty(0, np.int64), np.empty(0, np.int64), 2)
    assert len(fans.triangles) == 0
    np.testing.assert_array_equal(fans.panel_first, [0, 0, 0])


def test_who_is_not_there_and_who_comes_twice_is_named() -> None:
    patch = made_up_patch(np.random.default_rng(0), (0, 0, 4, 4), 0.0, 0)
    pool = BorderPool()
    with pytest.raises(KeyError, match="3"):
        pool.fans(np.array([0]), np.array([3]), 1)
    with pytest.raises(KeyError, match="3"):
        pool.remove(3)
    pool.add(3, patch, 0)
    with pytest.raises(InputError, match="patch 3 is in the pool already"):
        pool.add(3, patch, 0)
    with pytest.raises(KeyError, match="7"):
        pool.fans(np.array([0, 0]), np.array([3, 7]), 1)
