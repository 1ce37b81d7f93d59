"""Quilts: the rectangular images that the panels of one output are packed in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from limen.display.panel import Panel
from limen.errors import DisplayError
from limen.geometry import Floats

__all__ = ["HasPanels", "Quilt", "fill", "pack", "pieces", "quilt_names"]

_TURNED = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]], dtype=float)
"""What 0 to 3 quarter turns clockwise make of a step in pixels (right, down)."""


class HasPanels(Protocol):
    """A display, or a part of one."""

    @property
    def panels(self) -> tuple[Panel, ...]: ...


@dataclass(frozen=True, slots=True)
class Quilt:
    """One image that several panels share.

    Parameters
    ----------
    size_px
        Width and height of the image.
    panels
        Indices of the panels into the display.
    offsets_px
        Where the top left pixel of each panel's picture, turned, lies in the image.
    turns
        Quarter turns clockwise of each panel's picture in the image, 0 to 3; empty if none is turned.

    output
        The video output that shows it, where a display's owner named one.

    Raises
    ------
    DisplayError
        If the lists do not match, a panel is there twice, or a turn is none.
    """

    size_px: tuple[int, int]
    panels: tuple[int, ...]
    offsets_px: tuple[tuple[int, int], ...]
    turns: tuple[int, ...] = ()
    output: str = ""

    def __post_init__(self) -> None:
        if min(self.size_px) < 1:
            raise DisplayError(f"a quilt must have at least one pixel, got {self.size_px[0]} x {self.size_px[1]}")
        count = len(self.panels)
        if len(self.offsets_px) != count or len(self.turns) not in (0, count):
            raise DisplayError(
                f"a quilt of {count} panels needs as many offsets, and as many turns or none; "
                f"got {len(self.offsets_px)} and {len(self.turns)}"
            )
        if len(set(self.panels)) != count:
            raise DisplayError("a quilt must hold no panel twice")
        if not set(self.turns) <= {0, 1, 2, 3}:
            raise DisplayError(f"a quilt's turns must be 0 to 3 quarter turns, got {sorted(set(self.turns))}")

    @property
    def quarter_turns(self) -> tuple[int, ...]:
        """`turns`, with a 0 for every panel where none is turned."""
        return self.turns or (0,) * len(self.panels)

    def quilt_from_panel(self, display: HasPanels) -> Floats:
        """The affine maps from pixels of the panels to pixels of the quilt, in the order of `panels`.

        Returns
        -------
        shape (N, 2, 3)
            Row by row ``(a, b, c)``: a coordinate in the quilt is ``a x + b y + c``.
        """
        count = len(self.panels)
        turns = np.array(self.quarter_turns, dtype=int)
        sizes = np.array([display.panels[index].size_px for index in self.panels], dtype=float).reshape(-1, 2)
        maps = np.zeros((count, 2, 3))
        maps[:, :, :2] = _TURNED[turns]
        # The corner of the turned picture's bounding box that has the smallest coordinates lies at the offset.
        maps[:, :, 2] = self.offsets_px - np.minimum(maps[:, :, :2] * sizes[:, None], 0).sum(axis=2)
        return maps


def pack(
    display: HasPanels, *, max_size_px: int = 8192, max_px: int = 2**26, panels: Sequence[int] | None = None
) -> list[Quilt]:
    """Panels side by side on shelves, in as few quilts as shelves of falling height need.

    Parameters
    ----------
    max_size_px
        Longest side of a quilt: what the adapter's textures allow.
    max_px
        Most pixels of a quilt, which bounds the memory of drawing and reading it back (2^26 are 268 MB each).
    panels
        Indices of the panels to pack; all of them by default.

    Raises
    ------
    DisplayError
        If one panel alone exceeds a limit.
    """
    chosen = range(len(display.panels)) if panels is None else panels
    sizes = {index: display.panels[index].size_px for index in chosen}
    for index, (width, height) in sizes.items():
        if max(width, height) > max_size_px or width * height > max_px:
            raise DisplayError(
                f"panel '{display.panels[index].name}' has {width} x {height} pixels; this adapter draws at most "
                f"{max_size_px} a side and {max_px} in all: split the panel"
            )
    waiting = sorted(sizes, key=lambda index: (-sizes[index][1], -sizes[index][0], index))
    quilts = []
    while waiting:
        quilt = _fill(waiting, sizes, max_size_px, max_px)
        quilts.append(quilt)
        packed = set(quilt.panels)
        waiting = [index for index in waiting if index not in packed]
    return quilts


def quilt_names(quilts: Sequence[Quilt]) -> list[str]:
    """What pictures of quilts are called: by their outputs, else by their numbers."""
    return [quilt.output or f"quilt-{number}" for number, quilt in enumerate(quilts)]


def fill(display: HasPanels, quilt: Quilt) -> float:
    """Share of a quilt's pixels that belong to panels, 0 to 1."""
    used = sum(math.prod(display.panels[index].size_px) for index in quilt.panels)
    return used / math.prod(quilt.size_px)


