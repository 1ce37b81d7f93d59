"""Windows to judge: small parts of panels, drawn at random from a session, as one of its viewers sees them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from limen.display.display import Display, Rect
from limen.display.panel import Panel
from limen.errors import InputError
from limen.geometry import Floats, Vec3, as_vec3
from limen.layers.image.select import ImageOnDisplay
from limen.study.observer import LEAST_WINDOW_PX, SAMPLES_PER_DEGREE, WINDOW_PX
from limen.track.session import Session
from limen.viewing.viewer import Viewer

__all__ = ["Window", "choose_windows", "cut_display"]

_SIDE = 17
"""Points along a window's side at which angles are asked for."""

_TRIES = 400
"""Random places per window until one is shown to, and faced by, the viewer."""


@dataclass(frozen=True, slots=True)
class Window:
    """A part of a panel at one instant, and who looks at it.

    Parameters
    ----------
    panel
        Index into the display.
    rect_px
        Whole pixels of that panel.
    viewers
        Everybody in the room: all of them count when detail is chosen.
    looker
        Which of them judges.
    pixels_per_degree
        At the point of the window nearest to the looker's eyes, seen square on: elsewhere pixels look smaller.
    """

    panel: int
    rect_px: Rect
    viewers: tuple[Viewer, ...]
    looker: int
    pixels_per_degree: float
    distance_m: float

    def gazing(self, panel: Panel, eccentricity_deg: float) -> tuple[Viewer, ...]:
        """The viewers, of whom the looker looks past the window, at this angle from its nearest point.

        At 0 the looker looks at the middle of the window; else beside it, along the panel's rows. ``panel`` is the one
        that the window is a part of.
        """
        looker = self.viewers[self.looker]
        points = panel.position_m(_grid(self.rect_px))
        sight = self._sight(panel).reshape(-1, 3)
        ahead = points.mean(axis=0) - np.array(looker.position_m)
        ahead /= np.linalg.norm(ahead)
        beside = np.array(panel.right) - (np.array(panel.right) @ ahead) * ahead
        beside /= np.linalg.norm(beside)
        low, high = 0.0, math.radians(min(eccentricity_deg + 90.0, 180.0)) if eccentricity_deg else 0.0
        for _ in range(50):
            turn = 0.5 * (low + high)
            gaze = math.cos(turn) * ahead - math.sin(turn) * beside
            nearest_deg = math.degrees(math.acos(min(float((sight @ gaze).max()), 1.0)))
            low, high = (turn, high) if nearest_deg < eccentricity_deg else (low, turn)
        changed = replace(looker, gaze=as_vec3(gaze, "gaze"))
        return (*self.viewers[: self.looker], changed, *self.viewers[self.looker + 1 :])

    def eccentricities_deg(self, panel: Panel, gaze: Vec3) -> Floats:
        """Angles between the looker's gaze and points all over the window, corner to corner: shape (17, 17).

        Of the eye for which a point is nearer to the gaze.
        """
        ahead = np.clip(self._sight(panel) @ np.array(gaze), -1.0, 1.0)
        return np.asarray(np.degrees(np.arccos(ahead)).min(axis=1).reshape(_SIDE, _SIDE))

    def _sight(self, panel: Panel) -> Floats:
        """Unit vectors from the looker's eyes to points all over the window, (points, eyes, 3)."""
        sight = panel.position_m(_grid(self.rect_px))[:, None] - self.viewers[self.looker].eyes_m
        return np.asarray(sight / np.linalg.norm(sight, axis=-1, keepdims=True))


def choose_windows(view: ImageOnDisplay, session: Session, count: int, seed: int = 0) -> list[Window]:
    """Windows at random instants and places: where the image is shown, on panels that the looker faces.

    Raises
    ------
    InputError
        If there is no such place, or the image does not lie on the display's surface.
    """
    if view.maps is None:
        raise InputError("windows are chosen on images that lie on the display's surface, not on shapes in the room")
    if count < 1:
        raise InputError(f"at least one window must be judged, got {count}")
    rng = np.random.default_rng(seed)
    shown = _shown_px(view)
    areas = shown[:, 2:] - shown[:, :2]
    pitches = view.display.arrays.pitch_m
    share = np.maximum(areas, 0).prod(axis=1) * pitches.prod(axis=1)
    if not share.any():
        raise InputError(f"no panel of '{view.display.name}' shows any of the image")
    share /= share.sum()
    windows: list[Window] = []
    for _ in range(_TRIES * count):
        viewers = session.at(session.start_s + rng.uniform(0, session.duration_s))
        panel, looker = int(rng.choice(len(share), p=share)), int(rng.integers(len(viewers)))
        place_px = shown[panel, :2] + rng.uniform(0, 1, 2) * areas[panel]
        window = _window(view.display.panels[panel], panel, place_px, viewers, looker)
        if window is not None:
            windows.append(window)
        if len(windows) == count:
            return windows
    raise InputError(f"the viewers of session '{session.name}' hardly ever face a panel that shows the image")


