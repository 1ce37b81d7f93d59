from __future__ import annotations

import concurrent.futures
import functools
from pathlib import Path

import numpy as np
import pytest
import pyvips
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Picture

import limen.data
from limen.data.image.tiles import scales_of
from limen.errors import FormatError, InputError, MissingFileError, PageError
from support.pictures import codes_of, halved, light_of, noisy_picture, repeated, smooth_picture, write_tiff

LAYOUTS = {
    "deflate": {"compression": "deflate", "predictor": True},
    "zstd": {"compression": "zstd"},
    "lzw": {"compression": "lzw"},
    "uncompressed-512": {"tile": (512, 512)},
    "strips": {"tile": None, "rowsperstrip": 7},
    "webp": {"compression": "webp", "compressionargs": {"lossless": True}},
    "jpeg2000-240": {"compression": "jpeg2000", "tile": (240, 240)},
    "rgb-jpeg": {"compression": "jpeg", "compressionargs": {"level": 95, "outcolorspace": "rgb"}},
}


def levels_of(picture, count=3):
    found = [picture]
    for _ in range(count):
        found.append(halved(found[-1]))
    return found


@functools.cache
def smooth_levels(width, height):
    """The same for many layouts, and only read."""
    return levels_of(smooth_picture(width, height))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("subifds", [False, True], ids=["pages", "subifds"])
def test_pages_and_gutters_equal_the_texels_that_were_stored(tmp_path, layout, subifds):
    # Where pages and tiles meet does not depend on the codec: nine pages and their levels are enough for the others.
    levels = smooth_levels(*((1111, 701) if layout == "deflate" else (701, 555)))
    path = write_tiff(tmp_path / "a.tif", levels, subifds=subifds, **LAYOUTS[layout])
    with tifffile.TiffFile(path) as tiff:
        base = tiff.pages[0]
        stored = [base.asarray(), *(page.asarray() for page in (base.pages if subifds else list(tiff.pages)[1:]))]
    with limen.data.open(path) as image:
        for number in range(image.pyramid.page_count):
            level, column, row = image.pyramid.page_of(number)
            page = image.read_page(number)
            expected = repeated(stored[level], column * 256 - 4, row * 256 - 4, 264)
            assert np.array_equal(page[..., :3], expected), (layout, level, column, row)
            assert (page[..., 3] == 255).all()
            assert np.array_equal(image.read_page((level, column, row), gutter=0), page[4:-4, 4:-4])


@pytest.mark.parametrize("tile_px", [256, 512])
def test_jpeg_pages_equal_what_vips_decodes(tmp_path, tile_px):
    picture = pyvips.Image.new_from_array(smooth_picture(1500, 900))
    path = tmp_path / "a.tif"
    picture.tiffsave(
        str(path),
        tile=True,
        pyramid=True,
        compression="jpeg",
        Q=90,
        tile_width=tile_px,
        tile_height=tile_px,
        bigtiff=True,
    )
    with limen.data.open(path) as image:
        for level in range(2):
            reference = pyvips.Image.new_from_file(str(path), page=level).numpy()
            page = image.read_page((level, 1, 1))
            assert np.array_equal(page[..., :3], repeated(reference, 252, 252, 264))
        assert image.mean_page_bytes > 500


@pytest.mark.parametrize(("overlap", "suffix"), [(0, ".jpg[Q=95]"), (1, ".png"), (3, ".jpg[Q=95]")])
def test_deep_zoom_tiles_lose_their_overlap(tmp_path, overlap, suffix):
    picture = smooth_picture(1000, 777)
    pyvips.Image.new_from_array(picture).dzsave(str(tmp_path / "z"), tile_size=254, overlap=overlap, suffix=suffix)
    with limen.data.open(tmp_path / "z.dzi") as image:
        assert image.size_px == (1000, 777)
        page = image.read_page((0, 1, 1))[..., :3].astype(int)
        assert np.abs(page - repeated(picture, 252, 252, 264)).max() <= (0 if "png" in suffix else 6)
        assert image.info().format == "Deep Zoom"
        assert image.mean_page_bytes > 100


