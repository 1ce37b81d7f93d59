from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.display.display import Display
from limen.display.files import preset_names
from limen.display.grid import Grid, panels_of_grid
from limen.errors import InputError, MissingFileError
from limen.track.replay import session_text, write_session
from limen.track.room import BODY_M, room_of
from limen.track.session import Session
from limen.track.walk import SESSIONS, SPEED_M_PER_S, heat_map, hotspots, make_walk, plan_of, session_named
from limen.viewing.panel_demands import panel_demands
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer


def display_of(*grids: Grid) -> Display:
    panels, edge = [], 0.0
    for grid in grids:
        panels += panels_of_grid(grid, edge)
        edge += 3.0
    return Display("made", tuple(panels))


def wall(name: str, centre: tuple[float, float, float], facing: tuple[float, float, float]) -> Grid:
    return Grid(name=name, size_px=(1000, 500), size_m=(2.0, 1.0), centre_m=centre, facing=facing)


def flat(name: str, size_m: tuple[float, float], height_m: float) -> Grid:
    at = (0.0, height_m, 0.0)
    return Grid(name=name, size_px=(900, 600), size_m=size_m, centre_m=at, facing=(0, 1, 0), up=(0, 0, -1))


# Of the displays of many small panels, the cylinder, the desk, the teapot and a sphere stand for all.
@pytest.mark.parametrize("name", sorted({*preset_names()} - {"knot", "sphere", "spring"}))
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_walk_stays_on_the_floor_at_one_speed(name: str, seed: int):
    display = Display.preset(name)
    session = make_walk(display, 30.0, seed, viewers=2)
    room = room_of(display)
    assert session.duration_s == 30.0
    assert session.sample_count == 3600
    for track in session.tracks:
        place = track.position_m[:, [0, 2]]
        # Straight ways between cells may cut a corner of the walkable floor by less than the step it is tried at.
        assert room.wall_distance_m(place)[0].min(initial=9) >= BODY_M - 0.01
        assert (place >= room.low).all()
        assert (place <= room.high).all()
        steps = np.linalg.norm(np.diff(place, axis=0), axis=1) * 120
        assert steps.max() <= SPEED_M_PER_S + 1e-3
        assert np.median(steps) == pytest.approx(SPEED_M_PER_S, abs=1e-3)
        assert np.ptp(track.position_m[:, 1]) == 0
        assert 1.0 <= track.position_m[0, 1] <= 2.0
        assert np.allclose(np.linalg.norm(track.direction, axis=1), 1, atol=1e-5)
        # Heads turn fast, not at once: 100 degrees in a tenth of a second is the most for a turn on the spot.
        turned = np.degrees(np.arccos(np.clip((track.direction[12:] * track.direction[:-12]).sum(axis=1), -1, 1)))
        assert turned.max() < 100
    assert session.length_m == pytest.approx(2 * 30 * SPEED_M_PER_S, rel=0.03)


def test_inside_a_room_everybody_is_in_front_of_every_wall():
    display = Display.preset("reality-deck")
    session = make_walk(display, 60.0, 5)
    for panel in display.panels:
        ahead = (session.tracks[0].position_m - panel.origin_m) @ np.array(panel.normal)
        assert ahead.min() > BODY_M - 0.01


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not():
    display = Display.preset("cave")
    first = session_text(make_walk(display, 20.0, 7, viewers=2))
    assert first == session_text(make_walk(display, 20.0, 7, viewers=2))
    assert first != session_text(make_walk(display, 20.0, 8, viewers=2))


def test_the_first_of_several_walks_as_one_alone():
    display = Display.preset("cave")
    alone, three = make_walk(display, 10.0, 7), make_walk(display, 10.0, 7, viewers=3)
    assert np.array_equal(alone.tracks[0].position_m, three.tracks[0].position_m)
    assert [track.viewer for track in three.tracks] == ["v1", "v2", "v3"]
    assert not np.array_equal(three.tracks[1].position_m, three.tracks[2].position_m)


