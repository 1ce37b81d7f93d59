from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.terrain.voids import CELL, REACH, complete, fill, pull


def filled(heights, valid):
    return fill(heights, valid, complete(*pull(heights, valid)))


@settings(deadline=None, max_examples=20)
@given(st.integers(2, 200), st.integers(2, 200), st.floats(0.001, 0.999), st.integers(0, 99))
def test_what_is_known_stays_and_the_rest_lies_between(columns, rows, share, seed):
    rng = np.random.default_rng(seed)
    heights = rng.uniform(-500, 3000, (rows, columns)).astype(np.float32)
    valid = rng.random((rows, columns)) < share
    valid.flat[rng.integers(valid.size)] = True
    found = filled(heights, valid)
    assert np.array_equal(found[valid], heights[valid])
    low, high = heights[valid].min(), heights[valid].max()
    assert found.min() >= low - 0.01
    assert found.max() <= high + 0.01


def test_a_window_fills_as_the_whole_does():
    """Whatever lies `REACH` inside a window is the same number, bit by bit."""
    rng = np.random.default_rng(3)
    rows, columns = 13 * CELL + 17, 12 * CELL + 5
    y, x = np.mgrid[0:rows, 0:columns]
    heights = (800 + 300 * np.sin(x / 90) * np.cos(y / 70) + rng.normal(0, 5, (rows, columns))).astype(np.float32)
    valid = (np.hypot(x - 400, y - 400) > 170) & (rng.random((rows, columns)) > 0.1)
    grid = complete(*pull(heights, valid))
    whole = fill(heights, valid, grid)
    left, top = CELL, 2 * CELL
    right, bottom = 11 * CELL, rows
    part = fill(
        heights[top:bottom, left:right],
        valid[top:bottom, left:right],
        grid[top // CELL :, left // CELL : right // CELL],
    )
    inside = np.s_[top + REACH : rows, left + REACH : right - REACH]
    assert not valid[inside].all()
    assert np.array_equal(whole[inside], part[REACH:, REACH : right - left - REACH])


def test_a_void_on_a_slope_is_filled_smoothly():
    """No step in or around the void is much larger than the slope's own, where the nearest post would make a cliff."""
    x = np.broadcast_to(np.arange(400, dtype=np.float32), (400, 400)) * 2.0
    valid = np.ones(x.shape, bool)
    valid[120:280, 120:280] = False
    found = filled(np.ascontiguousarray(x), valid)
    assert np.abs(np.diff(found, axis=1)).max() < 12.0
    assert np.abs(found - x)[~valid].mean() < 40.0
