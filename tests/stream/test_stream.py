"""Streaming: a frame never waits, the pool never overflows, and a broken page never stops anything."""

from __future__ import annotations

import itertools
import logging
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.errors import PageError
from limen.stream.allocators import Slots
from limen.stream.chunks import completed
from limen.stream.pages import FADE_S, KeptTable, page_streaming
from support.page_streams import PageStream
from support.processes import PYTHON, finished

SIDE = PAGE + 2 * GUTTER


class Source:
    """Pages that know their own number; some broken, some slow."""

    def __init__(self, size_px=(4096, 2048), broken=(), gate=None):
        self.pyramid = Pyramid.of(size_px)
        self.broken, self.gate, self.reads = set(broken), gate, []

    def read_page(self, page):
        if self.gate is not None:
            self.gate.wait(10)
        self.reads.append(page)
        if page in self.broken:
            raise PageError(f"page {page}: damaged")
        return np.full((SIDE, SIDE, 4), page % 251, dtype=np.uint8)


class Pool:
    """What a GPU pool holds after the uploads: which page's texels are in which slot."""

    def __init__(self):
        self.slots = {}

    def write(self, uploads):
        for upload in uploads:
            self.slots[upload.place[0]] = int(upload.item[0, 0, 0])


def settle(stream, pool, wanted, frames=400):
    for _ in range(frames):
        pool.write(stream.update(wanted).arrived)
        if stream.settled:
            return
        stream.wait(0.05)
    raise AssertionError("the stream did not settle")


def settle_at(stream, pool, wanted, now_s):
    """All of it comes at one time of the clock that pages fade in by."""
    while True:
        pool.write(stream.update(wanted, now_s=now_s).arrived)
        if stream.settled:
            return
        stream.wait(0.05)


def test_what_is_wanted_becomes_resident_and_is_what_it_says():
    source, pool = Source(), Pool()
    with PageStream(source, slots=64) as stream:
        wanted = np.arange(40)
        settle(stream, pool, wanted)
        drawable = stream.drawable(wanted)
        assert (drawable.coarser == 0).all()
        assert [pool.slots[slot] for slot in drawable.slot.tolist()] == [page % 251 for page in range(40)]
    assert sorted(source.reads) == sorted({*range(40), source.pyramid.page_count - 1}), "every page is read once"


def test_a_frame_never_waits_for_a_page():
    gate = threading.Event()
    with PageStream(Source(gate=gate), slots=64) as stream:
        update = stream.update(np.arange(50))
        assert update.arrived == []
        assert update.statistics.missing == 50
        assert (stream.drawable(np.arange(50)).slot == -1).all()
        gate.set()


def test_the_nearest_resident_ancestor_is_drawn_meanwhile():
    source, pool = Source(), Pool()
    pyramid = source.pyramid
    with PageStream(source, slots=64) as stream:
        settle(stream, pool, np.array([pyramid.page_index(np.array([2]), np.array([1]), np.array([1]))[0]]))
        pages = pyramid.page_index(np.array([0, 0]), np.array([5, 15]), np.array([6, 0]))
        drawable = stream.drawable(pages)
        assert drawable.coarser.tolist() == [2, len(pyramid.levels) - 1], "its own ancestor; else the pinned level"
        everything = stream.table()
        some = np.arange(pyramid.page_count)
        one_by_one = stream.drawable(some)
        np.testing.assert_array_equal(everything.slot, one_by_one.slot)
        np.testing.assert_array_equal(everything.coarser, one_by_one.coarser)


