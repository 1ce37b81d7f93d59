"""Where chunks lie in memory of a fixed size: in slots of one size, or in ranges of big buffers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from limen.stream.chunks import Index
from limen.stream.ranges import RangeAllocator

__all__ = ["Ranges", "Slots"]


class Slots:
    """So many places of one size, which hold one chunk each; a place is its number.

    >>> slots = Slots(2)
    >>> slots.place(7, None), slots.place(8, None), slots.place(9, None)
    ((0,), (1,), None)
    >>> slots.free((0,))
    >>> slots.place(9, None)
    (0,)
    """

    def __init__(self, count: int) -> None:
        self.capacity = count
        self._free = list(range(count - 1, -1, -1))

    def fitting(self, chunks: Index) -> int:
        return min(len(chunks), self.capacity)

    def place(self, chunk: int, item: Any) -> tuple[int, ...] | None:
        return (self._free.pop(),) if self._free else None

    def free(self, place: tuple[int, ...]) -> None:
        self._free.append(place[0])


class Ranges:
    """Ranges of several big buffers, one of each for a chunk; a place is where they begin.

    Parameters
    ----------
    capacities
        How many elements each buffer holds.
    most
        For each buffer, how many elements every chunk takes at most: shape (chunks,).
    sizes_of
        How many elements of each buffer an item takes; it may have learned of fewer by being read.
    """

    capacity = 0

    def __init__(
        self, capacities: Sequence[int], most: Sequence[Index], sizes_of: Callable[[Any], tuple[int, ...]]
    ) -> None:
        self._buffers = [RangeAllocator(capacity) for capacity in capacities]
        self._most, self._sizes_of = most, sizes_of

    def fitting(self, chunks: Index) -> int:
        ends = zip(self._buffers, (np.cumsum(most[chunks]) for most in self._most), strict=True)
        return min(int(np.searchsorted(end, buffer.capacity, "right")) for buffer, end in ends)

    def place(self, chunk: int, item: Any) -> tuple[int, ...] | None:
        begins: list[int] = []
        for buffer, size in zip(self._buffers, self._sizes_of(item), strict=True):
            begin = buffer.take(size)
            if begin is None:
                self.free(tuple(begins))
                return None
            begins.append(begin)
        return tuple(begins)

    def free(self, place: tuple[int, ...]) -> None:
        for buffer, begin in zip(self._buffers, place, strict=False):
            buffer.give_back(begin)
