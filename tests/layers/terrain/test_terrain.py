"""The cut of a terrain: its laws, the bound of its error, and the kernel against the rules in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from limen.data.terrain.model import Nodes, PatchTable
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.terrain import kernels
from limen.layers.terrain.forms import terrain_forms
from limen.layers.terrain.select import Mode, TerrainCut, select_terrain
from support.made_up_terrain import Scene, made_up_scene, made_up_terrain

SEEDS = st.integers(0, 10_000)
ALLOWED = st.lists(st.floats(0.5, 300), min_size=2, max_size=2).map(np.array)
MODES: Any = st.sampled_from(["adaptive", "level"])
laws = settings(max_examples=20, deadline=None)


def cut_of(seed: int, allowed_px: Floats, **more: Any) -> tuple[Nodes, PatchTable, Scene, TerrainCut]:
    nodes, patches = made_up_terrain(seed)
    scene = made_up_scene(seed)
    cut = select_terrain(
        nodes, patches, scene.views, scene.quilt_size_px, scene.room_from_posts, allowed_px, **more
    )  # fmt: skip
    return nodes, patches, scene, cut


def some_available(patches: PatchTable, seed: int) -> Any:
    return np.random.default_rng(seed).random(len(patches.error_m)) < 0.7


def places_in(nodes: Nodes, node: int, random: np.random.Generator, count: int = 40) -> Floats:
    """Places inside a node's box, off the borders that it shares with its neighbours."""
    low, high = nodes.low_high_m[node]
    c0, r0, c1, r1 = nodes.rect[node]
    return np.asarray(random.uniform([c0, r0, low], [c1, r1, high], (count, 3)))


@laws
@given(seed=SEEDS, allowed=ALLOWED, mode=MODES, restricted=st.booleans())
def test_what_a_panel_sees_lies_in_one_node_each(seed: int, allowed: Floats, mode: Mode, restricted: bool) -> None:
    nodes, patches = made_up_terrain(seed)
    available = some_available(patches, seed) if restricted else None
    nodes, patches, scene, cut = cut_of(seed, allowed, mode=mode, available=available)
    random = np.random.default_rng(seed)
    for panel in range(2):
        chosen = nodes.rect[patches.node[cut.pair_patch[cut.pair_panel == panel]]]
        # A leaf's heights lie within those of all nodes above it, so what is seen of it is seen of them.
        places = np.concatenate([places_in(nodes, leaf, random, 12) for leaf in np.flatnonzero(nodes.is_leaf)])
        seen = places[scene.sees(panel, places)][:, None, :2]
        holding = ((seen > chosen[:, :2]) & (seen < chosen[:, 2:])).all(axis=2).sum(axis=1)
        assert (holding == 1).all()


@laws
@given(seed=SEEDS, allowed=ALLOWED, mode=MODES)
def test_no_panel_errs_by_more_than_allowed(seed: int, allowed: Floats, mode: Mode) -> None:
    cut = cut_of(seed, allowed, mode=mode)[3]
    assert (cut.panel_error_px <= allowed).all()
    assert (np.diff(cut.pair_panel) >= 0).all()
    for panel in range(2):
        errors = cut.pair_error_px[cut.pair_panel == panel]
        assert cut.panel_error_px[panel] == (errors.max() if len(errors) else 0)


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, share=st.floats(0, 1))
def test_a_displaced_place_moves_no_farther_than_the_bound(seed: int, share: float) -> None:
    nodes, _ = made_up_terrain(seed % 7)
    scene, random = made_up_scene(seed), np.random.default_rng(seed)
    node = int(random.integers(len(nodes.rect)))
    low, high = (float(height) for height in nodes.low_high_m[node])
    error_m = share * (high - low)
    true = places_in(nodes, node, random, 400)
    drawn = true.copy()
    drawn[:, 2] = np.clip(drawn[:, 2] + random.choice([-error_m, error_m], len(true)), low, high)
    forms = terrain_forms(scene.views, scene.quilt_size_px, scene.room_from_posts)
    c0, r0, c1, r1 = (float(part) for part in nodes.rect[node])
    for panel in range(2):
        least, seen = kernels.nearest_w(np.array([c0, r0, low, c1, r1, high]), panel, forms)
        for one, other in ((true, drawn), (drawn, true)):
            shown = scene.sees(panel, one)
            assert seen >= 0 or not shown.any()
            here, w = scene.pixel(panel, one)
            there, w_there = scene.pixel(panel, other)
            assert (w[shown] >= seen * (1 - 1e-9)).all()
            shown &= w_there > scene.views.near[panel]
            if not shown.any():
                continue
            moved = np.linalg.norm(here - there, axis=1)[shown]
            bound = kernels.error_px(error_m, panel, forms, least, seen)
            assert moved.max() <= bound * (1 + 1e-9) + 1e-9
            permitted = kernels.permitted_m(bound, panel, forms, least, seen)
            assert permitted == pytest.approx(error_m, rel=1e-6, abs=1e-9)


