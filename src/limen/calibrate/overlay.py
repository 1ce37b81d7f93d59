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
_ROOM = 1.2


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
    """The panels in a photograph, uint8 (height, width_px, 3): markers green, panels orange, by the file blue."""
    sighting = found.sightings[number]
    names = _panels_in(boards, sighting)
    before = [panel for panel in nominal.panels if panel.name in names]
    hung = [panel for panel in found.display.panels if panel.name in names]
    pose = found.photo_poses[number]
    old, new = ([_outline(panel, found.camera, pose) for panel in panels] for panels in (before, hung))
    left, top, width, height = _frame(np.concatenate(old + new), sighting.size_px)
    scale = width_px / width
    size = (width_px, round(width_px * sighting.size_px[1] / sighting.size_px[0]))
    box = (left, top, left + width, top + height)
    photo = Picture.fromarray(read_photo(Path(sighting.photo)))
    canvas = photo.resize(size, Picture.Resampling.BOX, box=box).convert("RGB")
    drawing = ImageDraw.Draw(canvas)
    line = max(1, round(width_px / 350))
    font = ImageFont.load_default(size=max(10.0, width_px / 45))

    def placed(line_px: Floats) -> list[tuple[float, float]]:
        # The first pixel's centre is (0, 0) to the camera and (0.5, 0.5) to the picture.
        return [(float(x), float(y)) for x, y in (line_px + 0.5 - [left, top]) * scale]

    for lines, colour in ((old, _NOMINAL), (new, _FOUND)):
        for each in lines:
            drawing.line(placed(each), fill=colour, width=line)
    for corners in sighting.corners_px:
        drawing.polygon(placed(corners), outline=_MARKER, width=line)
    for panel, each in zip(hung, new, strict=True):
        middle = placed(each.mean(axis=0, keepdims=True))[0]
        drawing.text(
            middle, panel.name, fill=_TEXT, font=font, anchor="mm", stroke_width=line + 1, stroke_fill=(0, 0, 0)
        )
    return np.asarray(canvas)


def _frame(points_px: Floats, size_px: tuple[int, int]) -> tuple[float, float, float, float]:
    """Left, top, width and height of the part of a photograph, of its shape, that holds points and some room."""
    low, high = points_px.min(axis=0), points_px.max(axis=0)
    share = float(((high - low) * _ROOM / np.array(size_px)).max())
    span = min(share, 1.0) * np.array(size_px)
    corner = np.clip((low + high) / 2 - span / 2, 0, np.array(size_px) - span)
    return float(corner[0]), float(corner[1]), float(span[0]), float(span[1])


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
