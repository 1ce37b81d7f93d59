"""Streaming patches: a frame never waits, ranges never overlap, and what is drawn is never evicted."""

from __future__ import annotations

import logging
import threading
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import InputError
from limen.layers.terrain.patches import PatchPlaces, patch_ranges, patch_streaming
from support.lands import GridLand

HEIGHTS = np.add.outer(np.arange(65.0), np.arange(129.0))


def land(**options):
    return GridLand(HEIGHTS, leaf=16, roots=(2, 1), **options)


@cache
def the_land():
    return land()


def patch_stream(source, *, vertex_capacity, index_capacity, **streaming):
    """A terrain's patches on their way to buffers of so many vertices and indices."""
    return patch_streaming(source, **streaming).stream(patch_ranges(source, vertex_capacity, index_capacity), 2)


class Buffers:
    """What a GPU's buffers hold after the uploads: which patch owns which vertex and which index."""

    def __init__(self, vertices, indices):
        self.vertices, self.indices = np.full(vertices, -1), np.full(indices, -1)

    def write(self, update):
        for patch, (begin, first, _), content in update.arrived:
            assert first % 2 == 0, "copies are aligned to 4 bytes"
            assert begin + len(content.posts) <= len(self.vertices)
            assert first + content.core.size <= len(self.indices)
            self.vertices[begin : begin + len(content.posts)] = patch
            self.indices[first : first + content.core.size] = patch

    def holds(self, patch, places, source):
        content = source.read_patch(patch)
        begin, first = places.first_vertex[patch], places.first_index[patch]
        assert places.core_indices[patch] == content.core.size
        assert (self.vertices[begin : begin + len(content.posts)] == patch).all()
        assert (self.indices[first : first + content.core.size] == patch).all()


def settle(stream, buffers, wanted, frames=400, **options):
    for _ in range(frames):
        update = stream.update(np.asarray(wanted), **options)
        buffers.write(update)
        if stream.settled:
            return update
        stream.wait(0.05)
    raise AssertionError("the stream did not settle")


def test_what_is_wanted_becomes_resident_and_is_what_it_says():
    source = land()
    buffers = Buffers(60_000, 200_000)
    with patch_stream(source, vertex_capacity=60_000, index_capacity=200_000) as stream:
        wanted = np.arange(len(source.patch_of))[::-1]
        update = settle(stream, buffers, wanted)
        assert update.statistics.missing == update.statistics.denied == 0
        places = PatchPlaces.of(stream.resident)
        assert places.resident.all()
        assert sorted(source.reads) == list(range(len(source.patch_of))), "every patch is read once"
        for patch in wanted.tolist():
            buffers.holds(patch, places, source)


def test_a_frame_never_waits_for_a_patch():
    gate = threading.Event()
    source = land()
    read = source.read_patch
    source.read_patch = lambda patch: gate.wait(10) and read(patch)
    with patch_stream(source, vertex_capacity=60_000, index_capacity=200_000) as stream:
        update = stream.update(np.arange(40))
        assert update.arrived == []
        assert update.statistics.missing == 40
        gate.set()


def test_a_broken_patch_is_logged_once_and_never_asked_again(caplog):
    source = land(broken=(7,))
    buffers = Buffers(60_000, 200_000)
    with (
        caplog.at_level(logging.WARNING),
        patch_stream(source, vertex_capacity=60_000, index_capacity=200_000) as stream,
    ):
        for _ in range(3):
            update = settle(stream, buffers, np.arange(12))
        assert update.statistics.failed == update.statistics.missing == 1
        assert PatchPlaces.of(stream.resident).resident[:12].tolist() == [patch != 7 for patch in range(12)]
    assert source.reads.count(7) == 1
    assert len([record for record in caplog.records if "patch 7" in record.getMessage()]) == 1


def test_the_least_recently_used_go_but_neither_roots_nor_what_is_wanted_or_drawn():
    source = land()
    exact = np.flatnonzero(source.patches.error_m == 0)  # 289 vertices each
    room = 2 * 25 + 4 * 289
    buffers = Buffers(room, 200_000)
    with patch_stream(source, vertex_capacity=room, index_capacity=200_000) as stream:
        settle(stream, buffers, exact[:2])
        settle(stream, buffers, exact[2:4])
        settle(stream, buffers, exact[:1])  # used again: the second is now the oldest
        update = settle(stream, buffers, exact[4:5])
        assert np.flatnonzero(PatchPlaces.of(stream.resident).resident).tolist() == [0, 1, *exact[[0, 2, 3, 4]]]
        update = settle(stream, buffers, exact[5:8], in_use=exact[:1])
        assert update.statistics.missing == 0
        assert np.flatnonzero(PatchPlaces.of(stream.resident).resident).tolist() == [0, 1, *exact[[0, 5, 6, 7]]]


def test_what_does_not_fit_is_denied_and_the_most_important_come_first():
    source = land()
    exact = np.flatnonzero(source.patches.error_m == 0)
    room = 2 * 25 + 3 * 289 + 100
    buffers = Buffers(room, 200_000)
    with patch_stream(source, vertex_capacity=room, index_capacity=200_000) as stream:
        update = settle(stream, buffers, exact[::-1])
        assert update.statistics.denied == len(exact) - 3
        assert np.flatnonzero(PatchPlaces.of(stream.resident).resident).tolist() == [0, 1, *exact[-3:]]


def test_too_little_room_for_the_roots_is_refused():
    with pytest.raises(InputError, match="coarsest patches of this terrain have 50 and 192"):
        patch_stream(land(), vertex_capacity=49, index_capacity=1000)


@settings(deadline=None, max_examples=15)
@given(st.lists(st.tuples(st.integers(0, 90), st.integers(1, 30)), min_size=1, max_size=6), st.integers(600, 6000))
def test_ranges_never_overlap_under_any_walk(walk, room):
    source = the_land()
    buffers = Buffers(room, 4 * room)
    options = {"vertex_capacity": room, "index_capacity": 4 * room, "bytes_per_frame": 20_000, "kept": 16}
    with patch_stream(source, **options) as stream:
        for start, count in walk:
            wanted = np.arange(start, min(start + count, len(source.patch_of)))
            for _ in range(4):
                update = stream.update(wanted)
                buffers.write(update)
                served = wanted[: len(wanted) - update.statistics.denied]  # the least important give way
                assert not np.isin(update.evicted, served).any()
                assert sum(16 * len(u.item.posts) + 2 * u.item.core.size for u in update.arrived[:-1]) < 20_000
                assert update.statistics.waiting <= 16 + 2
                stream.wait(0.005)
            places = PatchPlaces.of(stream.resident)
            for patch in np.flatnonzero(places.resident).tolist():
                buffers.holds(patch, places, source)
            assert places.resident[:2].all() or update.statistics.queued or update.statistics.waiting
