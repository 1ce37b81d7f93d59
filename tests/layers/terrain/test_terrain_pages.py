"""The pages of a terrain's textures: no pixel asks for one that was not chosen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.pages import PAGE, Pyramid
from limen.data.terrain.model import Nodes
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.common.page_detail import KEPT, plain_detail, reduced_detail
from limen.layers.terrain import kernels
from limen.layers.terrain.forms import TerrainForms, terrain_forms
from limen.layers.terrain.pages import Faint, pages_for_terrain, texel_tolerance_px
from limen.layers.terrain.select import select_terrain
from support.made_up_terrain import Scene, made_up_scene, made_up_terrain

SEEDS = st.integers(0, 10_000)
COLUMNS, ROWS = 512 * 4, 256 * 4
POSTS = np.eye(2)


def enlarged(nodes: Nodes, factor: int) -> Nodes:
    """The same tree over more posts, so that it spans pages."""
    return nodes._replace(rect=nodes.rect * factor)


def footprints(scene: Scene, panel: int, places: Floats, slopes: Floats, texel_from_post: Floats = POSTS) -> Floats:
    """Larger side of a pixel's footprint in texels, on ground with the slopes (metres a column, a row): by its rays.

    The place that is seen half a pixel to either side lies where the ray through it meets the ground's plane.
    """
    views, half = scene.views, np.array(scene.quilt_size_px) / 2
    room = scene.room_from_posts[:3, :3]
    way = scene.placed(places)
    clip = way @ views.clip[panel].T
    larger = np.zeros(len(places))
    for axis in range(2):
        ends = []
        for step in (-0.5, 0.5):
            there = clip / clip[:, 2:]
            there[:, axis] += step * 1e-3 / half[axis]
            ray = np.linalg.solve(room, np.linalg.solve(views.clip[panel], there.T)).T  # in columns, rows, metres
            origin = np.linalg.solve(room, -way.T).T  # the eye, as seen from the place
            normal = np.column_stack([-slopes, np.ones(len(places))])
            length = -(origin * normal).sum(axis=1) / (ray * normal).sum(axis=1)
            ends.append((origin + ray * length[:, None])[:, :2] @ texel_from_post.T)
        larger = np.maximum(larger, np.linalg.norm(ends[1] - ends[0], axis=1) * 1e3)
    return larger


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, allowed=st.lists(st.floats(0.2, 30), min_size=2, max_size=2).map(np.array), drape=st.booleans())
def test_every_pixel_finds_its_page(seed: int, allowed: Floats, drape: bool) -> None:
    nodes, patches = made_up_terrain(seed)
    nodes = enlarged(nodes, 4)
    scene, random = made_up_scene(seed, columns=COLUMNS, rows=ROWS), np.random.default_rng(seed)
    own = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]])
    # A picture that lies turned and mirrored on the ground, whose columns are 3 m and rows 4 m apart, and beyond it.
    turned = np.array([[0.8 * 3, 0.6 * 4, -700.0], [0.6 * 3, -0.8 * 4, 1500.0]]) * 0.5
    place = turned if drape else own
    size_px = (3000, 1500) if drape else (COLUMNS, ROWS)
    pyramid = Pyramid.of(size_px)
    args = (scene.views, scene.quilt_size_px, scene.room_from_posts, allowed)
    cut = select_terrain(nodes, patches, *args)
    wanted = pages_for_terrain(cut, nodes, patches, pyramid, *args, texel_from_post=turned if drape else None)
    assert (np.diff(wanted.importance) <= 0).all()
    chosen = set(wanted.pages.tolist())
    assert len(chosen) == len(wanted.pages)
    for panel in range(2):
        shown = patches.node[cut.pair_patch[cut.pair_panel == panel]]
        for node in shown[:20]:
            low, high = nodes.low_high_m[node]
            c0, r0, c1, r1 = nodes.rect[node]
            places = random.uniform([c0, r0, low], [c1, r1, high], (60, 3))
            places = places[scene.sees(panel, places)]
            texel = places[:, :2] @ place[:, :2].T + place[:, 2]
            inside = ((texel >= 0) & (texel < size_px)).all(axis=1)
            places, texel = places[inside], texel[inside]
            # Ground of any slope, the most are nearly level in the room or nearly upright.
            slopes = random.normal(size=(len(places), 2)) * 10 ** random.uniform(-3, 3, (len(places), 1))
            sides = footprints(scene, panel, places, slopes, place[:, :2])
            level = np.clip(
                np.floor(np.log2(sides * texel_tolerance_px(allowed)[panel])), 0, len(pyramid.levels) - 1
            ).astype(np.int64)
            column, row = (texel // (PAGE * 2.0 ** level[:, None])).astype(np.int64).T
            assert set(pyramid.page_index(level, column, row).tolist()) <= chosen


def test_no_slope_makes_a_footprint_smaller_than_the_bound_and_some_come_near() -> None:
    """Of places one by one, over slopes of all kinds: what the pages' levels rest on, and how tight it is."""
    reached = []
    for seed in range(40):
        scene, random = made_up_scene(seed), np.random.default_rng(seed)
        forms = terrain_forms(scene.views, scene.quilt_size_px, scene.room_from_posts)
        places = random.uniform([0, 0, 0], [512, 256, 100], (1000, 3))
        for place in places[scene.sees(0, places)][:5]:
            slopes = random.normal(size=(4000, 2)) * 10 ** random.uniform(-2, 5, (4000, 1))
            sides = footprints(scene, 0, np.tile(place, (len(slopes), 1)), slopes)
            seen = kernels.nearest_w(np.array([*place, *place]), 0, forms)[1]
            reached.append(sides.min() * forms.px_per_post[0] / seen)
    assert len(reached) > 100
    assert min(reached) >= 1 - 1e-4  # footprints are taken as differences over a thousandth of a pixel
    assert np.median(reached) < 1.3


