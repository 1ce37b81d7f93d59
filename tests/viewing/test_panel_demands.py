"""Who sees which panel and how large an error may be there: laws, brute force, and jittering trackers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from limen.display.display import Display
from limen.display.grid import Grid, panels_of_grid
from limen.display.panel import Panel
from limen.errors import InputError
from limen.geometry import Floats
from limen.viewing.panel_demands import (
    FIELD_DEG,
    FOCUS,
    FULL_ERROR_PX,
    HOLD_DEG,
    HOLD_OCTAVES,
    OUTSIDE,
    PERIPHERY,
    SCHEEL_FIELD_DEG,
    SELECTED,
    PanelDemands,
    panel_demands,
)
from limen.viewing.panel_distance import angle_deg
from limen.viewing.policy import Policy
from limen.viewing.tolerance import scheel_px, tolerance_of
from limen.viewing.viewer import Pointer, Viewer

WALL = Display.preset("rostock")
ROOM = Display.preset("cave")
SCHEEL, ACUITY, GAZE = Policy("scheel"), Policy("acuity"), Policy("acuity", gaze=True)

eyes = st.tuples(st.floats(-2, 2), st.floats(0.5, 2.5), st.floats(-1.4, 2))
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
viewers = st.builds(Viewer, eyes, directions, st.none() | directions)
policies = st.sampled_from([SCHEEL, ACUITY, GAZE, Policy("contrast", gaze=True), Policy("full")])
displays = st.sampled_from([WALL, ROOM, Display.preset("teapot").part(range(0, 60, 5))])
rules = st.sampled_from(["exact", "middle"])
quick = settings(max_examples=40, deadline=None)


def samples_on(panel: Panel, count: int = 40) -> Floats:
    """Places all over a panel's outline, its edges included."""
    ring = panel.outline_m
    u, v = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    inside = u + v <= 1 + 1e-9
    share = np.stack([1 - u[inside] - v[inside], u[inside], v[inside]], axis=1)
    return np.concatenate([share @ ring[[0, k, k + 1]] for k in range(1, len(ring) - 1)])


def in_front(panel: Panel, eye: Floats) -> bool:
    return bool(np.dot(panel.normal, eye - panel.outline_m[0]) > 1e-6)


@quick
@given(display=displays, people=st.lists(viewers, min_size=1, max_size=3), policy=st.sampled_from([ACUITY, GAZE]))
def test_no_place_of_a_panel_may_err_by_less_than_the_panel_and_none_that_is_seen_is_left_out(display, people, policy):
    """Against the tolerance at samples, for every eye that is in front and has the place in its field."""
    demands = panel_demands(display, people, policy)
    for number, panel in enumerate(display.panels):
        places = samples_on(panel)
        smallest = np.inf
        for person in people:
            look, slack = (person.direction, 15.0) if person.gaze is None else (person.gaze, 0.0)
            for eye, alone in zip(person.eyes_m, one_eyed(person), strict=True):
                angles = angle_deg(places - eye, np.array(look))
                if in_front(panel, eye) and angles.min() <= FIELD_DEG + slack:
                    pitch = max(panel.pitch_m)
                    smallest = min(smallest, float(tolerance_of([alone], policy).allowed_px(places, pitch).min()))
        assert demands.allowed_px[number] <= max(smallest, FULL_ERROR_PX) * (1 + 1e-9)
        if smallest < np.inf:
            assert demands.seen[number] > OUTSIDE


@quick
@given(
    display=displays, people=st.lists(viewers, max_size=3), policy=policies, rule=rules,
    field=st.none() | st.floats(20, 180), pointed=st.booleans(),
)  # fmt: skip
def test_nothing_asks_for_more_than_the_pixels_show(display, people, policy, rule, field, pointed):
    """Full detail, for nobody in particular, is never coarser than what anything else asks for."""
    pointers = [Pointer((0, 1.5, 0), (0, 0, -1))] * pointed
    demands = panel_demands(display, people, policy, rule=rule, field_deg=field, pointers=pointers)
    full = panel_demands(display, [], Policy("full"))
    assert (full.allowed_px <= demands.allowed_px).all()
    assert (panel_demands(display, people, policy, rule=rule, earlier=full).allowed_px >= full.allowed_px).all()


