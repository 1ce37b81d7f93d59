"""Moments of a walk that are worth a picture, and maps of the level that each panel is drawn at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.geometry import Floats
from limen.layers.image.draw.uniforms import level_colours
from limen.layers.image.select import ImageOnDisplay, levels_at
from limen.track.session import Session
from limen.viewing.tolerance import Tolerance
from limen.viewing.viewer import Viewer

__all__ = ["Moment", "level_tints", "nearest_panel", "telling_moments"]


class Moment(NamedTuple):
    """One instant of a walk."""

    title: str
    viewers: tuple[Viewer, ...]
    distance_m: float  # from the first viewer to the nearest panel


def nearest_panel(display: Display, position_m: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Index of, and distance to, the panel nearest to each place: (N, 3) metres to (N,) and (N,) metres."""
    arrays = display.arrays
    relative = position_m[:, None] - arrays.origin_m
    size_m = arrays.size_px * arrays.pitch_m
    x = np.einsum("npi,pi->np", relative, arrays.right)
    y = np.einsum("npi,pi->np", relative, arrays.down)
    height2 = np.maximum((relative**2).sum(axis=2) - x**2 - y**2, 0)
    beside2 = (x - np.clip(x, 0, size_m[:, 0])) ** 2 + (y - np.clip(y, 0, size_m[:, 1])) ** 2
    distance = np.sqrt(height2 + beside2)
    nearest = distance.argmin(axis=1)
    return nearest, distance[np.arange(len(nearest)), nearest]


def telling_moments(display: Display, shown: NDArray[np.bool_], session: Session) -> list[Moment]:
    """Three instants: closest to a wall that shows something, far from all walls, closest to another wall.

    Parameters
    ----------
    shown
        Which panels show some of the image, shape (P,).
    """
    times_s = session.times_s(10.0)
    viewers = [session.at(float(time_s)) for time_s in times_s]
    places = np.array([people[0].position_m for people in viewers])
    nearest, distance = nearest_panel(display, places)
    grids = np.array([panel.grid_name for panel in display.panels])[nearest]
    lit = shown[nearest] if shown[nearest].any() else np.ones(len(nearest), dtype=bool)
    close = int(np.where(lit, distance, np.inf).argmin())
    elsewhere = lit & (grids != grids[close])
    # On a display of one wall, 'another wall' is the place farthest along the wall from the first.
    apart = np.linalg.norm(places - places[close], axis=1)
    other = int(np.where(elsewhere, distance, np.inf).argmin()) if elsewhere.any() else int(apart.argmax())
    middle = int(distance.argmax())
    chosen = (
        (close, f"Up close, at the {grids[close]} wall"),
        (middle, "In the middle"),
        (other, f"At the {grids[other]} wall"),
    )
    return [Moment(title, viewers[at], float(distance[at])) for at, title in chosen]


def level_tints(
    view: ImageOnDisplay, tolerance: Tolerance, cells: tuple[int, int]
) -> tuple[dict[str, NDArray[np.uint8]], NDArray[np.int64]]:
    """The colour of the level drawn, for ``cells`` columns and rows of every panel, and how often each level is drawn.

    Returns
    -------
    tints, counts
        Panel name -> uint8 (rows, columns, 3), dark grey beyond the image; cells drawn at each level, shape (L,).
    """
    colours = (level_colours(len(view.pyramid.levels)) * 255).astype(np.uint8)
    palette = np.concatenate([colours, np.array([[30, 32, 36]], dtype=np.uint8)])  # -1 picks the last
    counts = np.zeros(len(view.pyramid.levels), dtype=np.int64)
    tints = {}
    for number, panel in enumerate(view.display.panels):
        x = (np.arange(cells[0]) + 0.5) / cells[0] * panel.size_px[0]
        y = (np.arange(cells[1]) + 0.5) / cells[1] * panel.size_px[1]
        levels = levels_at(view, tolerance, number, np.stack(np.meshgrid(x, y), axis=-1))
        tints[panel.name] = palette[levels]
        counts += np.bincount(levels[levels >= 0], minlength=len(counts))
    return tints, counts
