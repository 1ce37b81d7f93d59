"""Windows lie where the image is shown, before a viewer's eyes, and are as large as the observer takes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.pages import Pyramid
from limen.display.display import Display, Rect
from limen.errors import InputError
from limen.layers.image.select import ImageOnDisplay, view_of
from limen.study.observer import LEAST_WINDOW_PX, SAMPLES_PER_DEGREE, WINDOW_PX
from limen.study.windows import Window, choose_windows, cut_display
from limen.track.session import Session
from limen.track.walk import make_walk
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.viewer import Viewer


@pytest.fixture(scope="module")
def view() -> ImageOnDisplay:
    return view_of(Display.preset("reality-deck"), Pyramid.of((9000, 4000)), OnSurface())


@pytest.fixture(scope="module")
def walk(view: ImageOnDisplay) -> Session:
    return make_walk(view.display, 20.0, 5, viewers=2)


@pytest.fixture(scope="module")
def windows(view: ImageOnDisplay, walk: Session) -> list[Window]:
    return choose_windows(view, walk, 60, seed=3)


def directions(window: Window, display: Display) -> np.ndarray:
    """From the looker's eyes to a fine grid of the window's pixels: (eyes * points, 3)."""
    panel, rect = display.panels[window.panel], window.rect_px
    x, y = np.meshgrid(np.linspace(rect.left, rect.right, 65), np.linspace(rect.top, rect.bottom, 65))
    points = panel.position_m(np.stack([x, y], axis=-1).reshape(-1, 2))
    return np.asarray((points[None] - window.viewers[window.looker].eyes_m[:, None]).reshape(-1, 3))


def test_windows_are_on_panels_that_show_the_image_to_someone_before_them(
    view: ImageOnDisplay, windows: list[Window]
) -> None:
    assert view.maps is not None
    for window in windows:
        panel, rect = view.display.panels[window.panel], window.rect_px
        assert 0 <= rect.left < rect.right <= panel.size_px[0]
        assert 0 <= rect.top < rect.bottom <= panel.size_px[1]
        scale, offset = view.maps.scale[window.panel], view.maps.offset[window.panel]
        low, high = np.array(rect[:2]) * scale + offset, np.array(rect[2:]) * scale + offset
        assert (high > 0).all()
        assert (low < view.pyramid.size_px).all()
        viewer = window.viewers[window.looker]
        assert ((np.array(panel.origin_m) - viewer.eyes_m) @ np.array(panel.normal) < 0).all()


def test_windows_are_as_large_as_the_observer_takes_at_their_nearest_point(
    view: ImageOnDisplay, windows: list[Window]
) -> None:
    full = 0
    for window in windows:
        nearest = np.linalg.norm(directions(window, view.display), axis=1).min()
        assert window.distance_m == pytest.approx(nearest, rel=1e-3)
        pitch = view.display.panels[window.panel].pitch_m[0]
        assert window.pixels_per_degree == pytest.approx(nearest * math.tan(math.radians(1)) / pitch, rel=1e-3)
        rate = min(1.0, SAMPLES_PER_DEGREE / window.pixels_per_degree)
        sides = [int(side * rate + 1e-9) for side in (window.rect_px.width, window.rect_px.height)]
        assert max(sides) <= WINDOW_PX
        assert min(sides) >= LEAST_WINDOW_PX
        full += min(sides) >= WINDOW_PX - 2
    assert full > len(windows) / 2


def test_a_seed_repeats_and_another_does_not(view: ImageOnDisplay, walk: Session, windows: list[Window]) -> None:
    assert choose_windows(view, walk, 60, seed=3) == windows
    assert choose_windows(view, walk, 60, seed=4) != windows
    assert {window.looker for window in windows} == {0, 1}
    assert len({window.panel for window in windows}) > 20


@settings(max_examples=40, deadline=None)
@given(number=st.integers(0, 59), eccentricity_deg=st.floats(0.5, 60))
def test_the_gaze_passes_the_window_at_the_angle_asked_for(
    view: ImageOnDisplay, windows: list[Window], number: int, eccentricity_deg: float
) -> None:
    window = windows[number]
    viewers = window.gazing(view.display.panels[window.panel], eccentricity_deg)
    looker = viewers[window.looker]
    assert looker.gaze is not None
    assert replace(looker, gaze=None) == replace(window.viewers[window.looker], gaze=None)
    assert [v for n, v in enumerate(viewers) if n != window.looker] == [
        v for n, v in enumerate(window.viewers) if n != window.looker
    ]
    sight = directions(window, view.display)
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    nearest = math.degrees(np.arccos((sight @ np.array(looker.gaze)).max()))
    assert nearest == pytest.approx(eccentricity_deg, abs=0.02)


def test_without_eccentricity_the_looker_looks_at_the_window(view: ImageOnDisplay, windows: list[Window]) -> None:
    for window in windows[:10]:
        panel = view.display.panels[window.panel]
        looker = window.gazing(panel, 0.0)[window.looker]
        middle = panel.position_m(np.array([window.rect_px[:2], window.rect_px[2:]]).mean(axis=0))
        ahead = middle - np.array(looker.position_m)
        assert np.array(looker.gaze) @ ahead / np.linalg.norm(ahead) > math.cos(math.radians(0.2))


def test_the_cut_display_hangs_and_shows_as_the_whole_does(view: ImageOnDisplay, windows: list[Window]) -> None:
    cut = cut_display(view.display, windows)
    part = view_of(cut, view.pyramid, view.placement)
    assert view.maps is not None
    assert part.maps is not None
    for number, window in enumerate(windows):
        small, panel, rect = cut.panels[number], view.display.panels[window.panel], window.rect_px
        assert small.size_px == (rect.width, rect.height)
        pixel = np.array([[0.5, 0.5], [rect.width - 0.5, 3.5]])
        there = pixel + np.array(rect[:2])
        np.testing.assert_allclose(small.position_m(pixel), panel.position_m(there), atol=1e-12)
        texel = pixel * part.maps.scale[number] + part.maps.offset[number]
        whole = there * view.maps.scale[window.panel] + view.maps.offset[window.panel]
        np.testing.assert_allclose(texel, whole, atol=1e-6)
    assert cut.surface == view.display.surface


def test_an_outline_moves_with_its_cut_out() -> None:
    display = Display.window((100, 80))
    panel = replace(display.panels[0], outline_px=((0, 0), (100, 0), (100, 80), (20, 80)))
    cut = Display("d", (panel,)).cut_outs([("a", 0, Rect(30, 20, 90, 70))])
    assert cut.panels[0].outline_px == ((-30, -20), (70, -20), (70, 60), (-10, 60))


@pytest.mark.parametrize("rect", [(0, 0, 101, 80), (-1, 0, 50, 50), (50, 0, 50, 50), (0, 60, 50, 50)])
def test_cut_outs_that_are_no_part_of_their_panel(rect: tuple[int, int, int, int]) -> None:
    with pytest.raises(InputError, match=r"'window'.*holds no"):
        Display.window((100, 80)).cut_outs([("a", 0, Rect(*rect))])


def test_what_has_no_windows(view: ImageOnDisplay, walk: Session) -> None:
    shape = OnShape("plane", (0, 0, -3), (1, 0, 0), (0, -1, 0), eye_m=(0, 0, 0))
    with pytest.raises(InputError, match="display's surface"):
        choose_windows(view_of(view.display, view.pyramid, shape), walk, 3)
    with pytest.raises(InputError, match="at least one window"):
        choose_windows(view, walk, 0)
    elsewhere = view_of(view.display, view.pyramid, OnSurface("one-to-one", centre=(1000.0, 0.5)))
    with pytest.raises(InputError, match="shows any of the image"):
        choose_windows(elsewhere, walk, 3)
    desktop = view_of(Display.window((800, 600)), Pyramid.of((800, 600)), OnSurface())
    turned = Session.of("away", "window", 10.0, [Viewer((0, 0, 0), direction=(0, 0, 1))])
    with pytest.raises(InputError, match="'away' hardly ever face"):
        choose_windows(desktop, turned, 3)