def test_the_named_sessions_have_the_papers_lengths(tmp_path):
    display = Display.preset("rostock")
    for name, (seconds, _) in SESSIONS.items():
        session = session_named(name, display)
        assert (session.name, session.display, session.duration_s) == (name, "rostock", seconds)
        assert session.sample_count == seconds * 120
    path = tmp_path / "mine.csv"
    write_session(path, session)
    assert session_text(session_named(str(path), display)) == session_text(session)


def test_the_heat_map_is_where_people_can_stand():
    for name in preset_names():
        heat = heat_map(Display.preset(name), 3)
        assert sorted(heat.visits.shape) == [100, 160]
        assert not heat.visits[~heat.room.mask].any()
        assert heat.visits.sum() == pytest.approx(40_000, rel=0.05)
        distance, _ = heat.room.wall_distance_m(heat.room.cell_centres_m.reshape(-1, 2))
        visits = heat.visits.ravel()
        near = (distance > 0.45) & (distance < 1.5)
        far = (distance > 2.2) & heat.room.mask.ravel()
        if far.any():
            assert visits[near].mean() > 2 * visits[far].mean()


def test_six_hotspots_on_the_floor_and_all_of_them_visited_before_new_ones():
    heat = heat_map(Display.preset("reality-deck"), 1)
    spots = hotspots(heat, np.random.default_rng(0))
    assert spots.shape == (6, 2)
    assert len(np.unique(spots, axis=0)) == 6
    assert heat.room.walkable(spots).all()
    plan = plan_of(heat, 1, 0, 100.0)
    assert len(plan.stops) > 12
    first = plan.corners_m[plan.stops[:6]]
    assert len(np.unique(first, axis=0)) == 6


@pytest.mark.parametrize(
    ("grids", "around"),
    [
        ([wall("a", (0, 1.5, 0), (0, 0, 1))], False),
        ([wall("a", (0, 1.5, 0), (1, 0, 0))], False),
        ([wall("a", (0, 1.5, 0), (0.6, 0, 0.8))], False),
        ([wall("a", (0, 1.5, 0), (0, 0.5, 1))], False),
        ([wall("a", (0, 1.5, -2), (0, 0, 1)), wall("b", (0, 1.5, 2), (0, 0, -1))], False),
        ([wall("a", (0, 1.5, -0.1), (0, 0, -1)), wall("b", (0, 1.5, 0.1), (0, 0, 1))], True),
        ([flat("floor", (3.0, 3.0), 0.0)], False),
        ([flat("table", (1.5, 1.0), 0.8)], False),
    ],
    ids=["wall", "side wall", "oblique", "leaning", "corridor", "back to back", "floor", "table"],
)  # fmt: skip
def test_any_display_has_a_floor(grids: list[Grid], around: bool):
    display = display_of(*grids)
    room = room_of(display)
    assert room.around is around
    session = make_walk(display, 20.0, 1)
    places = session.tracks[0].position_m[:, [0, 2]]
    assert room.wall_distance_m(places)[0].min() >= BODY_M - 0.01
    for low, high in room.rows.tables:
        assert not ((places > low) & (places < high)).all(axis=1).any()
    seen = [((session.tracks[0].position_m - panel.origin_m) @ np.array(panel.normal) > 0) for panel in display.panels]
    assert np.any(seen, axis=0).all()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"seconds": 0.0}, "seconds must"),
        ({"seconds": float("nan")}, "seconds must"),
        ({"seconds": -1.0}, "seconds must"),
        ({"seconds": 1e9}, "seconds must"),
        ({"viewers": 0}, "viewers must"),
        ({"seed": -1}, "seed must"),
        ({"rate_hz": 0.0}, "rate_hz must"),
    ],
)
def test_walks_that_cannot_be(arguments: dict[str, float], says: str):
    with pytest.raises(InputError, match=says):
        make_walk(Display.preset("desktop"), **({"seconds": 1.0} | arguments))  # type: ignore[arg-type]


