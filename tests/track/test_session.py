from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.errors import SessionError
from limen.track.session import Session, Track
from limen.viewing.viewer import Viewer


def track(viewer: str = "v1", times: tuple[float, ...] = (0.0, 1.0, 2.0), **changes: object) -> Track:
    count = len(times)
    fields: dict[str, object] = {
        "time_s": np.array(times),
        "position_m": np.stack([np.arange(count), np.full(count, 1.7), np.zeros(count)], axis=1).astype(float),
        "direction": np.tile([0.0, 0.0, -2.0], (count, 1)),
    }
    return Track(viewer, **(fields | changes))  # type: ignore[arg-type]


def test_between_samples_positions_are_interpolated_and_gaze_is_the_last_ones():
    gaze = np.array([[1.0, 0, 0], [0, 1.0, 0], [math.nan] * 3])
    session = Session("s", "d", 1.0, (track(gaze=gaze, acuity_arcmin=np.array([0.5, math.nan, 1.0])),))
    (viewer,) = session.at(0.75)
    assert viewer.position_m == pytest.approx((0.75, 1.7, 0))
    assert viewer.direction == (0, 0, -1)
    assert viewer.gaze == (1, 0, 0)
    assert viewer.acuity_arcmin == 0.5
    assert session.at(1.0)[0].gaze == (0, 1, 0)
    assert session.at(1.5)[0].acuity_arcmin is None
    assert session.at(2.0)[0].gaze is None


def test_a_head_that_turns_around_between_two_samples_keeps_a_direction():
    turning = track(times=(0.0, 1.0), direction=np.array([[0, 0, 1.0], [0, 0, -1.0]]))
    assert Session("s", "d", 1.0, (turning,)).at(0.5)[0].direction == (0, 0, 1)


def test_before_the_first_and_after_the_last_sample_viewers_stand_still():
    session = Session("s", "d", 1.0, (track("a"), track("b", times=(1.0, 1.5))))
    assert [viewer.position_m[0] for viewer in session.at(0.0)] == [0, 0]
    assert [viewer.position_m[0] for viewer in session.at(9.0)] == [2, 1]


@given(rate=st.floats(0.5, 300), count=st.integers(1, 200), wanted=st.floats(0.5, 300))
def test_frames_are_evenly_spaced_and_fill_the_duration(rate: float, count: int, wanted: float):
    times = tuple(k / rate for k in range(count))
    session = Session("s", "d", rate, (track(times=times),))
    assert session.duration_s == pytest.approx(count / rate, abs=1e-5)
    at = session.times_s(wanted)
    assert at[0] == 0
    assert len(at) == max(1, math.floor(session.duration_s * wanted + 1e-3))
    assert np.allclose(np.diff(at), 1 / wanted)
    assert len(session.times_s()) == count


def test_frames_carry_every_viewer_and_the_time():
    frames = list(Session("s", "d", 1.0, (track("a"), track("b"))).frames(2.0))
    assert len(frames) == 6
    assert [viewer.name for viewer in frames[3].viewers] == ["a", "b"]
    assert frames[3].time_s == frames[3].viewers[0].time_s == 1.5


def test_length_is_that_of_all_paths():
    assert Session("s", "d", 1.0, (track("a"), track("b"))).length_m == pytest.approx(4)


