"""Windows drawn and judged: the same pixels as the whole panel's, verdicts that follow what was left out."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image as Picture

from limen.data.image.file import Image, open_image
from limen.display.display import Display
from limen.errors import InputError, PageError
from limen.frame.renderer import Renderer
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import view_of
from limen.study.charts import chart
from limen.study.observer import Observer, Verdict
from limen.study.verdict_plot import verdict_picture
from limen.study.verify import Judged, Trial, imperceptible, judge_windows, rows_of, trials_of
from limen.study.windows import Window, choose_windows
from limen.track.session import Session
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

ONE_TO_ONE = OnSurface("one-to-one")
PITCH_M = 0.0002335


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Image]:
    path = tmp_path_factory.mktemp("page") / "text.png"
    Picture.fromarray(chart("text", (1400, 1000), 2)).save(path)
    with open_image(path) as image:
        yield image


@pytest.fixture(scope="module")
def wall() -> Display:
    return Display.window((1400, 1000), PITCH_M, distance_m=2.7)


@pytest.fixture(scope="module")
def windows(page: Image, wall: Display) -> list[Window]:
    """From 2.7 m: a texel of level 1 is just hidden, and 256 samples are 520 pixels."""
    standing = Session.of("still", wall.name, 10.0, [Viewer((0, 0, 0), eye_separation_m=0.0)])
    return choose_windows(view_of(wall, page.pyramid, ONE_TO_ONE), standing, 3, seed=1)


@pytest.mark.gpu
def test_a_window_is_drawn_as_its_panel_would_show_it(
    page: Image, wall: Display, windows: list[Window], device: Any
) -> None:
    layer = ImageLayer(page, ONE_TO_ONE, Policy("acuity", distance_factor=2.0))
    viewers = windows[0].viewers
    with Renderer(device, wall, [layer]) as renderer:
        ((_, whole, _),) = renderer.pictures(renderer.state(0.0, viewers=viewers))
        whole = whole.copy()
    cut = wall.cut_outs([(str(number), window.panel, window.rect_px) for number, window in enumerate(windows)])
    with Renderer(device, cut, [layer]) as renderer:
        frame = renderer.state(0.0, viewers=viewers)
        for number, window in enumerate(windows):
            ((name, part, _),) = renderer.pictures(frame, panels=[number])
            assert name == str(number)
            left, top, right, bottom = (int(side) for side in window.rect_px)
            np.testing.assert_allclose(part.astype(int), whole[top:bottom, left:right], atol=1)
            assert part[..., :3].std() > 20


@pytest.mark.gpu
def test_the_observer_sees_what_was_left_out_for_a_wrong_distance_only(
    page: Image, wall: Display, windows: list[Window], device: Any, observer: Observer
) -> None:
    trials = trials_of([Policy("acuity"), Policy("acuity", gaze=True)], (1.0, 8.0), (0.0, 15.0))
    judged = list(judge_windows(device, page, wall, ONE_TO_ONE, windows, trials, {100.0: Observer(100.0)}))
    rows = {(r.policy, r.distance_factor, r.eccentricity_deg): r for r in rows_of(trials, judged)}
    assert len(rows) == 8
    assert all(row.false_alarms == 0 and row.windows == 3 for row in rows.values())
    for name in ("acuity", "acuity+gaze"):
        assert rows[name, 1.0, 0.0].detected == 0
        assert rows[name, 1.0, 15.0].detected == 0
        assert rows[name, 8.0, 0.0].detected == 1
        assert rows[name, 1.0, 0.0].jod_min < 10  # something was left out
    # Without gaze the same picture is judged off the gaze, where less of the error is seen.
    assert rows["acuity", 8.0, 15.0].jod_mean > rows["acuity", 8.0, 0.0].jod_mean
    # With it the policy leaves out more where it may.
    assert rows["acuity+gaze", 1.0, 15.0].jod_mean < rows["acuity", 1.0, 15.0].jod_mean


@pytest.mark.gpu
def test_a_page_that_cannot_be_read_is_no_verdict(
    page: Image, wall: Display, windows: list[Window], device: Any, observer: Observer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(_number: int, *_given: Any) -> Any:
        raise PageError("no such page")

    monkeypatch.setattr(page, "read_page", unreadable)
    with pytest.raises(PageError, match="cannot be judged"):
        next(judge_windows(device, page, wall, ONE_TO_ONE, windows, trials_of([Policy()], (1.0,)), {100.0: observer}))


def made_up() -> tuple[list[Trial], list[Judged]]:
    trials = trials_of([Policy("acuity")], (1.0, 10.0))
    fine, hidden, seen, alike = Verdict(10.0, 0.0, 0.001), Verdict(9.9, 0.2), Verdict(9.0, 2.0, 0.3), Verdict(10.0, 0.0)
    return trials, [Judged((fine, seen), (alike, alike)), Judged((hidden, hidden), (alike, seen))]


def test_rows_count_what_the_observer_saw() -> None:
    trials, judged = made_up()
    true, wrong = rows_of(trials, judged)
    assert (true.distance_factor, wrong.distance_factor) == (1.0, 10.0)
    assert (true.jod_mean, true.jod_min, true.drop_p99_max, true.flip_p99_max) == (pytest.approx(9.95), 9.9, 0.2, 0.001)
    assert (true.strict, true.practical, true.detected, true.false_alarms) == (0.5, 1.0, 0.0, 0.0)
    assert (wrong.practical, wrong.detected, wrong.false_alarms, wrong.worst_window) == (0.5, 0.5, 0.5, 0)
    assert not imperceptible([true, wrong]), "only half of the windows pass strictly"
    best = replace(true, strict=0.95)
    assert imperceptible([best, wrong]), "a wrong distance is no promise"
    assert not imperceptible([best, replace(true, strict=1.0, practical=0.97)])
    assert not imperceptible([replace(best, false_alarms=0.1)])


def test_trials_are_every_policy_factor_and_angle() -> None:
    plain, gaze = Policy(), Policy(gaze=True)
    trials = trials_of([plain, gaze])
    assert {t.eccentricity_deg for t in trials if not t.policy.gaze} == {0.0}
    assert {t.eccentricity_deg for t in trials if t.policy.gaze} == {0.0, 10.0, 20.0}
    assert {t.policy.distance_factor for t in trials} == {1.0, 2.0, 5.0, 10.0}
    assert len(trials_of([plain, gaze], (1.0,), (5.0, 7.0))) == 4
    with pytest.raises(InputError, match="distance_factor"):
        trials_of([plain], (0.0,))


def test_the_figure_has_a_line_for_every_policy_and_angle() -> None:
    trials, judged = made_up()
    svg = verdict_picture(rows_of(trials, judged), "a wall", "svg")
    assert ET.fromstring(svg.decode()).tag.endswith("svg")
    assert svg == verdict_picture(rows_of(trials, judged), "a wall", "svg")
    assert verdict_picture(rows_of(trials, judged), "a wall", "png").startswith(b"\x89PNG")
