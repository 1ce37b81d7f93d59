"""The one matrix of a panel, against the two classic ways to the same picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt, pack
from limen.viewing.projection import GUARD_PX, QuiltPanels, quilt_from_room

CUBE = Display.preset("cube")
CAVE = Display.preset("cave")
SMALL = st.floats(-1, 1)


def tilted(turn: int = 0, nudge_px: tuple[float, float] = (0.0, 0.0)) -> tuple[Display, Quilt]:
    """One panel with nothing parallel to an axis, alone in a quilt that is larger than it."""
    right = np.array([0.6, 0.3, -0.2]) / np.linalg.norm([0.6, 0.3, -0.2])
    down = np.cross(right, [0.2, 0.1, 0.9])
    down /= np.linalg.norm(down)
    panel = Panel("only", (300, 200), (0.4, 1.1, -0.7), tuple(right), tuple(down), (0.001, 0.0012), nudge_px=nudge_px)
    return Display("tilted", (panel,)), Quilt((700, 600), (0,), ((37, 59),), (turn,))


def pixel(matrix: NDArray[np.float64], quilt: Quilt, place_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a matrix puts a place of the room in the quilt, pixels."""
    x, y, _, w = matrix @ np.append(place_m, 1.0)
    return np.array([(x / w + 1) / 2 * quilt.size_px[0], (1 - y / w) / 2 * quilt.size_px[1]])


@pytest.mark.parametrize("turn", range(4))
@given(place=st.tuples(st.floats(0, 300), st.floats(0, 200)), reach=st.floats(0.1, 50), eye=st.tuples(SMALL, SMALL))
def test_what_lies_on_the_ray_through_a_pixel_is_drawn_there(
    turn: int, place: tuple[float, float], reach: float, eye: tuple[float, float]
) -> None:
    display, quilt = tilted(turn)
    panel = display.panels[0]
    eye_m = panel.centre_m + np.array(panel.normal) * 1.5 + np.array([*eye, 0.0])
    on_panel = panel.position_m(np.array(place))
    matrix = quilt_from_room(display, quilt, tuple(eye_m))[0]
    expected = quilt.quilt_from_panel(display)[0] @ [*place, 1.0]
    np.testing.assert_allclose(pixel(matrix, quilt, eye_m + (on_panel - eye_m) * reach), expected, atol=1e-7)


def test_a_nudge_moves_the_picture() -> None:
    display, quilt = tilted()
    nudged, _ = tilted(nudge_px=(3.0, -2.0))
    eye_m = display.panels[0].centre_m + np.array(display.panels[0].normal)
    place = display.panels[0].position_m(np.array([100.0, 50.0]))
    moved = pixel(quilt_from_room(nudged, quilt, tuple(eye_m))[0], quilt, place)
    still = pixel(quilt_from_room(display, quilt, tuple(eye_m))[0], quilt, place)
    np.testing.assert_allclose(moved - still, [3, -2], atol=1e-9)


def off_axis(panel: Panel, eye_m: NDArray[np.float64], near_m: float) -> NDArray[np.float64]:
    """Kooima 2009: glFrustum along the panel's normal, after its rotation and the eye's translation."""
    low_left, low_right, top_left = (panel.corners_m[number] for number in (3, 2, 0))
    right = (low_right - low_left) / np.linalg.norm(low_right - low_left)
    up = (top_left - low_left) / np.linalg.norm(top_left - low_left)
    normal = np.cross(right, up)
    distance = -normal @ (low_left - eye_m)
    left, rightmost = (right @ (corner - eye_m) * near_m / distance for corner in (low_left, low_right))
    bottom, top = (up @ (corner - eye_m) * near_m / distance for corner in (low_left, top_left))
    frustum = np.array(
        [
            [2 * near_m / (rightmost - left), 0, (rightmost + left) / (rightmost - left), 0],
            [0, 2 * near_m / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, -1, -2 * near_m],  # a far plane infinitely far away
            [0, 0, -1, 0],
        ]
    )
    rotation = np.eye(4)
    rotation[:3, :3] = [right, up, normal]
    translation = np.eye(4)
    translation[:3, 3] = -eye_m
    return np.asarray(frustum @ rotation @ translation)


