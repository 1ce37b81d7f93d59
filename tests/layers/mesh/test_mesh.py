"""Folded meshes: every vertex stands somewhere, a tighter tolerance never coarsens, budgets are kept, threads agree."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.mesh.mesh import NO_TEXTURE, Mesh, smooth_normals
from limen.data.mesh.node_kernels import add_up, cell_of
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.layers.common.contrast_scale import acuity_scale_of_contrast
from limen.layers.mesh.bend_kernels import MOMENTS, ripples, star_moments
from limen.layers.mesh.facing import SPREAD_SINES, facing_masks
from limen.layers.mesh.fold_kernels import HIDDEN, INTERIOR, SILHOUETTE, facing_of
from limen.layers.mesh.holes import visible_holes
from limen.layers.mesh.select import FoldRequest, FoldTree, select_mesh
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer


def ball(rings: int = 40, *, bumps: float = 0.02) -> Mesh:
    """A closed, bumpy ball of 1 m."""
    angle = np.linspace(0, np.pi, rings + 1)[1:-1]
    turn = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    a, t = np.meshgrid(angle, turn, indexing="ij")
    radius = 1 + bumps * np.sin(7 * t) * np.sin(9 * a)
    places = np.stack([radius * np.sin(a) * np.cos(t), radius * np.cos(a), radius * np.sin(a) * np.sin(t)], axis=-1)
    places = np.concatenate([[[0, 1, 0]], places.reshape(-1, 3), [[0, -1, 0]]]).astype(np.float32)
    around, last = 2 * rings, len(places) - 1
    triangles = [(0, 1 + (i + 1) % around, 1 + i) for i in range(around)]
    for ring in range(rings - 2):
        for i in range(around):
            one, two = 1 + ring * around + i, 1 + ring * around + (i + 1) % around
            triangles += [(one, two, two + around), (one, two + around, one + around)]
    begin = 1 + (rings - 2) * around
    triangles += [(last, begin + i, begin + (i + 1) % around) for i in range(around)]
    numbers = np.array(triangles, np.uint32)
    count = len(places)
    normals = smooth_normals(places, numbers, np.arange(count, dtype=np.uint32))
    return Mesh(
        None, places, numbers, normals, np.full((count, 4), 200, np.uint8), np.zeros((count, 2), np.float32),
        np.full(count, NO_TEXTURE, np.uint32), np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip


@cache
def a_ball():
    return FoldTree(build_vertex_tree(ball()))


VIEWS = QuiltPanels(Display.window((640, 480)), Quilt((640, 480), (0,), ((0, 0),))).seen_from(np.zeros(3))
SHARES = acuity_scale_of_contrast(100.0)


def sight(policy: str, distance_m: float = 6.0, turn: float = 0.3, *, acuity: float = 3.0, extent="displacement"):
    chosen = Policy.parse(policy)
    matrix = np.eye(4)
    matrix[:3, :3] = [[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]]
    matrix[:3, 3] = 0, 0, -distance_m
    viewers = [Viewer((0, 0, 0), gaze=(0.5, 0, -1), acuity_arcmin=acuity, eye_separation_m=0)]
    shares = SHARES if chosen.eyesight.name == "contrast" else np.ones(256)
    return FoldRequest((VIEWS,), matrix, tolerance_of(viewers, chosen.eyesight), chosen, shares, extent)


def test_all_triangles_are_left_where_nothing_is_folded():
    cut = select_mesh(a_ball(), sight("full"))
    assert np.array_equal(cut.triangles, a_ball().tree.triangles)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(1.5, 60.0), st.floats(0, 6.3), st.sampled_from(["acuity", "contrast", "contrast+gaze"]),
    st.sampled_from(["support", "displacement"]),
)  # fmt: skip
def test_every_vertex_stands_in_one_node_above_it_and_triangles_are_those_of_three(distance_m, turn, policy, extent):
    cut = select_mesh(a_ball(), sight(policy, distance_m, turn, extent=extent))
    tree = a_ball().tree
    state = cut.state[:-1]
    stands = state[: tree.vertices]
    assert (state[stands] == stands).all()
    above = np.arange(tree.vertices)
    reached = above == stands
    while not reached.all():
        above = np.where(reached, above, tree.parent[above])
        assert (above >= 0).all()
        reached |= above == stands
    corners = stands[tree.triangles]
    kept = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    assert np.array_equal(cut.triangles, kept)
    assert cut.reached <= cut.limit


@settings(max_examples=30, deadline=None)
@given(
    st.floats(2.0, 60.0), st.floats(0, 6.3), st.sampled_from(["acuity", "contrast", "contrast+gaze"]), st.floats(1, 8)
)
def test_a_tighter_tolerance_never_coarsens(distance_m, turn, policy, looser):
    fine = select_mesh(a_ball(), sight(policy, distance_m, turn, acuity=1.0)).state[:-1]
    coarse = select_mesh(a_ball(), sight(policy, distance_m, turn, acuity=looser)).state[:-1]
    # What stands for a vertex in the fine cut is itself below what stands for it in the coarse one.
    stands = fine[: a_ball().tree.vertices]
    assert np.array_equal(coarse[stands], coarse[: a_ball().tree.vertices])


@settings(max_examples=20, deadline=None)
@given(st.floats(2.0, 30.0), st.integers(4, 7000), st.sampled_from(["budget", "budget+gaze", "size"]))
def test_a_budget_is_kept_and_a_larger_one_folds_less(distance_m, most, policy):
    cut, more = (select_mesh(a_ball(), sight(f"{policy}:{number}", distance_m)) for number in (most, 2 * most))
    assert len(cut) <= most
    assert more.limit <= cut.limit
    assert len(more) >= len(cut)


def test_threads_do_not_change_the_cut():
    one, three = (select_mesh(a_ball(), sight("contrast", 20.0), threads=threads) for threads in (1, 3))
    assert np.array_equal(one.triangles, three.triangles)


def test_silhouettes_keep_more_than_what_is_inside():
    smooth = FoldTree(build_vertex_tree(ball(bumps=0.0)))
    cut = select_mesh(smooth, sight("budget:2000", 15.0))
    folded = cut.state[smooth.tree.vertices : -1] == np.arange(smooth.tree.vertices, len(smooth.tree.position))
    moved = [smooth.tree.displacement[folded & (cut.faces == kind)].max() for kind in (HIDDEN, INTERIOR, SILHOUETTE)]
    assert moved[SILHOUETTE] < moved[INTERIOR]
    assert moved[SILHOUETTE] < moved[HIDDEN]


def test_less_is_left_than_by_the_papers_own_extent():
    ours, papers = (
        len(select_mesh(a_ball(), sight("contrast", 20.0, extent=each))) for each in ("displacement", "support")
    )
    assert ours < papers


# ---------------------------------------------------------------------- parts


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_no_silhouette_is_missed(seed):
    """Whatever the masks call hidden or inside is so, for all its normals and all directions within its angle."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=3) + rng.uniform(0.05, 0.7) * rng.normal(size=(12, 3))
    mask = np.zeros(6, np.uint64)
    for normal in normals:
        cell = int(cell_of(*normal))
        mask[cell >> 6] |= np.uint64(1) << np.uint64(cell & 63)
    toward = rng.normal(size=3)
    sine = float(rng.uniform(0, SPREAD_SINES[-1]))
    masks = facing_masks()
    facing = facing_of(mask[None], 0, masks.front, masks.back, *toward, sine, SPREAD_SINES)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    tilt = np.arcsin(np.clip(unit @ toward / np.linalg.norm(toward), -1, 1))
    margin = math.asin(sine)
    if facing == HIDDEN:
        assert (tilt <= -margin + 1e-9).all()
    if facing == INTERIOR:
        assert (tilt >= margin - 1e-9).all()