def cut_display(display: Display, windows: list[Window]) -> Display:
    """The windows as panels of a display; a window's number is its panel's index."""
    return display.cut_outs([(f"{number}", window.panel, window.rect_px) for number, window in enumerate(windows)])


def _shown_px(view: ImageOnDisplay) -> Floats:
    """Pixels of every panel that show the image: left, top, right, bottom, shape (P, 4)."""
    assert view.maps is not None
    size_px = view.display.arrays.size_px.astype(float)
    low = -view.maps.offset / view.maps.scale
    high = (np.array(view.pyramid.size_px) - view.maps.offset) / view.maps.scale
    return np.concatenate([np.clip(low, 0, size_px), np.clip(high, 0, size_px)], axis=1)


def _window(panel: Panel, index: int, place_px: Floats, viewers: tuple[Viewer, ...], looker: int) -> Window | None:
    """The window around a place, or None where the looker does not face it or the panel is too small for one."""
    viewer = viewers[looker]
    sight = panel.position_m(place_px) - viewer.eyes_m
    if (sight @ np.array(panel.normal)).max() >= 0 or (sight @ np.array(viewer.direction)).min() <= 0:
        return None
    pitch_m = max(panel.pitch_m)
    distance_m = float(np.linalg.norm(sight, axis=1).min())
    # The nearest point lies nearer than the place, so the window that was cut for the place shrinks once.
    rect = _around(panel, place_px, _side_px(_pixels_per_degree(distance_m, pitch_m)))
    distance_m = _nearest_m(panel, rect, viewer)
    per_degree = _pixels_per_degree(distance_m, pitch_m)
    side = _side_px(per_degree)
    rect = _around(panel, np.array([rect.left + rect.right, rect.top + rect.bottom]) / 2, side)
    samples = min(rect.width, rect.height) * min(1.0, SAMPLES_PER_DEGREE / per_degree)
    if samples < LEAST_WINDOW_PX + 1:
        return None
    return Window(index, rect, viewers, looker, per_degree, distance_m)


def _pixels_per_degree(distance_m: float, pitch_m: float) -> float:
    return distance_m * math.tan(math.radians(1)) / pitch_m


def _side_px(per_degree: float) -> int:
    return math.floor(WINDOW_PX * max(1.0, per_degree / SAMPLES_PER_DEGREE))


def _around(panel: Panel, place_px: Floats, side: int) -> Rect:
    """A square around a place, moved and cut to lie on the panel."""
    width, height = (min(side, most) for most in panel.size_px)
    left = min(max(round(float(place_px[0]) - width / 2), 0), panel.size_px[0] - width)
    top = min(max(round(float(place_px[1]) - height / 2), 0), panel.size_px[1] - height)
    return Rect(left, top, left + width, top + height)


def _nearest_m(panel: Panel, rect: Rect, viewer: Viewer) -> float:
    """Distance from the nearer eye to the rectangle."""
    relative = viewer.eyes_m - np.array(panel.origin_m)
    along = np.stack([relative @ np.array(panel.right), relative @ np.array(panel.down)], axis=1)
    pitch = np.array(panel.pitch_m)
    foot = np.clip(along / pitch, (rect.left, rect.top), (rect.right, rect.bottom))
    return float(np.linalg.norm(panel.position_m(foot) - viewer.eyes_m, axis=1).min())


def _grid(rect: Rect) -> Floats:
    """Places all over a rectangle, its rim included, row by row: (17 * 17, 2)."""
    x, y = np.linspace(rect.left, rect.right, _SIDE), np.linspace(rect.top, rect.bottom, _SIDE)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
