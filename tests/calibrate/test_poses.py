"""Rigid motions: a group, its action, and the panels in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.calibrate import poses

numbers = st.floats(-3, 3)
pose = st.lists(numbers, min_size=6, max_size=6).map(np.array)
points = st.lists(st.lists(numbers, min_size=3, max_size=3), min_size=1, max_size=5).map(np.array)


@given(pose, pose, points)
def test_composing_is_doing_one_after_the_other(after, first, places):
    once = poses.apply(poses.compose(after, first), places)
    assert once == pytest.approx(poses.apply(after, poses.apply(first, places)), abs=1e-9)


@given(pose, points)
def test_the_inverse_undoes(motion, places):
    assert poses.apply(poses.inverse(motion), poses.apply(motion, places)) == pytest.approx(places, abs=1e-9)


@given(pose, points)
def test_distances_and_handedness_stay(motion, places):
    moved = poses.apply(motion, places)
    before, after = places - places[0], moved - moved[0]
    assert np.linalg.norm(after, axis=1) == pytest.approx(np.linalg.norm(before, axis=1), abs=1e-9)
    axes = poses.apply(motion, np.eye(3)) - poses.apply(motion, np.zeros((1, 3)))
    assert np.linalg.det(axes) == pytest.approx(1)


@given(pose, st.integers(0, 2**32 - 1))
def test_a_fit_finds_the_motion_that_was_made(motion, seed):
    places = np.random.default_rng(seed).normal(size=(6, 3))
    found = poses.fit(places, poses.apply(motion, places))
    assert poses.apply(found, places) == pytest.approx(poses.apply(motion, places), abs=1e-7)


def test_a_fit_needs_three_points():
    with pytest.raises(ValueError, match="three"):
        poses.fit(np.zeros((2, 3)), np.zeros((2, 3)))


@pytest.mark.parametrize("name", ["cube", "cave", "rostock"])
def test_a_panels_pose_takes_its_corners_into_the_room(name):
    for panel in limen.Display.preset(name).panels:
        width, height = panel.size_m
        own = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]])
        assert poses.apply(poses.of_panel(panel), own) == pytest.approx(panel.corners_m, abs=1e-9)
        toward = poses.apply(poses.of_panel(panel), np.array([[0, 0, -1.0]]))[0] - panel.origin_m
        assert toward == pytest.approx(panel.normal, abs=1e-9)


@given(pose)
def test_a_panel_hung_at_a_pose_is_there(motion):
    panel = poses.panel_at(limen.Display.preset("desktop").panels[0], motion)
    again = poses.of_panel(panel)
    assert poses.apply(again, np.eye(3)) == pytest.approx(poses.apply(motion, np.eye(3)), abs=1e-9)


def test_angles_are_those_of_the_rotation():
    assert poses.turn_deg(np.array([0, np.pi / 2, 0, 5, 5, 5])) == pytest.approx(90)