def plain_ripples2(parent, places, normals, area, triangles):
    """Of every inner node: fit the bend to its region, then the variance about it, child by child."""
    vertices = len(places)
    below = [{v} if v < vertices else set() for v in range(len(parent))]
    children = [[] for _ in parent]
    for node, above in enumerate(parent):
        if above >= 0:
            below[above] |= below[node]
            children[above].append(node)

    def mean(node, values):
        numbers = sorted(below[node])
        return np.average(values[numbers], axis=0, weights=area[numbers])

    found = np.zeros(len(parent))
    for node in range(vertices, len(parent)):
        corners = [(corner, weight) for v in below[node] for t, weight in triangles if v in t for corner in t]
        numbers, weights = np.array([v for v, _ in corners]), np.array([w for _, w in corners])
        x = places[numbers] - np.average(places[numbers], axis=0, weights=weights)
        n = normals[numbers] - np.average(normals[numbers], axis=0, weights=weights)
        spread = np.einsum("i,ia,ib->ab", weights, x, x) / weights.sum()
        spread += 1e-4 * np.trace(spread) * np.eye(3)
        bend = np.linalg.solve(spread, np.einsum("i,ia,ib->ab", weights, x, n) / weights.sum())
        for child in children[node]:
            share = area[sorted(below[child])].sum() / area[sorted(below[node])].sum()
            left = mean(child, normals) - mean(node, normals) - (mean(child, places) - mean(node, places)) @ bend
            found[node] += share * (left @ left + found[child])
    return found


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_ripples_are_what_is_left_of_normals_beside_the_bend_of_their_region(seed):
    rng = np.random.default_rng(seed)
    places, normals = rng.normal(size=(12, 3)), rng.normal(size=(12, 3))
    triangles = np.array(
        [rng.permutation(12)[:3] for _ in range(14)] + [[v, (v + 1) % 12, (v + 5) % 12] for v in range(12)]
    )
    parent = np.full(17, -1, np.int32)
    parent[:12], parent[12:16] = rng.integers(12, 16, 12), 16
    parent[:4] = np.arange(12, 16)  # none is without children
    area = rng.random(12) + 0.1
    region, own, ripple2 = np.zeros((17, MOMENTS)), np.zeros((17, 7)), np.zeros(17)
    star_moments(triangles.astype(np.uint32), places, normals, region)
    own[:12] = np.column_stack([area, area[:, None] * places, area[:, None] * normals])
    add_up(parent, region)
    add_up(parent, own)
    ripples(parent, region, own, ripple2)
    sizes = np.linalg.norm(
        np.cross(places[triangles[:, 1]] - places[triangles[:, 0]], places[triangles[:, 2]] - places[triangles[:, 0]]),
        axis=1,
    )
    expected = plain_ripples2(parent, places, normals, area, list(zip(triangles.tolist(), sizes, strict=True)))
    np.testing.assert_allclose(ripple2, expected, rtol=1e-6, atol=1e-9)


