"""Where a mesh stands on each kind of display."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from limen.display.display import Display
from limen.errors import InputError
from limen.layers.common.room_placement import RoomPlacement, mesh_in_room
from limen.layers.mesh.layer import MeshLayer
from limen.show.show import Show
from limen.viewing.arrangement import arrangement_of
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface, carried_lenses, texel_pointed_at
from limen.viewing.standing import standing_viewer
from limen.viewing.viewer import Pointer

BOX = np.array([(-1.0, 0.0, 2.0), (3.0, 2.0, 3.0)])


class Box(NamedTuple):
    bounds: np.ndarray


@pytest.mark.parametrize(
    ("name", "expected"),
    [("cube", "object"), ("knot", "object"), ("cylinder", "object"), ("cave", "room"), ("reality-deck", "room"),
     ("rostock", "wall"), ("desk", "wall"), ("desktop", "wall")],
)  # fmt: skip
def test_people_are_around_inside_or_before_a_display(name: str, expected: str) -> None:
    assert arrangement_of(Display.preset(name)) == expected


def is_behind_a_panel(display: Display, place: np.ndarray, eye: np.ndarray) -> bool:
    """Whether the way from the eye to a place goes through the rectangle of a panel that faces the eye."""
    for panel in display.panels:
        height, depth = (float(np.dot(each - panel.centre_m, panel.normal)) for each in (eye, place))
        if height > 0 > depth:
            meets = eye + (place - eye) * height / (height - depth) - np.array(panel.origin_m)
            along = np.array([np.dot(meets, panel.right), np.dot(meets, panel.down)])
            if np.all((along > 0) & (along < panel.size_m)):
                return True
    return False


@pytest.mark.parametrize("size_m", [None, 0.4])
@pytest.mark.parametrize("name", ["cube", "teapot", "cave", "reality-deck", "rostock", "desk"])
def test_a_mesh_is_inside_an_object_and_behind_walls(name: str, size_m: float | None) -> None:
    display = Display.preset(name)
    matrix = mesh_in_room(BOX, display, size_m=size_m)
    corners = np.array([(x, y, z, 1.0) for x in BOX[:, 0] for y in BOX[:, 1] for z in BOX[:, 2]])
    placed = (corners @ matrix.T)[:, :3]
    if size_m is not None:
        assert float(np.ptp(placed, axis=0).max()) == pytest.approx(size_m)
    middle = placed.mean(axis=0)
    match arrangement_of(display):
        case "object":
            np.testing.assert_allclose(middle, display.bounds_m.mean(axis=0), atol=1e-9)
        case "room":
            assert placed[:, 2].max() <= display.bounds_m[0, 2] + 1e-9
        case _:
            assert is_behind_a_panel(display, middle, np.array(standing_viewer(display).position_m))


def test_up_and_turn_are_about_the_middle() -> None:
    """The file's z points up; a quarter turn counter-clockwise takes what pointed right away from +z's viewer."""
    display = Display.preset("desktop")
    upright = mesh_in_room(BOX, display, size_m=4.0, at_m=(0, 0, 0), up="z")
    np.testing.assert_allclose(upright[:3, :3], [(1, 0, 0), (0, 0, 1), (0, -1, 0)], atol=1e-12)
    np.testing.assert_allclose(upright @ [1.0, 1.0, 2.5, 1.0], [0, 0, 0, 1], atol=1e-12)
    turned = mesh_in_room(BOX, display, size_m=4.0, at_m=(0, 0, 0), turn_deg=90.0)
    np.testing.assert_allclose(turned[:3, :3] @ [1.0, 0, 0], [0, 0, -1], atol=1e-12)


def test_what_is_tilted_shows_its_upper_side() -> None:
    leaning = mesh_in_room(BOX, Display.preset("desktop"), size_m=2.0, at_m=(0, 0, 0), up="z", tilt_deg=40.0)
    _, y, z = leaning[:3, :3] @ [0, 0, 1]
    assert math.degrees(math.atan2(z, y)) == pytest.approx(40)
    turned = mesh_in_room(BOX, Display.preset("desktop"), at_m=(0, 0, 0), turn_deg=70.0, tilt_deg=40.0)
    _, y, z = turned[:3, :3] @ [0, 1, 0]
    assert math.degrees(math.atan2(z, y)) == pytest.approx(40), "whatever way it is turned"


def test_what_has_no_size_is_refused() -> None:
    with pytest.raises(InputError, match="a single point"):
        mesh_in_room(np.zeros((2, 3)), Display.preset("desktop"))
    for size_m in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(InputError, match="positive number of metres"):
            mesh_in_room(BOX, Display.preset("desktop"), size_m=size_m)


def test_what_turns_moves_about_its_middle_unless_time_is_paused() -> None:
    stands, desk = RoomPlacement(turning=True), Display.preset("desktop")
    layer = MeshLayer(Box(BOX), stands)  # type: ignore[arg-type]
    moves = layer.state(1.5, desk).motion_matrix
    before, after = (stands.at(BOX, desk, time_s) for time_s in (1.49, 1.51))
    places = np.concatenate([BOX, [BOX.mean(axis=0)]])
    ways = (places @ (after - before)[:3, :3].T + (after - before)[:3, 3]) / 0.02
    stand = stands.at(BOX, desk, 1.5)
    room = np.column_stack([places @ stand[:3, :3].T + stand[:3, 3], np.ones(3)])
    np.testing.assert_allclose(room @ moves.T, ways, atol=1e-4)
    assert np.linalg.norm(ways[0]) > 0.01 > 1e-6 > np.linalg.norm(ways[2])
    (passing,), (paused,) = (Show((layer,)).frame(desk, 1.5, (), paused=each).layers for each in (False, True))
    assert np.array_equal(passing.motion_matrix, moves)
    assert not paused.motion_matrix.any()
    assert paused.placement == passing.placement
    assert not MeshLayer(Box(BOX)).state(1.5, desk).motion_matrix.any()  # type: ignore[arg-type]


def test_lenses_are_lenses() -> None:
    lens = Lens((5.0, 5.0), 3.0)
    assert OnSurface(lenses=lens).lenses == OnSurface(lenses=[lens]).lenses == (lens,)  # type: ignore[arg-type]
    assert OnSurface(lenses=(lens,)).bends
    assert not OnSurface().bends
    with pytest.raises(InputError, match=r"lenses must be of the type limen\.Lens"):
        OnSurface(lenses=((5.0, 5.0, 3.0, 2.0),))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["rostock", "reality-deck", "cave"])
def test_a_pointer_points_at_the_texel_that_the_panel_shows_there(name: str) -> None:
    display, size_px = Display.preset(name), (30_000, 20_000)
    maps = OnSurface("cover").panel_maps(display, size_px)
    rng = np.random.default_rng(3)
    for number in rng.integers(len(display.panels), size=12):
        panel = display.panels[number]
        pixel = rng.uniform(0, 1, 2) * panel.size_px
        place = panel.position_m(pixel)
        hand = place + 0.6 * np.array(panel.normal) + rng.normal(0, 0.1, 3)
        pointer = Pointer(tuple(hand), tuple(place - hand))
        assert texel_pointed_at(display, maps, pointer) == pytest.approx(
            tuple(pixel * maps.scale[number] + maps.offset[number]), abs=1e-5
        )


def test_lenses_go_on_across_bezels_and_end_beside_the_display() -> None:
    display, size_px = Display.preset("rostock"), (30_000, 20_000)
    maps = OnSurface("cover").panel_maps(display, size_px)
    left, right = display.panels[0], display.panels[1]
    edge = (left.position_m(np.array([left.size_px[0], 500.0])), right.position_m(np.array([0.0, 500.0])))
    middle = (edge[0] + edge[1]) / 2
    hand = middle + 1.5 * np.array(left.normal)
    found = texel_pointed_at(display, maps, Pointer(tuple(hand), tuple(middle - hand)))
    ends = [
        np.array(pixel) * maps.scale[number] + maps.offset[number]
        for number, pixel in enumerate(((left.size_px[0], 500.0), (0.0, 500.0)))
    ]
    assert found == pytest.approx(tuple((ends[0] + ends[1]) / 2), abs=2)
    lens = Lens((0.0, 0.0), 300.0, 5.0)
    (carried,) = carried_lenses(display, maps, [Pointer(tuple(hand), tuple(middle - hand))], [lens])
    assert carried.centre_px == found
    assert (carried.radius_px, carried.magnification) == (300.0, 5.0)
    for beside in (hand - middle, np.array([0.0, 1.0, 0.0])):
        assert texel_pointed_at(display, maps, Pointer(tuple(hand), tuple(beside))) is None
        assert carried_lenses(display, maps, [Pointer(tuple(hand), tuple(beside))], [lens]) == ()
