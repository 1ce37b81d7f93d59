"""The page grid that everybody else sees: power-of-two levels of 256 x 256 texel pages.

Whatever the levels of a file are, an image is presented as one :class:`Pyramid`. A texel of level ``l`` spans
exactly ``2**l`` base texels along each axis, measured from the top left corner: texel ``i`` covers base texels
``i * 2**l`` to ``(i + 1) * 2**l``. Sizes round up, so every base texel is covered at every level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from limen.errors import InputError

__all__ = ["GUTTER", "PAGE", "Level", "Pyramid"]

PAGE = 256
"""Texels of content along a page's edge."""

GUTTER = 4
"""Texels copied from the neighbours on every side, so that filters never leave the page."""

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Level:
    """One level of a pyramid; its pages are numbered row by row from ``first_page``."""

    size_px: tuple[int, int]
    columns: int
    rows: int
    first_page: int

    @property
    def page_count(self) -> int:
        return self.columns * self.rows


@dataclass(frozen=True)
class Pyramid:
    """Levels from full resolution (0) down to the first that fits into one page.

    From level ``soft_from`` on, texels are softer than they could be: to be drawn where half their size would do.

    >>> pyramid = Pyramid.of((1000, 300))
    >>> [(level.size_px, level.columns, level.rows, level.first_page) for level in pyramid.levels]
    [((1000, 300), 4, 2, 0), ((500, 150), 2, 1, 8), ((250, 75), 1, 1, 10)]
    >>> pyramid.page_of(9), pyramid.page_index(1, 1, 0)
    ((1, 1, 0), 9)
    """

    size_px: tuple[int, int]
    levels: tuple[Level, ...]
    page_count: int
    soft_from: int | None = None

    @classmethod
    def of(cls, size_px: tuple[int, int]) -> Pyramid:
        """The pyramid of an image of ``size_px`` = (width, height) texels; InputError unless both are positive."""
        width, height = size_px
        if width < 1 or height < 1:
            raise InputError(f"an image of {width} x {height} texels has no pages; both sizes must be at least 1")
        levels: list[Level] = []
        first_page = 0
        while True:
            level = Level((width, height), -(-width // PAGE), -(-height // PAGE), first_page)
            levels.append(level)
            first_page += level.page_count
            if level.page_count == 1:
                return cls(size_px, tuple(levels), first_page)
            # Rounding up twice equals rounding up once by the product, so sizes are ceil(base / 2**l) exactly.
            width, height = -(-width // 2), -(-height // 2)

    @overload
    def page_index(self, level: int, column: int, row: int) -> int: ...
    @overload
    def page_index(self, level: Index, column: Index, row: Index) -> Index: ...
    def page_index(self, level: Any, column: Any, row: Any) -> Any:
        """Linear number of a page; arrays of equal shape (or that broadcast) give an int64 array.

        Raises InputError (an IndexError would not say which page) if any page lies outside its level.
        """
        if all(isinstance(part, int | np.integer) for part in (level, column, row)):
            if 0 <= level < len(self.levels):
                found = self.levels[level]
                if 0 <= column < found.columns and 0 <= row < found.rows:
                    return int(found.first_page + row * found.columns + column)
            raise InputError(f"there is no page at level {level}, column {column}, row {row} of this image")
        levels, columns, rows = (np.asarray(part, dtype=np.int64) for part in (level, column, row))
        if levels.size and (levels.min() < 0 or levels.max() >= len(self.levels)):
            raise InputError(f"levels run from 0 to {len(self.levels) - 1}")
        grid = self._grid
        if np.any((columns < 0) | (rows < 0) | (columns >= grid[1][levels]) | (rows >= grid[2][levels])):
            raise InputError("some pages lie outside their level")
        return grid[0][levels] + rows * grid[1][levels] + columns

    @overload
    def page_of(self, index: int) -> tuple[int, int, int]: ...
    @overload
    def page_of(self, index: Index) -> tuple[Index, Index, Index]: ...
    def page_of(self, index: Any) -> Any:
        """(level, column, row) of a linear page number; an array gives three int64 arrays of its shape.

        Raises InputError for a number outside 0 .. page_count - 1.
        """
        numbers = np.asarray(index, dtype=np.int64)
        if numbers.size and (numbers.min() < 0 or numbers.max() >= self.page_count):
            raise InputError(f"page numbers of this image run from 0 to {self.page_count - 1}")
        first, columns, _ = self._grid
        level = np.searchsorted(first, numbers, side="right") - 1
        row, column = np.divmod(numbers - first[level], columns[level])
        if isinstance(index, int | np.integer):
            return int(level), int(column), int(row)
        return level.astype(np.int64), column, row

    @cached_property
    def _grid(self) -> tuple[Index, Index, Index]:
        """First page, columns and rows of every level as arrays."""
        table = np.array([(level.first_page, level.columns, level.rows) for level in self.levels], dtype=np.int64)
        return table[:, 0], table[:, 1], table[:, 2]
