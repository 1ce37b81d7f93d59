from __future__ import annotations

import errno
import itertools
import os
from pathlib import Path

import numpy as np
import pytest
import pyvips
import tifffile

import limen.data
from limen.data.image import bigtiff
from limen.data.image import ingest as build
from limen.data.image.halving_kernels import HALO, halve_rows
from limen.data.store import atomic as partial
from limen.data.store.resample import HALVING_TAPS, LINEAR_OF_SRGB, SRGB_OF_LINEAR
from limen.errors import FormatError, InputError, MissingFileError, StorageError
from support.pictures import halved, light_of, noisy_picture, smooth_picture, write_tiff


def png(path: Path, texels) -> Path:
    pyvips.Image.new_from_array(texels).pngsave(str(path), compression=1)
    return path


def test_levels_equal_the_plain_linear_light_reference_to_the_code(tmp_path, monkeypatch):
    class Stored(bigtiff.DeflateTiles):
        """Three bands without loss, so that texels can be compared exactly."""

        bands = 3

        def tags(self):
            wanted = {258: (8, 8, 8), 277: (3,)}
            return [(tag, kind, wanted.get(tag, value)) for tag, kind, value in super().tags() if tag != 338]

    monkeypatch.setattr(build, "JpegTiles", lambda *_: Stored())
    picture = noisy_picture(1403, 907)
    limen.data.ingest_image(png(tmp_path / "a.png", picture), tmp_path / "a.tif", workers=3)
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        stored = [page.asarray() for page in tiff.pages]
    assert np.array_equal(stored[0], picture)
    assert stored[-1].shape[:2] == (114, 176)
    for fine, coarse in itertools.pairwise(stored):
        away = np.abs(halved(fine, gives_back=True).astype(int) - coarse)
        assert away.max() <= 1
        assert away.mean() < 0.01


def test_a_star_keeps_its_light_from_level_to_level() -> None:
    """Where the kernel asks for less than no light, it is taken from the star and not given to it."""
    sky = np.full((256, 256, 3), 3, np.uint8)
    sky[37::61, 22::53] = 255
    light = [light_of(sky.astype(float)).sum()]
    for _ in range(2):
        rows, columns = sky.shape[0] // 2, sky.shape[1] // 2
        padded = np.pad(sky, ((HALO, HALO), (0, 0), (0, 0)), mode="edge")
        coarse = np.empty((rows, columns, 3), np.uint8)
        halve_rows(padded, coarse, 0, columns, HALVING_TAPS, LINEAR_OF_SRGB, SRGB_OF_LINEAR)
        plain = halved(sky)
        gained, would_gain = (light_of(each.astype(float)).sum() * 4 / light_of(sky.astype(float)).sum() - 1
                              for each in (coarse, plain))  # fmt: skip
        assert abs(gained) < 0.6 * would_gain
        sky = coarse
    assert abs(light_of(sky.astype(float)).sum() * 16 / light[0] - 1) < 0.12


def test_the_result_is_read_alike_by_vips_tifffile_and_limen(tmp_path):
    picture = smooth_picture(1111, 777)
    report = limen.data.ingest(png(tmp_path / "a.png", picture), tmp_path / "a.tif")
    assert (report.size, report.facts["pixels"]) == ((1111, 777), 1111 * 777)
    assert report.bytes == (tmp_path / "a.tif").stat().st_size
    assert report.peak_rss_mib > 1
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff, limen.data.open(tmp_path / "a.tif") as image:
        assert tiff.is_bigtiff
        assert [page.shape[1::-1] for page in tiff.pages] == [level.size_px for level in image.pyramid.levels]
        assert [page.is_reduced for page in tiff.pages] == [False, True, True, True]
        for number, page in enumerate(tiff.pages):
            by_vips = pyvips.Image.new_from_file(str(tmp_path / "a.tif"), page=number).numpy()
            h, w = (min(256, side) for side in by_vips.shape[:2])
            mine = image.read_page((number, 0, 0), gutter=0)[:h, :w, :3]
            assert np.array_equal(mine, by_vips[:h, :w])
            assert np.array_equal(mine, page.asarray()[:h, :w])
    assert np.abs(by_vips.astype(int) - halved(halved(halved(picture)))).mean() < 2


def test_openslide_reads_the_result(tmp_path):
    openslide = pytest.importorskip("openslide")
    limen.data.ingest(png(tmp_path / "a.png", smooth_picture(1111, 777)), tmp_path / "a.tif")
    with openslide.OpenSlide(str(tmp_path / "a.tif")) as slide:
        assert slide.level_dimensions == ((1111, 777), (556, 389), (278, 195), (139, 98))


