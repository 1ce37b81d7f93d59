"""Cuts of clouds: as the definition says, every point once, never coarser for a tighter tolerance, budgets kept."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.points.nodes import (
    ALL_AROUND,
    CHUNK_LEVEL,
    CHUNK_NODES,
    FAN,
    LEVEL_BEGIN,
    NODE,
    half_angle_deg,
    radius_of_code,
    unpacked_normal,
)
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.layers.common.contrast_scale import acuity_scale_of_contrast
from limen.layers.points.select import TOP_ITEM, PointsRequest, PointTree, ResidentNodes, select_points
from limen.viewing.policy import Policy
from limen.viewing.projection import PanelProjections, QuiltPanels
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer
from support.clouds import ball


@cache
def a_ball():
    return ball()


@cache
def tree():
    return PointTree.of(a_ball())


@cache
def nodes():
    return np.stack([a_ball().read_chunk(chunk) for chunk in range(a_ball().chunks)])


@cache
def every_node():
    return ResidentNodes(
        np.ascontiguousarray(nodes()).view(np.uint32).reshape(a_ball().chunks, CHUNK_NODES, 4),
        np.arange(a_ball().chunks, dtype=np.int32),
    )


SHARES = acuity_scale_of_contrast(100.0)


def views_of(size_px=(640, 480), eye_m=(0.0, 0.0, 0.0)) -> PanelProjections:
    display = Display.window(size_px)
    return QuiltPanels(display, Quilt(size_px, (0,), ((0, 0),))).seen_from(np.array(eye_m))


def standing(distance_m: float, turn: float = 0.0, size: float = 1.0):
    matrix = np.eye(4)
    matrix[:3, :3] = size * np.array(
        [[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]]
    )
    matrix[:3, 3] = 0, 0, -distance_m
    return matrix


def sight(policy: str, distance_m: float = 3.0, turn: float = 0.0, viewers=None, lit: bool = True) -> PointsRequest:
    chosen = Policy.parse(policy)
    viewers = [Viewer((0, 0, 0), gaze=(0.3, 0, -1), eye_separation_m=0)] if viewers is None else viewers
    shares = SHARES if chosen.eyesight.name == "contrast" else np.ones(256)
    tolerance = tolerance_of(viewers, chosen.eyesight)
    return PointsRequest(views_of(), standing(distance_m, turn), tolerance, chosen, shares, lit)


# ---------------------------------------------------------------------- the definition, in plain NumPy


def place_of(item: int):
    """Centre, radius, normal (or None), half angle and code of an item, in the cloud's coordinates."""
    if item & TOP_ITEM:
        row = np.concatenate(a_ball().tops)[item ^ TOP_ITEM]
        centre, radius = row["place"].astype(float), float(row["radius"])
    else:
        chunk, node = divmod(item, CHUNK_NODES)
        row = nodes()[chunk, node]
        origin, step, widest = (each[chunk] for each in a_ball().frames)
        centre = origin + step * row["place"].astype(float)
        radius = float(radius_of_code(row["radius"], widest))
    normal = None if row["cone"] == ALL_AROUND else unpacked_normal(row["normal"])
    return centre, radius, normal, math.radians(float(half_angle_deg(row["cone"]))), int(row["contrast"])