def test_a_page_that_comes_late_fades_in_over_what_was_shown_before():
    source, pool = Source(), Pool()
    pyramid, top = source.pyramid, len(source.pyramid.levels) - 1
    page = int(pyramid.page_index(0, 5, 6))
    parent = int(pyramid.page_index(2, 1, 1))
    with PageStream(source, slots=64) as stream:
        settle(stream, pool, np.array([parent]))  # no clock: there at once
        assert stream.drawable(np.array([parent])).share.tolist() == [1.0]
        while stream.drawable(np.array([page])).coarser.tolist()[0] != 0:
            pool.write(stream.update(np.array([page]), now_s=10.0).arrived)
            stream.wait(0.05)
        before = None
        for now_s in np.linspace(10.0, 10.0 + 1.2 * FADE_S, 13):
            stream.update(np.array([page]), now_s=float(now_s))
            drawn = stream.drawable(np.array([page]))
            assert (drawn.asked == 0).all()
            assert drawn.share.sum() == pytest.approx(1.0)
            own = float(drawn.share[drawn.coarser == 0].sum())
            assert own == pytest.approx(min(1.0, (now_s - 10.0) / FADE_S), abs=1e-4)
            if own < 1:
                assert drawn.coarser.tolist() == [0, 2], "over the page that stood there, not the coarsest"
            assert before is None or own >= before
            before = own
            table = stream.table()
            assert table.fade[page] == pytest.approx(own)
            assert table.fade[parent] == table.fade[pyramid.page_index(top, 0, 0)] == 1.0


def test_a_kept_table_is_that_of_every_frame_and_one_object_while_nothing_changes():
    source, pool = Source(), Pool()
    with PageStream(source, slots=64) as stream:
        kept = KeptTable(source.pyramid)
        tables = []
        for frame, wanted in enumerate([8] * 5 + [20] * 5):
            begin_s = 10.0 + frame * 0.45 * FADE_S
            settle_at(stream, pool, np.arange(wanted), begin_s)
            tables.append(kept.of(stream.resident))
            for ours, theirs in zip(tables[-1], stream.table(), strict=True):
                np.testing.assert_array_equal(ours, theirs)
        same = [one is other for one, other in itertools.pairwise(tables)]
        fades = [False] * 3  # for 0.45, 0.9 and 1.35 of the time that it takes
        assert same == [*fades, True, False, *fades, True]


def test_a_broken_page_is_logged_once_and_its_ancestor_stays(caplog):
    source, pool = Source(broken={3}), Pool()
    with caplog.at_level(logging.WARNING), PageStream(source, slots=64) as stream:
        for _ in range(3):
            settle(stream, pool, np.arange(8))
        assert stream.drawable(np.array([3])).coarser[0] == 1, "its parent is fetched in its stead"
        assert stream.update(np.arange(8)).statistics.failed == 1
    assert source.reads.count(3) == 1
    assert len([record for record in caplog.records if "page 3" in record.getMessage()]) == 1


@settings(deadline=None, max_examples=15)
@given(st.lists(st.tuples(st.integers(0, 150), st.integers(1, 60)), min_size=1, max_size=12), st.integers(2, 24))
def test_slots_and_pages_stay_in_step_under_any_walk(walk, slots):
    source, pool = Source(), Pool()
    with PageStream(source, slots=slots, per_frame=7, kept=16) as stream:
        for start, count in walk:
            wanted = np.arange(start, min(start + count, source.pyramid.page_count))
            for _ in range(4):
                update = stream.update(wanted)
                pool.write(update.arrived)
                assert len(update.arrived) <= 7
                stream.wait(0.01)
            drawable = stream.drawable(wanted)
            assert drawable.asked.tolist() == list(range(len(wanted)))
            for page, slot, coarser in zip(
                wanted.tolist(), drawable.slot.tolist(), drawable.coarser.tolist(), strict=True
            ):
                if slot >= 0 and coarser == 0:
                    assert pool.slots[slot] == page % 251
            assert update.statistics.resident <= slots
            assert update.statistics.waiting <= 16 + 2


def test_a_pool_too_small_for_a_frame_keeps_the_most_important():
    source, pool = Source(), Pool()
    with PageStream(source, slots=8) as stream:
        wanted = np.arange(30)
        for _ in range(60):
            pool.write(stream.update(wanted).arrived)
            stream.wait(0.02)
        drawable = stream.drawable(wanted)
        assert (drawable.slot >= 0).all(), "the pinned level serves the rest"
        assert (drawable.coarser[:5] == 0).all()