def homography(panel: Panel, eye_m: NDArray[np.float64], place_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Harish, Narayanan 2013, section 3.1: pixel of a place, by way of the image of a viewer's camera.

    The camera ``Cv`` at the eye looks at the panel's middle; ``H`` takes its image to the panel's own.
    """
    forward = panel.centre_m - eye_m
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 1.0, 0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    focal = 900.0
    intrinsic = np.array([[focal, 0, 500], [0, focal, 500], [0, 0, 1]])
    # A place on the panel's plane, pixel (u, v): origin + u right + v down, as the camera sees it.
    columns = np.array(
        [np.array(panel.right) * panel.pitch_m[0], np.array(panel.down) * panel.pitch_m[1], panel.origin_m - eye_m]
    ).T
    image_of_panel = intrinsic @ rotation @ columns
    x, y, w = np.linalg.inv(image_of_panel) @ (intrinsic @ rotation @ (place_m - eye_m))
    return np.array([x / w, y / w])


@given(eye=st.tuples(SMALL, SMALL), place=st.tuples(SMALL, SMALL, SMALL))
def test_the_direct_matrix_the_off_axis_frustum_and_the_homography_agree(
    eye: tuple[float, float], place: tuple[float, float, float]
) -> None:
    display, _ = tilted()
    panel = display.panels[0]
    eye_m = panel.centre_m + np.array(panel.normal) * 1.2 + np.array([*eye, 0.1])
    place_m = panel.centre_m + np.array(place) * 0.4
    alone = Quilt(panel.size_px, (0,), ((0, 0),))
    direct = pixel(quilt_from_room(display, alone, tuple(eye_m))[0], alone, place_m)
    np.testing.assert_allclose(pixel(off_axis(panel, eye_m, 0.1), alone, place_m), direct, atol=1e-6)
    np.testing.assert_allclose(homography(panel, eye_m, place_m), direct, atol=1e-6)


@given(step=st.floats(1e-6, 10), start=st.floats(0.3, 5), place=st.tuples(st.floats(0, 1024), st.floats(0, 1024)))
def test_depth_falls_along_every_ray(step: float, start: float, place: tuple[float, float]) -> None:
    quilt = pack(CUBE)[0]
    eye_m = np.array([0.7, 1.7, 0.9])
    views = QuiltPanels(CUBE, quilt).seen_from(eye_m)
    for row, index in enumerate(quilt.panels):
        if views.facing[row]:
            way = CUBE.panels[index].position_m(np.array(place)) - eye_m
            nearer, farther = (views.near[row] / (views.clip[row, 2] @ (way * t)) for t in (start, start + step))
            assert 1 > nearer > farther > 0


def test_only_panels_whose_front_is_seen_face_the_eye() -> None:
    quilt = pack(CUBE)[0]
    names = [CUBE.panels[index].grid_name for index in quilt.panels]

    def seen(eye_m: tuple[float, float, float]) -> set[str]:
        facing = QuiltPanels(CUBE, quilt).seen_from(eye_m).facing
        return {name for name, faces in zip(names, facing, strict=True) if faces}

    assert seen((0.0, 1.2, 2.0)) == {"front"}
    assert seen((2.0, 2.0, 2.0)) == {"front", "right", "top"}
    assert seen((0.0, 1.2, 0.0)) == set(), "the cube's panels look outward"
    assert seen((3.0, 1.2, 0.15)) == {"right"}, "an eye in the plane of the front sees nothing of it"


@pytest.mark.parametrize("display", [CUBE, CAVE], ids=["outward", "inward"])
def test_the_corners_are_those_of_outline_and_guard(display: Display) -> None:
    quilt = pack(display, max_size_px=4096)[0]
    eye_m = np.array([0.35, 1.9, 0.4])
    views = QuiltPanels(display, quilt).seen_from(eye_m)
    for row, index in enumerate(quilt.panels):
        if not views.facing[row]:
            continue
        panel = display.panels[index]
        corners = views.corners[row, : views.corner_count[row]]
        assert (corners @ views.clip[row, 2] > 0).all(), "corners lie where the eye looks, not behind it"
        np.testing.assert_allclose(np.linalg.norm(corners, axis=1), 1)
        width, height = panel.size_px
        grown = np.array([[-1, -1], [width + 1, -1], [width + 1, height + 1], [-1, height + 1]], dtype=float)
        grown += np.sign(grown) * (GUARD_PX - 1)
        grown[[1, 2], 0], grown[[2, 3], 1] = width + GUARD_PX, height + GUARD_PX
        ways = panel.position_m(grown) - eye_m
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        for way in ways:
            assert np.abs(corners - way).sum(axis=1).min() < 1e-9
        inside = (views.edges[row] @ (panel.centre_m - eye_m)) / (views.clip[row, 2] @ (panel.centre_m - eye_m))
        assert math.isclose(inside.min(), min(width, height) / 2 + GUARD_PX, rel_tol=1e-6)


def test_two_eyes_are_drawn_side_by_side() -> None:
    display, quilt = tilted()
    windows = QuiltPanels(display, quilt, copies=2)
    eye_m = display.panels[0].centre_m + np.array(display.panels[0].normal)
    way = display.panels[0].position_m(np.array([12.5, 30.5])) - eye_m
    places = []
    for copy in (0, 1):
        x, _, w = windows.seen_from(eye_m, copy).clip[0] @ way
        places.append((x / w + 1) / 2 * quilt.size_px[0] * 2)
    np.testing.assert_allclose(places, [37 + 12.5, 700 + 37 + 12.5], atol=1e-9)