def children_of(item: int) -> list[int]:
    """Items one level below; the empty list of a point."""
    if item & TOP_ITEM:
        row = item ^ TOP_ITEM
        level = int(np.searchsorted(tree().level_first, row, side="right")) - 1
        index = row - int(tree().level_first[level])
        if level:
            last = min(FAN * index + FAN, int(tree().level_count[level - 1]))
            return [TOP_ITEM | int(tree().level_first[level - 1]) + child for child in range(FAN * index, last)]
        chunk, level, index = index, CHUNK_LEVEL, 0
    else:
        chunk, node = divmod(item, CHUNK_NODES)
        level = next(level for level in range(CHUNK_LEVEL + 1) if node >= LEVEL_BEGIN[level])
        index = node - LEVEL_BEGIN[level]
    if level == 0:
        return []
    held = -(-a_ball().points_of_chunk(chunk) // FAN ** (level - 1))
    begin = LEVEL_BEGIN[level - 1]
    return [chunk * CHUNK_NODES + begin + child for child in range(FAN * index, min(FAN * index + FAN, held))]


def k_of(item: int, seen: PointsRequest) -> float:
    """-1 where it is skipped."""
    centre, radius, normal, half, code = place_of(item)
    way = seen.way_from_cloud
    d, radius = way[:, :3] @ centre + way[:, 3], radius * seen.size
    views = seen.views
    for edge in views.edges[0]:
        if edge @ d < -radius * np.linalg.norm(edge):
            return -1
    n = views.clip[0, 2]
    if n @ d < -radius:
        return -1
    along = views.edges[0] - np.outer(views.edges[0] @ n, n)
    deep = n @ d - radius
    pixels = math.inf if deep <= 0 else 2 * radius * np.linalg.norm(along, axis=1).max() / deep
    away = np.linalg.norm(d)
    by_eyes = len(seen.tolerance.tan_angle) and seen.policy.name not in ("full", "size")
    if normal is not None and away > radius:
        turned = way[:, :3] @ normal / seen.size
        tilt, margin = math.asin(np.clip(-turned @ d / away, -1, 1)), math.asin(radius / away)
        if tilt < -(half + margin):
            return -1
        if abs(tilt) <= half + margin:
            code = 255
    else:
        code = 255
    if not by_eyes:
        return pixels
    t = seen.tolerance
    allowed = math.inf
    for eye, tan, gaze, slack in zip(t.eyes_m, t.tan_angle, t.gaze, t.slack_deg, strict=True):
        to = d + views.eye_m - eye
        far = np.linalg.norm(to)
        if far <= radius:
            allowed = 0.0
            continue
        beside = 0.0
        if gaze.any():
            angle = math.acos(np.clip(to @ gaze / far, -1, 1)) - math.asin(radius / far)
            beside = max(math.degrees(angle) - slack, 0)
        allowed = min(allowed, (far - radius) * tan * (1 + 0.1 * beside))
    extent = 2 * radius * seen.shares[code]
    return 0.0 if extent == 0 else pixels if allowed <= 0 else min(pixels, extent / allowed)


def plain_cut(seen: PointsRequest, limit: float = 1.0) -> set[int]:
    root = TOP_ITEM | int(tree().level_first[-1])
    pending, drawn = [root], set()
    while pending:
        item = pending.pop()
        k = k_of(item, seen)
        if k < 0:
            continue
        below = children_of(item)
        if k <= limit or not below:
            drawn.add(item)
        else:
            pending += below
    return drawn


def as_nodes(items) -> set[int]:
    """Tops of level 4 are also node 0 of their chunk: one name for both."""
    return {int(item) for item in items}


@pytest.mark.parametrize("policy", ["full", "acuity", "contrast", "acuity+gaze", "contrast+gaze"])
def test_the_cut_is_what_the_definition_says(policy):
    seen = sight(policy, distance_m=6.0, turn=0.4, lit=False)
    cut = select_points(tree(), every_node(), seen)
    expected = plain_cut(seen)
    found = as_nodes(cut.pairs[:, 0])
    assert len(cut) == len(found) > 100
    # Places are float32 here and float64 there: a node at the very threshold may fall either way.
    assert len(found ^ expected) <= 0.002 * len(expected)


# ---------------------------------------------------------------------- laws


def leaves_below(item: int) -> list[int]:
    """Points below an item, as their items."""
    below = children_of(item)
    return [item] if not below else [leaf for child in below for leaf in leaves_below(child)]


def test_every_point_in_sight_is_covered_once_and_no_other_node_twice():
    seen = sight("contrast", distance_m=4.0)
    covered = [
        leaf for item in as_nodes(select_points(tree(), every_node(), seen).pairs[:, 0]) for leaf in leaves_below(item)
    ]
    assert len(covered) == len(set(covered))
    visible = {
        chunk * CHUNK_NODES + LEVEL_BEGIN[0] + point
        for chunk in range(a_ball().chunks)
        for point in range(a_ball().points_of_chunk(chunk))
        if k_of(chunk * CHUNK_NODES + LEVEL_BEGIN[0] + point, seen) >= 0
    }
    assert visible <= set(covered)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(1.5, 40.0), st.floats(0, 6.3), st.sampled_from(["acuity", "contrast", "contrast+gaze"]), st.floats(1, 5)
)
def test_a_tighter_tolerance_never_coarsens(distance_m, turn, policy, looser):
    tight = sight(policy, distance_m, turn)
    loose = PointsRequest(
        tight.views, tight.room_from_cloud,
        tolerance_of([Viewer((0, 0, 0), gaze=(0.3, 0, -1), eye_separation_m=0, acuity_arcmin=0.64 * looser)],
                     tight.policy),
        tight.policy, tight.shares,
    )  # fmt: skip
    fine, coarse = (as_nodes(select_points(tree(), every_node(), each).pairs[:, 0]) for each in (tight, loose))
    assert len(coarse) <= len(fine)
    # Nothing that the tight cut draws lies strictly above what the loose one draws.
    strictly = {ancestor for item in coarse for ancestor in ancestors_of(item)}
    assert not (fine & strictly)