@quick
@given(display=displays, people=st.lists(viewers, min_size=1, max_size=2), policy=policies)
def test_faint_detail_is_hidden_by_contrast_alone_and_nowhere_a_pointer_selects(display, people, policy):
    """Contrast is acuity in all but that: it never asks for finer triangles, and lets pages be coarser."""
    pointer = Pointer(people[0].position_m, people[0].direction)
    demands = panel_demands(display, people, policy, pointers=[pointer])
    assert (demands.hides_faint == ((demands.seen != SELECTED) & (policy.name == "contrast"))).all()
    acuity, contrast = (panel_demands(display, people, Policy(name)) for name in ("acuity", "contrast"))
    assert (acuity.allowed_px == contrast.allowed_px).all()
    assert not acuity.hides_faint.any()
    assert contrast.hides_faint.all()


def one_eyed(person: Viewer) -> list[Viewer]:
    return [
        Viewer(tuple(eye), person.direction, person.gaze, person.acuity_arcmin, eye_separation_m=0)
        for eye in person.eyes_m
    ]


@quick
@given(display=displays, people=st.lists(viewers, min_size=1, max_size=2))
def test_the_papers_formula_by_the_middle_rule_panel_by_panel(display, people):
    """Plain loops over equations 3 and 4, and no error smaller than pixels show."""
    demands = panel_demands(display, people, SCHEEL, rule="middle")
    for number, panel in enumerate(display.panels):
        allowed = np.inf
        for person in people:
            way = panel.outline_m.mean(axis=0) - person.position_m
            distance = float(np.linalg.norm(way))
            look = np.array(person.direction if person.gaze is None else person.gaze)
            angle = float(np.degrees(np.arccos(np.clip(way @ look / distance, -1, 1))))
            if in_front(panel, np.array(person.position_m)) and angle <= 60:
                theta = (1 + (1 - np.cos(np.radians(angle))) * 20) / 60
                allowed = min(allowed, max(0.5, 2 * distance * np.tan(np.radians(theta) / 2) / panel.pitch_m[1]))
        assert demands.allowed_px[number] == pytest.approx(allowed)
        assert (demands.seen[number] > OUTSIDE) == (allowed < np.inf)


@quick
@given(display=displays, people=st.lists(viewers, min_size=1, max_size=3), policy=policies, field=st.floats(20, 180))
def test_the_exact_rule_sees_all_that_the_middle_rule_sees_and_allows_no_more(display, people, policy, field):
    exact, middle = (panel_demands(display, people, policy, rule=rule, field_deg=field) for rule in ("exact", "middle"))
    assert (exact.angle_deg <= middle.angle_deg + 1e-9).all()
    assert (exact.seen[middle.seen > OUTSIDE] > OUTSIDE).all()
    assert (exact.allowed_px <= middle.allowed_px * (1 + 1e-9)).all()


@quick
@given(display=displays, people=st.lists(viewers, min_size=2, max_size=4), policy=policies, rule=rules)
def test_another_viewer_never_allows_more_or_hides_a_panel(display, people, policy, rule):
    fewer, more = (panel_demands(display, group, policy, rule=rule) for group in (people[1:], people))
    assert (more.allowed_px <= fewer.allowed_px).all()
    assert (more.seen >= fewer.seen).all()
    assert (more.angle_deg <= fewer.angle_deg).all()
    alone = [panel_demands(display, [person], policy, rule=rule).allowed_px for person in people]
    assert more.allowed_px == pytest.approx(np.min(alone, axis=0))
    named = more.decided_by >= 0
    assert np.array(alone)[more.decided_by[named], np.flatnonzero(named)] == pytest.approx(more.allowed_px[named])
    assert np.isinf(more.allowed_px[~named]).all() or policy.name == "full"


@given(st.floats(0.1, 5), st.floats(1, 3), st.floats(0, 90), st.floats(0, 30))
def test_nearer_or_more_central_never_allows_more(distance, farther, angle, more):
    base = scheel_px(distance, angle, 3e-4)
    assert base <= scheel_px(distance * farther, angle, 3e-4) + 1e-12
    assert base <= scheel_px(distance, angle + more, 3e-4) + 1e-12


