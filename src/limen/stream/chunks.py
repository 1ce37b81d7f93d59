"""From wanted to resident: numbered chunks are read in the background and placed, and no frame waits.

A chunk is a page of an image, a patch of a terrain, a group of points: whatever is read and kept as a whole. It is in
one of these states::

    absent ──wanted──> queued ──a worker takes it──> being read ──> read ──budget──> resident
       ^                 │ no longer wanted              │ PageError                     │ least
       └─────────────────┘                               v                               │ recently used
       ^                                               failed (logged once, not asked again)
       └─────────────────────────────────────────────────────────────────────────────────┘

`ChunkStream.update` takes a frame's wishes and returns, as a value, what has arrived, and where it lies. Pinned chunks
are never evicted, so that there is always something to draw.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from limen.stream.fetch import Fetcher

__all__ = [
    "Allocator",
    "Arrival",
    "ChunkSource",
    "ChunkStream",
    "Index",
    "Resident",
    "Statistics",
    "Streaming",
    "Update",
    "completed",
]

Index: TypeAlias = NDArray[np.int64]
Item = TypeVar("Item")
Item_co = TypeVar("Item_co", covariant=True)

_ALL = 1 << 62


class ChunkSource(Protocol[Item_co]):
    """Numbered chunks of one content, read from any thread."""

    @property
    def count(self) -> int: ...

    @property
    def pinned(self) -> Index:
        """Chunks that are always resident: what everything falls back on."""
        ...

    def read(self, chunk: int) -> Item_co:
        """A chunk; `PageError` if it cannot be read."""
        ...

    def parents(self, chunks: Index) -> Index:
        """What stands in for each of these chunks where it cannot be read; -1 for nothing."""
        ...


class Allocator(Protocol):
    """Where chunks lie in memory: see `limen.stream.allocators`."""

    @property
    def capacity(self) -> int:
        """How many chunks there is room for; 0 where that depends on which."""
        ...

    def fitting(self, chunks: Index) -> int:
        """How many of these fit together, the first ones first."""
        ...

    def place(self, chunk: int, item: Any) -> tuple[int, ...] | None:
        """Where a chunk goes; None where there is no room."""
        ...

    def free(self, place: tuple[int, ...]) -> None: ...


@dataclass(frozen=True, slots=True)
class Streaming:
    """A source, and how its chunks are to be streamed; see `ChunkStream`.

    Parameters
    ----------
    keeps_drawn
        Whether what a frame drew in place of missing chunks stays until these have come.
    required
        Whether nothing can be drawn without the pinned chunks.
    """

    source: ChunkSource[Any]
    name: str = "chunk"
    width: int = 1
    per_frame: int = 64
    cost: Callable[[Any], int] = lambda _: 1
    kept: int = 512
    keeps_drawn: bool = False
    required: bool = False

    def stream(self, allocator: Allocator, threads: int) -> ChunkStream[Any]:
        """A stream of it into memory that an allocator divides."""
        return ChunkStream(
            self.source, allocator, width=self.width, name=self.name, per_frame=self.per_frame, cost=self.cost,
            kept=self.kept, threads=threads,
        )  # fmt: skip


class Arrival(NamedTuple, Generic[Item]):
    """A chunk that has come, and where it lies from now on."""

    chunk: int
    place: tuple[int, ...]
    item: Item


class Resident(NamedTuple):
    """Which chunks are there; valid until the next update."""

    place: Index
    """Shape (count, k): what the allocator said of each; -1 where a chunk is not there."""
    since_s: NDArray[np.float64]
    """Shape (count,): when each came, by the clock of ``now_s``; -inf where it has always been there."""
    now_s: float
    """The last update's time, that chunks fade in by; inf where they do not."""
    generation: int
    """Grows whenever a chunk comes or goes."""
    capacity: int
    """How many chunks there is room for; 0 where that depends on which."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Shape (count,): which chunks are there."""
        return np.asarray(self.place[:, 0] >= 0)


@dataclass(frozen=True, slots=True)
class Statistics:
    """One frame of a stream."""

    wanted: int
    needed: int  # wanted, and not resident when the frame began
    missing: int  # wanted, and not resident after it either: something coarser is drawn instead
    denied: int  # wanted, and there is no room for them
    arrived: int
    waiting: int  # have been read, and wait for their turn
    queued: int
    failed: int
    resident: int
    update_ms: float