@pytest.mark.parametrize("kind", ["grey", "sixteen", "cmyk", "alpha", "zstd", "rgb-jpeg", "dzi", "strips", "planar"])
def test_any_source_keeps_its_colours(tmp_path, kind):
    picture = smooth_picture(600, 500)
    source, expected, allowed = tmp_path / "a.tif", picture, 2.0
    image = pyvips.Image.new_from_array(picture)
    if kind == "grey":
        source = png(tmp_path / "a.png", picture[..., 0])
        expected = np.repeat(picture[..., :1], 3, axis=2)
    elif kind == "sixteen":
        source = tmp_path / "a.png"
        (image.cast("ushort") * 257).cast("ushort").copy(interpretation="rgb16").pngsave(str(source))
    elif kind == "cmyk":
        source, allowed = tmp_path / "a.jpg", 40.0
        image.copy(interpretation="srgb").icc_transform("cmyk", input_profile="srgb").jpegsave(str(source), Q=95)
    elif kind == "alpha":
        source = png(tmp_path / "a.png", np.dstack([picture, noisy_picture(600, 500, 1)]))
    elif kind == "dzi":
        image.dzsave(str(tmp_path / "a"), suffix=".png", overlap=2)
        source = tmp_path / "a.dzi"
    elif kind == "planar":
        tifffile.imwrite(source, np.moveaxis(picture, 2, 0), photometric="rgb", planarconfig="separate")
    else:
        options = {"zstd": {"compression": "zstd"}, "strips": {"tile": None, "rowsperstrip": 5}}
        jpeg = {"compression": "jpeg", "compressionargs": {"level": 95, "outcolorspace": "rgb"}}
        write_tiff(source, [picture], **options.get(kind, jpeg))
    target = tmp_path / "out.tif"
    limen.data.ingest(source, target)
    with limen.data.open(target) as made:
        page = made.read_page(0, gutter=0)
    assert np.abs(page[..., :3].astype(int) - expected[:256, :256]).mean() < allowed
    if kind == "alpha":
        assert np.array_equal(page[..., 3], noisy_picture(600, 500, 1)[:256, :256, 0])


def test_an_embedded_profile_is_applied(tmp_path):
    picture = np.full((300, 300, 3), (200, 40, 40), dtype=np.uint8)
    plain = pyvips.Image.new_from_array(picture).copy(interpretation="srgb")
    wide = plain.icc_transform("p3", input_profile="srgb", depth=8)
    assert abs(int(wide.numpy()[0, 0, 0]) - 200) > 5
    wide.tiffsave(str(tmp_path / "p3.tif"), tile=True, compression="deflate")
    wide.pngsave(str(tmp_path / "p3.png"))
    for name in ("p3.tif", "p3.png"):
        limen.data.ingest(tmp_path / name, tmp_path / "out.tif")
        with limen.data.open(tmp_path / "out.tif") as made:
            assert np.abs(made.read_page(0)[8, 8, :3].astype(int) - (200, 40, 40)).max() <= 3


@pytest.fixture
def settled(tmp_path):
    """A source, a target that exists already, and the check that nothing but them is left."""
    source, target = png(tmp_path / "a.png", noisy_picture(900, 800)), tmp_path / "a.tif"
    target.write_bytes(b"as it was")

    def check():
        assert target.read_bytes() == b"as it was"
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.tif"]

    return source, target, check


@pytest.mark.parametrize("error", [RuntimeError("bug"), KeyboardInterrupt()], ids=["error", "ctrl-c"])
def test_an_interruption_leaves_nothing_behind(settled, error):
    source, target, check = settled

    def interrupt(done):
        if done > 0.5:
            raise error

    with pytest.raises(type(error)):
        limen.data.ingest(source, target, progress=interrupt)
    check()


@pytest.mark.parametrize("where", ["write", "sync"])
def test_a_full_disk_is_told_with_the_bytes_needed(settled, monkeypatch, where):
    source, target, check = settled
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if where == "sync":
        monkeypatch.setattr(partial.os, "fsync", lambda _: (_ for _ in ()).throw(full))
    else:
        real = bigtiff.BigTiffWriter.add

        def add(self, level, tile):
            if self.bytes_written > 200_000:
                raise full
            real(self, level, tile)

        monkeypatch.setattr(bigtiff.BigTiffWriter, "add", add)
    with pytest.raises(StorageError, match=r"the disk is full; about [\d,]+ bytes are needed"):
        limen.data.ingest(source, target)
    check()


def test_a_source_that_is_cut_short_leaves_nothing_behind(settled):
    source, target, check = settled
    data = source.read_bytes()
    source.write_bytes(data[: len(data) // 2])
    with pytest.raises(FormatError, match="cut short"):
        limen.data.ingest(source, target)
    check()


def test_targets_that_cannot_be_are_refused(tmp_path):
    source = write_tiff(tmp_path / "a.tif", [noisy_picture(300, 300)])
    for target, kind in (("a.tif", InputError), ("b.png", InputError), ("no/b.tif", MissingFileError)):
        with pytest.raises(kind):
            limen.data.ingest(source, tmp_path / target)
    with pytest.raises(MissingFileError):
        limen.data.ingest(tmp_path / "none.png", tmp_path / "b.tif")
    with pytest.raises(InputError):
        limen.data.ingest(source, tmp_path / "b.tif", quality=0)
    (tmp_path / "folder.tif").mkdir()
    with pytest.raises(StorageError):
        limen.data.ingest(source, tmp_path / "folder.tif")


def test_memory_is_bounded_by_the_width_not_the_size(tmp_path):
    source = tmp_path / "tall.tif"
    tall = pyvips.Image.new_from_array(smooth_picture(2000, 1000)).replicate(1, 24)
    tall.tiffsave(str(source), tile=True, tile_width=256, tile_height=256, compression="jpeg")
    before = limen.data.ingest(source, tmp_path / "warm.tif").peak_rss_mib
    report = limen.data.ingest(source, tmp_path / "b.tif")
    assert report.facts["pixels"] == 48_000_000
    # All texels would be 137 MiB; the rolling rows are a few MiB.
    assert report.peak_rss_mib - before < 60


@pytest.mark.data
def test_a_real_panorama_keeps_its_mean_light(data_dir, tmp_path):
    source = data_dir / "image" / "bluemarble_ng_5400x2700.jpg"
    limen.data.ingest(source, tmp_path / "a.tif")
    with limen.data.open(source) as plain, limen.data.open(tmp_path / "a.tif") as made:
        for number in (2, 5):
            a, b = (image.read_page((number, 0, 0))[..., :3].astype(int) for image in (plain, made))
            assert np.abs(a - b).mean() < 3