def ancestors_of(item: int) -> list[int]:
    return parents()[item]


@cache
def parents() -> dict[int, list[int]]:
    found: dict[int, list[int]] = {TOP_ITEM | int(tree().level_first[-1]): []}
    pending = list(found)
    while pending:
        item = pending.pop()
        for child in children_of(item):
            found[child] = [*found[item], item]
            pending.append(child)
    return found


@settings(max_examples=20, deadline=None)
@given(st.floats(1.5, 40.0), st.integers(1, 30_000), st.sampled_from(["budget", "budget+gaze", "size"]))
def test_a_budget_is_kept_and_what_it_draws_is_the_cut_at_its_limit(distance_m, most, policy):
    seen = sight(f"{policy}:{most}", distance_m)
    cut = select_points(tree(), every_node(), seen)
    assert len(cut) <= most
    assert cut.reached <= cut.limit


def test_more_budget_is_nearer_to_all_points():
    limits = [select_points(tree(), every_node(), sight(f"budget:{most}")).limit for most in (200, 1000, 5000)]
    assert limits == sorted(limits, reverse=True)
    assert limits[0] > 2 * limits[-1]


def test_threads_do_not_change_the_cut():
    seen = sight("contrast", distance_m=2.0)
    one, four = (select_points(tree(), every_node(), seen, threads=threads) for threads in (1, 4))
    assert np.array_equal(one.pairs, four.pairs)
    assert np.array_equal(one.wanted, four.wanted)


def test_what_is_not_resident_is_drawn_as_its_top_and_asked_for():
    nothing = ResidentNodes(every_node().words, np.full(a_ball().chunks, -1, np.int32))
    cut = select_points(tree(), nothing, sight("acuity"))
    assert (cut.pairs[:, 0] & TOP_ITEM).all()
    assert len(cut.wanted) > 1
    assert cut.reached > 1
    assert set(cut.wanted) == set(select_points(tree(), every_node(), sight("acuity")).wanted)


def test_the_more_viewers_the_finer():
    alone = [Viewer((0, 0, 0), acuity_arcmin=20, eye_separation_m=0)]
    together = [*alone, Viewer((0, 0, -15), acuity_arcmin=20, eye_separation_m=0)]
    one, two = (
        len(select_points(tree(), every_node(), sight("acuity", 20.0, viewers=each))) for each in (alone, together)
    )
    assert two > one


def test_normals_lit_differently_make_contrast():
    assert len(select_points(tree(), every_node(), sight("contrast", 12.0, lit=True))) >= len(
        select_points(tree(), every_node(), sight("contrast", 12.0, lit=False))
    )


def test_a_node_is_sixteen_bytes_for_shaders():
    assert NODE.itemsize == 4 * every_node().words.itemsize