@quick
@given(x=st.floats(-1.5, 1.5), y=st.floats(0.9, 2.1), near=st.floats(0.2, 2), step=st.floats(0, 2))
def test_walking_up_to_a_panel_never_allows_it_more(x, y, near, step):
    """The panel that is looked at: of those beside it the angle grows, and with it what is allowed."""
    there, here = (panel_demands(WALL, [Viewer((x, y, -1.5 + away))], SCHEEL) for away in (near + step, near))
    ahead = int(there.angle_deg.argmin())
    assert there.angle_deg[ahead] == here.angle_deg[ahead] == 0
    assert here.allowed_px[ahead] <= there.allowed_px[ahead] + 1e-9


def test_classes_follow_the_line_of_sight():
    """Looked at through the middle of panel 2,1; a gaze past the wall leaves its periphery; from behind, nothing."""
    names = [panel.name for panel in WALL.panels]
    aim = names.index("wall/2,1")
    at = WALL.panels[aim].centre_m
    viewer = Viewer((at[0], at[1], at[2] + 1.0))
    demands = panel_demands(WALL, [viewer], SCHEEL)
    assert [names[k] for k in np.flatnonzero(demands.seen == FOCUS)] == ["wall/2,1"]
    assert demands.allowed_px[aim] == pytest.approx(scheel_px(1.0, 0.0, 0.000303))
    past = panel_demands(WALL, [Viewer((0, 1.5, 0), direction=(0, 1.5, -1))], SCHEEL)
    assert (past.seen != FOCUS).all()
    assert set(past.seen) == {OUTSIDE, PERIPHERY}
    behind = panel_demands(WALL, [Viewer((0, 1.5, -3), direction=(0, 0, 1))], ACUITY)
    assert (behind.seen == OUTSIDE).all()
    assert np.isinf(behind.allowed_px).all()
    assert np.isinf(behind.angle_deg).all()
    assert (behind.decided_by == -1).all()


def test_by_the_middle_rule_the_panels_are_in_focus_whose_middle_is_seen_sharply():
    at = WALL.panels[8].centre_m
    near = panel_demands(WALL, [Viewer((at[0], at[1], at[2] + 0.5))], SCHEEL, rule="middle")
    assert (np.flatnonzero(near.seen == FOCUS) == [8]).all()
    between = Viewer((0, 1.5, -1.0))  # where four panels meet, all of whose middles are 34 degrees away
    assert (panel_demands(WALL, [between], SCHEEL, rule="middle").seen != FOCUS).all()
    assert (panel_demands(WALL, [between], SCHEEL, rule="exact").seen == FOCUS).any()


def test_limens_own_policies_keep_what_an_eye_could_see_in_the_corner_of_the_eye():
    """A wall of a CAVE beside the viewer, 100 degrees from where the head points, is drawn; 60 degrees drop it."""
    viewer = Viewer((0.0, 1.5, -0.5), direction=(1, 0, 0), gaze=(1, 0, 0), eye_separation_m=0)
    back = Display("two", tuple(panels_of_grid(side_wall(), 0.0)))
    own, scheel, narrow = (
        panel_demands(back, [viewer], policy, field_deg=field)
        for policy, field in ((ACUITY, None), (SCHEEL, None), (ACUITY, 90.0))
    )
    assert 90 < own.angle_deg[0] < FIELD_DEG
    assert own.seen[0] == PERIPHERY
    assert scheel.seen[0] == narrow.seen[0] == OUTSIDE
    turned = Viewer((0.0, 1.5, -0.5), direction=(1, 0, 0), eye_separation_m=0)
    far = Display("one", tuple(panels_of_grid(side_wall(-1.2), 0.0)))
    assert FIELD_DEG < panel_demands(far, [turned], ACUITY).angle_deg[0] < FIELD_DEG + 15
    assert panel_demands(far, [turned], ACUITY).seen[0] == PERIPHERY, "the eyes may be turned from the head"
    assert panel_demands(far, [viewer], ACUITY).seen[0] == OUTSIDE, "an eye tracker knows that they are not"


