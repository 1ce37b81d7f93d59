"""Which parts of a growing array are free."""

from __future__ import annotations

from bisect import bisect_left

__all__ = ["FreeRanges"]


class FreeRanges:
    """Ranges of an array that grows at its end: handed out where the first that is long enough is free.

    >>> ranges = FreeRanges()
    >>> [ranges.take(length) for length in (10, 20, 5)], ranges.size
    ([0, 10, 30], 35)
    >>> ranges.give(0, 10)
    >>> ranges.give(10, 20)
    >>> ranges.take(25), ranges.take(8), ranges.size
    (0, 35, 43)
    """

    def __init__(self) -> None:
        self.size = 0
        """How long the array has to be for all that was handed out."""
        self._first: list[int] = []
        self._length: list[int] = []

    def take(self, length: int) -> int:
        """Where a range of this length begins; it is the caller's until given back."""
        for number, free in enumerate(self._length):
            if free >= length:
                first = self._first[number]
                if free == length:
                    del self._first[number], self._length[number]
                else:
                    self._first[number], self._length[number] = first + length, free - length
                return first
        first, self.size = self.size, self.size + length
        return first

    def give(self, first: int, length: int) -> None:
        """Give back a range; neighbours that are free become one, and one at the end shortens the array."""
        if length == 0:
            return
        number = bisect_left(self._first, first)
        if number < len(self._first) and first + length == self._first[number]:
            length += self._length[number]
            del self._first[number], self._length[number]
        if number and self._first[number - 1] + self._length[number - 1] == first:
            number -= 1
            first, length = self._first[number], self._length[number] + length
            del self._first[number], self._length[number]
        if first + length == self.size:
            self.size = first
        else:
            self._first.insert(number, first)
            self._length.insert(number, length)