def test_uploads_respect_the_budget_and_the_least_recently_used_go_first():
    source, pool = Source(), Pool()
    with PageStream(source, slots=12, per_frame=3) as stream:
        settle(stream, pool, np.arange(6))
        settle(stream, pool, np.arange(6, 11))  # fills the pool
        settle(stream, pool, np.arange(3, 6))  # 3..5 are used again
        settle(stream, pool, np.array([20, 21, 22]))
        coarser = stream.drawable(np.array([3, 4, 5, 0, 1, 2])).coarser
        assert (coarser[:3] == 0).all()
        assert (coarser[3:] > 0).all()


def test_closing_in_the_middle_of_work_returns():
    stream = PageStream(Source(), slots=64)
    stream.update(np.arange(60))
    stream.close()


def test_a_pool_of_one_page_holds_the_coarsest_and_denies_all_else():
    source, pool = Source(), Pool()
    with PageStream(source, slots=1) as stream:
        settle(stream, pool, np.arange(8))
        statistics = stream.update(np.arange(8)).statistics
        assert (statistics.denied, statistics.missing, statistics.resident) == (8, 8, 1)
        drawable = stream.drawable(np.arange(8))
        assert (drawable.slot == 0).all()
        assert (drawable.coarser == len(source.pyramid.levels) - 1).all()
    assert source.reads == [source.pyramid.page_count - 1]


def test_a_program_that_fails_before_it_closes_a_stream_ends():
    program = """
import numpy as np
from limen.data.pages import Pyramid
from limen.stream.allocators import Slots
from limen.stream.pages import page_streaming

class Source:
    pyramid = Pyramid.of((4096, 2048))
    def read_page(self, page):
        return np.zeros((264, 264, 4), np.uint8)

stream = page_streaming(Source()).stream(Slots(64), 2)
stream.update(np.arange(8))
raise SystemExit(3)
"""
    assert finished([*PYTHON, "-c", program], timeout_s=60).returncode == 3


def finished_soon(asked, most=200):
    """All updates of `completed`, which has to end by itself."""
    updates = list(itertools.islice(completed(asked), most))
    assert len(updates) < most, "it goes on for ever"
    return updates


def test_what_is_left_over_from_earlier_wishes_does_not_hold_up_a_picture():
    with PageStream(Source(), slots=64) as stream:
        stream.update(np.arange(20))
        while not stream.idle:
            time.sleep(0.001)
        finished_soon([(stream, np.arange(30, 35))])
        assert stream.resident.mask[30:35].all()


def test_a_picture_waits_for_what_stands_in_for_a_page_that_fails_meanwhile():
    for _ in range(30):
        source = Source(broken={3})
        with PageStream(source, slots=64) as stream:
            finished_soon([(stream, np.array([3]))])
            parent = int(page_streaming(source).source.parents(np.array([3]))[0])
            assert stream.resident.mask[parent]


def test_a_whole_branch_that_fails_ends_in_the_coarsest_page_or_in_nothing():
    pyramid = Source().pyramid
    for broken in (range(pyramid.page_count - 1), range(pyramid.page_count)):
        with PageStream(Source(broken=broken), slots=8) as stream:
            finished_soon([(stream, np.arange(4))], 2000)
            assert stream.resident.mask.sum() == pyramid.page_count - len(broken)


def test_a_chunk_that_is_denied_is_tried_again_when_what_held_its_room_is_let_go():
    with page_streaming(Source()).stream(Slots(2), 2) as stream:
        settle_chunks(stream, np.array([1]))
        settle_chunks(stream, np.array([3]), in_use=np.array([1]))
        update = stream.update(np.array([3]), in_use=np.array([1]))
        assert (update.statistics.denied, update.statistics.needed, update.statistics.missing) == (1, 1, 1)
        settle_chunks(stream, np.array([3]))
        assert stream.resident.mask[3]


def settle_chunks(stream, wanted, **options):
    for _ in range(20):
        stream.update(wanted, **options)
        stream.wait(0.02)


def test_what_is_wanted_and_has_been_read_is_not_thrown_away_for_a_budget():
    source = Source((16384, 8192))
    with PageStream(source, slots=2000, kept=64, per_frame=4) as stream:
        finished = 0
        while finished < 300:
            finished += len(stream.update(np.arange(300)).arrived)
            time.sleep(0.0005)
    assert max(source.reads.count(page) for page in range(300)) == 1
