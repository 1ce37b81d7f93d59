"""Ranges of one big buffer, handed out and taken back."""

from __future__ import annotations

from bisect import bisect_left

__all__ = ["RangeAllocator"]


class RangeAllocator:
    """Room for ``capacity`` elements; every request gets the first free range that is long enough.

    Ranges that are given back grow together with free neighbours, so that no two free ranges ever touch.

    >>> ranges = RangeAllocator(10)
    >>> ranges.take(4), ranges.take(4), ranges.take(4)
    (0, 4, None)
    >>> ranges.give_back(0)
    >>> ranges.take(3), ranges.free
    (0, 3)

    References
    ----------
    Knuth 1997, *The Art of Computer Programming*, vol. 1, section 2.5 (first fit, and boundary coalescing).
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"an allocator needs room for at least one element, got {capacity}")
        self.capacity = capacity
        self.free = capacity
        """Elements that belong to nobody, in however many pieces."""
        self._begins = [0]  # of free ranges, ascending
        self._ends = [capacity]
        self._taken: dict[int, int] = {}  # begin -> end

    def take(self, size: int) -> int | None:
        """Where a range of ``size`` elements (at least one) begins; ``None`` where no free range is long enough."""
        if size < 1:
            raise ValueError(f"a range has at least one element, got {size}")
        for place, (begin, end) in enumerate(zip(self._begins, self._ends, strict=True)):
            if end - begin >= size:
                if end - begin == size:
                    del self._begins[place], self._ends[place]
                else:
                    self._begins[place] = begin + size
                self._taken[begin] = begin + size
                self.free -= size
                return begin
        return None

    def grow(self, capacity: int) -> None:
        """More room at the end; what was handed out stays where it is. ValueError if it is less."""
        if capacity < self.capacity:
            raise ValueError(f"an allocator of {self.capacity} elements cannot shrink to {capacity}")
        if capacity == self.capacity:
            return
        if self._ends and self._ends[-1] == self.capacity:
            self._ends[-1] = capacity
        else:
            self._begins.append(self.capacity)
            self._ends.append(capacity)
        self.free += capacity - self.capacity
        self.capacity = capacity

    def give_back(self, begin: int) -> None:
        """The range that begins there is free again; KeyError if none does."""
        end = self._taken.pop(begin)
        self.free += end - begin
        place = bisect_left(self._begins, begin)
        if place < len(self._begins) and self._begins[place] == end:
            end = self._ends[place]
            del self._begins[place], self._ends[place]
        if place and self._ends[place - 1] == begin:
            self._ends[place - 1] = end
        else:
            self._begins.insert(place, begin)
            self._ends.insert(place, end)
