"""What nobody can see: laws of the acuity formula and of several viewers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.errors import InputError
from limen.viewing.policy import Policy
from limen.viewing.tolerance import STANDS, scheel_px, tolerance_of
from limen.vision.acuity import acuity_from, acuity_level, optimal_distance_m
from limen.vision.motion import motion_scale

places = st.tuples(*[st.floats(-9, 9)] * 3)
acuities = st.floats(0.1, 10)


def test_the_papers_figures():
    inch = 0.0254
    pitch = 23.53 / 2560 * inch
    assert optimal_distance_m(pitch) / inch == pytest.approx(31.60, abs=0.005)
    square = 20 / math.hypot(2048, 2048) * inch
    assert optimal_distance_m(square) / inch == pytest.approx(23.74, abs=0.005)
    assert [acuity_level(inches * inch, pitch) for inches in (30, 63.1, 63.3, 126.5, 198)] == [0, 0, 1, 2, 2]


def test_levels_change_exactly_at_powers_of_two_of_the_optimal_distance():
    pitch = 1e-3
    best = optimal_distance_m(pitch, 0.64)
    for level in range(1, 6):
        edge = best * 2**level
        assert acuity_level(np.nextafter(edge, 0), pitch, 0.64) == level - 1
        assert acuity_level(edge * (1 + 1e-15), pitch, 0.64) == level


@given(places, st.lists(st.tuples(places, acuities), min_size=1, max_size=4), acuities)
def test_another_viewer_never_allows_more(place, viewers, acuity):
    people = [limen.Viewer(position, acuity_arcmin=own) for position, own in viewers]
    policy = Policy("acuity", acuity)
    together = tolerance_of(people, policy).allowed_m(np.array(place))
    alone = [tolerance_of([person], policy).allowed_m(np.array(place)) for person in people]
    assert together == pytest.approx(min(alone))


@given(places, places, acuities, st.floats(1.01, 5))
def test_duller_eyes_allow_more(place, position, acuity, factor):
    viewer = limen.Viewer(position)
    sharp, dull = (
        tolerance_of([viewer], Policy("acuity", a)).allowed_m(np.array(place)) for a in (acuity, acuity * factor)
    )
    assert dull >= sharp


def test_full_tolerates_nothing_and_both_eyes_count():
    viewer = limen.Viewer((0, 0, 0), direction=(0, 0, -1))
    assert tolerance_of([viewer], Policy("full")).allowed_m(np.array([5.0, 0, 0])) == 0
    assert tolerance_of([], Policy("acuity")).allowed_m(np.array([5.0, 0, 0])) == 0, "nobody known: nothing is left out"
    allowed = tolerance_of([viewer], Policy("acuity", 60)).allowed_m(np.array([[5.0, 0, 0], [-5.0, 0, 0]]))
    np.testing.assert_allclose(allowed, (5 - 0.0315) * math.tan(math.radians(1)))


def test_policies_by_name():
    assert Policy.parse("acuity").acuity_arcmin == 0.64
    assert Policy.parse("acuity", "snellen") == Policy.parse("snellen") == Policy("acuity", 1.0)
    assert acuity_from("human") == 0.64
    for bad in ("sharp", "0", "-1", "nan"):
        with pytest.raises(InputError, match="acuity"):
            Policy.parse("acuity", bad)
    with pytest.raises(InputError, match="full, acuity"):
        Policy.parse("everything")


@pytest.mark.parametrize(
    ("field", "value"),
    [("position_m", (0, math.nan, 0)), ("direction", (0, 0, 0)), ("acuity_arcmin", 0), ("gaze", (math.inf, 0, 0)),
     ("time_s", math.nan), ("eye_separation_m", -1)],
)  # fmt: skip
def test_impossible_viewers_are_refused(field, value):
    with pytest.raises(InputError, match=field):
        limen.Viewer(**{"position_m": (0, 1.7, 0), field: value})


def test_eyes_lie_left_and_right_of_the_head():
    eyes = limen.Viewer((1, 1.7, 0), direction=(1, 0, 0), eye_separation_m=0.06).eyes_m
    np.testing.assert_allclose(eyes, [[1, 1.7, -0.03], [1, 1.7, 0.03]], atol=1e-12)
    assert limen.Viewer((0, 0, 0), direction=(0, 1, 0)).eyes_m.shape == (2, 3)
    assert limen.Viewer((0, 0, 0), eye_separation_m=0).eyes_m.shape == (1, 3)


def test_scheels_policy_is_named_without_acuity_or_gaze_and_is_for_panels():
    policy = Policy.parse("scheel", 2.0)
    assert policy == Policy("scheel")
    assert policy.label == policy.title == "scheel"
    with pytest.raises(InputError, match=r"no policy is named 'scheel\+gaze'"):
        Policy.parse("scheel+gaze")
    with pytest.raises(InputError, match="take acuity for anything else"):
        tolerance_of([limen.Viewer((0, 0, 0))], policy)


def test_scheels_formula():
    """1 arcminute where one looks, 11 at 60 degrees (equation 3); equation 2 says that an arcminute is a pixel."""
    pixel_m = 2 * 1.5 * math.tan(math.radians(1 / 60) / 2)
    assert scheel_px(1.5, [0.0, 60.0], pixel_m) == pytest.approx([1.0, 11.0], rel=1e-4)
    assert scheel_px([1.5, 3.0], 0.0, pixel_m) == pytest.approx([1.0, 2.0])


def test_policies_that_spend_a_number_of_items_say_how_many():
    policy = Policy.parse("budget+gaze:29866", "snellen")
    assert policy == Policy("budget", 1.0, gaze=True, max_items=29866) == Policy.parse("budget+gaze", 1.0, 29866)
    assert policy.label == "budget+gaze:29866 1'"
    assert Policy.parse("size:5").label == Policy.parse("size:5").title == "size:5"
    assert policy.eyesight == Policy("contrast", 1.0, gaze=True)
    assert Policy("acuity").eyesight == Policy("acuity")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("budget", "how many triangles or splats may the policy budget spend"),
        ("budget:0", "at least 1"),
        ("budget:many", "is no policy: a number follows budget or size alone"),
        ("acuity:5", "is no policy: a number follows budget or size alone"),
        ("size+gaze:5", "no policy is named"),
        ("size+motion:5", "no policy is named"),
        ("contrast+gaze+gaze", "no policy is named"),
        ("contrast+", "no policy is named"),
        ("full+motion", "no policy is named"),
    ],
)
def test_what_may_be_spent_has_to_make_sense(text, says):
    with pytest.raises(InputError, match=says):
        Policy.parse(text)


def test_a_number_of_items_is_for_meshes_and_points():
    with pytest.raises(InputError, match="images and terrains take full"):
        tolerance_of([limen.Viewer((0, 0, 0))], Policy.parse("budget:100"))
    with pytest.raises(InputError, match="take budget for that"):
        Policy("acuity", max_items=5)


def test_what_passes_is_allowed_more_by_its_own_velocity():
    """A viewer walks to the right at 1 m/s: ahead, in 2 m, that is 28.6 degrees a second; where she walks to, none."""
    walker = limen.Viewer((0, 0, 0), eye_separation_m=0.0, velocity_m_s=(1.0, 0, 0))
    places = np.array([[0, 0, -2.0], [2.0, 0, 0], [0, 3.0, -4.0], [0, 0, 0]])
    policy = Policy.parse("acuity+motion+gaze")
    assert policy == Policy("acuity", gaze=True, motion=True)
    assert policy.title == "acuity+gaze+motion"
    policy = Policy("acuity", motion=True)
    still = tolerance_of([walker], Policy("acuity")).allowed_m(places)
    grown = tolerance_of([walker], policy, STANDS).allowed_m(places)
    np.testing.assert_allclose(grown[:3] / still[:3], motion_scale(np.degrees([0.5, 0.0, 0.2])))
    assert grown[3] == 0
    # What turns about the upright at one radian a second, 1 m before an eye that stands, is passed as fast everywhere.
    turns = np.array([[0, 0, 1.0, 0], [0, 0, 0, 0], [-1.0, 0, 0, 0]])
    around = np.array([[0, 0, -1.0], [1.0, 0, 0], [0.6, 0, 0.8]])
    stands = limen.Viewer((0, 0, 0), eye_separation_m=0.0)
    ratio = tolerance_of([stands], policy, turns).allowed_m(around) / tolerance_of([stands], Policy()).allowed_m(around)
    np.testing.assert_allclose(ratio, motion_scale(np.degrees(1.0)))
    both = tolerance_of([walker, stands], policy, STANDS).allowed_m(places)
    np.testing.assert_allclose(both, still, err_msg="whoever stands sees everything")


def test_motion_is_for_what_stays_in_memory():
    with pytest.raises(InputError, match=r"leave out \+motion"):
        tolerance_of([limen.Viewer((0, 0, 0))], Policy("acuity", motion=True))
