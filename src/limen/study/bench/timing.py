"""What calls take: by the clock and by the processor, in turns, as medians."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, TypeVar

from limen.study.bench.table import Row

__all__ = ["Spent", "T", "median_of", "medians", "steady_ms", "timed", "turns"]

T = TypeVar("T")


class Spent(NamedTuple):
    """What a call took, milliseconds."""

    clock_ms: float
    cpu_ms: float
    """Of the processor, all threads together: steadier than the clock where others compute, too."""

    def steady_ms(self, *, by_cpu: bool) -> float:
        """The steadier one: the processor's where that does all the work, as it does for a software adapter."""
        return self.cpu_ms if by_cpu else self.clock_ms


def timed(call: Callable[[], T]) -> tuple[T, Spent]:
    """What a call returned, and what it took."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    made = call()
    return made, Spent((time.perf_counter() - begin) * 1e3, (time.process_time() - begin_cpu) * 1e3)


def median_of(spent: Iterable[Spent]) -> Spent:
    """Of several calls."""
    return Spent(*map(statistics.median, zip(*spent, strict=True)))


def medians(name: str, spent: Iterable[Spent], *, by_cpu: bool) -> Row:
    """Columns ``name_ms`` and ``name_cpu_ms`` of several calls; the second is None where it tells nothing."""
    found = median_of(spent)
    return {f"{name}_ms": found.clock_ms, f"{name}_cpu_ms": found.cpu_ms if by_cpu else None}


def steady_ms(row: Row, name: str) -> float:
    """The steadier column of `medians`."""
    return float(row.get(f"{name}_cpu_ms") or row.get(f"{name}_ms") or 0.0)


def turns(ways: Sequence[T], rounds: int) -> Iterator[tuple[int, T]]:
    """Every way once a round, with the round's number.

    Another one is first each time: whoever goes first finds other things in the caches.

    >>> list(turns("ab", 2))
    [(0, 'a'), (0, 'b'), (1, 'b'), (1, 'a')]
    """
    for number in range(rounds):
        first = number % max(len(ways), 1)
        for way in (*ways[first:], *ways[:first]):
            yield number, way
