"""Contrast sensitivity against the authors' numbers, and the laws that every selector leans on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.errors import InputError
from limen.vision.acuity import HUMAN_ARCMIN

FREQUENCIES = [1, 2, 4, 8, 16, 32, 60]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({}, [51.47, 104.99, 134.28, 98.56, 38.20, 8.236, 1.343]),
        ({"eccentricity_deg": 10}, [16.96, 28.69, 25.23, 8.753, 0.758, 0.0082]),
        ({"eccentricity_deg": 20}, [5.591, 7.841, 4.740, 0.777, 0.0150]),
        ({"temporal_hz": 5}, [72.39, 90.24, 92.88, 63.51, 25.77, 6.896, 1.787]),
    ],
)
def test_castle_csf_is_the_authors(arguments, expected):
    """100 cd/m2, 1 deg2; the figures are rounded to as many digits as are given."""
    found = limen.sensitivity(FREQUENCIES[: len(expected)], **arguments)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=6e-5)


def test_people_resolve_what_was_measured():
    np.testing.assert_allclose(limen.resolution_cpd([0, 5, 10, 20, 30]), [47.7, 26.5, 18.3, 11.4, 8.2], atol=0.06)
    ratios = limen.resolution_cpd(0, [10, 30, 100, 300]) / limen.resolution_cpd(0, 100)
    np.testing.assert_allclose(ratios, [0.64, 0.82, 1, 1.11], atol=0.006)
    assert limen.resolution_cpd(20, 5, model="snellen") == 30
    samples_per_deg = 2 * float(limen.resolution_cpd())
    assert 60 / samples_per_deg == pytest.approx(HUMAN_ARCMIN, abs=0.015)


@given(st.floats(4, 64), st.floats(0, 40), st.floats(1, 250), st.floats(1.01, 2))
def test_more_of_what_hides_never_shows_more(frequency, eccentricity, luminance, factor):
    here = limen.sensitivity(frequency, eccentricity, luminance)
    assert limen.sensitivity(frequency, eccentricity + factor, luminance) <= here, "farther from the gaze"
    assert limen.sensitivity(frequency, eccentricity, luminance, area_deg2=1 / factor) <= here, "smaller"
    assert limen.resolution_cpd(eccentricity + factor, luminance) <= limen.resolution_cpd(eccentricity, luminance)
    assert limen.resolution_cpd(eccentricity, luminance * factor) >= limen.resolution_cpd(eccentricity, luminance)


def test_the_dark_and_the_extremes_are_clamped_and_nonsense_is_refused():
    assert np.isfinite(limen.sensitivity([0, 1, 100], 0, [[0], [1e-9], [1e9]])).all()
    assert limen.sensitivity(4, 0, 0) == limen.sensitivity(4, 0, 0.0113)
    for bad in ({"frequency_cpd": -1}, {"frequency_cpd": np.nan}, {"frequency_cpd": 1, "luminance_cd_m2": -3}):
        with pytest.raises(InputError, match="finite and not negative"):
            limen.sensitivity(**bad)
    with pytest.raises(InputError, match="castle"):
        limen.sensitivity(1, model="owl")
    with pytest.raises(InputError, match="human and snellen"):
        limen.resolution_cpd(model="owl")
    with pytest.raises(InputError, match="nasal"):
        limen.sensitivity(1, field="upper")
