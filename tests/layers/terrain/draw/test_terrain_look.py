"""Colours, sun and tints of a terrain, and the rows that its shaders read."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen.layers.terrain.draw.uniforms as records
from limen.data.terrain.model import Nodes
from limen.display.display import Display
from limen.display.mapping import quilt_outlines
from limen.display.packing import pack_outlines
from limen.display.panel import Panel
from limen.errors import InputError
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.layers.terrain.look import TerrainLook, contour_interval_m, panel_tints, tint_range_m, toward_sun
from limen.layers.terrain.selector import nearest_m
from limen.viewing.projection import NEAR_M, QuiltPanels

SHADERS = "terrain.wgsl", "terrain_clip.wgsl"
STRUCTS = {"Terrain": records.TERRAIN, "TerrainView": records.TERRAIN_VIEW, "Source": records.SOURCE}


def uncommented(text: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.strip().startswith("//"))


@pytest.mark.parametrize("name", STRUCTS)
def test_structs_are_those_of_the_shaders(name: str) -> None:
    texts = [uncommented(shader_text("limen.layers.terrain.draw", name)) for name in SHADERS]
    assert wgsl_struct(name, STRUCTS[name]) in texts[0]
    if name != "Source":
        assert wgsl_struct(name, STRUCTS[name]) in texts[1]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("colours", "rainbow"), ("azimuth_deg", np.inf), ("altitude_deg", 91.0), ("altitude_deg", -1.0),
        ("ambient", 1.5), ("contour_interval_m", -5.0), ("contour_interval_m", "some"),
        ("contour_interval_m", np.nan), ("tint_range_m", (5.0, 5.0)), ("sea_level_m", np.nan),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_its_name(field: str, value: object) -> None:
    with pytest.raises(InputError, match=field):
        TerrainLook(**{field: value})


def test_the_sun_of_maps_stands_in_the_north_west() -> None:
    east, north, up = toward_sun(TerrainLook())
    assert (east, north, up) == pytest.approx((-0.5, 0.5, np.sqrt(0.5)))


@given(st.floats(-500, 8000), st.floats(0.01, 9000))
def test_automatic_intervals_are_round_and_leave_some_lines(low: float, extent: float) -> None:
    interval = contour_interval_m(TerrainLook(contour_interval_m="auto"), low, low + extent)
    digit = interval / 10 ** np.floor(np.log10(interval) + 1e-9)
    assert min(abs(digit - round_) for round_ in (1, 2, 5)) < 1e-6
    assert 14 < extent / interval < 44


def test_a_plain_has_no_automatic_lines_and_still_a_range_of_tints() -> None:
    assert contour_interval_m(TerrainLook(contour_interval_m="auto"), 3.0, 3.0) == 0
    assert tint_range_m(TerrainLook(), 3.0, 3.0) == (3.0, 4.0)
    assert tint_range_m(TerrainLook(sea_level_m=0.0), -50.0, 900.0) == (0.0, 900.0)


def test_tints_tell_class_by_hue_and_error_by_brightness() -> None:
    seen = np.array([0, 1, 2, 3, 2], np.int8)
    tints = panel_tints(seen, np.array([1.0, 1.0, 1.0, 1.0, 4.0]))
    assert len({tuple(row) for row in tints[:4, :3].round(4).tolist()}) == 4
    np.testing.assert_allclose(tints[4, :3], tints[2, :3] / 2, rtol=1e-6)


@given(
    st.lists(st.tuples(*[st.integers(0, 500)] * 2, *[st.integers(1, 90)] * 2), min_size=1, max_size=6),
    st.tuples(*[st.floats(-9, 9)] * 3), st.floats(-3, 3),
)  # fmt: skip
def test_no_box_is_nearer_than_the_near_plane_says(boxes: object, eye: object, turn: float) -> None:
    rows = np.array(boxes)
    rect = np.column_stack([rows[:, :2], rows[:, :2] + rows[:, 2:]]).astype(np.int32)
    low_high = np.column_stack([rows[:, 2] * 1.0, rows[:, 2] + rows[:, 3]]).astype(np.float32)
    nodes = Nodes(rect, low_high, np.full((len(rows), 4), -1, np.int32), np.arange(len(rows) + 1), len(rows))
    room = np.eye(4)
    room[:3, :3] = 0.01 * np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    near = nearest_m(nodes, np.arange(len(rows)), room, np.array(eye))
    shares = np.random.default_rng(0).random((200, 3))
    for (left, top, right, bottom), (low, high) in zip(rect.tolist(), low_high.tolist(), strict=True):
        places = np.array([left, top, low]) + shares * np.array([right - left, bottom - top, high - low])
        distance = np.linalg.norm(places @ room[:3, :3].T - np.array(eye), axis=1)
        assert distance.min() >= near - 1e-9 or near == NEAR_M


def test_what_is_near_is_drawn_first_on_every_panel() -> None:
    rect = np.array([[0, 0, 8, 8], [8, 0, 16, 8], [16, 0, 24, 8]], np.int32)
    nodes = Nodes(rect, np.zeros((3, 2), np.float32), np.full((3, 4), -1, np.int32), np.arange(4), 3)
    panel, node = np.array([0, 0, 0, 2, 2]), np.array([0, 1, 2, 2, 1], np.int32)
    order = records.nearest_first(nodes, node, panel, np.eye(4), np.array([21.0, 4.0, 1.0]))
    assert panel[order].tolist() == panel.tolist()
    assert node[order].tolist() == [2, 1, 0, 2, 1]


def test_places_are_counted_from_the_post_below_the_eye() -> None:
    room = np.diag([30.0, 30.0, 1.0, 1.0])
    origin = records.origin_near(np.array([30.0 * 65_500.4, 30.0 * 12.2, 812.3]), room, (65_536, 65_536))
    assert origin.post.tolist() == [65_500, 12]
    assert origin.height_m == pytest.approx(812.3, abs=1e-4)
    assert origin.height_m == float(np.float32(origin.height_m))
    outside = records.origin_near(np.array([-1e7, 1e9, 0.0]), room, (65_536, 65_536))
    assert outside.post.tolist() == [0, 65_535]


def test_a_pixel_and_its_depth_lead_back_to_the_place() -> None:
    """On a panel beside the eye, in a quilt for two eyes, of land that is turned, stretched and far from its corner."""
    turn = 0.4
    panel = Panel("only", (320, 200), (0.3, 0.9, -0.2), (math.cos(turn), 0.0, math.sin(turn)), (0, -1, 0), (0.002,) * 2)
    display = Display("one", (panel, Panel("behind", (320, 200), (0, 0, 3), (1, 0, 0), (0, -1, 0), (0.002,) * 2)))
    (quilt,) = pack_outlines(display)
    windows = QuiltPanels(display, quilt, copies=2)
    eye, room = np.array([0.1, 0.5, 1.4]), np.eye(4)
    room[:3, :3] = np.array([[0.02, 0.004, 0.0], [0.0, 0.0, 0.003], [0.005, -0.03, 0.0]])
    room[:3, 3] = -room[:3, :3] @ [70_000.0, 40_000.0, 900.0]
    origin = records.origin_near(eye, room, (100_000, 100_000))
    size_px = (2 * quilt.size_px[0], quilt.size_px[1])
    view = windows.seen_from(eye, copy=1, near_m=0.3)
    row = records.view_rows([view], room, origin, np.ones(2), None, size_px)[0]
    rng = np.random.default_rng(2)
    share = rng.uniform(0.0, 1.0, (50, 2)) * panel.size_px * 0.002
    on_panel = np.array(panel.origin_m) + share[:, :1] * panel.right + share[:, 1:] * panel.down
    way_m = (on_panel - eye) * rng.uniform(1.5, 400.0, (50, 1))
    place = (way_m + eye - room[:3, 3]) @ np.linalg.inv(room[:3, :3]).T - [*origin.post, origin.height_m]
    x, y, w = (np.column_stack([place, np.ones(50)]) @ row[name].astype(float) for name in ("x", "y", "w"))
    pixel, depth = np.column_stack([1 + x / w, 1 - y / w]) * size_px / 2, row["near"] / w
    assert (pixel > [quilt.size_px[0], 0]).all(), "in the second eye's half"
    ways = np.column_stack([pixel, np.ones(50)]) @ [
        row[name][:3].astype(float) for name in ("way_right", "way_down", "way")
    ]
    found = row["eye"][:3] + ways / depth[:, None]
    np.testing.assert_allclose((found - place) @ room[:3, :3].T, 0, atol=2e-5 * np.linalg.norm(way_m, axis=1).max())


def test_a_panel_is_coloured_inside_its_outline() -> None:
    """Corners in clip space are those of the outline and its guard band, the last one again where there are fewer."""
    outline = ((24, 0), (48, 40), (0, 40))
    display = Display(
        "one", (Panel("top", (48, 40), (0, 0, 0), (1, 0, 0), (0, -1, 0), (0.01,) * 2, outline_px=outline),)
    )
    (quilt,) = pack_outlines(display)
    windows = QuiltPanels(display, quilt)
    view = windows.seen_from((0.2, 0.1, 0.7))
    row = records.view_rows(
        [view], np.eye(4), records.Origin(np.zeros(2, np.int64), 0.0), np.ones(1), None, quilt.size_px
    )
    corners_px = (row["corners"][0, :, :2] * [1, -1] + 1) * quilt.size_px / 2
    (lit_px,) = quilt_outlines(display, quilt)
    off = np.linalg.norm(corners_px[:3, None] - lit_px[None], axis=2).min(axis=0)
    assert ((off >= windows.guard_px - 1e-3) & (off < 4 * windows.guard_px)).all()
    np.testing.assert_array_equal(corners_px[3:], np.repeat(corners_px[2:3], 5, axis=0))


def test_rows_of_panels_lie_where_bindings_may_begin() -> None:
    assert records.VIEW_STRIDE % 256 == 0
    rows = np.zeros(3, records.TERRAIN_VIEW)
    rows["near"] = [1.0, 2.0, 3.0]
    apart = records.in_strides(rows)
    again = [apart[k].tobytes()[: rows.itemsize] for k in range(3)]
    np.testing.assert_array_equal(np.frombuffer(b"".join(again), records.TERRAIN_VIEW), rows)
