"""Packs panels of any outline tightly into quilts: shelves of panels that follow each other's slanted sides.

A shelf is filled from the left. The panel that comes next is, of the next few in order of height, and upright or upside
down, at the shelf's top or bottom, the one that wastes least between its left side and the right side of what is there.
Packing polygons best is NP-hard; this fills about nine tenths, fast.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from limen.display.panel import Panel
from limen.display.quilt import HasPanels, Quilt
from limen.errors import DisplayError
from limen.geometry import Floats, signed_area

__all__ = ["GAP_PX", "GUARD_PX", "lit_fill", "pack_outlines"]

GUARD_PX = 1.5
"""How far outside of a panel's outline drawing may leave pixels, so that no seam shows between panels."""

GAP_PX = 4.0
"""Between outlines, unless told otherwise; not less than twice the guard."""

_AHEAD = 6
"""How many panels in order of height compete for the next place."""

_LOW = 2.0
"""How much worse than other waste it is to leave a panel's width free above or below it: shelves stay level."""

_SLACK = 0.92
"""Share of a quilt that is expected to be filled, when its width is chosen."""


def pack_outlines(
    display: HasPanels,
    *,
    gap_px: float = GAP_PX,
    max_size_px: int = 8192,
    max_px: int = 2**26,
    panels: Sequence[int] | None = None,
) -> list[Quilt]:
    """Panels' lit outlines side by side, some turned by half a turn, in as few quilts as shelves need.

    Bounding rectangles of pixel grids may overlap, and stick out of the quilt; outlines do not.

    Parameters
    ----------
    gap_px
        Least distance between two outlines; half of it is left free along the quilt's border.
    max_size_px, max_px
        Longest side and most pixels of a quilt, as in `limen.display.quilt.pack`.
    panels
        Indices of the panels to pack; all of them by default.

    Raises
    ------
    DisplayError
        If the gap is less than twice the guard, or one panel alone exceeds a limit.
    """
    if not (math.isfinite(gap_px) and gap_px >= 2 * GUARD_PX):
        raise DisplayError(
            f"gap_px must be at least {2 * GUARD_PX:g}, twice what is drawn beyond an outline; got {gap_px}"
        )
    chosen = range(len(display.panels)) if panels is None else panels
    margin = math.ceil(gap_px / 2)
    limits = _Limits(max_size_px - 2 * margin, max_px, margin)
    items = [_item(index, display.panels[index], gap_px) for index in chosen]
    for item in items:
        _refuse_too_large(display.panels[item.index], item, limits, max_size_px)
    waiting = sorted(items, key=lambda item: (-item.height, -item.area, item.index))
    quilts = []
    while waiting:
        placed, waiting = _fill_quilt(waiting, limits, gap_px)
        quilts.append(_quilt(placed, margin))
    return quilts


def lit_fill(display: HasPanels, quilt: Quilt) -> float:
    """Share of a quilt's area that lies inside lit outlines, 0 to 1."""
    lit = sum(_area(display.panels[index].lit_outline_px) for index in quilt.panels)
    return lit / math.prod(quilt.size_px)


@dataclass(frozen=True, slots=True)
class _Limits:
    side: int  # without margins
    pixels: int  # with margins
    margin: int

    def allow(self, width: float, height: float) -> bool:
        outer = (math.ceil(width) + 2 * self.margin, math.ceil(height) + 2 * self.margin)
        return max(width, height) <= self.side and math.prod(outer) <= self.pixels


@dataclass(frozen=True, slots=True, eq=False)
class _Item:
    """A panel's outline, row of pixels by row: how far it reaches to the left and right within each.

    ``left`` and ``right`` have two rows: upright, and after half a turn. ``right`` is widened by the gap: whatever
    stands beside it at or beyond this is nowhere nearer than the gap.
    """

    index: int
    low: tuple[int, int]  # first column and row of the pixel grid that the outline touches
    beyond: tuple[int, int]  # columns and rows of the pixel grid behind the last that it touches
    width: int
    height: int
    gap: int  # rows above and below that ``right`` reaches beyond the outline
    left: Floats  # (2, height)
    right: Floats  # (2, height + 2 gap)
    area: float


