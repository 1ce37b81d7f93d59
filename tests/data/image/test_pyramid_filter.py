"""Which kernel a file's levels were made with is recognised, on files by other programs."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
import pyvips

import limen
from limen.data import ingest
from limen.data.image.file import open_image
from limen.layers.common.page_detail import KEPT, plain_detail


@functools.cache
def picture(kind: str) -> np.ndarray:
    rng = np.random.default_rng(8)
    height, width = 1100, 1500
    if kind == "flat":
        return np.full((height, width, 3), 90, np.uint8)
    spectrum = np.fft.rfft2(rng.normal(size=(height, width)))
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    pink = np.fft.irfft2(spectrum / np.maximum(frequency, 1 / height), s=(height, width))
    codes = 128 + 40 * pink / pink.std()
    return np.clip(codes[..., None] + rng.normal(size=(height, width, 3)), 0, 255).astype(np.uint8)


def save(path: Path, kind: str, **options: object) -> Path:
    image = pyvips.Image.new_from_array(picture(kind)).copy(interpretation="srgb")
    image.tiffsave(str(path), tile=True, pyramid=True, bigtiff=True, tile_width=256, tile_height=256, **options)
    return path


@pytest.mark.parametrize("compression", [{"compression": "deflate"}, {"compression": "jpeg", "Q": 85}])
@pytest.mark.parametrize("shrink", ["mean", "nearest"])
def test_averaged_and_thinned_levels_are_recognised(tmp_path, shrink, compression):
    path = save(tmp_path / "box.tif", "pink", region_shrink=shrink, **compression)
    with open_image(path) as image:
        assert image.pyramid.soft_from == 1
        assert image.info().soft_from_level == 1
        tau = plain_detail(image.pyramid).tau
        first = image.pyramid.levels[1].first_page
        assert tau[first] == pytest.approx(4 / KEPT), "level 1 gives way where level 2 would"


def test_our_own_levels_and_those_made_here_are_sharp(tmp_path):
    path = save(tmp_path / "box.tif", "pink", region_shrink="mean", compression="deflate")
    ingest(path, tmp_path / "own.tif")
    with open_image(tmp_path / "own.tif") as image:
        assert image.pyramid.soft_from is None
    pyvips.Image.new_from_array(picture("pink")).write_to_file(str(tmp_path / "plain.png"))
    with limen.open(tmp_path / "plain.png") as image:
        assert image.pyramid.soft_from is None


def test_a_lanczos_pyramid_by_another_program_is_sharp(tmp_path):
    """Written level by level, and without our name in it."""
    import tifffile

    levels = [pyvips.Image.new_from_array(picture("pink"))]
    for _ in range(3):
        levels.append(levels[-1].resize(0.5, kernel="lanczos3"))
    with tifffile.TiffWriter(tmp_path / "sharp.tif", bigtiff=True) as writer:
        for number, level in enumerate(levels):
            writer.write(level.numpy(), tile=(256, 256), compression="deflate", photometric="rgb",
                         subfiletype=int(number > 0))  # fmt: skip
    with open_image(tmp_path / "sharp.tif") as image:
        assert len(image.info().file_levels) > 1
        assert image.pyramid.soft_from is None


def test_where_nothing_tells_nothing_is_assumed(tmp_path):
    with open_image(save(tmp_path / "flat.tif", "flat", region_shrink="mean", compression="deflate")) as image:
        assert image.pyramid.soft_from is None


def test_a_broken_tile_is_no_obstacle(tmp_path):
    path = save(tmp_path / "box.tif", "pink", region_shrink="mean", compression="deflate")
    content = bytearray(path.read_bytes())
    content[2000:20000] = bytes(18000)
    path.write_bytes(content)
    with open_image(path) as image:
        assert image.pyramid.soft_from in (None, 1)
