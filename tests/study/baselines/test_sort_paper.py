"""The ways of sorting that limen is compared with: right where they can be, and wrong where they are said to be."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from limen.data import torus_knot
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pack
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.layers.common.panel_uniforms import PANEL_VIEW
from limen.layers.mesh.layer import MeshLayer
from limen.study.baselines.sort_paper import PAPER_FRAME
from limen.study.baselines.sort_whole import OCTREE_FRAME
from limen.viewing.projection import GUARD_PX, QuiltPanels
from support.brute import ROUNDING_PX, soup
from support.brute import pairs as brute_pairs
from support.displays import DISPLAYS
from support.drawing import begun, drawn_mesh, eyes_view

pytestmark = pytest.mark.gpu

PLACE = np.array([[0.4, 0, 0, 0], [0, 0.4, 0, 1.2], [0, 0, 0.4, 0], [0, 0, 0, 1.0]])


def found_pairs(device: Any, method: Any, display: Display, eyes: Any, mesh: Any, **options: Any) -> Any:
    """(pairs, views) of one quilt with all panels."""
    from limen.study.bench.panels import METHODS

    (quilt,) = pack(display, max_size_px=8192)
    eyes = np.asarray(eyes, dtype=float).reshape(-1, 3)
    windows = QuiltPanels(display, quilt, len(eyes))
    views = [windows.seen_from(eye, copy) for copy, eye in enumerate(eyes)]
    eye_from_mesh = np.repeat(np.eye(3, 4)[None], len(eyes), axis=0)
    eye_from_mesh[:, :, 3] = -eyes
    sorter = METHODS[method](device, *mesh, **options)
    sorter.sort(views, eye_from_mesh)
    found = [(int(triangle), int(view)) for triangle, view in sorter.read_pairs()]
    sorter.destroy()
    return found, views


@pytest.mark.parametrize(("file", "frame"), [("sort_paper.wgsl", PAPER_FRAME), ("sort_octree.wgsl", OCTREE_FRAME)])
def test_the_shaders_have_the_dtypes_structs(file: str, frame: Any) -> None:
    text = re.sub(r"^\s*//.*\n", "", shader_text("limen.study.baselines", file), flags=re.MULTILINE)
    assert wgsl_struct("Frame", frame) in text
    assert wgsl_struct("PanelView", PANEL_VIEW) in text


@pytest.mark.parametrize("size_m", [0.003, 0.05, 0.5, 5.0])
def test_the_papers_pairs_are_right_where_no_panels_overlap(device: Any, size_m: float) -> None:
    display, eye = DISPLAYS["icosahedron"]
    positions, triangles = soup(np.random.default_rng(1), 400, size_m, (0, 1.2, 0), 0.5)
    found, (views,) = found_pairs(device, "paper", display, eye, (positions, triangles))
    ways = positions.astype(float) - eye
    assert len(found) == len(set(found)), "a pair must be drawn once"
    # Its first pass knows no guard band.
    needed = brute_pairs(views, ways, triangles, GUARD_PX + ROUNDING_PX)
    assert needed <= set(found)
    assert set(found) <= brute_pairs(views, ways, triangles, -ROUNDING_PX)
    assert len(needed) > 40


def test_the_papers_first_pass_loses_pairs_where_panels_overlap_in_view(device: Any) -> None:
    """A knot: a triangle whose corners lie on the nearer tube is lost on the one behind it."""
    display = Display.preset("knot").scaled(0.3)
    eye = np.array([0.4, 1.5, 1.5])
    positions, triangles = soup(np.random.default_rng(7), 1_000, 0.004, (0, 1.2, -0.2), 0.2)
    exact, (views,) = found_pairs(device, "limen", display, eye, (positions, triangles))
    paper, _ = found_pairs(device, "paper", display, eye, (positions, triangles))
    needed = brute_pairs(views, positions.astype(float) - eye, triangles, GUARD_PX + ROUNDING_PX)
    lost = needed - set(paper)
    assert needed <= set(exact)
    assert len(lost) > 0.1 * len(needed)
    # None of those that the second pass saw is among them.
    panels_of = {triangle: 0 for triangle, _ in lost}
    for triangle, _ in paper:
        if triangle in panels_of:
            panels_of[triangle] += 1
    assert set(panels_of.values()) == {1}


def test_the_first_pass_finds_the_nearest_panel(device: Any) -> None:
    """Of a triangle much smaller than any panel, through the leaves of the octree and past many panels."""
    display, eye = DISPLAYS["stairs"]
    positions, triangles = soup(np.random.default_rng(2), 3_000, 1e-5, (0, 1.2, -1.5), 0.5)
    found, (views,) = found_pairs(device, "paper", display, eye, (positions, triangles))
    heights = np.einsum("na,na->n", views.clip[:, 2], views.outline_m[:, 0] - views.eye_m)
    checked = 0
    for triangle, panel in found:
        way = positions[triangle * 3].astype(float) - eye
        depth = views.clip[:, 2] @ way
        inside = ((views.edges @ way) > (GUARD_PX + 0.2) * depth[:, None]).all(axis=1) & (depth > 0) & views.facing
        near_rim = ((views.edges @ way) > (GUARD_PX - 0.2) * depth[:, None]).all(axis=1) & (depth > 0) & views.facing
        if inside.sum() > 1 and (inside == near_rim).all():
            distance = np.where(inside, heights / np.where(inside, depth, 1), np.inf)
            assert panel == distance.argmin()
            checked += 1
    assert checked > 200


@pytest.mark.parametrize("method", ["paper", "hierarchy"])
@pytest.mark.parametrize("name", ["cube", "icosahedron"])
def test_two_eyes_and_no_room_at_first(device: Any, name: str, method: str) -> None:
    display, eye = DISPLAYS[name]
    mesh = soup(np.random.default_rng(3), 300, 0.2, (0, 1.2, 0), 0.4)
    eyes = np.array(eye) + np.array([[-0.03, 0, 0], [0.03, 0, 0]])
    roomy, _ = found_pairs(device, method, display, eyes, mesh)
    tight, _ = found_pairs(device, method, display, eyes, mesh, first_pairs=1)
    assert sorted(roomy) == sorted(tight)
    panels = len(display.panels)
    for number, one in enumerate(eyes):
        alone, _ = found_pairs(device, method, display, one, mesh)
        assert sorted((t, v - number * panels) for t, v in roomy if v // panels == number) == sorted(alone)


@pytest.mark.parametrize("size_m", [0.01, 0.5, 5.0])
@pytest.mark.parametrize("name", DISPLAYS)
def test_the_hierarchy_loses_nothing(device: Any, name: str, size_m: float) -> None:
    """Triangles of 5 m enter so many leaves that there has to be made room for them."""
    display, eye = DISPLAYS[name]
    middle = np.mean([panel.centre_m for panel in display.panels], axis=0)
    positions, triangles = soup(np.random.default_rng(4), 300, size_m, middle, 0.5)
    found, (views,) = found_pairs(device, "hierarchy", display, eye, (positions, triangles))
    needed = brute_pairs(views, positions.astype(float) - eye, triangles, GUARD_PX)
    assert needed <= set(found)
    assert {panel for _, panel in found} <= set(np.flatnonzero(views.facing).tolist())
    if size_m < 0.1:
        assert len(set(found)) < 0.7 * len(triangles) * views.facing.sum(), "leaves beside a panel are not drawn for it"


def lit_px(display: Display, quilt: Quilt) -> Any:
    """Pixels whose centres lie within outlines, by more than rounding: bool (H, W)."""
    mask = np.zeros(quilt.size_px[::-1], bool)
    y, x = np.indices(mask.shape) + 0.5
    for index, affine in zip(quilt.panels, quilt.quilt_from_panel(display), strict=True):
        corners = display.panels[index].lit_outline_px @ affine[:, :2].T + affine[:, 2]
        inside = np.ones_like(mask)
        for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            step = (there - here) / np.linalg.norm(there - here)
            inside &= step[0] * (y - here[1]) - step[1] * (x - here[0]) > 0.05
        mask |= inside
    return mask


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("name", ["cube", "icosahedron", "stairs"])
def test_all_ways_draw_the_same_picture(device: Any, name: str, clip: bool) -> None:
    from limen.study.bench.panels import METHODS

    display, eye = DISPLAYS[name]
    eyes = np.array(eye) + np.array([[0, 0, 0], [0.06, 0, 0]])
    (quilt,) = pack_outlines(display)
    mesh = torus_knot(2_000)
    view = begun(eyes_view(display, quilt, eyes), mesh.bounds, PLACE)
    pictures = {}
    for method in METHODS:
        layer = MeshLayer(mesh, clip=clip)
        picture, _ = drawn_mesh(device, layer, view, room_from_mesh=PLACE, sorter=METHODS[method])
        pictures[method] = picture.astype(int)
    ours = pictures["limen"]
    assert ours[..., :3].any(axis=2).mean() > 0.02
    lit = np.tile(lit_px(display, quilt), 2)
    for method, theirs in pictures.items():
        differs = np.abs(theirs - ours).max(axis=2) > 2
        if method == "paper":
            # Its first pass leaves guard bands black in places, and loses pairs where panels overlap.
            assert differs.any()
            if name == "stairs":
                continue
            differs &= lit
        assert differs.sum() <= 4, f"{method} draws {differs.sum()} pixels otherwise"
