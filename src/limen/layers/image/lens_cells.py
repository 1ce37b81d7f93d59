"""Where on a display's panels lenses are looked through: cells of pixels, all else is drawn page by page.

A cell is what a panel shows, without lenses, of one page of its ordinary mip level (or of a quarter of that, where a
lens is smaller), so cells lie on a grid and every page of that level or a coarser one is made up of cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import PAGE, Pyramid
from limen.display.display import Display
from limen.viewing.lens import Lens
from limen.viewing.placement import PanelMaps

__all__ = ["NOBODY", "LensCells", "first_pixel", "lens_cells"]

Index = NDArray[np.int64]

NOBODY = -1
"""In place of a neighbour: no lens reaches there, or the panel ends."""

_SMALLEST_PX = 16
_NO_RECTS = np.empty((0, 4), dtype=np.int64)


class LensCells(NamedTuple):
    """Those that lenses reach into, panel by panel.

    ``rect_px`` are the pixels whose centres lie in a cell: left, top, right, bottom. Neighbours share no pixel and
    leave none out.
    """

    panel: Index  # (N,)
    rect_px: Index  # (N, 4)
    beside: Index  # (N, 4): the cells to the left, above, to the right and below, or `NOBODY`
    plain_panel: Index  # (M,): cells of the same panels that no lens reaches into
    plain_cell: Index  # (M, 2): column and row among all of their size
    level: Index  # (P,): log2 of a cell's size in pages of full resolution, panel by panel

    def without(self, pyramid: Pyramid, panel: Index, page: Index) -> NDArray[np.bool_]:
        """Which (panel, page) pairs show something that is not looked at through a lens, shape (len(panel),)."""
        kept = np.ones(len(panel), dtype=bool)
        page_level = pyramid.page_of(page)[0]
        for number in np.unique(self.panel):
            cells = self.plain_cell[self.plain_panel == number]
            here = panel == number
            for level in np.unique(page_level[here]):
                of_level = np.flatnonzero(here & (page_level == level))
                # Where texels are larger than pixels, cells are smaller than any page.
                cell = cells >> (level - self.level[number])
                shown = pyramid.levels[level]
                cell = cell[((cell >= 0) & (cell < (shown.columns, shown.rows))).all(axis=1)]
                kept[of_level] = np.isin(page[of_level], pyramid.page_index(level, cell[:, 0], cell[:, 1]))
        return kept

    def of_panels(self, panels: Sequence[int]) -> tuple[Index, Index, Index]:
        """Panels (by their place among those given), rectangles and neighbours of the cells on these panels."""
        place = np.full(int(max(self.panel.max(initial=0), max(panels, default=0))) + 1, -1)
        place[list(panels)] = np.arange(len(panels))
        here = place[self.panel] >= 0
        number = np.append(np.cumsum(here) - 1, NOBODY)  # the last one for `NOBODY` itself
        return place[self.panel[here]], self.rect_px[here], number[self.beside[here]]


def first_pixel(texel: NDArray[np.float64], scale: NDArray[np.float64], offset: NDArray[np.float64]) -> Index:
    """The first pixel whose centre lies at or behind a texel, along each axis; any shape (..., 2)."""
    return np.ceil((texel - offset) / scale - 0.5).astype(np.int64)


def lens_cells(display: Display, maps: PanelMaps, lenses: Sequence[Lens]) -> LensCells:
    """The cells of all panels that lenses reach into."""
    level = np.zeros(len(display.panels), dtype=np.int64)
    centre = np.array([lens.centre_px for lens in lenses]).reshape(-1, 2)
    radii = np.array([lens.radii_px for lens in lenses]).reshape(-1, 2)
    low, high = maps.offset[:, None], (maps.offset + maps.scale * display.arrays.size_px)[:, None]
    # What a lens that magnifies nothing reaches is as it was.
    bends = np.array([lens.magnification > 1 for lens in lenses], dtype=bool)
    reached = bends & ((centre - radii < high) & (centre + radii > low)).all(axis=2)
    numbers = np.flatnonzero(reached.any(axis=1))
    parts, so_far = [], 0
    for number in numbers:
        own = reached[number]
        level[number] = _level(maps.footprint[number], float(radii[own].min()))
        boxes = np.stack([centre[own] - radii[own], centre[own] + radii[own]], axis=1)
        part = _of_panel(display.arrays.size_px[number], maps, int(number), int(level[number]), boxes)
        parts.append(part._replace(beside=np.where(part.beside == NOBODY, NOBODY, part.beside + so_far)))
        so_far += len(part.rect_px)
    return LensCells(
        np.repeat(numbers, [len(part.rect_px) for part in parts]),
        np.concatenate([part.rect_px for part in parts] or [_NO_RECTS]),
        np.concatenate([part.beside for part in parts] or [_NO_RECTS]),
        np.repeat(numbers, [len(part.plain_cell) for part in parts]),
        np.concatenate([part.plain_cell for part in parts] or [_NO_RECTS[:, :2]]),
        level,
    )


class _Part(NamedTuple):
    """`LensCells` of one panel; neighbours count from its first cell."""

    rect_px: Index
    beside: Index
    plain_cell: Index


def _of_panel(size_px: Index, maps: PanelMaps, panel: int, level: int, boxes: NDArray[np.float64]) -> _Part:
    """``boxes``: what lenses reach, from and to, texels, (K, 2, 2)."""
    cells, edges = _grid(size_px, maps, panel, level)
    bounds = [edge * maps.scale[panel, axis] + maps.offset[panel, axis] for axis, edge in enumerate(edges)]
    touched = np.zeros((len(cells[1]), len(cells[0])), dtype=bool)
    for low, high in boxes:
        across, down = ((bounds[axis][:-1] < high[axis]) & (bounds[axis][1:] > low[axis]) for axis in range(2))
        touched |= down[:, None] & across
    row, column = np.nonzero(touched)
    name = np.full((touched.shape[0] + 2, touched.shape[1] + 2), NOBODY)
    name[1:-1, 1:-1][touched] = np.arange(len(row))
    plain_row, plain_column = np.nonzero(~touched)
    return _Part(
        np.stack([edges[0][column], edges[1][row], edges[0][column + 1], edges[1][row + 1]], axis=1),
        np.stack(
            [name[row + 1, column], name[row, column + 1], name[row + 1, column + 2], name[row + 2, column + 1]], axis=1
        ),
        np.stack([cells[0][plain_column], cells[1][plain_row]], axis=1),
    )


def _level(footprint: float, radius_px: float) -> int:
    """The panel's mip level; less where cells would be larger than a lens, as long as they are not tiny."""
    mip = math.floor(math.log2(footprint) + 1e-3)
    small = math.floor(math.log2(2 * radius_px / PAGE))
    smallest = math.ceil(math.log2(_SMALLEST_PX * footprint / PAGE))
    return min(mip, max(small, smallest))


def _grid(size_px: Index, maps: PanelMaps, panel: int, level: int) -> tuple[list[Index], list[Index]]:
    """Columns and rows of the cells that have pixels on a panel, and between which pixels they lie."""
    numbers, edges = [], []
    span = PAGE * 2.0**level
    for axis in range(2):
        scale, offset = maps.scale[panel, axis], maps.offset[panel, axis]
        begin, end = offset, offset + scale * size_px[axis]
        cell = np.arange(math.floor(begin / span), math.floor(end / span) + 2)
        edge = np.clip(first_pixel(cell * span, scale, offset), 0, size_px[axis])
        kept = edge[1:] > edge[:-1]
        numbers.append(cell[:-1][kept])
        edges.append(np.append(edge[:-1][kept], edge[1:][kept][-1:]))
    return numbers, edges