@pytest.mark.parametrize(("name", "mode"), [("grey", 1), ("sixteen", 16), ("palette", 0), ("white", -1), ("alpha", 4)])
def test_other_kinds_of_samples_become_rgba(tmp_path, name, mode):
    base = noisy_picture(300, 280)
    grey = base[..., 0]
    expected = np.repeat(grey[..., None], 3, axis=2)
    path = tmp_path / f"{name}.tif"
    tile = {"tile": (256, 256), "metadata": None}
    if mode == 1:
        tifffile.imwrite(path, grey, photometric="minisblack", **tile)
    elif mode == -1:
        tifffile.imwrite(path, 255 - grey, photometric="miniswhite", **tile)
    elif mode == 0:
        table = np.random.default_rng(1).integers(0, 256, (3, 256), dtype=np.uint16) * 257
        tifffile.imwrite(path, grey, photometric="palette", colormap=table, **tile)
        expected = (table.T[grey] // 257).astype(np.uint8)
    elif mode == 16:
        tifffile.imwrite(path, base.astype(np.uint16) * 257, photometric="rgb", **tile)
        expected = base
    else:
        rgba = noisy_picture(300, 280, 4)
        tifffile.imwrite(path, rgba, photometric="rgb", extrasamples=["unassalpha"], compression="deflate", **tile)
        with limen.data.open(path) as image:
            assert np.array_equal(image.read_page(0, gutter=0), rgba[:256, :256])
        return
    with limen.data.open(path) as image:
        assert np.array_equal(image.read_page(0, gutter=0)[..., :3], expected[:256, :256])


def ramp(width, height, span):
    """Grey whose code tells the base position: a texel spanning ``span`` base texels from its left and top edge."""
    x = (np.arange(width) + 0.5) * span - 0.5
    y = (np.arange(height) + 0.5) * span - 0.5
    grey = 20 + 0.1 * x[None, :] + 0.12 * y[:, None]
    return np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2)


