from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.data.pages import PAGE, Pyramid
from limen.errors import InputError

sizes = st.tuples(st.integers(1, 200_000), st.integers(1, 200_000))


@given(sizes)
def test_levels_halve_rounding_up_until_one_page_is_left(size_px):
    pyramid = Pyramid.of(size_px)
    for number, level in enumerate(pyramid.levels):
        assert level.size_px == tuple(-(-side // 2**number) for side in size_px)
        assert (level.columns, level.rows) == tuple(-(-side // PAGE) for side in level.size_px)
    assert pyramid.levels[-1].columns == pyramid.levels[-1].rows == 1
    assert all(level.columns * level.rows > 1 for level in pyramid.levels[:-1])


@given(sizes)
def test_pages_are_numbered_without_gaps_finest_first(size_px):
    pyramid = Pyramid.of(size_px)
    following = 0
    for level in pyramid.levels:
        assert level.first_page == following
        following += level.columns * level.rows
    assert pyramid.page_count == following


@given(sizes, st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=20))
def test_page_numbers_go_there_and_back_alone_and_in_arrays(size_px, shares):
    pyramid = Pyramid.of(size_px)
    numbers = np.array([int(share * pyramid.page_count) for share in shares])
    level, column, row = pyramid.page_of(numbers)
    assert np.array_equal(pyramid.page_index(level, column, row), numbers)
    alone = pyramid.page_of(int(numbers[0]))
    assert alone == (level[0], column[0], row[0])
    assert pyramid.page_index(*alone) == numbers[0]


@given(sizes)
def test_every_base_texel_lies_in_a_page_of_every_level(size_px):
    pyramid = Pyramid.of(size_px)
    for number, level in enumerate(pyramid.levels):
        for side, pages in zip(size_px, (level.columns, level.rows), strict=True):
            assert 0 <= (side - 1) // 2**number // PAGE < pages


def test_what_does_not_exist_is_refused():
    pyramid = Pyramid.of((1000, 300))
    for page in ((0, 4, 0), (0, 0, 2), (3, 0, 0), (-1, 0, 0), (0, -1, 0)):
        with pytest.raises(InputError):
            pyramid.page_index(*page)
        with pytest.raises(InputError):
            pyramid.page_index(*(np.array([part]) for part in page))
    for number in (-1, pyramid.page_count):
        with pytest.raises(InputError):
            pyramid.page_of(number)
    with pytest.raises(InputError):
        Pyramid.of((0, 5))