def test_the_bound_is_near_what_happens() -> None:
    """Of places one by one: a bound that is never exceeded could also be far too large."""
    reached = []
    for seed in range(40):
        scene = made_up_scene(seed)
        forms = terrain_forms(scene.views, scene.quilt_size_px, scene.room_from_posts)
        places = np.random.default_rng(seed).uniform([0, 0, 0], [512, 256, 100], (2000, 3))
        for place in places[scene.sees(0, places)][:10]:
            moved = np.linalg.norm(scene.pixel(0, place + np.array([0, 0, 0.1]))[0] - scene.pixel(0, place)[0])
            least, seen = kernels.nearest_w(np.array([*place - 0.1, *place + 0.1]), 0, forms)
            reached.append(moved / kernels.error_px(0.1, 0, forms, least, seen))
    assert len(reached) > 200
    assert np.median(reached) > 0.9


def node_errors(nodes: Nodes, patches: PatchTable, cut: TerrainCut, panel: int) -> Floats:
    """Error in metres of what is drawn at the middle of every leaf, infinite where nothing is: shape (leaves,)."""
    middle = nodes.rect[nodes.is_leaf].reshape(-1, 2, 2).mean(axis=1)
    chosen = cut.pair_patch[cut.pair_panel == panel]
    rect = nodes.rect[patches.node[chosen]]
    inside = ((middle[:, None] > rect[:, :2]) & (middle[:, None] < rect[:, 2:])).all(axis=2)
    errors = np.where(inside, patches.error_m[chosen], np.inf)
    return np.asarray(errors.min(axis=1, initial=np.inf))


@laws
@given(seed=SEEDS, allowed=ALLOWED, tighter=st.floats(0.01, 1), mode=MODES, restricted=st.booleans())
def test_a_tighter_tolerance_never_coarsens(
    seed: int, allowed: Floats, tighter: float, mode: Mode, restricted: bool
) -> None:
    nodes, patches = made_up_terrain(seed)
    available = some_available(patches, seed) if restricted else None
    loose = cut_of(seed, allowed, mode=mode, available=available)[3]
    tight = cut_of(seed, allowed * tighter, mode=mode, available=available)[3]
    for panel in range(2):
        both = [node_errors(nodes, patches, cut, panel) for cut in (loose, tight)]
        there = np.isfinite(both[1])  # finer boxes are smaller, so a panel may turn out not to see some
        assert (both[1][there] <= both[0][there]).all()


@laws
@given(seed=SEEDS, allowed=ALLOWED, other=st.floats(0.5, 300) | st.just(np.inf), mode=MODES)
def test_what_one_panel_may_is_no_matter_of_another(seed: int, allowed: Floats, other: float, mode: Mode) -> None:
    one, two = (cut_of(seed, part, mode=mode)[3] for part in (allowed, np.array([allowed[0], other])))
    first = [cut.pair_panel == 0 for cut in (one, two)]
    np.testing.assert_array_equal(one.pair_patch[first[0]], two.pair_patch[first[1]])
    np.testing.assert_array_equal(one.pair_error_px[first[0]], two.pair_error_px[first[1]])
    assert other < np.inf or not (two.pair_panel == 1).any()


