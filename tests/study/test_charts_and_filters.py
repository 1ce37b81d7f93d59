"""Charts are deterministic and what their names say; filters keep light, and levels are drawn where they lie."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.store.resample import HALVING_TAPS, linear_of_srgb, srgb_of_linear, weights
from limen.errors import InputError
from limen.study.charts import CHARTS, chart
from limen.study.filters import FILTERS, filter_named, magnified, matrix, resampled
from limen.study.kernels import drawn_level, pixels_per_degree, window_px


@pytest.mark.parametrize("name", CHARTS)
def test_charts_have_the_size_asked_for_and_repeat(name: str) -> None:
    page = chart(name, (70, 50), 3)
    assert page.shape == (50, 70, 3)
    assert page.dtype == np.uint8
    assert (page == chart(name, (70, 50), 3)).all()
    assert (page != chart(name, (70, 50), 4)).any()
    assert page.std() > 10


def test_charts_are_what_they_say() -> None:
    lines = chart("grating", (64, 64))[..., 0].astype(int)
    assert (np.abs(np.diff(lines[:, :32], axis=0)) == 255).all()
    assert (np.abs(np.diff(lines[:, 32:], axis=1)) == 255).all()
    noise = chart("noise", (256, 256))[..., 0]
    assert set(np.unique(noise)) == {0, 255}
    assert abs(float(noise.mean()) - 127.5) < 2
    text = chart("text", (400, 400))
    assert (text == 255).mean() > 0.5  # paper
    assert (text < 64).mean() > 0.05  # ink


@pytest.mark.parametrize(("name", "slope"), [("pink", -1.0), ("photograph", -1.0)])
def test_amplitude_falls_with_frequency_as_in_nature(name: str, slope: float) -> None:
    side = 256
    light = linear_of_srgb(chart(name, (side, side), 1)[..., 1] / 255.0)
    window = np.hanning(side)
    power = np.abs(np.fft.fft2((light - light.mean()) * window[:, None] * window)) ** 2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    edges = np.geomspace(0.02, 0.25, 8)
    rings = [power[(frequency >= low) & (frequency < high)].mean() for low, high in pairwise(edges)]
    fitted = np.polyfit(np.log(np.sqrt(edges[:-1] * edges[1:])), 0.5 * np.log(rings), 1)[0]
    assert fitted == pytest.approx(slope, abs=0.3)


def test_unknown_names_and_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="no chart is named 'x'"):
        chart("x", (9, 9))
    with pytest.raises(InputError, match="at least 1 px"):
        chart("noise", (0, 9))
    with pytest.raises(InputError, match="no filter is named 'x'"):
        filter_named("x")


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(sorted(FILTERS)),
    st.integers(1, 40),
    st.integers(1, 60),
    st.floats(0.2, 6.0),
)
def test_every_row_of_weights_sums_to_one(name: str, inputs: int, outputs: int, ratio: float) -> None:
    rows = matrix(name, inputs, outputs, ratio).toarray()
    assert rows.shape == (outputs, inputs)
    assert np.allclose(rows.sum(axis=1), 1.0)


@pytest.mark.parametrize("name", ["bilinear", "catmull-rom", "lanczos-2", "lanczos-3", "lanczos-4", "kaiser-4"])
def test_interpolating_filters_keep_samples_where_they_are(name: str) -> None:
    assert np.allclose(matrix(name, 12, 12, 1.0).toarray(), np.eye(12))


@pytest.mark.parametrize("name", sorted(set(FILTERS) - {"box"}))
def test_a_ramp_stays_a_ramp_away_from_the_ends(name: str) -> None:
    """Filters are symmetric, so levels do not shift: sample k of a level is the light at its own middle."""
    ramp = np.repeat(np.linspace(0, 1, 80)[:, None, None], 3, axis=2) * np.ones((80, 80, 3))
    coarse = resampled(ramp, 2.0, name)
    assert np.abs(coarse[12:-12, 20, 0] - (ramp[24:-24:2, 20, 0] + ramp[25:-24:2, 20, 0]) / 2).max() < 2e-4
    drawn = magnified(coarse, (80, 80), name)
    assert np.abs(drawn[24:-24] - ramp[24:-24]).max() < 2e-3


def test_lanczos_with_two_lobes_is_the_one_that_pages_are_halved_with() -> None:
    row = matrix("lanczos-2", 40, 20, 2.0).toarray()[10]
    assert np.abs(row[17:25] - HALVING_TAPS).max() < 1e-6
    start, plain = weights(0, 13, 3.1, 40)
    ours = matrix("lanczos-2", 40, 13, 3.1).toarray()
    assert np.abs(ours[:, start : start + plain.shape[1]] - plain).max() < 1e-6


def test_codes_and_light_are_each_others_inverse() -> None:
    codes = np.arange(256) / 255.0
    assert np.abs(srgb_of_linear(linear_of_srgb(codes)) - codes).max() < 1e-6


def test_a_level_of_a_plain_picture_is_the_picture() -> None:
    page = chart("text", (64, 64))
    assert (drawn_level(page, 0, "box", "bilinear") == page).all()
    plain = np.full((64, 64, 3), 137, np.uint8)
    assert (drawn_level(plain, 3, "lanczos-2", "catmull-rom") == 137).all()
    with pytest.raises(InputError, match="multiples of 4"):
        drawn_level(page[:62], 2, "box", "bilinear")


def test_windows_hold_what_the_observer_takes() -> None:
    assert pixels_per_degree(0.64, 1) == pytest.approx(2 * 93.75, rel=2e-4)
    assert pixels_per_degree(2.0, 1) == pytest.approx(60, rel=2e-4)
    assert window_px(2.0, 1) == 256
    assert window_px(0.64, 1) == 500
    assert window_px(0.64, 2) == 1000
