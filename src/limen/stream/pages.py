"""From wanted to resident: pages are decoded in the background and placed in slots, and no frame waits.

A page is in one of these states::

    absent ──wanted──> queued ──a worker takes it──> decoding ──> decoded ──upload budget──> resident
       ^                 │ no longer wanted              │ PageError                            │ least
       └─────────────────┘                               v                                      │ recently used
       ^                                               failed (logged once, never asked again)  │
       └────────────────────────────────────────────────────────────────────────────────────────┘

`Stream.update` takes a frame's wishes and returns, as a value, what the frame may draw with: pages to upload
into slots, and for every wanted page the nearest resident ancestor. The coarsest level is pinned, so an
ancestor is always there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.errors import InputError
from limen.stream.fetch import Fetcher

__all__ = ["FADE_S", "Drawable", "PageSource", "PageTable", "Statistics", "Stream", "Update", "Upload", "page_table"]

FADE_S = 0.2
_NO_PAGE = 0xFFFF_FFFF
"""How long a page that came late takes to replace the coarser one shown in its place: a change of 2.5 Hz, at which the
eye is no more sensitive to fine detail than if it stood still (castleCSF, Ashraf et al. 2024)."""


class PageSource(Protocol):
    """What a stream reads from; `limen.Image` is one."""

    @property
    def pyramid(self) -> Pyramid: ...

    def read_page(self, page: int) -> NDArray[np.uint8]: ...


class Upload(NamedTuple):
    slot: int
    texels: NDArray[np.uint8]  # (PAGE + 2 GUTTER, PAGE + 2 GUTTER, 4)


class Drawable(NamedTuple):
    """What to draw in the place of each page asked about: one entry a page, and more where pages fade into each other.

    Parameters
    ----------
    asked
        Which of the pages asked about, in their order: shape (N,).
    slot
        Where to draw from; -1 before the coarsest page has come.
    coarser
        How many levels coarser that slot's page is.
    share
        0 ... 1; the shares of all entries of a page add up to 1.
    over
        The shares of the page's finer entries together, painted over this one.
    """

    asked: NDArray[np.int64]
    slot: NDArray[np.int32]
    coarser: NDArray[np.int32]
    share: NDArray[np.float32]
    over: NDArray[np.float32]


class PageTable(NamedTuple):
    """For every page of a pyramid: the slot of the nearest resident page, and how many levels coarser that is.

    ``fade`` is how much of it has faded in; the rest belongs to the entry of the next coarser page.
    """

    slot: NDArray[np.int32]
    coarser: NDArray[np.int32]
    fade: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Statistics:
    """One frame of a stream."""

    wanted: int
    needed: int  # wanted, and not resident when the frame began
    missing: int  # wanted, and not resident after its uploads either: drawn from an ancestor
    uploads: int
    decoded_waiting: int
    queued: int
    failed: int
    resident: int
    update_ms: float


@dataclass(frozen=True, slots=True)
class Update:
    uploads: list[Upload]
    statistics: Statistics
    version: int
    """Grows whenever a page became resident or was evicted."""


class Stream:
    """Pages of one image on their way to the slots of a pool.

    Parameters
    ----------
    source
        Where pages are read, from several threads at once.
    slots
        How many pages the pool holds.
    cpu_pages
        How many decoded pages may wait in memory for their upload.
    uploads_per_frame
        Most pages handed over by one `update`.
    threads
        Decoding threads.

    Raises
    ------
    InputError
        If there is not room for the pinned level and one page more.
    """

    def __init__(
        self, source: PageSource, slots: int, *, cpu_pages: int = 512, uploads_per_frame: int = 64, threads: int = 2
    ) -> None:
        pyramid = source.pyramid
        if slots < 2:
            raise InputError(f"a pool of {slots} pages is too small: at least 2 are needed")
        self._pyramid = pyramid
        self._uploads_per_frame = uploads_per_frame
        self._slot_of = np.full(pyramid.page_count, -1, dtype=np.int32)
        self._page_in = np.full(slots, -1, dtype=np.int64)
        self._last_used = np.full(slots, -1, dtype=np.int64)
        self._placed_s = np.full(slots, -np.inf)
        self._now_s = np.inf
        self._frame = 0
        self._version = 0
        self._pinned = pyramid.page_count - 1  # the one page of the coarsest level
        self._fetcher = Fetcher(source.read_page, kept=cpu_pages, threads=threads, name="page", cost=lambda _: 1)

    # ------------------------------------------------------------------ what a frame does

    def update(
        self,
        wanted: NDArray[np.int64],
        *,
        soon: NDArray[np.int64] | None = None,
        uploads: int | None = None,
        now_s: float = np.inf,
    ) -> Update:
        """One frame: queue what is missing, hand over what is decoded. Never waits for a page.

        Parameters
        ----------
        wanted
            Distinct page numbers, the most important first.
        soon
            Pages that will be wanted shortly: they come after all others, in whatever room is left.
        uploads
            Another upload budget for this frame.
        now_s
            The time that pages fade in by; without it they are there at once.
        """
        begin = time.perf_counter()
        self._now_s = now_s
        self._frame += 1
        room = len(self._page_in) - 1  # what the pool can hold beside the pinned page
        missing = self._touch(self._without_failed(wanted)[:room])
        if self._slot_of[self._pinned] < 0:
            missing = np.concatenate([np.array([self._pinned]), missing[missing != self._pinned]])
        needed = len(missing)
        if soon is not None:
            later = np.setdiff1d(soon, wanted, assume_unique=True)[: max(0, room - len(wanted))]
            missing = np.concatenate([missing, self._touch(later)])
        budget = self._uploads_per_frame if uploads is None else uploads
        ready, pending = self._fetcher.exchange(missing.tolist(), budget)
        placed = self._place(ready)
        statistics = Statistics(
            wanted=len(wanted),
            needed=needed,
            missing=int((self._slot_of[wanted] < 0).sum()),
            uploads=len(placed),
            decoded_waiting=pending.decoded,
            queued=pending.queued,
            failed=pending.failed,
            resident=int((self._page_in >= 0).sum()),
            update_ms=(time.perf_counter() - begin) * 1e3,
        )
        return Update(placed, statistics, self._version)

    def drawable(self, pages: NDArray[np.int64]) -> Drawable:
        """The nearest resident page of each (itself, or an ancestor), with its own ancestors while it fades in."""
        level, column, row = self._pyramid.page_of(pages)
        found: list[tuple[NDArray[np.int64], NDArray[np.int32], int, NDArray[np.float32], NDArray[np.float32]]] = []
        pending = np.arange(len(pages))
        left = np.ones(len(pages), dtype=np.float32)
        top = len(self._pyramid.levels) - 1
        for step in range(top + 1):
            page = self._pyramid.page_index(level[pending] + step, column[pending] >> step, row[pending] >> step)
            slot = self._slot_of[page]
            fade = np.where(level[pending] + step < top, self._fade(slot), 1.0).astype(np.float32)
            here = slot >= 0
            found.append((pending[here], slot[here], step, (left[pending] * fade)[here], 1 - left[pending[here]]))
            left[pending[here]] *= 1 - fade[here]
            # A page without anything is asked about up to the top; what is left of the others, while they fade.
            pending = pending[(left[pending] > 0) & (level[pending] + step < top)]
            if not len(pending):
                break
        nothing = np.setdiff1d(np.arange(len(pages)), np.concatenate([asked for asked, *_ in found]))
        whole, none = (np.full(len(nothing), share, np.float32) for share in (1, 0))
        found.append((nothing, np.full(len(nothing), -1, np.int32), 0, whole, none))
        asked = np.concatenate([each[0] for each in found])
        order = np.argsort(asked, kind="stable")
        coarser = np.concatenate([np.full(len(each[0]), each[2], np.int32) for each in found])[order]
        slots, shares, over = (np.concatenate([each[part] for each in found])[order] for part in (1, 3, 4))
        used = slots[slots >= 0]
        self._last_used[used] = np.maximum(self._last_used[used], self._frame)
        return Drawable(asked[order], slots, coarser, shares, over)

    def table(self) -> PageTable:
        """`drawable` for every page of the pyramid, for shaders that look pages up for themselves."""
        slot = self._slot_of.copy()
        coarser = np.zeros(len(slot), dtype=np.int32)
        levels = self._pyramid.levels
        for number in range(len(levels) - 2, -1, -1):
            level, parent = levels[number], levels[number + 1]
            own = slice(level.first_page, level.first_page + level.columns * level.rows)
            above = slice(parent.first_page, parent.first_page + parent.columns * parent.rows)
            rows, columns = np.arange(level.rows) >> 1, np.arange(level.columns) >> 1
            inherited = slot[above].reshape(parent.rows, parent.columns)[rows][:, columns].ravel()
            distance = coarser[above].reshape(parent.rows, parent.columns)[rows][:, columns].ravel() + 1
            absent = slot[own] < 0
            slot[own] = np.where(absent, inherited, slot[own])
            coarser[own] = np.where(absent, distance, 0)
        fade = self._fade(slot)
        fade[slot == self._slot_of[self._pinned]] = 1.0  # nothing coarser is there to fade from
        return PageTable(slot, coarser, fade)

    def _fade(self, slots: NDArray[np.int32]) -> NDArray[np.float32]:
        """How much of the pages in these slots has faded in."""
        if self._now_s == np.inf:
            return np.ones(len(slots), dtype=np.float32)
        return np.clip((self._now_s - self._placed_s[slots]) / FADE_S, 0.0, 1.0).astype(np.float32)

    @property
    def idle(self) -> bool:
        """Nothing is queued or being decoded."""
        return self._fetcher.idle

    @property
    def settled(self) -> bool:
        """Nothing is queued, being decoded, or waiting for its upload."""
        return self._fetcher.settled

    def wait(self, timeout_s: float = 1.0) -> None:
        """Sleep until a page has been decoded (for offscreen pictures; a live frame never calls this)."""
        self._fetcher.wait(timeout_s)

    def close(self) -> None:
        """Stop the workers; pages being decoded are finished first."""
        self._fetcher.close()

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of an update

    def _without_failed(self, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
        """The wanted pages, those that cannot be read replaced by their nearest coarser page that can."""
        failed = self._fetcher.failed
        if not failed:
            return wanted
        pages: dict[int, None] = {}  # keeps the order, most important first
        for page in wanted.tolist():
            level, column, row = self._pyramid.page_of(page)
            while page in failed and level + 1 < len(self._pyramid.levels):
                level, column, row = level + 1, column >> 1, row >> 1
                page = self._pyramid.page_index(level, column, row)
            pages[page] = None
        return np.fromiter(pages, dtype=np.int64, count=len(pages))

    def _touch(self, pages: NDArray[np.int64]) -> NDArray[np.int64]:
        """Mark pages as used by this frame; returns those that are not resident, in their order."""
        slots = self._slot_of[pages]
        self._last_used[slots[slots >= 0]] = self._frame
        return pages[slots < 0]

    def _place(self, ready: list[tuple[int, NDArray[np.uint8]]]) -> list[Upload]:
        """Give each page a slot: a free one, else the least recently used (never one that this frame wants)."""
        if not ready:
            return []
        pinned_slot = self._slot_of[self._pinned]
        age = self._last_used.copy()
        if pinned_slot >= 0:
            age[pinned_slot] = np.iinfo(np.int64).max
        oldest = np.argpartition(age, len(ready) - 1)[: len(ready)]
        placed = []
        for (page, texels), slot in zip(ready, oldest.tolist(), strict=True):
            evicted = self._page_in[slot]
            if evicted >= 0:
                self._slot_of[evicted] = -1
            self._page_in[slot], self._slot_of[page] = page, slot
            self._last_used[slot] = self._frame
            self._placed_s[slot] = self._now_s if self._now_s < np.inf else -np.inf
            placed.append(Upload(slot, texels))
        self._version += bool(placed)
        return placed


def page_table(table: PageTable) -> NDArray[np.uint32]:
    """One number a page: slot (20 bits), how much has faded in (7 bits), how many levels coarser (5 bits)."""
    fade = np.rint(table.fade * 127).astype(np.int64)
    packed = (table.slot.astype(np.int64) << 12) | (fade << 5) | table.coarser
    return np.where(table.slot < 0, _NO_PAGE, packed).astype(np.uint32)