def test_a_session_of_viewers_in_any_order():
    viewers = [Viewer((t, 1, 0), time_s=t, name=name, acuity_arcmin=1.0) for t in (2.0, 0.0, 1.0) for name in "ab"]
    session = Session.of("s", "d", 1.0, viewers)
    assert [list(each.time_s) for each in session.tracks] == [[0, 1, 2], [0, 1, 2]]
    assert session.at(1.0)[1].at_rest == Viewer((1, 1, 0), time_s=1.0, name="b", acuity_arcmin=1.0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"times": (0.0, 2.0, 1.0)}, "sample 2: time_s does not grow"),
        ({"times": (0.0, 0.0)}, "sample 1: time_s does not grow"),
        ({"times": (0.0, math.nan)}, "time_s is not a finite number"),
        ({"times": (math.inf, math.inf)}, "time_s is not a finite number"),
        ({"times": ()}, "has no samples"),
        ({"position_m": np.full((3, 3), math.nan)}, "position is not finite"),
        ({"position_m": np.zeros((3, 2))}, "position_m must have shape"),
        ({"direction": np.zeros((3, 3))}, "direction is zero"),
        ({"direction": np.full((3, 3), math.inf)}, "direction is not finite"),
        ({"gaze": np.zeros((3, 3))}, "gaze is zero"),
        ({"gaze": np.array([[1, 0, math.nan]] * 3)}, "gaze is not finite"),
        ({"acuity_arcmin": np.array([1.0, 0.0, 1.0])}, "sample 1: acuity_arcmin must lie above 0"),
        ({"acuity_arcmin": np.array([1.0, 1.0, math.inf])}, "sample 2: acuity_arcmin"),
    ],
)
def test_tracks_that_cannot_be(changes: dict[str, object], says: str):
    with pytest.raises(SessionError, match=says):
        track(**changes)  # type: ignore[arg-type]


def test_sessions_that_cannot_be():
    with pytest.raises(SessionError, match="no viewers"):
        Session("s", "d", 1.0, ())
    with pytest.raises(SessionError, match="two viewers are named 'v1'"):
        Session("s", "d", 1.0, (track(), track()))
    for rate in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(SessionError, match="rate_hz"):
            Session("s", "d", rate, (track(),))
        with pytest.raises(SessionError, match="rate_hz"):
            Session("s", "d", 1.0, (track(),)).times_s(rate)


def test_pointers_go_beside_the_viewers_and_are_none():
    viewers, hand = (track("a"), track("b", times=(0.0, 4.0))), track("a", times=(1.0, 2.0))
    session, without = Session("s", "d", 1.0, viewers, (hand,)), Session("s", "d", 1.0, viewers)
    for with_them, alone in zip(session.frames(), without.frames(), strict=True):
        assert with_them.viewers == alone.viewers
        assert (len(with_them.pointers), alone.pointers) == (1, ())
        assert with_them.pointers == session.pointers_at(with_them.time_s)
    assert (session.length_m, session.duration_s, session.sample_count) == (
        without.length_m, without.duration_s, without.sample_count,
    )  # fmt: skip
    (pointer,) = session.pointers_at(1.25)
    assert pointer.position_m == pytest.approx((0.25, 1.7, 0))
    assert (pointer.direction, pointer.time_s, pointer.name) == ((0, 0, -1), 1.25, "a")


def test_pointers_that_cannot_be():
    with pytest.raises(SessionError, match="two pointers are named 'p'"):
        Session("s", "d", 1.0, (track(),), (track("p"), track("p")))
    with pytest.raises(SessionError, match="pointer 'p' has a gaze or an acuity"):
        Session("s", "d", 1.0, (track(),), (track("p", acuity_arcmin=np.ones(3)),))
    with pytest.raises(SessionError, match="no viewers"):
        Session("s", "d", 1.0, (), (track("p"),))


def test_velocities_are_those_of_the_last_tenth_of_a_second():
    session = Session("s", "d", 1.0, (track(),))
    assert [viewer.velocity_m_s[0] for time_s in (0.0, 0.05, 1.0, 2.05, 9.0) for viewer in session.at(time_s)] == (
        pytest.approx([0, 0.5, 1, 0.5, 0])
    )
    jumped = track(times=(0.0, 1.0, 1.01), position_m=np.array([[0, 1.7, 0], [0, 1.7, 0], [3.0, 1.7, 0]]))
    assert Session("s", "d", 1.0, (jumped,)).at(1.01)[0].velocity_m_s == (0, 0, 0)
