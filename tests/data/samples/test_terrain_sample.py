from __future__ import annotations

import itertools

import numpy as np
import pytest
import rasterio

from limen.data.samples.terrain import SAMPLE_SPACING_M, sample_heights, sample_terrain
from limen.data.terrain.elevation import ElevationSource
from limen.data.terrain.elevation_type import is_elevation
from limen.errors import InputError, MissingFileError


def test_a_block_is_the_same_whatever_is_around_it():
    whole = sample_heights(3, 4000, 8000, 96, 64)
    assert np.array_equal(sample_heights(3, 4032, 8020, 40, 30), whole[20:50, 32:72])
    assert np.abs(sample_heights(4, 4000, 8000, 96, 64) - whole).mean() > 50


def test_the_same_file_with_any_number_of_workers(tmp_path):
    seen = []
    report = sample_terrain(tmp_path / "a.tif", 700, seed=5, workers=1, progress=seen.append)
    sample_terrain(tmp_path / "b.tif", 700, seed=5, workers=3)
    sample_terrain(tmp_path / "c.tif", 600, seed=5, dtype="float32")
    assert report.size == (700, 700)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    with (
        rasterio.open(tmp_path / "a.tif") as a,
        rasterio.open(tmp_path / "b.tif") as b,
        rasterio.open(tmp_path / "c.tif") as c,
    ):
        heights = a.read(1)
        assert heights.dtype == np.int16
        assert np.array_equal(heights, b.read(1))
        assert np.array_equal(heights[:600, :600], np.rint(c.read(1)))
        assert a.block_shapes == [(512, 512)]
    assert {path.name for path in tmp_path.iterdir()} == {"a.tif", "b.tif", "c.tif"}


def test_a_sample_is_a_terrain_where_it_says(tmp_path):
    sample_terrain(tmp_path / "a.tif", 64)
    assert is_elevation(tmp_path / "a.tif")
    with ElevationSource(tmp_path / "a.tif") as source:
        assert source.spacing_m == (SAMPLE_SPACING_M, SAMPLE_SPACING_M)
        assert source.exact
        assert "UTM zone 11N" in source.crs
        assert source.notes == ()


def test_mountains_are_steep_smooth_and_wet_somewhere():
    """Slopes as in real mountains, no noise from post to post, and lakes that are flat."""
    heights = sample_heights(10, 8000, 8000, 512, 512).astype(float)
    down, across = np.gradient(heights, SAMPLE_SPACING_M)
    slope_deg = np.degrees(np.arctan(np.hypot(down, across)))
    assert 5 < np.median(slope_deg) < 35
    assert np.percentile(slope_deg, 99) < 65
    # Neighbouring slopes agree: for white noise they would be anticorrelated.
    steps = np.diff(heights, axis=1)
    assert np.corrcoef(steps[:, 1:].ravel(), steps[:, :-1].ravel())[0, 1] > 0.7
    places = itertools.product(range(3), range(0, 16384, 512), range(0, 16384, 512))
    spots = [sample_heights(seed, column, row, 8, 8) for seed, column, row in places]
    flat = [spot for spot in spots if spot.max() == spot.min()]
    assert 1 < len(flat) < 0.15 * len(spots)
    assert {float(lake[0, 0]) for lake in flat} == {min(float(spot.min()) for spot in spots)}


@pytest.mark.parametrize(
    ("name", "size", "seed", "error"),
    [
        ("a.png", 9, 0, InputError),
        ("a.tif", 1, 0, InputError),
        ("a.tif", 9, -1, InputError),
        ("no/a.tif", 9, 0, MissingFileError),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path, name, size, seed, error):
    with pytest.raises(error):
        sample_terrain(tmp_path / name, size, seed)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_nothing(tmp_path):
    def interrupted(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sample_terrain(tmp_path / "a.tif", 700, progress=interrupted)
    assert list(tmp_path.iterdir()) == []
