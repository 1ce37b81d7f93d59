"""Rows that the shaders of clouds of points read. No GPU here.

The dtypes are the structs of ``points.wgsl``, field by field; a test compares them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.layers.common.lighting import AMBIENT, TOWARD_LIGHT
from limen.layers.common.panel_uniforms import ways_of_pixels
from limen.viewing.projection import PanelProjections, QuiltPanels

__all__ = ["CHUNK_ROW", "CLOUD", "CLOUD_STRIDE", "PLACED", "RAYS", "chunk_row", "cloud_rows", "ray_rows", "stride_of"]

Rows: TypeAlias = NDArray[np.void]

RAYS = np.dtype([("across", "<f4", 4), ("along", "<f4", 4), ("base", "<f4", 4), ("bounds", "<f4", 4)])
CHUNK_ROW = np.dtype(
    [
        ("origin", "<f4", 3),
        ("step", "<f4"),
        ("radius", "<f4"),
        ("padding_a", "<f4"),
        ("padding_b", "<f4"),
        ("padding_c", "<f4"),
    ]
)
CLOUD = np.dtype(
    [
        ("way_from_cloud", "<f4", (3, 4)),
        ("normal_from_cloud", "<f4", (3, 4)),
        ("light", "<f4", 4),
        ("background", "<f4", 4),
        ("unit_m", "<f4"),
        ("is_lit", "<u4"),
        ("first", "<u4"),
        ("end", "<u4"),
        ("stride", "<u4"),
        ("width", "<u4"),
        ("height", "<u4"),
        ("padding", "<u4"),
    ]
)
CLOUD_STRIDE = 256
"""Bytes from one row to the next: where a uniform may begin on any adapter."""

PLACED = np.dtype(
    [
        ("way", "<f4", 3),
        ("reach", "<f4"),
        ("first", "<u4"),
        ("last", "<u4"),
        ("middle", "<u4"),
        ("view", "<u4"),
        ("depth", "<u4"),
        ("is_inside", "<u4"),
        ("padding_a", "<u4"),
        ("padding_b", "<u4"),
    ]
)


def stride_of(width_px: int) -> int:
    """Words of a row of ids: as textures are copied to buffers, whose rows begin at multiples of 256 bytes."""
    return -(-width_px // 64) * 64


def ray_rows(windows: QuiltPanels, views: PanelProjections) -> Rows:
    """Rows of `RAYS`: along which way each pixel sees, and which pixels may be each panel's."""
    rows = np.zeros(len(views.near), RAYS)
    for axis, name in enumerate(("across", "along", "base")):
        rows[name][:, :3] = ways_of_pixels(views.clip, windows.quilt.size_px)[:, :, axis]
    rows["bounds"] = windows.bounds_px
    return rows


def chunk_row(origin: NDArray[np.float32], step: float, radius: float) -> Rows:
    """The one row of `CHUNK_ROW`, in the cloud's unit."""
    row = np.zeros(1, CHUNK_ROW)
    row["origin"], row["step"], row["radius"] = origin, step, radius
    return row


def cloud_rows(
    windows: QuiltPanels,
    way_from_cloud: Floats,
    unit_m: float,
    *,
    ends: Sequence[int],
    lit: bool,
    background: tuple[float, float, float],
) -> NDArray[np.uint8]:
    """A row of `CLOUD` for every batch of pairs, each followed by what is missing to `CLOUD_STRIDE` bytes: (B, stride).

    Parameters
    ----------
    way_from_cloud
        From the cloud's coordinates to the way from the eye, metres: (3, 4), a rotation times ``unit_m``, and a move.
    ends
        Where each batch ends, and so the next begins.
    """
    row = np.zeros(len(ends), CLOUD)
    row["way_from_cloud"] = way_from_cloud
    row["normal_from_cloud"][:, :, :3] = way_from_cloud[:, :3] / unit_m
    row["light"], row["background"][:, :3] = [*TOWARD_LIGHT, AMBIENT], background
    row["unit_m"], row["is_lit"] = unit_m, lit
    row["first"], row["end"] = [0, *ends[:-1]], ends
    row["width"], row["height"] = windows.quilt.size_px
    row["stride"] = stride_of(windows.quilt.size_px[0])
    padded = np.zeros((len(ends), CLOUD_STRIDE), np.uint8)
    padded[:, : CLOUD.itemsize] = row.view(np.uint8).reshape(len(ends), -1)
    return padded
