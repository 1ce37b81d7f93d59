"""The allocator against a plain list of who owns which element."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.stream.ranges import RangeAllocator


class Owners:
    """The plain way: an owner for every element, searched from the left for the first gap."""

    def __init__(self, capacity):
        self.owner = [None] * capacity

    def take(self, size, name):
        for begin in range(len(self.owner) - size + 1):
            if all(owner is None for owner in self.owner[begin : begin + size]):
                self.owner[begin : begin + size] = [name] * size
                return begin
        return None

    def give_back(self, name):
        self.owner = [None if owner == name else owner for owner in self.owner]


@given(st.integers(1, 60), st.lists(st.tuples(st.booleans(), st.integers(1, 25), st.integers(0, 100)), max_size=60))
def test_ranges_are_those_of_the_plain_search(capacity, steps):
    arena, owners = RangeAllocator(capacity), Owners(capacity)
    held = []
    for number, (takes, size, which) in enumerate(steps):
        if takes or not held:
            begin = arena.take(size)
            assert begin == owners.take(size, number), "first fit, with all free neighbours grown together"
            if begin is None and which % 2:
                capacity += size
                arena.grow(capacity)
                owners.owner += [None] * size
                begin = arena.take(size)
                assert begin == owners.take(size, number) is not None, "there is room at the end"
            if begin is not None:
                held.append((number, begin))
        else:
            name, begin = held.pop(which % len(held))
            arena.give_back(begin)
            owners.give_back(name)
        assert arena.free == sum(owner is None for owner in owners.owner)
    for _, begin in held:
        arena.give_back(begin)
    assert arena.take(capacity) == 0, "all that is given back is one range again"


def test_what_was_not_taken_cannot_be_given_back():
    arena = RangeAllocator(8)
    arena.take(4)
    with pytest.raises(KeyError):
        arena.give_back(2)
    with pytest.raises(ValueError, match="at least one element"):
        arena.take(0)
    with pytest.raises(ValueError, match="at least one element"):
        RangeAllocator(0)
    with pytest.raises(ValueError, match="cannot shrink to 7"):
        arena.grow(7)