@laws
@given(seed=SEEDS, allowed=ALLOWED)
def test_one_level_a_panel_is_what_its_most_demanding_leaf_needs(seed: int, allowed: Floats) -> None:
    nodes, patches, scene, adaptive = cut_of(seed, allowed)
    level = cut_of(seed, allowed, mode="level")[3]
    forms = terrain_forms(scene.views, scene.quilt_size_px, scene.room_from_posts)
    low, high = nodes.low_high_m.astype(float).T
    boxes = np.column_stack([nodes.rect[:, :2], low, nodes.rect[:, 2:], high])
    for panel in range(2):
        bounds = [kernels.nearest_w(box, panel, forms) for box in boxes]
        demand = min(
            (
                kernels.permitted_m(allowed[panel], panel, forms, *bounds[leaf])
                for leaf in np.flatnonzero(nodes.is_leaf)
                if bounds[leaf][1] >= 0
            ),
            default=np.inf,
        )
        for patch in level.pair_patch[level.pair_panel == panel]:
            assert patches.error_m[patch] <= demand
            node = patches.node[patch]
            if patch > nodes.first_patch[node]:
                # But where a node's box is too large to vouch for all of its places, nothing coarser would do.
                coarser = float(patches.error_m[patch - 1])
                assert coarser > demand or kernels.error_px(coarser, panel, forms, *bounds[node]) > allowed[panel]
        one, many = (node_errors(nodes, patches, cut, panel) for cut in (level, adaptive))
        there = np.isfinite(one) & np.isfinite(many)
        assert (one[there] <= many[there]).all()


def plain_cut(
    nodes: Nodes, patches: PatchTable, scene: Scene, allowed: Floats, level_m: Any, available: Any
) -> list[tuple[int, int]]:
    """The rules, one box's corner at a time; pairs in no order that matters."""
    room = scene.room_from_posts
    metre = room[:3, 2]

    def box(node: int) -> Floats:
        c0, r0, c1, r1 = nodes.rect[node]
        low, high = nodes.low_high_m[node]
        return np.array([(c, r, z) for c in (c0, c1) for r in (r0, r1) for z in (low, high)], dtype=float)

    def bounds(panel: int, node: int) -> tuple[float, float]:
        ways = scene.placed(box(node))
        views = scene.views
        w = ways @ views.clip[panel, 2]
        if ((ways @ views.edges[panel].T) < 0).all(axis=0).any() or w.max() <= views.near[panel]:
            return 0.0, -1.0
        eye = np.linalg.solve(room[:3, :3], views.eye_m - room[:3, 3])
        closest = np.clip(eye, box(node).min(axis=0), box(node).max(axis=0))
        distance = float(np.linalg.norm(scene.placed(closest)))
        corners = views.corners[panel, : views.corner_count[panel]]
        cosine = float((corners @ views.clip[panel, 2]).min())
        return float(w.min()), max(float(w.min()), distance * cosine, float(views.near[panel]))

    def pixels(panel: int, error: float, least: float, seen: float) -> float:
        views, half = scene.views, np.array(scene.quilt_size_px) / 2
        largest = 0.0
        for corner in views.corners[panel, : views.corner_count[panel]]:
            x, y, w = views.clip[panel] @ corner
            moved = views.clip[panel, :2] @ metre - np.array([x, y]) / w * (views.clip[panel, 2] @ metre)
            largest = max(largest, float(np.linalg.norm(moved * half)))
        return error * largest / max(seen - error * abs(float(views.clip[panel, 2] @ metre)), least, 1e-9)

    def choice(panel: int, node: int, least: float, seen: float) -> tuple[int, bool]:
        finest = -1
        for patch in range(nodes.first_patch[node], nodes.first_patch[node + 1]):
            root_first = node < nodes.roots and patch == nodes.first_patch[node]
            if available[patch] or root_first:
                finest = patch
                error = float(patches.error_m[patch])
                fits = pixels(panel, error, least, seen) <= allowed[panel]
                if fits if level_m is None else error <= level_m[panel]:
                    return patch, True
        return finest, False

    def visit(panel: int, node: int) -> list[tuple[int, int]]:
        least, seen = bounds(panel, node)
        if seen < 0:
            return []
        patch, enough = choice(panel, node, least, seen)
        below = [int(child) for child in nodes.children[node] if child >= 0]
        visible = [child for child in below if bounds(panel, child)[1] >= 0]
        ready = all(choice(panel, child, 0.0, 1.0)[0] >= 0 for child in visible)
        if enough or not below or not ready:
            return [(panel, patch)]
        return [pair for child in visible for pair in visit(panel, child)]

    return [pair for panel in range(2) for root in range(nodes.roots) for pair in visit(panel, root)]


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("restricted", [False, True])
def test_the_kernel_follows_the_rules(seed: int, restricted: bool) -> None:
    nodes, patches = made_up_terrain(seed)
    allowed = np.array([3.0, 40.0]) * 2.0 ** (seed % 4)
    available = some_available(patches, seed) if restricted else np.ones(len(patches.error_m), bool)
    scene, cut = cut_of(seed, allowed, available=available)[2:]
    pairs = list(zip(cut.pair_panel.tolist(), cut.pair_patch.tolist(), strict=True))
    expected = plain_cut(nodes, patches, scene, allowed, None, available)
    assert sorted(pairs) == sorted((int(panel), int(patch)) for panel, patch in expected)