def test_what_bends_steadily_does_not_ripple_and_what_ripples_does():
    def middle_ripple(bumps):
        foldable = FoldTree(build_vertex_tree(ball(60, bumps=bumps)))
        return float(np.median(foldable.ripple[: len(foldable.ripple) // 2]))

    assert 100 * middle_ripple(0.0) < 0.005 < middle_ripple(0.05)


def test_a_closed_surface_hides_its_back_and_one_with_a_hole_from_one_side_only():
    closed = ball()
    open_below = Mesh(
        None, closed.positions, closed.triangles[closed.positions[closed.triangles, 1].min(axis=1) > -0.8],
        closed.normals, closed.colours, closed.uv, closed.layers, closed.textures,
    )  # fmt: skip
    whole, holed = a_ball().covers, FoldTree(build_vertex_tree(open_below)).covers
    above, below = np.array([0.0, 5, 0]), np.array([0.0, -5, 0])
    assert not len(visible_holes(whole, above))
    assert not len(visible_holes(whole, below))
    assert not len(visible_holes(holed, above))
    ((x, y, z, half),) = visible_holes(holed, below)
    np.testing.assert_allclose([x, y, z], [0, 1, 0], atol=0.05)
    assert half == pytest.approx(math.asin(0.6 / math.hypot(4.2, 0)), rel=0.1)  # the rim is 0.6 m about y = -0.8 m
    assert visible_holes(holed, np.array([0, -0.9, 0]))[0, 3] == np.pi, "an eye in the hole sees all of the inside"
    assert visible_holes(None, above)[0, 3] == np.pi, "what is no surface hides nothing"


def test_what_is_seen_through_a_hole_folds_as_late_as_the_front():
    closed = ball()
    heights = closed.positions[closed.triangles, 1]
    holed = FoldTree(build_vertex_tree(replace(closed, triangles=closed.triangles[heights.min(axis=1) > -0.5])))
    below = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, -6.0], [0, 0, 0, 1]])  # its lower side to the eye
    chosen = Policy.parse("contrast", 3.0)
    tolerance = tolerance_of([Viewer((0, 0, 0), eye_separation_m=0.0)], chosen)
    left = []
    for foldable in (holed, a_ball()):
        cut = select_mesh(foldable, FoldRequest((VIEWS,), below, tolerance, chosen, SHARES))
        top = foldable.tree.middle[:, 1] > 0.3
        assert (cut.faces[top] == HIDDEN).any()
        left.append(int((cut.state[foldable.tree.vertices : -1][top] == -1).sum()))
    assert left[0] > left[1] > 0


def test_a_mesh_of_several_parts_folds():
    knot = torus_knot(2000)
    foldable = FoldTree(build_vertex_tree(knot))
    assert len(select_mesh(foldable, sight("budget:500", 4.0))) <= 500


def test_what_passes_is_folded_further_than_what_comes_near() -> None:
    still = sight("contrast")
    past, toward = np.zeros((2, 1, 3, 4))
    past[0, 0, 3] = toward[0, 2, 3] = 2.0
    tolerances = [still.tolerance, *(replace(still.tolerance, motion=each) for each in (toward, past))]
    counts = [len(select_mesh(a_ball(), replace(still, tolerance=each))) for each in tolerances]
    assert counts[0] >= counts[1] > counts[2] > 0
