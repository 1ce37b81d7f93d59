"""The pages that an image needs, pixel by pixel in plain NumPy, and a display small enough to look at every one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import limen
from limen.display import files
from limen.layers.common.page_detail import BLEND_LEVELS, KEPT
from limen.typed_toml import typed

__all__ = ["pages_drawn", "pages_of", "pixels", "small_room"]


def small_room(pitch_mm=4.0, columns=3):
    """Two walls at a right angle, coarse pixels: small enough to look at every pixel."""
    text = f"""
name = "room"
[[grid]]
name = "front"
columns = {columns}
rows = 2
size_px = [100, 60]
pitch_mm = {pitch_mm}
bezel_mm = [8, 8]
centre_m = [0, 1.5, -2]
[[grid]]
name = "right"
columns = 2
rows = 2
size_px = [100, 60]
pitch_mm = {pitch_mm}
centre_m = [1.2, 1.5, -1]
facing = [-1, 0, 0.3]
"""
    content = typed(Path("room.toml"), text, files.DisplayFile)
    return limen.Display("room", files._panels(content))


def pixels(panel):
    """Centres of all pixels, (h, w, 2)."""
    width, height = panel.size_px
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


def pages_drawn(pyramid, texels, footprint, allowed_px):
    """The pages that places draw, level by level: fully where a level is the coarsest allowed, blended just before.

    ``texels`` (N, 2), ``footprint`` and ``allowed_px`` (N,) or one number.
    """
    top = len(pyramid.levels) - 1
    finest = np.clip(np.floor(np.log2(footprint) + 1e-3), 0, top)
    tolerance = np.log2(np.maximum(KEPT * allowed_px * footprint, 1e-300)) + np.zeros(len(texels))

    def given_over_to_finer(level):
        if level > top:
            return 1.0
        return np.where(level <= finest, 0.0, np.clip((level - tolerance) / BLEND_LEVELS, 0, 1))

    wanted = set()
    for level in range(top + 1):
        drawn = given_over_to_finer(level + 1) > given_over_to_finer(level)
        drawn &= level >= finest
        wanted |= pages_of(pyramid, texels[drawn], np.full(drawn.sum(), level))
    return wanted


def pages_of(pyramid, texels, level):
    column, row = (np.floor(texels[:, axis] / (256 * 2.0**level)).astype(int) for axis in (0, 1))
    return set(np.unique(pyramid.page_index(level, column, row)).tolist())
