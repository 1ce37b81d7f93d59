"""Whether quilts that somebody wrote can be: every panel in one of them, inside, and beside the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from limen.display.panel import MAX_OUTLINE_CORNERS
from limen.display.quilt import HasPanels, Quilt
from limen.errors import DisplayError
from limen.geometry import Floats

__all__ = ["check_quilts", "overlaps", "part_of_quilts", "quilt_outlines"]

_TOUCH_PX = 1e-3
"""Outlines may come so near, or lie over each other by so much: they touch."""

_BLOCK = 512


def check_quilts(display: HasPanels, quilts: Sequence[Quilt]) -> None:
    """Refuse quilts that cannot show a display.

    Raises
    ------
    DisplayError
        If a panel is in no quilt or in two, reaches out of its quilt, or lies over another.
    """
    homes: dict[int, int] = {}
    for number, quilt in enumerate(quilts):
        for index in quilt.panels:
            if not 0 <= index < len(display.panels):
                raise DisplayError(f"quilt {number + 1} holds panel {index} of {len(display.panels)}")
            if index in homes:
                raise DisplayError(f"panel '{display.panels[index].name}' is in two quilts: keep one of them")
            homes[index] = number
    for index, panel in enumerate(display.panels):
        if index not in homes:
            raise DisplayError(f"panel '{panel.name}' is in no quilt: add it to one, or leave all quilts away")
    for number, quilt in enumerate(quilts):
        _check_inside(display, quilt, number)
        for a, b in overlaps(quilt_outlines(display, quilt)):
            names = [display.panels[quilt.panels[row]].name for row in (a, b)]
            raise DisplayError(f"quilt {number + 1}: panels '{names[0]}' and '{names[1]}' overlap: move one of them")


def quilt_outlines(display: HasPanels, quilt: Quilt) -> Floats:
    """Lit outlines of a quilt's panels in its pixels, clockwise, shape (N, 8, 2); the last corner is repeated."""
    loops = np.zeros((len(quilt.panels), MAX_OUTLINE_CORNERS, 2))
    for row, index in enumerate(quilt.panels):
        corners = display.panels[index].lit_outline_px
        loops[row, : len(corners)], loops[row, len(corners) :] = corners, corners[-1]
    maps = quilt.quilt_from_panel(display)
    return np.asarray(loops @ maps[:, :, :2].transpose(0, 2, 1) + maps[:, None, :, 2])


def overlaps(outlines: Floats, margin_px: float = -_TOUCH_PX) -> Iterator[tuple[int, int]]:
    """Pairs of convex clockwise outlines, shape (N, K, 2), that no line along an edge of either keeps apart.

    ``margin_px`` is the distance that counts as apart along that line.
    """
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    for begin in range(0, len(outlines), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        near = ((low[rows, None] < high[None] + margin_px) & (high[rows, None] + margin_px > low[None])).all(axis=2)
        first, second = np.nonzero(near)
        first += begin
        pairs = np.stack([first, second], axis=1)[first < second]
        hit = ~(_apart(outlines[pairs[:, 0]], outlines[pairs[:, 1]], margin_px)
                | _apart(outlines[pairs[:, 1]], outlines[pairs[:, 0]], margin_px))  # fmt: skip
        yield from ((int(a), int(b)) for a, b in pairs[hit])


def part_of_quilts(quilts: Sequence[Quilt], chosen: Sequence[int]) -> tuple[Quilt, ...]:
    """The quilts of a part of a display that has the chosen panels: the hardware wants them where they were."""
    place = {index: number for number, index in enumerate(chosen)}
    parts = []
    for quilt in quilts:
        kept = [row for row, index in enumerate(quilt.panels) if index in place]
        if kept:
            parts.append(
                Quilt(
                    quilt.size_px,
                    tuple(place[quilt.panels[row]] for row in kept),
                    tuple(quilt.offsets_px[row] for row in kept),
                    tuple(quilt.quarter_turns[row] for row in kept),
                    quilt.output,
                )
            )
    return tuple(parts)


def _check_inside(display: HasPanels, quilt: Quilt, number: int) -> None:
    outlines = quilt_outlines(display, quilt)
    inside = (outlines >= -_TOUCH_PX) & (outlines <= np.array(quilt.size_px) + _TOUCH_PX)
    outside = ~inside.all(axis=(1, 2))
    if outside.any():
        row = int(np.argmax(outside))
        low, high = outlines[row].min(axis=0), outlines[row].max(axis=0)
        name = display.panels[quilt.panels[row]].name
        raise DisplayError(
            f"quilt {number + 1}: panel '{name}' reaches from {low[0]:.0f},{low[1]:.0f} "
            f"to {high[0]:.0f},{high[1]:.0f} px, out of {quilt.size_px[0]} x {quilt.size_px[1]}: move it"
        )


def _apart(these: Floats, those: Floats, margin_px: float) -> NDArray[np.bool_]:
    """Whether an edge of the first outline of each pair has all of the second on its outer side."""
    edges = np.roll(these, -1, axis=1) - these
    lengths = np.linalg.norm(edges, axis=2)
    outward = np.stack([edges[..., 1], -edges[..., 0]], axis=2) / np.maximum(lengths, 1e-12)[..., None]
    beyond = np.einsum("peck,pek->pec", those[:, None] - these[:, :, None], outward).min(axis=2)
    return np.asarray(((beyond >= margin_px) & (lengths > 0)).any(axis=1))
