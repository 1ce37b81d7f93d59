"""Pages: the 256 x 256 texel squares that a pyramid's levels are cut into."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["GUTTER", "PAGE", "Level", "Pyramid"]

PAGE = 256
GUTTER = 4


@dataclass(frozen=True, slots=True)
class Level:
    size_px: tuple[int, int]
    columns: int
    rows: int
    first_page: int


@dataclass(frozen=True)
class Pyramid:
    size_px: tuple[int, int]
    levels: tuple[Level, ...]

    @classmethod
    def of(cls, size_px: tuple[int, int]) -> Pyramid:
        levels: list[Level] = []
        number, first = 0, 0
        while True:
            width, height = (max(1, -(-side // 2**number)) for side in size_px)
            columns, rows = -(-width // PAGE), -(-height // PAGE)
            levels.append(Level((width, height), columns, rows, first))
            first += columns * rows
            if columns == rows == 1:
                return cls(size_px, tuple(levels))
            number += 1

    @property
    def page_count(self) -> int:
        last = self.levels[-1]
        return last.first_page + last.columns * last.rows

    @cached_property
    def _columns(self) -> NDArray[np.int64]:
        return np.array([level.columns for level in self.levels])

    @cached_property
    def _first(self) -> NDArray[np.int64]:
        return np.array([level.first_page for level in self.levels])

    def page_index(
        self, level: NDArray[np.int64], column: NDArray[np.int64], row: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        return self._first[level] + row * self._columns[level] + column

    def page_of(self, page: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        level = np.searchsorted(self._first, page, side="right") - 1
        inside = page - self._first[level]
        return level, inside % self._columns[level], inside // self._columns[level]
