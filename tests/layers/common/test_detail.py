"""When a page's finer detail is needed: laws of the one number a page."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import limen
from limen.data.pages import Pyramid
from limen.layers.common.page_detail import (
    BLEND_LEVELS,
    KEPT,
    contrast_detail,
    level_shares,
    needed_share,
    plain_detail,
    reduced_detail,
)

PYRAMID = Pyramid.of((3000, 1700))
BASE = PYRAMID.levels[0].page_count
seeds = st.integers(0, 10_000)


def random_detail(seed):
    rng = np.random.default_rng(seed)
    return reduced_detail(PYRAMID, rng.choice([0.0, 0.01, 0.2, 0.5, 0.9, 1.0], PYRAMID.page_count))


def places(seed, count=400):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, PYRAMID.size_px, (count, 2)), np.exp2(rng.uniform(-2, 7, count))


@settings(deadline=None)
@given(seeds)
def test_no_page_needs_less_than_its_finer_pages(seed):
    tau = random_detail(seed).tau
    assert (tau[:BASE] == 0).all()
    for page in range(BASE, PYRAMID.page_count):
        level, column, row = PYRAMID.page_of(page)
        finer = PYRAMID.levels[level - 1]
        below = [
            tau[PYRAMID.page_index(level - 1, x, y)]
            for x in (2 * column, 2 * column + 1)
            for y in (2 * row, 2 * row + 1)
            if x < finer.columns and y < finer.rows
        ]
        assert tau[page] >= max(below)
        assert tau[page] <= 2.0**level / KEPT


@settings(deadline=None)
@given(seeds)
def test_the_shares_of_all_levels_fill_every_place_once(seed):
    shares = level_shares(PYRAMID, random_detail(seed), *places(seed))
    np.testing.assert_allclose(shares.sum(axis=0), 1, atol=1e-12)
    assert (shares >= 0).all()


@settings(deadline=None)
@given(seeds, st.floats(1.0, 8.0))
def test_more_tolerance_never_draws_finer_and_what_is_reached_is_allowed(seed, factor):
    texels, tolerance = places(seed)
    levels = np.arange(len(PYRAMID.levels))
    for detail in (plain_detail(PYRAMID), random_detail(seed)):
        tight, loose = (levels @ level_shares(PYRAMID, detail, texels, tolerance * f) for f in (1.0, factor))
        assert (loose >= tight - 1e-9).all()
    # The level between two that are blended, as trilinear filtering counts it.
    reached = levels @ level_shares(PYRAMID, plain_detail(PYRAMID), texels, tolerance)
    assert (reached <= np.maximum(np.log2(KEPT * tolerance), 0) + 1e-9).all()
    fainter = levels @ level_shares(PYRAMID, random_detail(seed), texels, tolerance)
    assert (fainter >= reached - 1e-9).all(), "faintness only ever saves"


@settings(deadline=None)
@given(st.floats(0, 1))
def test_the_blend_never_shows_more_loss_than_its_end(position):
    """The contrast lost, times the eye's sensitivity to it, is largest where the coarser level is all there is."""
    end_cpd = 47.0
    sensitivity_gain = 10 ** (0.043936 * end_cpd * (1 - 2 ** -(BLEND_LEVELS * (1 - position))))
    assert position * sensitivity_gain <= 1 + 1e-9


def test_what_contrast_needs_is_what_eyes_see():
    contrast = np.geomspace(1e-3, 1, 200)
    for luminance in (5.0, 30.0, 100.0, 300.0):
        needed = needed_share(contrast, np.asarray(luminance)) * limen.resolution_cpd(0, luminance)
        assert (np.diff(needed) >= -1e-9).all()
        # No less than people resolve, nor than castleCSF sees where it was measured.
        castle = limen.visible_cpd(contrast, 0, luminance, floor="none")
        measured = castle <= min(32, limen.resolution_cpd(0, luminance))
        assert (needed[measured] >= castle[measured] - 1e-9).all()
        people = (
            (np.log10(contrast) + 2.13475) / 0.043936 * limen.resolution_cpd(0, luminance) / limen.resolution_cpd(0)
        )
        assert (needed >= np.minimum(people, limen.resolution_cpd(0, luminance)) - 1e-6).all()
    assert needed_share(np.array([1.0, 0.0]), np.asarray(100.0)).tolist() == [1.0, 0.0]


def test_stark_pages_are_kept_and_empty_ones_left_out_at_once():
    empty, stark = (contrast_detail(PYRAMID, np.full(PYRAMID.page_count, c), np.array([100.0])) for c in (0.0, 1.0))
    np.testing.assert_array_equal(stark.tau, plain_detail(PYRAMID).tau)
    assert (empty.tau == 0).all()
    texels, tolerance = places(1)
    assert (level_shares(PYRAMID, empty, texels, tolerance)[-1] == 1).all(), "the coarsest page says it all"