def plain_pages(
    boxes: Floats, panels: list[int], forms: TerrainForms, pyramid: Pyramid, allowed: Floats, faint: Faint | None = None
) -> set[int]:
    """The rule, one page at a time: seen, and no coarser page there is fine enough for all of a pair in it."""
    found = set()
    tolerance = np.maximum(1.0, allowed * KEPT)
    for box, panel in zip(boxes, panels, strict=True):
        for page in range(pyramid.page_count):
            level, column, row = pyramid.page_of(page)
            enough, parts = [], []
            for coarser in range(level, len(pyramid.levels)):
                span = PAGE * 2.0**coarser
                corner = np.array([column >> (coarser - level), row >> (coarser - level)]) * span
                part = np.concatenate(
                    [np.maximum(box[:2], corner), box[2:3], np.minimum(box[3:5], corner + span), box[5:]]
                )
                seen = kernels.nearest_w(part, panel, forms)[1] if (part[:2] <= part[3:5]).all() else -1.0
                texels = seen / forms.px_per_post[panel] * (1 - 1e-3)
                parts.append(seen >= 0)
                fine = texels * tolerance[panel] >= 2.0**coarser
                if faint is not None and faint.panels[panel]:
                    above = pyramid.page_index(coarser, column >> (coarser - level), row >> (coarser - level))
                    fine = fine or texels * allowed[panel] >= faint.detail.tau[above]
                enough.append(coarser > level and fine)
            if all(parts) and not any(enough):
                found.add(page)
    return found


def made_up_faint(pyramid: Pyramid, seed: int) -> Faint:
    """Pages of any contrast, many of them flat; on the second of two panels nothing may be hidden."""
    random = np.random.default_rng(seed)
    share = random.uniform(size=pyramid.page_count) * (random.uniform(size=pyramid.page_count) < 0.5)
    return Faint(reduced_detail(pyramid, share), np.array([True, False]))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("hidden", [False, True])
