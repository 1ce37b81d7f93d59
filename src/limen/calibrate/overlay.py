"""Photographs with what was found in them: markers, and panels where they were thought to hang and where they do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from limen.calibrate.boards import Board
from limen.calibrate.camera import Intrinsics
from limen.calibrate.detect import Sighting, read_photo
from limen.calibrate.poses import apply
from limen.calibrate.solve import Calibration
from limen.display.display import Display
from limen.display.panel import Panel
from limen.geometry import Floats

__all__ = ["draw_overlay", "draw_sheet"]

_FOUND, _NOMINAL, _MARKER, _TEXT = (255, 138, 30), (86, 156, 255), (70, 220, 90), (255, 255, 255)
_MOST_PHOTOS = 6
_EDGE_POINTS = 24


def draw_sheet(
    nominal: Display, boards: Sequence[Board], found: Calibration, width_px: int = 1800
) -> NDArray[np.uint8]:
    """Up to six of the photographs side by side, uint8 (height, width_px, 3): see `draw_overlay`."""
    count = min(_MOST_PHOTOS, len(found.photos))
    columns = math.ceil(math.sqrt(count))
    chosen = np.linspace(0, len(found.photos) - 1, count).round().astype(int)
    tiles = [draw_overlay(nominal, boards, found, int(number), width_px // columns) for number in chosen]
    height, width = tiles[0].shape[:2]
    sheet = np.full((height * math.ceil(count / columns), width_px, 3), 24, dtype=np.uint8)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        sheet[row * height : (row + 1) * height, column * width : (column + 1) * width] = tile
    return sheet


def draw_overlay(
    nominal: Display, boards: Sequence[Board], found: Calibration, number: int, width_px: int = 1200
) -> NDArray[np.uint8]:
    """One photograph, uint8 (height, width_px, 3): markers green, panels orange, and blue by the display file."""
    sighting = found.sightings[number]
    scale = width_px / sighting.size_px[0]
    size = (width_px, round(sighting.size_px[1] * scale))
    canvas = Picture.fromarray(read_photo(Path(sighting.photo))).resize(size, Picture.Resampling.BOX).convert("RGB")
    drawing = ImageDraw.Draw(canvas)
    line = max(1, round(width_px / 500))
    font = ImageFont.load_default(size=max(10.0, width_px / 45))

    def loop(panel: Panel) -> list[tuple[float, float]]:
        places = _outline(panel, found.camera, found.photo_poses[number]) * scale
        return [(float(x), float(y)) for x, y in places]

    before = {panel.name: panel for panel in nominal.panels}
    names = _panels_in(boards, sighting)
    hung = [panel for panel in found.display.panels if panel.name in names]
    for panel in hung:
        drawing.line(loop(before[panel.name]), fill=_NOMINAL, width=line)
    for panel in hung:
        drawing.line(loop(panel), fill=_FOUND, width=line)
    for corners in sighting.corners_px * scale:
        drawing.polygon([(float(x), float(y)) for x, y in corners], outline=_MARKER, width=line)
    for panel in hung:
        x, y = np.array(loop(panel)).mean(axis=0)
        drawing.text(
            (x, y), panel.name, fill=_TEXT, font=font, anchor="mm", stroke_width=2 * line, stroke_fill=(0, 0, 0)
        )
    return np.asarray(canvas)


def _panels_in(boards: Sequence[Board], sighting: Sighting) -> set[str]:
    seen = set(sighting.ids.tolist())
    return {board.panel for board in boards if seen & set(board.ids)}


def _outline(panel: Panel, camera: Intrinsics, pose: Floats) -> Floats:
    """The lit outline as the camera sees it: a closed line (N, 2), bent as the lens bends it."""
    width, height = panel.size_px
    corners = np.array(panel.outline_px or [(0, 0), (width, 0), (width, height), (0, height)], dtype=float)
    share = np.linspace(0, 1, _EDGE_POINTS, endpoint=False)[:, None]
    edges: Sequence[Floats] = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    line = np.concatenate([*edges, corners[:1]])
    return camera.project(apply(pose, panel.position_m(line)))
