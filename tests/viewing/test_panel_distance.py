"""The smallest angle, distance and tolerance over a panel, against panels that are covered with samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.display.panel import Panel
from limen.geometry import Floats
from limen.viewing.panel_distance import MOST_SLACK_DEG, angle_deg, least_tolerance_m, nearest_m, smallest_angle_deg
from limen.vision.acuity import eccentricity_scale

SIDES = 48  # samples along each side of a triangle of an outline


def panel_of(corners: int, turn: float, tall: float) -> Panel:
    """A panel of 1 m, of 3 to 8 corners, that hangs at z = 0."""
    at = turn + 2 * np.pi * np.arange(corners) / corners
    outline = np.stack([500 + 499 * np.cos(at), (500 + 499 * np.sin(at)) * tall], axis=1)
    return Panel(
        "p", (1000, math.ceil(1000 * tall)), (-0.5, tall / 2, 0), (1, 0, 0), (0, -1, 0), (1e-3, 1e-3),
        outline_px=tuple((float(x), float(y)) for x, y in outline),
    )  # fmt: skip


def places_on(corners: Floats) -> Floats:
    """Places all over a convex outline, its edges and corners included."""
    u, v = np.meshgrid(np.linspace(0, 1, SIDES), np.linspace(0, 1, SIDES))
    inside = u + v <= 1 + 1e-9
    share = np.stack([1 - u[inside] - v[inside], u[inside], v[inside]], axis=1)
    fans = [share @ corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
    along = np.linspace(0, 1, 400)[:, None]
    edges = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.concatenate([*fans, *edges])


panels = st.builds(panel_of, st.integers(3, 8), st.floats(0, 7), st.floats(0.3, 1.0))
eyes = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.05, 3)).map(np.array)
lines = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


def padded(panel: Panel, eye: Floats) -> Floats:
    """The corners from the eye, with the last one repeated as `Display.outlines_m` does."""
    corners = panel.outline_m - eye
    return np.concatenate([corners, np.repeat(corners[-1:], 8 - len(corners), axis=0)])


@settings(max_examples=150, deadline=None)
@given(panel=panels, eye=eyes, line=lines)
def test_no_sample_is_nearer_to_the_line_of_sight_or_the_eye_and_some_are_nearly_so(panel, eye, line):
    corners, normal = padded(panel, eye), np.array(panel.normal)
    places = places_on(panel.outline_m) - eye
    spacing_deg = math.degrees(0.03 / np.linalg.norm(places, axis=1).min())
    sampled = angle_deg(places, line).min()
    exact = smallest_angle_deg(corners, normal, line)
    assert exact <= sampled + 1e-6
    assert exact >= sampled - spacing_deg
    near = nearest_m(corners, normal)
    assert near <= np.linalg.norm(places, axis=1).min() + 1e-9
    assert near >= np.linalg.norm(places, axis=1).min() - 0.03


@settings(max_examples=60, deadline=None)
@given(panel=panels, eye=eyes, line=lines)
def test_the_smallest_angle_off_a_panel_is_reached_at_an_edge(panel, eye, line):
    """Between dense samples of the edges alone the angle differs in the second order: a sharper test of the formula."""
    corners, normal = padded(panel, eye), np.array(panel.normal)
    exact = smallest_angle_deg(corners, normal, line)
    if exact > 0:
        along = np.linspace(0, 1, 4001)[:, None]
        ring = panel.outline_m - eye
        edges = np.concatenate([a + along * (b - a) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)])
        step_deg = math.degrees(np.linalg.norm(np.diff(edges[:4001], axis=0), axis=1).max() * 2)
        step_deg /= np.linalg.norm(edges, axis=1).min()
        assert angle_deg(edges, line).min() == pytest.approx(
            exact, abs=max(step_deg**2, 1e-6) + 0.5 * step_deg * (exact < 1)
        )


def test_a_line_of_sight_through_a_panel_has_no_angle_to_it_and_one_away_from_it_has():
    panel = panel_of(4, 0.3, 1.0)
    eye = np.array([0.1, -0.1, 0.7])
    corners, normal = padded(panel, eye), np.array(panel.normal)
    for place in places_on(panel.outline_m)[::97]:
        inward = place * 0.999
        line = (inward - eye) / np.linalg.norm(inward - eye)
        assert smallest_angle_deg(corners, normal, line) == 0
        assert smallest_angle_deg(corners, normal, -line) > 90


@settings(max_examples=120, deadline=None)
@given(panel=panels, eye=eyes, line=lines, slack=st.sampled_from([0.0, 5.0, 15.0, 60.0]))
def test_the_least_tolerance_is_never_more_than_at_any_sample_and_hardly_less(panel, eye, line, slack):
    corners, normal = padded(panel, eye), np.array(panel.normal)
    places = places_on(panel.outline_m) - eye
    beside = angle_deg(places, line)
    every = np.linalg.norm(places, axis=1) * eccentricity_scale(np.maximum(beside - slack, 0))
    least = least_tolerance_m(corners, normal, line, np.array(slack))
    assert least <= every.min() * (1 + 1e-9)
    if beside.max() <= 120:  # farther off, a smaller function stands in
        # Samples are up to 2 cm from the true minimum, where it may be smaller by the slope, at most U + U'.
        slope = (every / np.linalg.norm(places, axis=1))[every.argmin()] + math.degrees(0.1)
        assert least >= 0.99 * every.min() - 0.02 * slope


def test_the_least_tolerance_of_a_wall_that_is_looked_at_from_the_side_is_found_to_some_thousandths():
    """From eyes that look at the nearest place, and past it."""
    panel = panel_of(4, math.pi / 4, 1.0)
    corners = panel.outline_m
    normal = np.array(panel.normal)
    for eye in ([0.6, 0.1, 0.3], [0.0, 0.0, 0.5], [-0.9, 0.3, 0.2]):
        for target in ([0.0, 0.0, 0], [-0.3, 0.2, 0], [1.5, 0, 0]):
            line = np.array(target) - eye
            line /= np.linalg.norm(line)
            across, down = corners[1] - corners[0], corners[3] - corners[0]
            u, v, smallest = 0.5, 0.5, math.inf
            for half in (0.5, 0.01, 0.0002):  # ever finer about the smallest so far
                us, vs = (np.linspace(max(middle - half, 0), min(middle + half, 1), 201) for middle in (u, v))
                places = corners[0] + us[:, None, None] * across + vs[None, :, None] * down - eye
                every = np.linalg.norm(places, axis=-1) * eccentricity_scale(angle_deg(places, line))
                row, column = np.unravel_index(every.argmin(), every.shape)
                u, v, smallest = us[row], vs[column], min(smallest, every.min())
            least = least_tolerance_m(corners - eye, normal, line, np.array(0.0))
            assert least == pytest.approx(smallest, rel=4e-3)
            assert least <= smallest


def test_a_gaze_that_is_unknown_or_known_too_badly_leaves_the_distance():
    panel = panel_of(5, 0.0, 0.8)
    corners, normal = padded(panel, np.array([0.2, 0.1, 0.6])), np.array(panel.normal)
    near = nearest_m(corners, normal)
    aside = np.array([1.0, 0, 0])
    assert least_tolerance_m(corners, normal, np.zeros(3), np.array(0.0)) == near
    assert least_tolerance_m(corners, normal, aside, np.array(MOST_SLACK_DEG + 1)) == near
    assert least_tolerance_m(corners, normal, aside, np.array(0.0)) > 2 * near