def test_the_kernel_follows_the_rule(seed: int, hidden: bool) -> None:
    nodes, patches = made_up_terrain(seed)
    nodes = enlarged(nodes, 4)
    scene = made_up_scene(seed, columns=COLUMNS, rows=ROWS)
    allowed = np.array([1.5, 4.0])
    args = (scene.views, scene.quilt_size_px, scene.room_from_posts, allowed)
    cut = select_terrain(nodes, patches, *args)
    pyramid = Pyramid.of((COLUMNS, ROWS))
    node = patches.node[cut.pair_patch]
    rect, heights = nodes.rect[node] + 0.5, nodes.low_high_m[node].astype(float)
    boxes = np.column_stack([rect[:, :2], heights[:, 0], rect[:, 2:], heights[:, 1]])
    room = scene.room_from_posts.copy()
    room[:3, 3] -= room[:3, :2] @ [0.5, 0.5]
    forms = terrain_forms(scene.views, scene.quilt_size_px, room)
    faint = made_up_faint(pyramid, seed) if hidden else None
    expected = plain_pages(boxes, cut.pair_panel.tolist(), forms, pyramid, allowed, faint)
    assert set(pages_for_terrain(cut, nodes, patches, pyramid, *args, faint=faint).pages.tolist()) == expected


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, allowed=st.lists(st.floats(0.2, 30), min_size=2, max_size=2).map(np.array))
def test_what_is_too_faint_never_costs_more_pages_and_nothing_where_it_may_not_be_hidden(
    seed: int, allowed: Floats
) -> None:
    nodes, patches = made_up_terrain(seed)
    nodes = enlarged(nodes, 4)
    scene = made_up_scene(seed, columns=COLUMNS, rows=ROWS)
    pyramid = Pyramid.of((COLUMNS, ROWS))
    args = (scene.views, scene.quilt_size_px, scene.room_from_posts, allowed)
    cut = select_terrain(nodes, patches, *args)
    chosen = {}
    for name, panels in {"none": (False, False), "one": (True, False), "both": (True, True)}.items():
        faint = made_up_faint(pyramid, seed)._replace(panels=np.array(panels))
        chosen[name] = set(pages_for_terrain(cut, nodes, patches, pyramid, *args, faint=faint).pages.tolist())
    assert chosen["none"] == set(pages_for_terrain(cut, nodes, patches, pyramid, *args).pages.tolist())
    assert chosen["both"] <= chosen["one"] <= chosen["none"]
    all_stark = Faint(plain_detail(pyramid), np.array([True, True]))
    assert set(pages_for_terrain(cut, nodes, patches, pyramid, *args, faint=all_stark).pages) == chosen["none"]
    all_flat = Faint(reduced_detail(pyramid, np.zeros(pyramid.page_count)), np.array([True, True]))
    assert set(pages_for_terrain(cut, nodes, patches, pyramid, *args, faint=all_flat).pages) <= {pyramid.page_count - 1}


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, allowed=st.floats(0.2, 30))
def test_coarser_pages_of_a_page_come_with_it_and_before_it(seed: int, allowed: float) -> None:
    nodes, patches = made_up_terrain(seed)
    nodes = enlarged(nodes, 4)
    scene = made_up_scene(seed, columns=COLUMNS, rows=ROWS)
    args = (scene.views, scene.quilt_size_px, scene.room_from_posts, np.full(2, allowed))
    cut = select_terrain(nodes, patches, *args)
    pyramid = Pyramid.of((COLUMNS, ROWS))
    wanted = pages_for_terrain(cut, nodes, patches, pyramid, *args)
    place = {int(page): number for number, page in enumerate(wanted.pages)}
    for page in wanted.pages:
        level, column, row = pyramid.page_of(int(page))
        if level < len(pyramid.levels) - 1:
            assert place[pyramid.page_index(level + 1, column // 2, row // 2)] < place[int(page)]


def test_far_ground_needs_coarse_pages_and_no_more_than_it_shows() -> None:
    """Ground seen at right angles: the level is known, up to the half that a pixel on a diagonal slope may want."""
    nodes, patches = made_up_terrain(3)
    nodes = enlarged(nodes, 4)
    pyramid = Pyramid.of((COLUMNS, ROWS))
    scene = made_up_scene(3, panels=1, columns=COLUMNS, rows=ROWS)
    views = scene.views
    # Columns along the panel's right, rows along its down, height toward the eye; a pixel is 2.9 posts at its foot.
    right, down, toward = np.linalg.inv(views.clip[0])[:, 0], -np.linalg.inv(views.clip[0])[:, 1], -views.clip[0, 2]
    right, down = right / np.linalg.norm(right), down - toward * (down @ toward)
    across = np.cross(down / np.linalg.norm(down), toward)
    room = np.eye(4)
    room[:3, 0], room[:3, 1] = across * 0.001, down / np.linalg.norm(down) * 0.001
    room[:3, 2] = toward * 1e-6
    corner = views.corners[0].mean(axis=0)
    height = float((views.outline_m[0, 0] - views.eye_m) @ views.clip[0, 2])
    middle = views.eye_m + corner / (corner @ views.clip[0, 2]) * 2.9 * height
    room[:3, 3] = middle - room[:3, :3] @ [COLUMNS / 2, ROWS / 2, 0]
    args = (views, scene.quilt_size_px, room, np.array([0.5]))
    cut = select_terrain(nodes, patches, *args)
    wanted = pages_for_terrain(cut, nodes, patches, pyramid, *args)
    levels = pyramid.page_of(wanted.pages)[0]
    assert levels.min() == 1
    shown = 400 * 260 * 2.9**2
    texels = PAGE**2 * 4 * (levels == 1).sum()
    assert texels < 4 * shown


def test_a_map_of_another_shape_is_named() -> None:
    nodes, patches = made_up_terrain(0)
    scene = made_up_scene(0)
    args = (scene.views, scene.quilt_size_px, scene.room_from_posts, np.ones(2))
    cut = select_terrain(nodes, patches, *args)
    with pytest.raises(InputError, match="texel_from_post must be of shape"):
        pages_for_terrain(cut, nodes, patches, Pyramid.of((9, 9)), *args, texel_from_post=np.eye(3))
    sheared = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    with pytest.raises(InputError, match="right angles"):
        pages_for_terrain(cut, nodes, patches, Pyramid.of((9, 9)), *args, texel_from_post=sheared)
