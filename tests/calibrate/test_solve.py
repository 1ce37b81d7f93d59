"""Calibration against the truth: synthetic photographs of a cube, a wall and a triangle, and what may be wrong."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import limen
from limen.calibrate.camera import Intrinsics
from limen.calibrate.detect import Sighting
from limen.calibrate.poses import apply, compose, of_panel, panel_at
from limen.calibrate.rehearse import displaced, errors_of
from limen.calibrate.solve import solve
from limen.errors import InputError
from support import photographs

pytest.importorskip("cv2")

CAMERA = photographs.CAMERA


def shots(name):
    """A nominal display, and places to photograph it from."""
    if name == "cube":
        turns = np.arange(10) * 36.0
        return limen.Display.preset("cube"), photographs.around(
            limen.Display.preset("cube"), 0.75, turns, [0.45, 0.2, 0.6, 0.3, 0.5] * 2
        )
    if name == "wall":
        wall = photographs.wall()
        return wall, photographs.around(wall, 1.35, [-40, -15, 10, 35, 0], [0.3, -0.2, 0.5, 0.0, -0.6])
    both = photographs.triangle()
    return both, photographs.around(both, 1.1, [-35, 0, 30, 10, -15], [0.2, 0.5, -0.1, -0.4, 0.1])


@cache
def photographed(name):
    """Nominal display, truth, and what synthetic photographs show."""
    nominal, poses = shots(name)
    truth, photos = photographs.photographed(nominal, poses)
    return nominal, truth, tuple(photographs.sighted(photos))


@cache
def ideal(name="wall"):
    nominal, poses = shots(name)
    truth = displaced(nominal, 0.02, 3.0, 1)
    return nominal, truth, tuple(photographs.ideal_sightings(truth, poses))


@cache
def solved():
    """The calibration of the wall by ideal sightings."""
    nominal, _, sightings = ideal()
    return solve(nominal, sightings)


def off(found, truth):
    """Largest error of position in millimetres, and of angle in degrees."""
    return tuple(max(each) for each in zip(*errors_of(found, truth).values(), strict=True))


# Photographs


@pytest.mark.parametrize("name", ["cube", "wall", "triangle"])
def test_panels_are_found_where_they_hang(name):
    nominal, truth, sightings = photographed(name)
    moved_mm, turned_deg = off(solve_nothing(nominal), truth)
    assert moved_mm > 5
    assert turned_deg > 0.5
    found = solve(nominal, sightings)
    position_mm, angle_deg = off(found, truth)
    assert position_mm < 0.25, "a pixel is 1.2 milliradians: 1 to 1.6 mm"
    assert angle_deg < 0.05
    assert found.rms_px < 0.15
    assert found.camera.focal_px[0] == pytest.approx(CAMERA.focal_px[0], rel=0.004)
    assert found.camera.centre_px == pytest.approx(CAMERA.centre_px, abs=4)
    assert not found.warnings
    assert {panel.panel for panel in found.panels} == {panel.name for panel in nominal.panels}


def solve_nothing(display):
    """The display as it was, as if it had been calibrated."""

    class Unmoved:
        panels = tuple(type("P", (), {"panel": panel.name}) for panel in display.panels)

    Unmoved.display = display
    return Unmoved


def test_a_camera_that_is_known_is_kept():
    nominal, truth, sightings = photographed("wall")
    found = solve(nominal, sightings, camera=CAMERA)
    assert found.camera == CAMERA
    assert max(off(found, truth)) < 0.2


def test_a_photograph_from_before_a_panel_moved_ruins_nothing_and_is_named():
    nominal, truth, sightings = photographed("wall")
    before = displaced(nominal, 0.08, 8.0, 7)
    (odd,) = photographs.ideal_sightings(before, [shots("wall")[1][1]])
    found = solve(nominal, [*sightings, replace(odd, photo="old.jpg")])
    position_mm, angle_deg = off(found, truth)
    assert position_mm < 0.3
    assert angle_deg < 0.06
    assert [warning for warning in found.warnings if "old.jpg" in warning and "does not agree" in warning]


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_wrong_corners_are_left_out(share):
    nominal, truth, sightings = photographed("cube")
    random = np.random.default_rng(3)
    spoilt = []
    for sighting in sightings:
        wrong = random.random(sighting.corners_px.shape[:2]) < share
        noise = random.uniform(-40, 40, sighting.corners_px.shape)
        spoilt.append(replace(sighting, corners_px=sighting.corners_px + noise * wrong[..., None]))
    found = solve(nominal, spoilt)
    position_mm, angle_deg = off(found, truth)
    assert position_mm < 0.3
    assert angle_deg < 0.06
    assert sum(photo.left_out for photo in found.photos) >= share / 2 * sum(4 * len(s.ids) for s in sightings)


# The frame


@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6).map(np.array))
def test_the_result_moves_with_the_nominal_display(motion):
    """Photographs know nothing of the room: moved as a whole, the display file moves the answer and nothing else."""
    nominal, _, sightings = ideal()
    there = replace(
        nominal, panels=tuple(panel_at(panel, compose(motion, of_panel(panel))) for panel in nominal.panels)
    )
    one, other = solved(), solve(there, sightings)
    for a, b in zip(one.display.panels, other.display.panels, strict=True):
        assert apply(motion, a.corners_m) == pytest.approx(b.corners_m, abs=2e-6)
    assert other.rms_px == pytest.approx(one.rms_px, rel=1e-6)
    for p, q in zip(one.panels, other.panels, strict=True):
        assert p.position_std_mm == pytest.approx(q.position_std_mm, rel=0.01)


def test_all_panels_together_stay_where_they_were():
    nominal, found = ideal()[0], solved()
    shift = [a.centre_m - b.centre_m for a, b in zip(found.display.panels, nominal.panels, strict=True)]
    assert np.mean(shift, axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize("fixed", ["wall/0,0", "wall/2,1"])
def test_a_fixed_panel_stays_and_shapes_are_the_same(fixed):
    nominal, truth, sightings = ideal()
    found = solve(nominal, sightings, fix=fixed)
    (before,) = [panel for panel in nominal.panels if panel.name == fixed]
    (after,) = [panel for panel in found.display.panels if panel.name == fixed]
    assert after.corners_m == pytest.approx(before.corners_m, abs=1e-9)
    (row,) = [row for row in found.panels if row.panel == fixed]
    assert row.position_std_mm < 1e-6
    assert off(found, truth) == pytest.approx(off(solved(), truth), abs=1e-3)


def test_everything_but_the_poses_is_kept():
    nominal, found = ideal()[0], solved()
    kept = ("name", "size_px", "pitch_m", "surface_m", "outline_px", "node", "luminance_cd_m2", "nudge_px")
    for before, after in zip(nominal.panels, found.display.panels, strict=True):
        assert [getattr(before, name) for name in kept] == [getattr(after, name) for name in kept]


def test_the_stated_deviations_are_those_that_happen():
    """Over many draws of noise, errors are as large as the calibration says that they are."""
    nominal, poses = shots("wall")
    truth = displaced(nominal, 0.02, 3.0, 1)
    ratios = []
    for seed in range(4):
        found = solve(nominal, photographs.ideal_sightings(truth, poses, noise_px=0.3, seed=seed))
        errors = errors_of(found, truth)
        ratios += [(errors[p.panel][0] / p.position_std_mm, errors[p.panel][1] / p.angle_std_deg) for p in found.panels]
    assert np.sqrt(np.mean(np.square(ratios), axis=0)) == pytest.approx([1, 1], abs=0.3)


# What may be wrong


def test_a_panel_in_no_photograph_is_named_and_keeps_its_pose():
    nominal, _, sightings = ideal()
    hidden = [without(sighting, nominal, "wall/2,1") for sighting in sightings]
    found = solve(nominal, hidden)
    assert [warning for warning in found.warnings if "'wall/2,1' is in no photograph" in warning]
    assert found.display.panels[-1] == nominal.panels[-1]
    assert len(found.panels) == 5
    with pytest.raises(InputError, match="'wall/2,1' is in no photograph"):
        solve(nominal, hidden, fix="wall/2,1")


def without(sighting, display, *names):
    from limen.calibrate.boards import boards_of

    gone = [marker for board in boards_of(display) if board.panel in names for marker in board.ids]
    kept = ~np.isin(sighting.ids, gone)
    return replace(sighting, ids=sighting.ids[kept], corners_px=sighting.corners_px[kept])


def test_islands_are_refused_with_names_of_both():
    nominal, _, sightings = ideal()
    left, right = ("wall/0,0", "wall/0,1", "wall/1,0", "wall/1,1"), ("wall/2,0", "wall/2,1")
    parts = [without(s, nominal, *(left if n % 2 else right)) for n, s in enumerate(sightings)]
    with pytest.raises(InputError, match=r"'wall/2,0', 'wall/2,1' to 'wall/0,0'.*take one or two more"):
        solve(nominal, parts)


def test_a_photograph_without_markers_is_named():
    nominal, _, sightings = ideal()
    empty = Sighting("holiday.jpg", CAMERA.size_px, np.empty(0, dtype=np.int64), np.empty((0, 4, 2)))
    assert [w for w in solve(nominal, [*sightings, empty]).warnings if "holiday.jpg" in w]
    with pytest.raises(InputError, match="none of 1 photographs shows a marker"):
        solve(nominal, [empty])
    with pytest.raises(InputError, match="no photographs"):
        solve(nominal, [])


def test_a_panel_in_one_photograph_is_said_to_be_unchecked():
    nominal, _, sightings = ideal()
    few = [s if n == 0 else without(s, nominal, "wall/0,0") for n, s in enumerate(sightings)]
    assert [w for w in solve(nominal, few).warnings if "'wall/0,0' is in one photograph only" in w]


def test_photographs_of_two_sizes_are_refused_by_name():
    nominal, _, sightings = ideal()
    with pytest.raises(InputError, match=r"zoomed.jpg is 720 x 960 px and 0.png is 960 x 720"):
        solve(nominal, [*sightings, replace(sightings[0], photo="zoomed.jpg", size_px=(720, 960))])
    with pytest.raises(InputError, match="--camera is for 640 x 480"):
        solve(nominal, sightings, camera=Intrinsics((640, 480), (500, 500), (320, 240)))


@pytest.mark.parametrize("noise_px", [0.0, 0.05])
def test_one_photograph_straight_on_is_no_camera_calibration(noise_px):
    nominal = limen.Display.preset("desktop")
    straight = photographs.ideal_sightings(nominal, photographs.around(nominal, 1.0, [0], [0]), noise_px=noise_px)
    assert [w for w in solve(nominal, straight).warnings if "the focal length is" in w]
    pinhole = replace(CAMERA, distortion=(0.0,) * 5)
    assert not [w for w in solve(nominal, straight, camera=pinhole).warnings if "focal length" in w]


def test_a_size_that_is_not_true_is_noticed_and_ruins_nothing_else():
    nominal, truth, sightings = ideal()
    first = nominal.panels[0]
    wide = replace(first, pitch_m=(first.pitch_m[0] * 1.05, first.pitch_m[1]))
    found = solve(replace(nominal, panels=(wide, *nominal.panels[1:])), sightings)
    assert [w for w in found.warnings if "'wall/0,0'" in w and "size" in w]
    others = replace(found, panels=tuple(row for row in found.panels if row.panel != first.name))
    assert max(off(others, truth)) < 0.2


def test_a_nudge_that_made_up_for_the_place_is_mentioned():
    nominal, _, sightings = ideal()
    nudged = replace(nominal, panels=(replace(nominal.panels[0], nudge_px=(1.0, 0.0)), *nominal.panels[1:]))
    assert [w for w in solve(nudged, sightings).warnings if "nudge_px" in w]