def side_wall(right_edge_m: float = -0.35) -> Grid:
    """One panel that faces +z, to the left of x = ``right_edge_m``, 2.5 m from the viewer's plane."""
    return Grid(name="w", size_px=(100, 100), size_m=(1.0, 1.0), centre_m=(right_edge_m - 0.5, 1.5, -3.0))


def test_full_shows_all_that_a_pixel_can_whoever_looks():
    for people in ([], [Viewer((0, 1.5, -3.0))], [Viewer((0, 1.5, 0))]):
        demands = panel_demands(WALL, people, Policy("full"))
        assert (demands.allowed_px == FULL_ERROR_PX).all()
        assert (demands.seen >= PERIPHERY).all()
    limited = panel_demands(WALL, [Viewer((0, 1.5, -1.3))], Policy("full"), field_deg=40)
    assert set(limited.allowed_px) == {FULL_ERROR_PX, np.inf}
    assert np.isinf(panel_demands(WALL, [], ACUITY).allowed_px).all()


@quick
@given(display=displays, people=st.lists(viewers, max_size=2), hand=eyes, way=directions, policy=policies)
def test_a_pointer_selects_what_its_cone_touches_whoever_looks(display, people, hand, way, policy):
    pointer = Pointer(hand, way)
    without = panel_demands(display, people, policy)
    demands = panel_demands(display, people, policy, pointers=[pointer])
    chosen = demands.seen == SELECTED
    for number, panel in enumerate(display.panels):
        angles = angle_deg(samples_on(panel, 80) - np.array(hand), np.array(pointer.direction))
        if in_front(panel, np.array(hand)):
            assert chosen[number] >= (angles.min() <= 10)
            if chosen[number]:
                assert angles.min() <= 10 + np.degrees(0.03 / np.linalg.norm(samples_on(panel) - hand, axis=1).min())
        else:
            assert not chosen[number]
    assert (demands.allowed_px == np.minimum(without.allowed_px, np.where(chosen, FULL_ERROR_PX, np.inf))).all()
    assert (demands.seen[~chosen] == without.seen[~chosen]).all()
    assert (demands.angle_deg == without.angle_deg).all(), "a pointer is no viewer"


def jittering(frames: int, seed: int) -> list[Viewer]:
    """A viewer who stands still, with the noise of an ordinary tracker: 3 mm and half a degree."""
    rng = np.random.default_rng(seed)
    place = np.array([0.1, 1.55, -1.0]) + rng.normal(0, 0.003, (frames, 3))
    look = np.array([0.0, 0.0, -1.0]) + rng.normal(0, np.radians(0.5), (frames, 3))
    return [Viewer(tuple(p), tuple(v)) for p, v in zip(place, look, strict=True)]


def run(people: list[Viewer], policy: Policy, held: bool, **options: object) -> list[PanelDemands]:
    found: list[PanelDemands] = []
    for person in people:
        earlier = found[-1] if held and found else None
        found.append(panel_demands(WALL, [person], policy, earlier=earlier, **options))  # type: ignore[arg-type]
    return found


def flickers(found: list[PanelDemands]) -> tuple[int, int]:
    """How often a panel's class and its error went there and back again."""
    seen = np.array([demands.seen for demands in found])
    allowed = np.array([demands.allowed_px for demands in found])
    return tuple(int(((values[1:] != values[:-1]).sum(axis=0) > 1).sum()) for values in (seen, allowed))  # type: ignore[return-value]


@pytest.mark.parametrize("rule", ["exact", "middle"])
def test_a_tracker_that_jitters_makes_panels_flicker_unless_the_state_is_kept(rule: str):
    """The limit is put just where a panel's angle is, so that without the state it comes and goes."""
    people = jittering(80, 5)
    angles = panel_demands(WALL, people[:1], SCHEEL, rule=rule).angle_deg  # type: ignore[arg-type]
    limit = float(np.sort(angles)[12])
    loose = run(people, SCHEEL, False, rule=rule, field_deg=limit)
    held = run(people, SCHEEL, True, rule=rule, field_deg=limit)
    assert flickers(loose)[0] >= 1, "the control: nothing to hold"
    assert flickers(loose)[1] >= 12
    assert flickers(held)[0] == 0
    steps = np.array([demands.allowed_px for demands in held])
    assert not (steps[21:] > steps[20:-1]).any(), "errors only settle down to the finest demand"