class Update(NamedTuple, Generic[Item]):
    """What one frame may draw with beside what was there before."""

    arrived: list[Arrival[Item]]
    evicted: list[int]
    statistics: Statistics


class ChunkStream(Generic[Item]):
    """Chunks of one content on their way to where they are drawn from.

    Parameters
    ----------
    source
        Where chunks are read, from several threads at once.
    allocator
        Where they lie.
    width
        How many numbers the allocator says of each.
    name
        What a chunk is called in the log.
    per_frame
        Most that one `update` hands over: it stops after the chunk that reaches it.
    cost
        What a chunk counts of that; 1 without it.
    kept
        How many chunks may wait in memory after they have been read.
    threads
        Reading threads.
    """

    def __init__(
        self,
        source: ChunkSource[Item],
        allocator: Allocator,
        *,
        width: int = 1,
        name: str = "chunk",
        per_frame: int = 64,
        cost: Callable[[Item], int] = lambda _: 1,
        kept: int = 512,
        threads: int = 2,
    ) -> None:
        self._source, self._allocator, self._per_frame = source, allocator, per_frame
        self._places = np.full((width, source.count), -1, np.int64)
        self._since_s = np.full(source.count, -np.inf)
        self._last_used = np.full(source.count, -1, np.int64)
        self._pinned = np.asarray(source.pinned, np.int64)
        self._stays = np.zeros(source.count, np.bool_)
        self._stays[self._pinned] = True
        self._members = np.zeros(0, np.int64)  # resident chunks
        self._frame, self._generation, self._now_s = 0, 0, math.inf
        self._denied: set[int] = set()
        self._denied_while = np.zeros(0, np.int64)
        self._known_failed = 0
        self._fetcher = Fetcher(source.read, kept=kept, threads=threads, name=name, cost=cost)

    # ------------------------------------------------------------------ what a frame does

    def update(
        self,
        wanted: Index,
        *,
        soon: Index | None = None,
        in_use: Index | None = None,
        budget: int | None = None,
        now_s: float = math.inf,
    ) -> Update[Item]:
        """One frame: queue what is missing, hand over what has been read. Never waits.

        Parameters
        ----------
        wanted
            Distinct chunks, the most important first. Where they do not all fit, the last are denied.
        soon
            Chunks that will be wanted shortly: they come after all others, in whatever room is left.
        in_use
            Chunks that are drawn in the place of missing ones: they stay, but are not asked for.
        budget
            Another one for this frame than ``per_frame``.
        now_s
            The time that chunks fade in by; without it they are there at once.
        """
        begin = time.perf_counter()
        self._now_s, self._frame = now_s, self._frame + 1
        wanted = np.asarray(wanted, np.int64)
        readable = self._readable(wanted)
        ordered = np.concatenate([self._pinned, readable[~self._stays[readable]]])
        served = ordered[: self._allocator.fitting(ordered)]
        if in_use is not None:
            self._last_used[in_use] = self._frame
        uses = served if in_use is None else np.concatenate([served, np.array([-1]), in_use])
        if not np.array_equal(uses, self._denied_while):
            self._denied.clear()  # other chunks may be evicted
            self._denied_while = uses
        missing = self._missing(served)
        needed = int((self._places[0, served] < 0).sum())
        if soon is not None and len(served) == len(ordered):
            missing += self._missing_soon(served, soon[self._last_used[soon] < self._frame])
        ready, pending = self._fetcher.exchange(missing, self._per_frame if budget is None else budget)
        arrived, evicted = self._place(ready)
        denied = len(self._denied.intersection(served.tolist())) if self._denied else 0
        statistics = Statistics(
            wanted=len(wanted), needed=needed, missing=int((self._places[0, wanted] < 0).sum()),
            denied=len(ordered) - len(served) + denied, arrived=len(arrived), waiting=pending.decoded,
            queued=pending.queued, failed=pending.failed, resident=len(self._members),
            update_ms=(time.perf_counter() - begin) * 1e3,
        )  # fmt: skip
        return Update(arrived, evicted, statistics)

    @property
    def resident(self) -> Resident:
        """What is there now."""
        return Resident(self._places.T, self._since_s, self._now_s, self._generation, self._allocator.capacity)

    def touch(self, chunks: Index) -> None:
        """Chunks that the last frame drew in the place of missing ones: others are evicted before them."""
        self._last_used[chunks] = self._frame

    @property
    def idle(self) -> bool:
        """Nothing is queued or being read."""
        return self._fetcher.idle

    @property
    def settled(self) -> bool:
        """Nothing that the last frame asked for is queued, being read, or waiting, or has failed since it asked."""
        return self._fetcher.settled and len(self._fetcher.failed) == self._known_failed

    def wait(self, timeout_s: float = 1.0) -> None:
        """Sleep until a chunk has been read (for pictures in files; a live frame never calls this)."""
        self._fetcher.wait(timeout_s)

    def close(self) -> None:
        """Stop the workers; chunks being read are finished first."""
        self._fetcher.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of an update

    def _readable(self, wanted: Index) -> Index:
        """The wanted chunks, those that cannot be read replaced by what stands in for them, each once."""
        failed = np.array(sorted(self._fetcher.failed.copy()), np.int64)
        self._known_failed = len(failed)
        if not len(failed):
            return wanted
        while (bad := np.isin(wanted, failed)).any():
            wanted = wanted.copy()
            wanted[bad] = self._source.parents(wanted[bad])
            wanted = wanted[wanted >= 0]
        return wanted[np.sort(np.unique(wanted, return_index=True)[1])]

    def _missing(self, served: Index) -> list[int]:
        """Of these chunks, which this frame uses, those to be read, in their order."""
        self._last_used[served] = self._frame
        return self._absent(served)

    def _missing_soon(self, served: Index, soon: Index) -> list[int]:
        together = np.concatenate([served, soon])
        soon = together[len(served) : self._allocator.fitting(together)]
        self._last_used[soon] = self._frame
        return self._absent(soon)

    def _absent(self, chunks: Index) -> list[int]:
        """Of these those that are not there, and that there may be room for."""
        absent: list[int] = chunks[self._places[0, chunks] < 0].tolist()
        return [chunk for chunk in absent if chunk not in self._denied] if self._denied else absent

    def _place(self, ready: list[tuple[int, Item]]) -> tuple[list[Arrival[Item]], list[int]]:
        """Give each chunk its place; where there is none, the least recently used go, never what this frame uses."""
        if not ready:
            return [], []
        evictable = self._oldest(len(ready))
        arrived: list[Arrival[Item]] = []
        evicted: list[int] = []
        for chunk, item in ready:
            place = self._allocator.place(chunk, item)
            while place is None and (gone := next(evictable, None)) is not None:
                evicted.append(gone)
                self._allocator.free(tuple(self._places[:, gone].tolist()))
                self._places[:, gone] = -1
                place = self._allocator.place(chunk, item)
            if place is None:
                self._denied.add(chunk)
                continue
            self._places[:, chunk] = place
            self._last_used[chunk] = self._frame
            self._since_s[chunk] = self._now_s if self._now_s < math.inf else -math.inf
            arrived.append(Arrival(chunk, place, item))
        stay = self._members[self._places[0, self._members] >= 0] if evicted else self._members
        self._members = np.concatenate([stay, np.array([each.chunk for each in arrived], np.int64)])
        self._generation += bool(arrived or evicted)
        return arrived, evicted

    def _oldest(self, about: int) -> Iterator[int]:
        """What may be evicted, the least recently used first; found when it is asked for, about so many at once."""
        old = self._members[self._last_used[self._members] < self._frame]
        old = old[~self._stays[old]]
        while len(old):
            first = np.arange(len(old))
            if about < len(old):
                first = np.argpartition(self._last_used[old], about)[:about]
            yield from old[first[np.argsort(self._last_used[old[first]], kind="stable")]].tolist()
            old = np.delete(old, first)


def completed(asked: Sequence[tuple[ChunkStream[Any], Index]]) -> Iterator[tuple[int, Update[Any]]]:
    """Updates of several streams at once, with their numbers, until all that is wanted is there or has failed.

    Waits for chunks: for pictures in files, never for a live frame.
    """
    while True:
        for number, (stream, wanted) in enumerate(asked):
            yield number, stream.update(wanted, budget=_ALL)
        waiting = [stream for stream, _ in asked if not stream.settled]
        if not waiting:
            return
        waiting[0].wait()