@dataclass(frozen=True, slots=True)
class _Placed:
    item: _Item
    turned: bool
    x: int  # of the outline's bounding rectangle, from the margin
    y: int


def _item(index: int, panel: Panel, gap_px: float) -> _Item:
    outline = panel.lit_outline_px
    # Whole rows and columns of the panel's own grid, so that its pixels fall on the quilt's.
    low = np.floor(outline.min(axis=0) + 1e-9).astype(int)
    size = np.maximum(np.ceil(outline.max(axis=0) - 1e-9).astype(int) - low, 1)
    upright = outline - low
    sides = [_sides(corners, int(size[1])) for corners in (upright, size - upright)]
    reach = math.ceil(gap_px)
    return _Item(
        index=index,
        low=(int(low[0]), int(low[1])),
        beyond=(panel.size_px[0] - int(low[0] + size[0]), panel.size_px[1] - int(low[1] + size[1])),
        width=int(size[0]),
        height=int(size[1]),
        gap=reach,
        left=np.stack([left for left, _ in sides]),
        right=np.stack([_widened(right, gap_px, reach) for _, right in sides]),
        area=_area(outline),
    )


def _sides(corners: Floats, height: int) -> tuple[Floats, Floats]:
    """Least and largest x of a convex polygon within each row of pixels, shape (height,) each."""
    edge = np.arange(height + 1.0)
    begin, end = corners, np.roll(corners, -1, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (edge - begin[:, 1:]) / (end - begin)[:, 1:]
        x = begin[:, :1] + along * (end - begin)[:, :1]
    met = (along >= 0) & (along <= 1)
    least = np.where(met, x, np.inf).min(axis=0)
    most = np.where(met, x, -np.inf).max(axis=0)
    left, right = np.minimum(least[:-1], least[1:]), np.maximum(most[:-1], most[1:])
    row = np.clip(corners[:, 1].astype(int), 0, height - 1)
    np.minimum.at(left, row, corners[:, 0])
    np.maximum.at(right, row, corners[:, 0])
    return left, right


def _widened(right: Floats, gap_px: float, reach: int) -> Floats:
    """A right side that keeps a distance from what stands beside it, ``reach`` rows further up and down.

    Points of rows that are k apart are k - 1 apart vertically, or more.
    """
    wide = np.full(len(right) + 2 * reach, -np.inf)
    for k in range(-reach, reach + 1):
        apart = max(abs(k) - 1, 0)
        across = math.sqrt(max(gap_px**2 - apart**2, 0))
        part = wide[reach + k : reach + k + len(right)]
        np.maximum(part, right + across, out=part)
    return wide


def _refuse_too_large(panel: Panel, item: _Item, limits: _Limits, max_size_px: int) -> None:
    if not limits.allow(item.width, item.height):
        width, height = panel.size_px
        raise DisplayError(
            f"panel '{panel.name}' has {width} x {height} pixels; this adapter draws at most {max_size_px} a side and "
            f"{limits.pixels} in all, with gaps: split the panel"
        )


def _fill_quilt(waiting: list[_Item], limits: _Limits, gap_px: float) -> tuple[list[_Placed], list[_Item]]:
    """One quilt with the first panels of a list, tallest first, that fit; and those that are left."""
    gap = math.ceil(gap_px)
    width = _shelf_width(waiting, limits)
    placed: list[_Placed] = []
    top = 0
    while waiting and limits.allow(width, top + waiting[0].height):
        height = waiting[0].height
        shelf, waiting = _fill_shelf(waiting, width, top)
        placed += shelf
        top += height + gap
    return placed, waiting


def _shelf_width(waiting: list[_Item], limits: _Limits) -> int:
    """A width that makes the quilt about square, so that neither side meets the adapter's limit early."""
    with_gaps = sum(item.area + item.gap * (item.height + item.area / item.height) for item in waiting)
    side = math.sqrt(min(with_gaps / _SLACK, limits.pixels))
    widest = max(item.width for item in waiting)
    most = limits.pixels // (waiting[0].height + 2 * limits.margin) - 2 * limits.margin
    return max(widest, min(limits.side, most, math.ceil(side)))


def _fill_shelf(waiting: list[_Item], width: int, top: int) -> tuple[list[_Placed], list[_Item]]:
    """A shelf as high as the first panel; and the panels that are left."""
    height, reach = waiting[0].height, waiting[0].gap
    taken = np.zeros(height + 2 * reach)  # how far each row of the shelf, and of the gaps around it, is used up
    placed: list[_Placed] = []
    rest = list(waiting)
    while rest:
        best: tuple[float, int, _Placed, Floats] | None = None
        room = width - float(taken[reach:-reach].min())
        # The tallest begins the shelf, or it would hold up every shelf to come.
        for number, item in _candidates(rest, room) if placed else [(0, rest[0])]:
            for place, after in _places(item, taken, height, width):
                # What the shelf loses, less what the panel fills; nothing is turned for less than a pixel.
                waste = float(after[reach:-reach].sum() - taken[reach:-reach].sum()) - item.area + place.turned
                waste += _LOW * (height - item.height) * item.width
                if best is None or waste < best[0]:
                    best = (waste, number, place, after)
        if best is None:
            break
        _, number, place, taken = best
        placed.append(_Placed(place.item, place.turned, place.x, place.y + top))
        del rest[number]
    return placed, rest


def _candidates(waiting: list[_Item], room: float) -> Iterator[tuple[int, _Item]]:
    """The first few panels that may fit into the rest of a shelf; of those shaped alike, one is enough."""
    seen: set[tuple[int, ...]] = set()
    for number, item in islice(((n, item) for n, item in enumerate(waiting) if item.width <= room), _AHEAD):
        alike = (item.width, item.height, round(item.area), round(item.left[0, 0]), round(item.left[0, -1]))
        if alike not in seen:
            seen.add(alike)
            yield number, item


def _places(item: _Item, taken: Floats, height: int, width: int) -> list[tuple[_Placed, Floats]]:
    """Upright and turned, at the shelf's top and bottom: where a panel comes to stand, and what is taken then."""
    found = []
    for turned in (False, True):
        left, right = item.left[int(turned)], item.right[int(turned)]
        for y in sorted({0, height - item.height}):
            x = max(0, math.ceil(float((taken[item.gap + y : item.gap + y + item.height] - left).max()) - 1e-9))
            if x + item.width > width:
                continue
            after = taken.copy()
            rows = after[y : y + len(right)]
            np.maximum(rows, x + right, out=rows)
            found.append((_Placed(item, turned, x, y), after))
    return found


def _quilt(placed: list[_Placed], margin: int) -> Quilt:
    placed = sorted(placed, key=lambda each: each.item.index)
    width = max(each.x + each.item.width for each in placed)
    height = max(each.y + each.item.height for each in placed)
    return Quilt(
        size_px=(width + 2 * margin, height + 2 * margin),
        panels=tuple(each.item.index for each in placed),
        offsets_px=tuple(_offset_px(each, margin) for each in placed),
        turns=tuple(2 if each.turned else 0 for each in placed),
    )


def _offset_px(placed: _Placed, margin: int) -> tuple[int, int]:
    """Where the corner of the whole pixel grid comes to lie; after half a turn its end comes first."""
    item = placed.item
    before = item.beyond if placed.turned else item.low
    return (placed.x + margin - before[0], placed.y + margin - before[1])


def _area(outline: Floats) -> float:
    return abs(signed_area(outline))
