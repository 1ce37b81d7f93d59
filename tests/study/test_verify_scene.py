"""The observer before meshes and points: poses as in the paper, windows where pictures differ, honest verdicts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.errors import InputError
from limen.study.verify import rows_of, trials_of
from limen.study.verify_scene import judge_views, monitor, random_poses, subject_of
from limen.viewing.policy import Policy
from support.clouds import ball


def test_the_monitor_is_the_papers() -> None:
    display, viewer = monitor()
    (panel,) = display.panels
    assert panel.size_px == (1600, 1200)
    assert math.hypot(*panel.size_m) / 0.0254 == pytest.approx(23, abs=0.05)
    assert viewer.position_m[2] / 0.0254 == pytest.approx(25)


def test_poses_are_rotations_of_all_sizes_and_the_same_for_a_seed() -> None:
    poses = random_poses(300, seed=2)
    for pose in poses:
        assert np.allclose(pose.turn @ pose.turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.turn) == pytest.approx(1)
    sizes = np.array([pose.size_deg for pose in poses])
    assert 5 <= sizes.min() < 8 < 57 < sizes.max() <= 60
    assert np.abs(np.mean([pose.turn[:, 2] for pose in poses], axis=0)).max() < 0.15
    assert [pose.size_deg for pose in random_poses(3, seed=2)] == [pose.size_deg for pose in poses[:3]]
    with pytest.raises(InputError, match="at least one"):
        random_poses(0)


@pytest.mark.gpu
def test_several_panels_are_refused(device: Any) -> None:
    with pytest.raises(InputError, match="judged on one"):
        subject_of(device, torus_knot(500), Display.preset("cube"))


@pytest.mark.gpu
@pytest.mark.parametrize("make", [lambda: torus_knot(20_000), ball], ids=["mesh", "points"])
def test_the_truth_is_not_seen_and_what_was_folded_for_far_away_is(device: Any, observer: Any, make: Any) -> None:
    display, viewer = monitor()
    trials = trials_of([Policy.parse("contrast+gaze")], (1.0, 20.0), (20.0,))
    subject = subject_of(device, make(), display)
    try:
        poses = random_poses(1, seed=5)
        judged = [each for view in judge_views(subject, display, viewer, poses, trials, observer) for each in view]
    finally:
        subject.close()
    true, far = rows_of(trials, judged)
    assert true.windows == 2
    assert true.detected == true.false_alarms == 0
    assert far.detected > 0
    assert far.jod_mean < true.jod_mean


@pytest.mark.gpu
def test_what_passes_is_folded_further_and_stays_unseen(device: Any, observer: Any) -> None:
    display, viewer = monitor()
    policies = [Policy.parse("contrast"), Policy.parse("contrast+motion")]
    trials = trials_of(policies, (1.0,))
    knot = torus_knot(20_000)
    subject = subject_of(device, knot, display)
    try:
        poses = random_poses(1, seed=5)
        judged = [
            each
            for view in judge_views(subject, display, viewer, poses, trials, observer, speed_deg_s=30.0)
            for each in view
        ]
    finally:
        subject.close()
    for row in rows_of(trials, judged):
        assert row.detected == row.false_alarms == 0
        assert row.flip_p99_max is None
