"""Pages of images on their way to the slots of a pool, and which of them are drawn while others are on theirs."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.stream.chunks import Index, Resident, Streaming

__all__ = [
    "FADE_S",
    "Drawable",
    "KeptTable",
    "PageSource",
    "PageTable",
    "drawable_pages",
    "page_streaming",
    "page_table",
    "resident_table",
]

FADE_S = 0.2
"""How long a page that came late takes to replace the coarser one shown in its place: a change of 2.5 Hz, at which the
eye is no more sensitive to fine detail than if it stood still (castleCSF, Ashraf et al. 2024)."""

_NO_PAGE = 0xFFFF_FFFF


class PageSource(Protocol):
    """What pages are read from; `limen.Image` is one."""

    @property
    def pyramid(self) -> Pyramid: ...

    def read_page(self, page: int) -> NDArray[np.uint8]: ...


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


def page_streaming(source: PageSource) -> Streaming:
    """Pages of one image, on their way to the slots of a pool; the one page of the coarsest level is pinned."""
    return Streaming(_Pages(source), "page")


def drawable_pages(pyramid: Pyramid, resident: Resident, pages: Index) -> tuple[Drawable, Index]:
    """The nearest resident page of each (itself, or an ancestor), with its own ancestors while it fades in.

    Also all the pages that these are.
    """
    level, column, row = pyramid.page_of(pages)
    places = resident.place[:, 0]
    found: list[tuple[Index, NDArray[np.int32], int, NDArray[np.float32], NDArray[np.float32]]] = []
    used: list[Index] = []
    pending = np.arange(len(pages))
    left = np.ones(len(pages), dtype=np.float32)
    top = len(pyramid.levels) - 1
    for step in range(top + 1):
        page = pyramid.page_index(level[pending] + step, column[pending] >> step, row[pending] >> step)
        slot = places[page].astype(np.int32)
        fade = np.where(level[pending] + step < top, _fade(resident, page), 1.0).astype(np.float32)
        here = slot >= 0
        used.append(page[here])
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
    return Drawable(asked[order], slots, coarser, shares, over), np.concatenate(used)


def resident_table(pyramid: Pyramid, resident: Resident) -> PageTable:
    """`drawable_pages` for every page of the pyramid, for shaders that look pages up for themselves."""
    places, levels = resident.place[:, 0], pyramid.levels
    shown = np.where(places >= 0, np.arange(len(places)), -1)
    coarser = np.zeros(len(shown), dtype=np.int32)
    for number in range(len(levels) - 2, -1, -1):
        level, parent = levels[number], levels[number + 1]
        own = slice(level.first_page, level.first_page + level.columns * level.rows)
        above = slice(parent.first_page, parent.first_page + parent.columns * parent.rows)
        rows, columns = np.arange(level.rows) >> 1, np.arange(level.columns) >> 1
        inherited = shown[above].reshape(parent.rows, parent.columns)[rows][:, columns].ravel()
        distance = coarser[above].reshape(parent.rows, parent.columns)[rows][:, columns].ravel() + 1
        absent = shown[own] < 0
        shown[own] = np.where(absent, inherited, shown[own])
        coarser[own] = np.where(absent, distance, 0)
    slot = np.where(shown < 0, -1, places[shown]).astype(np.int32)
    # Of the coarsest page all is there: nothing coarser could be shown meanwhile.
    fade = np.where(shown == pyramid.page_count - 1, 1.0, _fade(resident, shown)).astype(np.float32)
    return PageTable(slot, coarser, fade)


class KeptTable:
    """A `resident_table` that is the same object while nothing comes or fades in: it is copied to the GPU when it is
    another."""

    def __init__(self, pyramid: Pyramid) -> None:
        self._pyramid = pyramid
        self._generation = -1
        self._changed_s = self._made_s = -math.inf
        self._table: PageTable | None = None

    def of(self, resident: Resident) -> PageTable:
        """The table now."""
        if resident.generation != self._generation:
            self._generation, self._changed_s = resident.generation, resident.now_s
        elif self._table is not None and not self._made_s - self._changed_s < FADE_S:
            return self._table  # not by the time that has passed: the next frame may come when all would have faded in
        self._made_s = resident.now_s
        self._table = resident_table(self._pyramid, resident)
        return self._table


def _fade(resident: Resident, pages: Index) -> NDArray[np.float32]:
    """How much of these pages has faded in."""
    if resident.now_s == math.inf:
        return np.ones(len(pages), dtype=np.float32)
    return np.clip((resident.now_s - resident.since_s[pages]) / FADE_S, 0.0, 1.0).astype(np.float32)


class _Pages:
    """Pages as chunks; where one cannot be read, the coarser page that holds it stands in for it."""

    def __init__(self, source: PageSource) -> None:
        self._pyramid = source.pyramid
        self.count, self.read = source.pyramid.page_count, source.read_page
        self.pinned = np.array([self.count - 1])

    def parents(self, chunks: Index) -> Index:
        level, column, row = self._pyramid.page_of(chunks)
        top = level + 1 >= len(self._pyramid.levels)
        up = (~top).astype(np.int64)
        above = self._pyramid.page_index(level + up, column >> up, row >> up)
        return np.where(top, -1, above)


def page_table(table: PageTable) -> NDArray[np.uint32]:
    """One number a page: slot (20 bits), how much has faded in (7 bits), how many levels coarser (5 bits)."""
    fade = np.rint(table.fade * 127).astype(np.int64)
    packed = (table.slot.astype(np.int64) << 12) | (fade << 5) | table.coarser
    return np.where(table.slot < 0, _NO_PAGE, packed).astype(np.uint32)
