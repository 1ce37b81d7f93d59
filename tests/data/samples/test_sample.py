from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import limen.data
from limen.data.pages import PAGE
from limen.data.samples.image import paint_rows, sample_size_px
from limen.errors import InputError


def draw(seed, top, size_px, workers):
    with ThreadPoolExecutor(workers) as pool:
        return paint_rows(seed, top, size_px, pool)


def test_the_same_seed_draws_the_same_texels_with_any_number_of_threads():
    size = (1500, 600)
    for top in (0, 512):
        once = draw(5, top, size, 1)
        assert once.shape == (min(256, 600 - top), 1500, 3)
        assert np.array_equal(once, draw(5, top, size, 4))
    assert np.abs(draw(5, 0, size, 2).astype(int) - draw(6, 0, size, 2)).mean() > 5


def test_blocks_join_without_a_seam():
    rows = draw(2, 0, (1536, 600), 2).astype(float)
    steps = np.abs(np.diff(rows, axis=1)).mean((0, 2))
    borders = steps[255::256]
    assert borders.max() < 3 * np.percentile(steps, 90)


def test_a_sample_is_a_pyramid_with_detail_at_every_level(tmp_path):
    done = []
    report = limen.data.sample_image(tmp_path / "s.tif", size=3000, aspect=2.0, seed=3, progress=done.append)
    assert report.size == (3000, 1500)
    assert done[-1] == 1.0
    assert done == sorted(done)
    with limen.data.open(tmp_path / "s.tif") as image:
        assert len(image.info().file_levels) == len(image.pyramid.levels)
        for number, level in enumerate(image.pyramid.levels):
            w, h = (min(PAGE, side) for side in level.size_px)
            assert image.read_page((number, 0, 0), gutter=0)[:h, :w, :3].std() > 3


def test_runs_are_equal_byte_for_byte(tmp_path):
    for name, workers in (("a", 1), ("b", 3)):
        limen.data.sample_image(tmp_path / f"{name}.tif", size=900, aspect=1.5, seed=1, workers=workers)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


@pytest.mark.parametrize("size", [(1, 1), (150, 2), (8, 700)])
def test_extreme_shapes_can_be_drawn(tmp_path, size):
    limen.data.sample_image(tmp_path / "s.tif", size=size[0], aspect=size[0] / size[1])
    with limen.data.open(tmp_path / "s.tif") as image:
        assert image.size_px == size


def test_sizes_that_cannot_be_meant_are_refused(tmp_path):
    assert sample_size_px(0.25, 1.0) == (15811, 15811)
    for wrong in ({"gigapixels": 0}, {"gigapixels": float("nan")}, {"aspect": 0}, {"size": 0}, {"seed": -1}):
        with pytest.raises(InputError):
            limen.data.sample_image(tmp_path / "s.tif", **wrong)
    with pytest.raises(InputError):
        limen.data.sample_image(tmp_path / "s.png")
    assert not list(tmp_path.iterdir())