def test_the_panel_in_focus_does_not_change_with_every_tremor_at_a_seam():
    people = [Viewer((x, 1.6, 0.0)) for x in np.random.default_rng(2).normal(0, 0.004, 60)]
    assert flickers(run(people, SCHEEL, False))[0] >= 2
    assert flickers(run(people, SCHEEL, True))[0] == 0


@quick
@given(people=st.lists(viewers, min_size=2, max_size=5), policy=policies, rule=rules)
@example(
    [
        Viewer((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        Viewer((0.0, 0.625, 0.5), (-0.5, -0.75, -0.3125)),
        Viewer((0.5625, 1.78125, 0.0), (1.0, 0.0, 0.0), (-0.875, 0.875, 0.0)),
    ],
    GAZE,
    "exact",
)
def test_what_is_held_is_never_more_than_what_is_allowed_now_and_never_far_from_it(people, policy, rule):
    # Up to `HOLD_DEG` beyond the limit an eye that has seen a panel still demands what it does.
    limit_deg = SCHEEL_FIELD_DEG if policy.name == "scheel" else FIELD_DEG + policy.head_slack_deg
    wide = {} if policy.name == "full" else {"field_deg": limit_deg + HOLD_DEG}
    now_and_held = run(people, policy, False, rule=rule), run(people, policy, True, rule=rule)
    for now, held, widest in zip(*now_and_held, run(people, policy, False, rule=rule, **wide), strict=True):
        assert (held.allowed_px <= now.allowed_px).all()
        assert (held.seen >= now.seen).all()
        near = now.seen > OUTSIDE
        assert (held.angle_deg == now.angle_deg).all()
        assert (held.allowed_px[near] >= widest.allowed_px[near] / 2**HOLD_OCTAVES * (1 - 1e-12)).all()


def test_a_panel_stays_seen_up_to_five_degrees_beyond_the_limit_and_no_more():
    def turned(degrees: float) -> Viewer:
        return Viewer((0, 1.5, 0), direction=(np.sin(np.radians(degrees)), 0, -np.cos(np.radians(degrees))))

    row = 6  # the leftmost panel of the second row
    base = panel_demands(WALL, [turned(0)], SCHEEL).angle_deg[row]
    seen = panel_demands(WALL, [turned(0)], SCHEEL, field_deg=base + 0.1)
    assert seen.seen[row] == PERIPHERY
    kept = panel_demands(WALL, [turned(HOLD_DEG - 0.5)], SCHEEL, field_deg=base + 0.1, earlier=seen)
    assert kept.seen[row] == PERIPHERY
    assert kept.allowed_px[row] < np.inf
    gone = panel_demands(WALL, [turned(HOLD_DEG + 1.5)], SCHEEL, field_deg=base + 0.1, earlier=kept)
    assert gone.seen[row] == OUTSIDE
    assert gone.allowed_px[row] == np.inf
    back = panel_demands(WALL, [turned(HOLD_DEG - 0.5)], SCHEEL, field_deg=base + 0.1, earlier=gone)
    assert back.seen[row] == OUTSIDE, "the limit itself, once it is gone"


def test_what_cannot_be_asked():
    for field in (0.0, 181.0, float("nan")):
        with pytest.raises(InputError, match="field_deg"):
            panel_demands(WALL, [], ACUITY, field_deg=field)
    with pytest.raises(InputError, match="24 panels, 'cave' has"):
        panel_demands(ROOM, [], ACUITY, earlier=panel_demands(WALL, [], ACUITY))
    with pytest.raises(InputError, match=r"pointer\.direction"):
        Pointer((0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match=r"pointer\.position_m"):
        Pointer((0, float("nan"), 0), (0, 0, 1))