@laws
@given(seed=SEEDS, allowed=ALLOWED)
def test_what_a_cut_calls_needed_is_enough_to_draw_it(seed: int, allowed: Floats) -> None:
    """Nodes on the way included, whatever else is not resident; and fetched in order, nothing gets worse."""
    # One panel: to another, what the first needs may be finer than what it takes for itself later.
    allowed = np.array([allowed[0], np.inf])
    nodes, patches, _, cut = cut_of(seed, allowed)
    assert len(set(cut.patches)) == len(cut.patches)
    assert set(cut.pair_patch) <= set(cut.patches)
    assert (np.diff(cut.importance) <= 0).all()
    resident = np.zeros(len(patches.error_m), bool)
    resident[cut.patches] = True
    again = cut_of(seed, allowed, available=resident)[3]
    np.testing.assert_array_equal(again.pair_patch, cut.pair_patch)
    before = [np.full(nodes.is_leaf.sum(), np.inf)] * 2
    for known in np.linspace(0, len(cut.patches), 5).astype(int):
        resident[:] = False
        resident[cut.patches[:known]] = True
        partly = cut_of(seed, allowed, available=resident)[3]
        now = [node_errors(nodes, patches, partly, panel) for panel in range(2)]
        assert all((new <= old)[np.isfinite(new)].all() for new, old in zip(now, before, strict=True))
        before = now


@laws
@given(seed=SEEDS, allowed=ALLOWED, share=st.floats(0.05, 0.95), mode=MODES)
def test_a_budget_is_kept_by_larger_errors(seed: int, allowed: Floats, share: float, mode: Mode) -> None:
    nodes, patches, _, free = cut_of(seed, allowed, mode=mode)
    coarsest = cut_of(seed, np.full(2, 1e30), mode=mode)[3].triangles
    most = max(int(free.triangles * share), coarsest)
    assume(0 < most < free.triangles)
    cut = cut_of(seed, allowed, mode=mode, max_triangles=most)[3]
    assert cut.triangles <= most
    assert cut.bias_octaves > 0
    assert free.bias_octaves == 0
    for panel in range(2):
        errors = [node_errors(nodes, patches, part, panel) for part in (free, cut)]
        there = np.isfinite(errors[0])
        assert (errors[0][there] <= errors[1][there]).all()
    assert cut.denied == max(len(free.patches) - len(cut.patches), 0)


def test_zero_error_is_every_post_and_still_has_a_budget() -> None:
    _, patches, _, exact = cut_of(4, np.zeros(2))
    assert len(exact)
    assert (patches.error_m[exact.pair_patch] == 0).all()
    cut = cut_of(4, np.zeros(2), max_triangles=exact.triangles // 2)[3]
    assert 0 < cut.triangles <= exact.triangles // 2


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"allowed_px": np.array([1.0])}, "one number for each of 2 panels"),
        ({"allowed_px": np.array([1.0, -1.0])}, "must not be negative"),
        ({"allowed_px": np.array([1.0, np.nan])}, "must not be negative, and be a number"),
        ({"mode": "both"}, "adaptive, level"),
        ({"available": np.ones(3, bool)}, "available must tell of"),
        ({"max_triangles": 0}, "at least 1"),
        ({"room_from_posts": np.eye(3)}, "shape"),
        ({"room_from_posts": np.eye(4) + np.eye(4, k=1)}, "right angles"),
        ({"room_from_posts": np.diag([1.0, 1, 0, 1])}, "spacings above 0"),
    ],
)
def test_wrong_input_is_named(wrong: dict[str, Any], message: str) -> None:
    nodes, patches = made_up_terrain(0)
    scene = made_up_scene(0)
    given_ = {"room_from_posts": scene.room_from_posts, "allowed_px": np.ones(2)} | wrong
    with pytest.raises(InputError, match=message):
        select_terrain(nodes, patches, scene.views, scene.quilt_size_px, **given_)