@pytest.mark.parametrize("rounding", ["down", "up", "stretched", "skipping"])
def test_coarse_levels_stay_aligned_whatever_the_file_rounds(tmp_path, rounding):
    width, height = 1037, 779
    levels = [np.rint(ramp(width, height, 1)).astype(np.uint8)]
    options = {"compression": "deflate"}
    for power in (2, 4, 8) if rounding != "skipping" else (4,):
        w, h = (
            (width // power, height // power)
            if rounding in ("down", "skipping")
            else (-(-width // power), -(-height // power))
        )
        level = ramp(w, h, power)
        if rounding == "stretched":
            x = (np.arange(w) + 0.5) * width / w - 0.5
            y = (np.arange(h) + 0.5) * height / h - 0.5
            level = np.repeat((20 + 0.1 * x[None, :] + 0.12 * y[:, None])[..., None], 3, axis=2)
            options["extratags"] = [(42113, "s", 2, "0", True)]
        levels.append(np.rint(level).astype(np.uint8))
    path = write_tiff(tmp_path / "a.tif", levels, **options)
    with limen.data.open(path) as image:
        for number, level in enumerate(image.pyramid.levels):
            w, h = level.size_px
            exact = ramp(w, h, 2**number)[:256, :256, 0]
            page = image.read_page((number, 0, 0), gutter=0)[: min(h, 256), : min(w, 256), 0]
            inner = np.abs(page.astype(float) - exact)[4:-5, 4:-5]
            # A shift of half a texel of level 2 would change codes by 0.2, of level 3 by 0.4; codes are rounded twice.
            assert abs((page.astype(float) - exact)[4:-5, 4:-5].mean()) < 0.12, (number, inner.mean())
            assert inner.max() <= 1.3


@given(st.integers(1000, 100_000), st.integers(1000, 100_000), st.integers(1, 7), st.booleans())
def test_scales_of_whole_halvings_are_found_from_rounded_sizes(width, height, power, up):
    whole = 2**power
    size = (-(-width // whole), -(-height // whole)) if up else (width // whole, height // whole)
    assert scales_of((width, height), size) == (float(whole), float(whole))


def test_levels_that_a_file_lacks_equal_the_plain_reference(tmp_path):
    levels = levels_of(noisy_picture(1201, 903), 4)
    path = write_tiff(tmp_path / "a.tif", levels[:1], compression="deflate")
    png = tmp_path / "a.png"
    pyvips.Image.new_from_array(levels[0]).pngsave(str(png), compression=1)
    for file, tolerance in ((path, 2), (png, 3)):
        with limen.data.open(file) as image:
            for number in range(1, len(image.pyramid.levels)):
                page = image.read_page((number, 0, 0), gutter=0)[..., :3]
                h, w = (min(256, side) for side in levels[number].shape[:2])
                away = np.abs(page[:h, :w].astype(int) - levels[number][:h, :w])
                # Each level is rounded to 8 bits on the way, hence codes differ by one, near black by two or three.
                assert away.max() <= tolerance, (file.name, number, away.max())
                assert away.mean() < 0.05


def test_gutters_of_derived_pages_equal_their_neighbours(tmp_path):
    path = write_tiff(tmp_path / "a.tif", [noisy_picture(1300, 1200)], compression="deflate")
    with limen.data.open(path) as image:
        left, right = image.read_page((1, 0, 0)), image.read_page((1, 1, 0))
        assert np.array_equal(left[:, 256:], right[:, :8])
        upper, lower = image.read_page((1, 1, 0)), image.read_page((1, 1, 1))
        assert np.array_equal(upper[256:], lower[:8])


def test_many_threads_read_the_same_pages(tmp_path):
    path = write_tiff(tmp_path / "a.tif", levels_of(noisy_picture(1300, 1200), 2), compression="deflate")
    with limen.data.open(path, cache_bytes=1 << 20) as image, concurrent.futures.ThreadPoolExecutor(8) as pool:
        numbers = [n % image.pyramid.page_count for n in range(200)]
        pages = list(pool.map(image.read_page, numbers))
        for number, page in zip(numbers, pages, strict=True):
            assert np.array_equal(page, pages[numbers.index(number)])


def cut(path: Path, share: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


@pytest.mark.parametrize("share", [0.001, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("writer", ["tifffile", "vips", "limen"])
def test_a_tiff_that_is_cut_short_is_refused_at_opening(tmp_path, share, writer):
    path = tmp_path / "a.tif"
    picture = smooth_picture(1500, 1400)
    if writer == "tifffile":
        write_tiff(path, levels_of(picture, 2), compression="deflate")
    elif writer == "vips":
        pyvips.Image.new_from_array(picture).tiffsave(str(path), tile=True, pyramid=True, compression="jpeg")
    else:
        pyvips.Image.new_from_array(picture).pngsave(str(tmp_path / "a.png"), compression=1)
        limen.data.ingest(tmp_path / "a.png", path)
    with pytest.raises(FormatError, match="copy it again") as caught:
        limen.data.open(cut(path, share))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("compression", ["jpeg", "deflate"])
def test_a_damaged_tile_is_an_error_that_names_the_page(tmp_path, compression):
    path = write_tiff(tmp_path / "a.tif", [noisy_picture(1024, 1024)], compression=compression)
    with tifffile.TiffFile(path) as tiff:
        offset, count = tiff.pages[0].dataoffsets[5], tiff.pages[0].databytecounts[5]
    data = bytearray(path.read_bytes())
    data[offset + count // 2 : offset + count] = bytes(count - count // 2)
    path.write_bytes(data)
    with limen.data.open(path) as image:
        image.read_page((0, 3, 3))
        with pytest.raises(PageError, match=r"a\.tif: the page at level 0, column 1, row 1 cannot be read"):
            image.read_page((0, 1, 1))


def test_reading_after_closing_is_an_error(tmp_path):
    path = write_tiff(tmp_path / "a.tif", [noisy_picture(600, 600)])
    image = limen.data.open(path)
    image.close()
    image.close()
    with pytest.raises(PageError):
        image.read_page(0)


def test_wrong_files_are_told_in_one_line(tmp_path):
    (tmp_path / "empty.tif").touch()
    (tmp_path / "text.jpg").write_text("no picture")
    (tmp_path / "bomb.dzi").write_text('<!DOCTYPE a [<!ENTITY b "c">]><Image/>')
    (tmp_path / "lost.dzi").write_text(
        '<Image TileSize="254" Overlap="1" Format="png"><Size Width="9" Height="9"/></Image>'
    )
    (tmp_path / "evil.dzi").write_text(
        '<Image TileSize="9" Overlap="1" Format="../x"><Size Width="9" Height="9"/></Image>'
    )
    cases = [("nowhere.tif", MissingFileError), (".", InputError)]
    cases += [(name, FormatError) for name in ("empty.tif", "text.jpg", "bomb.dzi", "lost.dzi", "evil.dzi")]
    for name, kind in cases:
        with pytest.raises(kind) as caught:
            limen.data.open(tmp_path / name)
        assert str(tmp_path) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_large_images_without_levels_name_the_command(tmp_path):
    path = tmp_path / "large.png"
    pyvips.Image.black(12_000, 9_000).pngsave(str(path), compression=1)
    with pytest.raises(FormatError, match=rf"limen ingest {path} {tmp_path}/large\.pyramid\.tif"):
        limen.data.open(path)


def test_info_says_what_the_file_is(tmp_path):
    path = write_tiff(tmp_path / "a.tif", levels_of(noisy_picture(700, 600), 1), compression="deflate")
    with limen.data.open(path) as image:
        info = image.info()
    assert (info.kind, info.size, info.page_px) == ("image", (700, 600), 256)
    assert info.levels == [(700, 600), (350, 300), (175, 150)]
    assert info.file_levels == [(700, 600), (350, 300)]
    assert "DEFLATE" in info.compression


@pytest.mark.data
def test_a_real_slide_equals_what_openslide_reads(data_dir):
    openslide = pytest.importorskip("openslide")
    path = data_dir / "image" / "CMU-1-Small-Region.svs"
    with limen.data.open(path) as image, openslide.OpenSlide(str(path)) as slide:
        assert image.size_px == slide.dimensions == (2220, 2967)
        page = image.read_page((0, 3, 4), gutter=0)[..., :3]
        reference = np.asarray(slide.read_region((3 * 256, 4 * 256), 0, (256, 256)))[..., :3]
        assert np.abs(page.astype(int) - reference).max() <= 2
        top = image.read_page(image.pyramid.page_count - 1, gutter=0)
        thumbnail = light_of(np.asarray(slide.get_thumbnail((139, 186)))).mean((0, 1))
        mean = light_of(top[:186, :139, :3].astype(float)).mean((0, 1))
        assert np.abs(codes_of(mean).astype(int) - codes_of(thumbnail)).max() <= 2


def test_a_format_that_is_not_read_is_not_called_damaged(tmp_path):
    valid = tmp_path / "valid.tga"
    Picture.fromarray(np.zeros((8, 8, 3), np.uint8)).save(valid)
    with pytest.raises(FormatError, match="of no image format that limen reads: make a TIFF") as told:
        limen.data.open(valid)
    assert "damaged" not in str(told.value)
    cut = tmp_path / "cut.png"
    Picture.fromarray(np.zeros((8, 8, 3), np.uint8)).save(cut)
    cut.write_bytes(cut.read_bytes()[:20])
    with pytest.raises(FormatError, match="damaged"):
        limen.data.open(cut)