def test_unknown_sessions(tmp_path):
    display = Display.preset("desktop")
    with pytest.raises(InputError, match="no session is named 'D': there are A, B, C"):
        session_named("D", display)
    with pytest.raises(MissingFileError):
        session_named(str(tmp_path / "none.csv"), display)


def test_a_made_up_eye_tracker_fixates_and_jumps_near_where_the_head_points():
    display = Display.preset("reality-deck")
    plain, tracked = make_walk(display, 20.0, seed=4), make_walk(display, 20.0, seed=4, gaze=True)
    (before,), (track,) = plain.tracks, tracked.tracks
    np.testing.assert_array_equal(before.position_m, track.position_m)
    assert before.gaze is None
    np.testing.assert_allclose(np.linalg.norm(track.gaze, axis=1), 1, atol=2e-6)
    jumps = np.flatnonzero((np.diff(track.gaze, axis=0) != 0).any(axis=1)) + 1
    held_s = np.diff(track.time_s[jumps])
    assert 0.2 < np.median(held_s) < 0.45
    beside = np.degrees(np.arccos((track.gaze * track.direction).sum(axis=1).clip(-1, 1)))[jumps]
    assert 4 < np.median(beside) < 12
    assert beside.max() < 18
    again = make_walk(display, 20.0, seed=4, gaze=True)
    np.testing.assert_array_equal(again.tracks[0].gaze, track.gaze)
    named = session_named("A+gaze", display)
    assert named.name == "A+gaze"
    assert named.tracks[0].gaze is not None
    assert session_named("A", display).tracks[0].gaze is None


@pytest.mark.parametrize("name", ["rostock", "cave", "cube"])
def test_pointers_wander_over_the_panels_in_the_hands_of_viewers(name: str):
    display = Display.preset(name)
    session = make_walk(display, 10.0, 3, viewers=2, pointers=3)
    assert session_text(session) == session_text(make_walk(display, 10.0, 3, viewers=2, pointers=3))
    alone = make_walk(display, 10.0, 3, viewers=2)
    for with_them, without in zip(session.tracks, alone.tracks, strict=True):
        assert np.array_equal(with_them.position_m, without.position_m)
    assert [track.viewer for track in session.pointers] == ["p1", "p2", "p3"]
    for number, track in enumerate(session.pointers):
        reach = np.linalg.norm(track.position_m - session.tracks[number % 2].position_m, axis=1)
        assert reach == pytest.approx(np.hypot(0.4, 0.2), abs=1e-5)
        turned = np.degrees(np.arccos(np.clip((track.direction[1:] * track.direction[:-1]).sum(axis=1), -1, 1)))
        assert turned.mean() * 120 > 3, "it wanders"
    pointed = {int(angles.argmin()) for angles in pointed_at(display, session)}
    assert len(pointed) >= min(3, len(display.panels))


def pointed_at(display: Display, session: Session) -> list[np.ndarray]:
    """The angle from a pointer to every panel that faces it, ten times over ten seconds."""
    viewers = [Viewer(each.position_m, each.direction, each.direction, eye_separation_m=0)
               for t in np.linspace(0, 9.9, 10) for each in session.pointers_at(float(t))]  # fmt: skip
    return [panel_demands(display, [viewer], Policy("acuity")).angle_deg for viewer in viewers]


def test_a_pointer_before_a_wall_nearly_always_points_at_it():
    display = Display.preset("rostock")
    session = make_walk(display, 10.0, 3, pointers=1)
    smallest = [angles.min() for angles in pointed_at(display, session)]
    assert max(smallest) == 0


def test_numbers_of_pointers_that_cannot_be():
    for pointers in (-1, 65):
        with pytest.raises(InputError, match="pointers must be from 0 to 64"):
            make_walk(Display.preset("cave"), 1.0, pointers=pointers)
