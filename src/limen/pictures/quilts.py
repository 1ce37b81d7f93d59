"""Pictures of quilts: where each panel lies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from limen.display.display import Display
from limen.display.mapping import quilt_outlines
from limen.display.quilt import Quilt

__all__ = ["draw_quilts"]

_BACKGROUND = (24, 26, 30)
_FREE = (38, 41, 47)
_PANEL = (52, 64, 82)
_TURNED = (64, 74, 60)
_EDGE = (132, 146, 168)
_TEXT = (214, 218, 224)
_BETWEEN_PX = 12
_LEAST_FONT_PX = 8.0
_MOST_FONT_PX = 16.0
_SUPERSAMPLE = 2


def draw_quilts(display: Display, quilts: Sequence[Quilt], width_px: int = 1600) -> NDArray[np.uint8]:
    """The lit outlines of panels in their quilts, the quilts below each other; turned panels in another colour.

    Names are written where they can be read.

    Returns
    -------
    uint8 (height, width_px, 3), sRGB; the height follows from the quilts
    """
    scale = width_px * _SUPERSAMPLE / max(quilt.size_px[0] for quilt in quilts)
    heights = [max(1, math.ceil(quilt.size_px[1] * scale)) for quilt in quilts]
    between = _BETWEEN_PX * _SUPERSAMPLE
    tall = sum(heights) + between * (len(quilts) - 1)
    canvas = Picture.new("RGB", (width_px * _SUPERSAMPLE, tall), _BACKGROUND)
    drawing = ImageDraw.Draw(canvas)
    top = 0
    for quilt, height in zip(quilts, heights, strict=True):
        drawing.rectangle([0, top, quilt.size_px[0] * scale, top + height], fill=_FREE)
        outlines = quilt_outlines(display, quilt) * scale + [0, top]
        for index, turn, outline in zip(quilt.panels, quilt.quarter_turns, outlines, strict=True):
            corners = [tuple(corner) for corner in outline.tolist()]
            drawing.polygon(corners, fill=_TURNED if turn else _PANEL, outline=_EDGE, width=_SUPERSAMPLE)
            _write_name(drawing, display.panels[index].name, outline)
        top += height + between
    return np.asarray(canvas.resize((width_px, max(1, tall // _SUPERSAMPLE)), Picture.Resampling.BOX))


def _write_name(drawing: ImageDraw.ImageDraw, name: str, outline: NDArray[np.float64]) -> None:
    # A glyph is about 0.6 of the font's size wide, and a triangle is half as wide in the middle.
    size = float(np.ptp(outline[:, 0])) * 0.6 / (0.6 * len(name))
    if size >= _LEAST_FONT_PX * _SUPERSAMPLE:
        font = ImageFont.load_default(size=min(_MOST_FONT_PX * _SUPERSAMPLE, size))
        middle = np.unique(outline, axis=0).mean(axis=0)
        drawing.text((float(middle[0]), float(middle[1])), name, fill=_TEXT, font=font, anchor="mm")
