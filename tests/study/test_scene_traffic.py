"""Triangles and splats of walks: full is all, policies save, budgets are kept."""

from __future__ import annotations

import numpy as np
import pytest

from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.layers.common.room_placement import mesh_in_room
from limen.study.scene_traffic import count_scene_traffic
from limen.study.traffic import policies_of
from limen.track.walk import session_named
from support.clouds import ball

CUBE = Display.preset("cube")
WALK = session_named("A", CUBE)
POLICIES = policies_of(["full", "acuity", "contrast+gaze", "budget:500"], ["human"])


@pytest.mark.parametrize("make", [lambda: torus_knot(3000), ball], ids=["mesh", "points"])
def test_policies_save_and_budgets_are_kept(make) -> None:
    content, steps = make(), []
    traffic = count_scene_traffic(
        content, "thing", CUBE, [WALK], POLICIES, mesh_in_room(content.bounds, CUBE), rate_hz=3 / WALK.duration_s,
        advance=lambda: steps.append(1),
    )  # fmt: skip
    (session,) = traffic.sessions
    full, acuity, faint, budget = session.rows
    assert len(steps) == session.frames >= 3
    assert full.saving == 0
    assert full.items_mean >= acuity.items_mean >= faint.items_mean
    assert acuity.distance_factor <= 1
    assert budget.items_p99 <= 500 * len(CUBE.panels)
    assert budget.saving > 0.5
    assert budget.bytes_per_s == pytest.approx(30 * budget.bytes_mean)
    if traffic.items == "triangles":
        assert full.items_mean == content.size


def test_what_is_counted_is_on_the_panels_asked_for() -> None:
    cloud = ball(5000)
    stands = mesh_in_room(cloud.bounds, CUBE)
    whole, part = (
        count_scene_traffic(cloud, "ball", display, [WALK], POLICIES[:1], stands, rate_hz=2 / WALK.duration_s)
        for display in (CUBE, CUBE.select([CUBE.panels[0].name]))
    )
    assert np.isfinite(whole.sessions[0].rows[0].items_mean)
    assert part.sessions[0].rows[0].items_mean < whole.sessions[0].rows[0].items_mean
