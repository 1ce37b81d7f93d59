"""Rows that the shaders of three-dimensional layers read: every panel as every eye sees it. No GPU here.

The dtype is a struct of several shaders, field by field; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.viewing.projection import PanelProjections

__all__ = ["MAX_EYES", "PANEL_VIEW", "Rows", "view_rows", "ways_of_pixels"]

Rows: TypeAlias = NDArray[np.void]

MAX_EYES = 2

PANEL_VIEW = np.dtype(
    [
        ("x", "<f4", 4),
        ("y", "<f4", 4),
        ("w", "<f4", 4),
        ("edges", "<f4", (8, 4)),
        ("corners", "<f4", (8, 4)),
        ("corner_count", "<u4"),
        ("eye", "<u4"),
        ("padding", "<u4", 2),
    ]
)


def view_rows(views: Sequence[PanelProjections], erosion_px: Sequence[Floats]) -> Rows:
    """Rows of `PANEL_VIEW`: all panels of the first eye, then all of the second.

    Parameters
    ----------
    erosion_px
        For each eye: how far inside each edge and its guard the sorter takes a panel to begin, (N, 8) or one number.
    """
    rows = np.zeros((len(views), len(views[0].near)), PANEL_VIEW)
    for eye, (row, view, erosion) in enumerate(zip(rows, views, erosion_px, strict=True)):
        row["x"][:, :3], row["y"][:, :3], row["w"][:, :3] = (view.clip[:, axis] for axis in range(3))
        row["x"][:, 3] = view.near
        row["edges"][..., :3], row["edges"][..., 3] = view.edges, erosion
        row["corners"][..., :3] = view.corners
        row["corner_count"], row["eye"] = view.corner_count, eye
    return rows.reshape(-1)


def ways_of_pixels(clip: Floats, size_px: tuple[int, int]) -> Floats:
    """Ways from the eye through pixels of what is drawn into, shape (N, 3, 3): times (x, y, 1), with w = 1.

    Clip space's x, y, w are linear in the way from the eye, so it is the inverse of those forms (``clip``, shape
    (N, 3, 3)), applied to (x / w, y / w, 1), which is affine in the pixel.
    """
    width, height = size_px
    clip_from_pixel = np.array([[2 / width, 0.0, -1.0], [0.0, -2 / height, 1.0], [0.0, 0.0, 1.0]])
    return np.asarray(np.linalg.inv(clip) @ clip_from_pixel)
