"""The order of points along Hilbert's curve."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.points.hilbert_kernels import (
    KEY_LEVELS,
    LATTICE_BITS,
    NUMBER_BITS,
    box_of,
    crowded,
    hilbert_keys,
    numbered,
    sort_digit,
)
from limen.data.points.tree import hilbert_order


def keys_of(places, levels=KEY_LEVELS):
    keys = np.empty(len(places), np.uint64)
    hilbert_keys(np.ascontiguousarray(places, np.int32), levels, keys)
    return keys


@pytest.mark.parametrize("levels", [1, 2, 3, 4])
def test_the_curve_visits_every_cell_once_and_never_jumps(levels):
    cells = np.stack(np.meshgrid(*[np.arange(2**levels)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    keys = keys_of(cells << (LATTICE_BITS - levels), levels)
    assert np.array_equal(np.sort(keys), np.arange(len(cells), dtype=np.uint64))
    assert np.all(np.abs(np.diff(cells[np.argsort(keys)], axis=0)).sum(axis=1) == 1)


@given(st.integers(1, KEY_LEVELS), st.lists(st.integers(0, 2**LATTICE_BITS - 1), min_size=3, max_size=3))
def test_fewer_levels_are_the_first_bits_of_more(levels, place):
    fine, coarse = (int(keys_of(np.array([place]), n)[0]) for n in (KEY_LEVELS, levels))
    assert fine >> (3 * (KEY_LEVELS - levels)) == coarse


def test_words_hold_keys_and_numbers_and_a_pass_of_the_sort_is_numpys_stable_one():
    chance = np.random.default_rng(1)
    keys = chance.integers(0, 2**60, 5000, dtype=np.uint64)
    order = chance.permutation(5000).astype(np.uint32)
    words, out, counts = np.empty_like(keys), np.empty_like(keys), np.empty((3, 2048), np.int64)
    numbered(keys, order, 13, words, counts)
    parts = keys[order] >> np.uint64(13) & np.uint64(2**33 - 1)
    assert np.array_equal(words, parts << np.uint64(NUMBER_BITS) | order)
    for digit in range(3):
        values = (parts >> np.uint64(11 * digit) & np.uint64(2047)).astype(np.int64)
        assert np.array_equal(counts[digit], np.bincount(values, minlength=2048))
        sort_digit(words, digit, counts, out)
        assert np.array_equal(out, words[np.argsort(values, kind="stable")])


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 3000), st.integers(1, LATTICE_BITS), st.integers(0, 2**32 - 1))
def test_points_come_in_the_order_of_their_keys_where_density_varies_little(count, bits, seed):
    """Eleven levels below the common cell, so equal keys may come in any order."""
    places = np.random.default_rng(seed).integers(0, 2**bits, (count, 3)).astype(np.int32)
    order = hilbert_order(places)
    assert np.array_equal(np.sort(order), np.arange(count))
    keys = keys_of(places)
    shared = LATTICE_BITS - max(int(places[:, axis].min() ^ places[:, axis].max()).bit_length() for axis in range(3))
    low = 3 * (KEY_LEVELS - min(KEY_LEVELS, shared + 11))
    assert np.all(np.diff((keys[order] >> np.uint64(low)).astype(np.int64)) >= 0)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-1000, 1000)] * 3), min_size=1, max_size=40), st.integers(1, 5))
def test_boxes_and_crowds_are_numpys(places, longest):
    positions = np.array(places, dtype=float)
    box = np.empty((2, 3))
    box_of(positions, box)
    assert np.array_equal(box, [positions.min(axis=0), positions.max(axis=0)])
    keys = np.sort(positions[:, 0] // 200 + 5).astype(np.uint64)
    words = keys << np.uint64(NUMBER_BITS) | np.arange(len(keys), dtype=np.uint64)
    _, counts = np.unique(keys, return_counts=True)
    assert crowded(words, longest) == counts[counts > longest].sum()


def test_where_points_are_much_denser_than_elsewhere_all_levels_count():
    chance = np.random.default_rng(2)
    dense = chance.integers(0, 2**14, (5000, 3)) + 2**28
    far = np.array([[0, 0, 0], [2**LATTICE_BITS - 1] * 3])
    places = np.concatenate([dense, far]).astype(np.int32)
    assert np.all(np.diff(keys_of(places[hilbert_order(places)]).astype(np.int64)) >= 0)
