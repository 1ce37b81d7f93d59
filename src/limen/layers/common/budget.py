"""What the selectors of points and of meshes tell their loops alike, and how a budget becomes a limit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.layers.common.sphere_kernels import BINS, BINS_PER_OCTAVE, LOWEST_OCTAVE
from limen.viewing.projection import PanelProjections
from limen.viewing.tolerance import Tolerance

__all__ = ["budget_limit", "eye_rows", "panel_rows"]


def budget_limit(histogram: NDArray[np.int64], least: int, most: int) -> float:
    """The smallest edge of a bin such that no more than ``most`` items are drawn.

    Parameters
    ----------
    histogram
        (256,): items that are drawn in addition, where all above an edge, by ``k``, is gone into.
    least
        How many there are when nothing is.
    """
    above = np.append(np.cumsum(histogram[::-1])[::-1], 0) + least
    fits = np.flatnonzero(above <= most)
    edge = int(fits[0]) if len(fits) else BINS
    return 0.0 if edge == 0 else math.inf if edge >= BINS else 2.0 ** (LOWEST_OCTAVE + edge / BINS_PER_OCTAVE)


def eye_rows(tolerance: Tolerance, eye_m: Floats) -> Floats:
    """What the loops are told of all eyes, (E, 8), from the one that is drawn for; (E, 20) where things move."""
    moves = tolerance.motion.any()
    eyes = np.zeros((len(tolerance.tan_angle), 20 if moves else 8))
    eyes[:, :3] = tolerance.eyes_m - eye_m
    eyes[:, 3], eyes[:, 4:7], eyes[:, 7] = tolerance.tan_angle, tolerance.gaze, tolerance.slack_deg
    if moves:
        linear = tolerance.motion[..., :3]
        eyes[:, 8:17], eyes[:, 17:] = linear.reshape(-1, 9), linear @ eye_m + tolerance.motion[..., 3]
    return eyes


def panel_rows(views: PanelProjections) -> Floats:
    """What the loops are told of every panel, (N, 30)."""
    rows = np.zeros((len(views.near), 30))
    normal = views.clip[:, 2]
    edges = views.edges / np.maximum(np.linalg.norm(views.edges, axis=2, keepdims=True), 1e-300)
    rows[:, :24] = edges.reshape(len(rows), 24)
    rows[:, 24:27] = normal
    along = views.edges - np.einsum("nka,na->nk", views.edges, normal)[..., None] * normal[:, None]
    rows[:, 27] = np.linalg.norm(along, axis=2).max(axis=1)  # an edge's distance in pixels grows by so much a metre
    return rows