def pieces(display: HasPanels, quilt: Quilt, image: NDArray[np.uint8]) -> dict[str, NDArray[np.uint8]]:
    """The picture of every panel of a quilt, upright, by the panel's name.

    Views of ``image``, (H, W, ...); of panels with an outline copies that are 0 outside of it, for their pixel grids
    may reach over neighbours and beyond the quilt.
    """
    pictures = {}
    for index, (x, y), turn in zip(quilt.panels, quilt.offsets_px, quilt.quarter_turns, strict=True):
        panel = display.panels[index]
        width, height = _turned_size(panel.size_px, turn)
        top, left = max(y, 0), max(x, 0)
        piece = image[top : max(y + height, 0), left : max(x + width, 0)]
        if panel.outline_px:
            whole = np.zeros((height, width, *image.shape[2:]), image.dtype)
            whole[top - y : top - y + piece.shape[0], left - x : left - x + piece.shape[1]] = piece
            piece = whole
            np.rot90(piece, turn)[~_is_lit(panel)] = 0
        pictures[panel.name] = np.rot90(piece, turn)
    return pictures


def _is_lit(panel: Panel) -> NDArray[np.bool_]:
    """Which pixels of a panel's grid its outline touches or nearly touches: shape (h, w)."""
    width, height = panel.size_px
    corners = panel.lit_outline_px
    step = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1)[:, None]
    offset = (corners * inward).sum(axis=1)
    x, y = (np.arange(count) + 0.5 for count in (width, height))
    lit = np.ones((height, width), bool)
    for (a, b), c in zip(inward, offset, strict=True):
        lit &= (y * b)[:, None] + (x * a)[None] >= c - 1.0
    return lit


def _turned_size(size_px: tuple[int, int], turn: int) -> tuple[int, int]:
    return size_px if turn % 2 == 0 else (size_px[1], size_px[0])


def _fill(waiting: list[int], sizes: dict[int, tuple[int, int]], max_size_px: int, max_px: int) -> Quilt:
    """One quilt with the first panels of a list, tallest first, that fit."""
    shelf_px = _shelf_width(waiting, sizes, max_size_px, max_px)
    placed: dict[int, tuple[int, int]] = {}
    x, y, shelf_height, width_used = 0, 0, 0, 0
    for index in waiting:
        width, height = sizes[index]
        if placed and x + width > shelf_px:
            x, y, shelf_height = 0, y + shelf_height, 0
        height_after = y + max(shelf_height, height)
        if height_after > max_size_px or max(width_used, x + width) * height_after > max_px:
            break
        placed[index] = (x, y)
        x, shelf_height = x + width, max(shelf_height, height)
        width_used = max(width_used, x)
    order = sorted(placed)
    return Quilt((width_used, y + shelf_height), tuple(order), tuple(placed[index] for index in order))


def _shelf_width(waiting: list[int], sizes: dict[int, tuple[int, int]], max_size_px: int, max_px: int) -> int:
    """A width that makes the quilt about square, so that neither side meets the adapter's limit early."""
    area = min(sum(sizes[index][0] * sizes[index][1] for index in waiting), max_px)
    widest = max(sizes[index][0] for index in waiting)
    across = max(1, round(float(np.sqrt(area)) / widest))
    return min(max_size_px, max(widest, across * widest))
