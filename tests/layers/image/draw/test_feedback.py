"""The pages that pixels need are the pages that selectors choose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from limen.data.pages import Pyramid
from limen.display.display import Display
from limen.errors import InputError
from limen.layers.common.page_detail import reduced_detail
from limen.layers.image.draw.feedback import Feedback
from limen.layers.image.select import select, view_of
from limen.viewing.lens import Lens
from limen.viewing.placement import OnShape, OnSurface, Placement
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

pytestmark = pytest.mark.gpu

_EYE = (0.2, 1.6, 0.1)
_PYRAMID = Pyramid.of((40_000, 20_000))
LENSES = (
    Lens((19_000.0, 9_000.0), 4000.0, 12.0),
    Lens((21_500.0, 10_500.0), (2500.0, 1800.0), 3.0, 0.2, "gaussian", "rectangular"),
    Lens((27_000.0, 12_000.0), 900.0, 5.0, heights=np.outer(np.hanning(9), np.hanning(12))),
)
PLACEMENTS: dict[str, Placement] = {
    "cover": OnSurface("cover", zoom=1.3),
    "zoomed out": OnSurface("contain", zoom=0.37),
    "one-to-one": OnSurface("one-to-one"),
    "plane": OnShape("plane", (-6, 4.5, -4), (12, 0, 0), (0, -6.0, 0)),
    "tilted plane": OnShape("plane", (-2, 3.0, -2), (4, 0, -3), (0.3, -3.0, 0)),
    "cylinder": OnShape("cylinder", (0, 1.5, 0), (0, 0, -5.0), (0, -6.0, 0)),
    "ellipsoid": OnShape("ellipsoid", (0, 1.5, 0), (1, 0, -5.0), (0, -5.0, 0)),
    "part of an ellipsoid": OnShape("ellipsoid", (0, 1.5, 0), (0, 0, -5.0), (0, -3.0, 0), turn_deg=200),
    "lenses": OnSurface("cover", zoom=1.3, lenses=LENSES),
}
VIEWERS = {
    "nobody": [],
    "one": [Viewer((0.3, 1.6, 0.2), gaze=(0.2, -0.1, -1.0), acuity_arcmin=12)],
    "three": [
        Viewer((0.3, 1.6, 0.2), acuity_arcmin=16),
        Viewer((-0.7, 1.2, 0.5), acuity_arcmin=6),
        Viewer((1.2, 1.7, -1.2), (1.0, 0.0, 0.2), acuity_arcmin=24),
    ],
}


@pytest.fixture(scope="module")
def cave() -> Display:
    return Display.preset("cave").scaled(0.25)


CASES = [
    (kind, people, policy)
    for kind in PLACEMENTS
    for people in (["three"] if kind == "lenses" else VIEWERS)
    for policy in ("acuity", "contrast+gaze")
]


@pytest.mark.parametrize(("kind", "people", "policy"), CASES)
def test_selectors_leave_out_no_page_and_add_few(
    kind: str, people: str, policy: str, device: Any, cave: Display
) -> None:
    tolerance = tolerance_of(VIEWERS[people], Policy.parse(policy))
    share = np.random.default_rng(2).choice([0.0, 0.2, 0.7, 1.0], _PYRAMID.page_count)
    detail = reduced_detail(_PYRAMID, share) if policy == "contrast+gaze" else None
    view = view_of(cave, _PYRAMID, PLACEMENTS[kind], detail)
    feedback = Feedback(device, view)
    assert feedback.run(tolerance, divisor=1, eye_m=_EYE)
    needed = feedback.read()
    feedback.destroy()
    chosen = select(view, tolerance, eye_m=_EYE)
    assert np.setdiff1d(needed.pages, chosen.pages).size == 0
    extra = len(chosen) - len(needed.pages)
    # Where levels blend, the bounds over a cell may touch a level that none of its pixels does; a page of 23 weighs
    # more than one of hundreds.
    assert extra <= 0.4 * len(needed.pages) + 8, f"{extra} of {len(chosen)}"


def test_every_pixel_is_counted_once(device: Any) -> None:
    display = Display.window((333, 222))
    feedback = Feedback(device, view_of(display, _PYRAMID, OnSurface("cover")))
    feedback.run(tolerance_of([], Policy("full")), divisor=1)
    assert feedback.read().coverage.sum() == 333 * 222
    feedback.destroy()


def test_the_frames_jitter_visits_every_pixel(device: Any) -> None:
    """All frames of a cycle together count what one frame without reduction does."""
    display = Display.window((333, 222))
    feedback = Feedback(device, view_of(display, _PYRAMID, OnSurface("cover")))
    tolerance = tolerance_of([], Policy("full"))
    total = np.zeros(_PYRAMID.page_count, int)
    for frame in range(16):
        feedback.run(tolerance, divisor=4, frame=frame)
        pages, coverage = feedback.read()
        total[pages] += coverage
    feedback.run(tolerance, divisor=1)
    pages, coverage = feedback.read()
    assert (np.flatnonzero(total) == pages).all()
    assert (total[pages] == coverage).all()
    feedback.destroy()


def test_a_result_comes_without_waiting_and_a_full_ring_drops_frames(device: Any, cave: Display) -> None:
    feedback = Feedback(device, view_of(cave, _PYRAMID, OnSurface()))
    tolerance = tolerance_of([], Policy("full"))
    assert feedback.latest() is None
    with pytest.raises(RuntimeError, match="before any"):
        feedback.read()
    ran = [feedback.run(tolerance, frame=frame) for frame in range(30)]
    assert ran[0]
    expected = feedback.read()
    latest = feedback.latest()
    assert latest is not None
    assert (latest.pages == expected.pages).all()
    feedback.destroy()


def test_an_impossible_divisor_is_refused(device: Any, cave: Display) -> None:
    feedback = Feedback(device, view_of(cave, _PYRAMID, OnSurface()))
    with pytest.raises(InputError, match="from 1 to 64"):
        feedback.run(tolerance_of([], Policy("full")), divisor=0)
    feedback.destroy()
