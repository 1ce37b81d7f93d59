"""The camera: pixels and rays undo each other, and clip space is the same projection."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import InputError
from limen.viewing.camera import Camera

_NUMBER = st.floats(-3, 3)
_PLACE = st.tuples(_NUMBER, _NUMBER, _NUMBER)


def cameras() -> Any:
    """Looking about along -z, tilted, with the axis anywhere."""
    return st.builds(
        lambda eye, tilt, size, fov, axis: Camera(
            eye, (eye[0] + tilt[0] / 4, eye[1] + tilt[1] / 4, eye[2] - 2.0), size, fov, axis_px=axis
        ),
        _PLACE,
        _PLACE,
        st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
        st.floats(5, 120),
        st.none() | st.tuples(st.floats(-500, 4000), st.floats(-500, 4000)),
    )


@given(
    cameras(), st.lists(st.tuples(st.floats(0, 4000), st.floats(0, 4000)), min_size=1, max_size=5), st.floats(0.1, 9)
)
@settings(deadline=None)
def test_what_lies_on_a_pixels_ray_is_seen_in_it(camera: Camera, places: list[Any], depth_m: float) -> None:
    points = np.array(camera.eye_m) + camera.rays(np.array(places)) * depth_m
    found, depth = camera.project(points)
    np.testing.assert_allclose(found, places, atol=1e-5 * max(camera.focal_px, 1))
    np.testing.assert_allclose(depth, depth_m, rtol=1e-9)


@given(cameras(), _PLACE, st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)))
@settings(deadline=None)
def test_clip_space_is_the_same_projection(camera: Camera, step: Any, shift: Any) -> None:
    """A pixel's centre, moved by ``shift``, looks at what lands in the pixel's centre in clip space."""
    way = camera.axes[2] * 4 + np.array(step) / 3
    place, depth = camera.project(np.array(camera.eye_m) + way)
    x, y, w = camera.clip_rows(shift) @ way
    width, height = camera.size_px
    seen = np.array([(x / w + 1) * width / 2, (1 - y / w) * height / 2])
    np.testing.assert_allclose(seen, place - shift, atol=1e-6 * max(camera.focal_px, 1))
    assert w == pytest.approx(depth)


def test_right_is_right_and_up_is_up() -> None:
    camera = Camera((0, 0, 0), (0, 0, -1), (100, 80), 90.0)
    place, depth = camera.project(np.array([[0.5, 0.0, -1.0], [0.0, 0.5, -1.0], [0.0, 0.0, -2.0]]))
    np.testing.assert_allclose(place, [[70, 40], [50, 20], [50, 40]])  # tan 45 degrees is half the height
    np.testing.assert_allclose(depth, [1, 1, 2])


@given(st.lists(_PLACE, min_size=1, max_size=9), _PLACE.filter(lambda v: np.hypot(v[0], v[2]) > 0.2))
@settings(deadline=None)
def test_a_framing_camera_sees_everything_and_goes_no_farther_than_it_must(points: list[Any], toward: Any) -> None:
    places = np.array(points)
    camera = Camera.framing(places, np.array(toward), (320, 240))
    seen, depth = camera.project(places)
    assert (depth > 0).all()
    share = np.abs(seen - [160, 120]).max(axis=0) / [160, 120]
    assert (share <= np.array([0.9, 0.82]) + 1e-6).all()
    if depth.min() > 0.05 + 0.02 * np.ptp(places, axis=0).max():  # else the points themselves were in the way
        assert share[0] > 0.9 - 1e-6 or share[1] > 0.82 - 1e-6
    np.testing.assert_allclose(camera.axes[2], -np.array(toward) / np.linalg.norm(toward), atol=1e-6)


def test_another_size_is_the_same_view() -> None:
    camera = Camera((0, 0, 0), (0, 0, -1), (100, 80), 50.0, axis_px=(40.0, 70.0))
    large = camera.sized((200, 160))
    point = np.array([0.2, -0.3, -1.4])
    np.testing.assert_allclose(large.project(point)[0], 2 * camera.project(point)[0])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"target_m": (0, 0, 0)}, "the way to target_m must not be the zero vector"),
        ({"up": (0, 0, 2)}, "up must not lie along the way to target_m"),
        ({"size_px": (0, 9)}, "size_px must be from 1 pixel a side"),
        ({"fov_deg": 180.0}, "fov_deg must lie between 0 and 180"),
        ({"eye_m": (0, float("nan"), 0)}, "eye_m must be three finite numbers"),
        ({"axis_px": (0, float("inf"))}, "axis_px must be finite"),
    ],
)
def test_an_impossible_camera_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^camera: {message}"):
        Camera(**{"eye_m": (0, 0, 0), "target_m": (0, 0, -1)} | fields)
