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
from limen.lens import Lens
from limen.placement import PanelMaps

__all__ = ["NOBODY", "LensCells", "first_pixel", "lens_cells"]

Index = NDArray[np.int64]

NOBODY = -1
"""In place of a neighbour: no lens reaches there, or the panel ends."""

_SMALLEST_PX = 16


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
    count = len(display.panels)
    level = np.zeros(count, dtype=np.int64)
    panels, rects, besides, plain_panels, plain_cells, so_far = [], [], [], [], [], 0
    centre = np.array([lens.centre_px for lens in lenses]).reshape(-1, 2)
    radii = np.array([lens.radii_px for lens in lenses]).reshape(-1, 2)
    low, high = maps.offset, maps.offset + maps.scale * display.arrays.size_px
    # What a lens that magnifies nothing reaches is as it was.
    bends = np.array([lens.magnification > 1 for lens in lenses], dtype=bool)
    reached = bends & (
        (centre - radii < high[:, None]) & (centre + radii > low[:, None])
    ).all(axis=2)  # fmt: skip
    for number in np.flatnonzero(reached.any(axis=1)):
        own = reached[number]
        level[number] = _level(maps.footprint[number], float(radii[own].min()))
        first, edges = _grid(display.arrays.size_px[number], maps, int(number), int(level[number]))
        bounds = [edge * maps.scale[number, axis] + maps.offset[number, axis] for axis, edge in enumerate(edges)]
        touched = np.zeros((len(edges[1]) - 1, len(edges[0]) - 1), dtype=bool)
        for middle, radius in zip(centre[own], radii[own], strict=True):
            across, down = (
                (bounds[axis][:-1] < middle[axis] + radius[axis]) & (bounds[axis][1:] > middle[axis] - radius[axis])
                for axis in range(2)
            )
            touched |= down[:, None] & across
        rows, columns = np.nonzero(touched)
        panels.append(np.full(len(rows), number))
        rects.append(np.stack([edges[0][columns], edges[1][rows], edges[0][columns + 1], edges[1][rows + 1]], axis=1))
        name = np.pad(np.where(touched, so_far + np.cumsum(touched).reshape(touched.shape) - 1, NOBODY), 1,
                      constant_values=NOBODY)  # fmt: skip
        besides.append(
            np.stack([name[rows + 1, columns], name[rows, columns + 1], name[rows + 1, columns + 2],
                      name[rows + 2, columns + 1]], axis=1)
        )  # fmt: skip
        so_far += len(rows)
        rows, columns = np.nonzero(~touched)
        plain_panels.append(np.full(len(rows), number))
        plain_cells.append(np.stack([first[0][columns], first[1][rows]], axis=1))
    return LensCells(
        _joined(panels, ()), _joined(rects, (4,)), _joined(besides, (4,)), _joined(plain_panels, ()),
        _joined(plain_cells, (2,)), level,
    )  # fmt: skip


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


def _joined(parts: list[Index], shape: tuple[int, ...]) -> Index:
    return np.concatenate(parts) if parts else np.empty((0, *shape), dtype=np.int64)
