"""The survey of an image's pages, the file that keeps it, and what ingest leaves."""

from __future__ import annotations

import logging
import os
import shutil
import time

import msgspec
import numpy as np
import pytest
import pyvips
import tifffile

import limen.data
from limen.data.image import contrast_file
from limen.data.image.contrast import UNKNOWN, ContrastSurvey, page_contrast
from limen.data.image.contrast_file import byte_of_contrast, read_contrast, sidecar_of
from limen.errors import StorageError
from support.contrast_reference import reference
from support.pictures import noisy_picture, smooth_picture, write_tiff


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    """Nobody's own cache is written to."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "limen"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "a.png"
    texels = smooth_picture(1400, 1100)
    texels[:400, 1100:] = noisy_picture(300, 400)  # beyond the first page of level 2
    pyvips.Image.new_from_array(texels).pngsave(str(path), compression=1)
    return path


@pytest.fixture
def picture(tmp_path, saved):
    """In a folder of its own, where files come to lie beside it."""
    return shutil.copyfile(saved, tmp_path / "a.png")


def bytes_of(path):
    with limen.data.open(path) as image:
        return page_contrast(image)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


# ------------------------------------------------------------------------------------------- files of all kinds


@pytest.mark.parametrize("kind", ["dzi", "vips", "jpeg", "transparent", "gaps"])
def test_files_of_others_are_measured_as_they_are_read(tmp_path, kind):
    picture = smooth_picture(1400, 1100)
    picture[500:700, 300:600] = noisy_picture(300, 200)
    image = pyvips.Image.new_from_array(picture)
    path = tmp_path / {"dzi": "a.dzi", "jpeg": "a.jpg"}.get(kind, "a.tif")
    if kind == "dzi":
        image.dzsave(str(tmp_path / "a"), suffix=".png", overlap=1, tile_size=254)
    elif kind == "vips":
        image.tiffsave(str(path), tile=True, pyramid=True, compression="jpeg", Q=80)
    elif kind == "jpeg":
        image.jpegsave(str(path), Q=80)
    elif kind == "transparent":
        opacity = smooth_picture(1400, 1100, seed=4)[..., :1]
        write_tiff(path, [np.dstack([picture, opacity])], extrasamples=["unassalpha"])
    else:
        write_tiff(path, [picture, picture[::4, ::4]])
    with limen.data.open(path) as opened:
        found, pyramid = page_contrast(opened), opened.pyramid
        assert found.shape == (pyramid.page_count,)
        assert found.dtype == np.uint8
        assert not found[: pyramid.levels[0].page_count].any()
        for page in range(pyramid.levels[1].first_page, pyramid.page_count, 3):
            plain = byte_of_contrast(reference(opened, *pyramid.page_of(page)))
            assert abs(plain - int(found[page])) <= 1


@pytest.mark.data
def test_a_real_slide_is_measured(data_dir, tmp_path):
    path = shutil.copy(data_dir / "image" / "CMU-1-Small-Region.svs", tmp_path)
    with limen.data.open(path) as slide:
        found = page_contrast(slide)
        page = slide.pyramid.levels[1].first_page + 7
        assert abs(byte_of_contrast(reference(slide, *slide.pyramid.page_of(page))) - int(found[page])) <= 1
        assert len(np.unique(found[slide.pyramid.levels[1].first_page :])) > 3


# ------------------------------------------------------------------------------------------- the file beside


def test_what_was_found_is_kept_and_not_found_again(tmp_path, picture, monkeypatch):
    first = bytes_of(picture)
    assert names(tmp_path) == ["a.png", "a.png.contrast"]
    with limen.data.open(picture) as image:
        monkeypatch.setattr(image, "read_page", lambda *_, **__: pytest.fail("a page was read"))
        assert np.array_equal(page_contrast(image), first)
        assert image.info().contrast == "known"


def damage(content, how):
    line, payload = content.split(b"\n", 1)
    header = msgspec.json.decode(line)
    if how == "version":
        return msgspec.json.encode({**header, "version": 99}) + b"\n" + payload
    if how == "another-size":
        return msgspec.json.encode({**header, "size": [1, 1]}) + b"\n" + payload
    return {
        "cut": content[:-3],
        "empty": b"",
        "flipped": content[:-5] + bytes([content[-5] ^ 4]) + content[-4:],
        "foreign": b"%PDF-1.7 contrast of my own\nnothing",
        "binary": bytes(range(256)) * 4,
        "no-payload": line + b"\n",
        "list": b"[1, 2]\n" + payload,
    }[how]


def test_what_the_first_version_measured_otherwise_is_found_anew(picture):
    first = bytes_of(picture)
    sidecar = sidecar_of(picture)
    line, payload = sidecar.read_bytes().split(b"\n", 1)
    sidecar.write_bytes(msgspec.json.encode({**msgspec.json.decode(line), "version": 1}) + b"\n" + payload)
    with limen.data.open(picture) as image:
        assert read_contrast(image.path, image.pyramid) is None
    assert np.array_equal(bytes_of(picture), first)
    assert msgspec.json.decode(sidecar.read_bytes().split(b"\n", 1)[0])["version"] == 2


HOWS = ["cut", "empty", "flipped", "foreign", "binary", "no-payload", "list", "version", "another-size"]


@pytest.mark.parametrize("how", HOWS)
def test_a_damaged_or_foreign_file_is_replaced(picture, caplog, how):
    first = bytes_of(picture)
    sidecar = sidecar_of(picture)
    good = sidecar.read_bytes()
    sidecar.write_bytes(damage(good, how))
    with limen.data.open(picture) as image:
        assert image.info().contrast == "not yet"
        with caplog.at_level(logging.INFO, logger="limen"):
            assert read_contrast(image.path, image.pyramid) is None
        assert "a.png.contrast: is passed over" in caplog.text
        assert np.array_equal(page_contrast(image), first)
    assert sidecar.read_bytes() == good


def test_a_changed_image_is_measured_anew(picture):
    first = bytes_of(picture)
    time.sleep(0.01)
    pyvips.Image.new_from_array(np.full((1100, 1400, 3), 77, dtype=np.uint8)).pngsave(str(picture))
    assert first.any()
    assert not bytes_of(picture).any()


def test_a_read_only_folder_is_left_alone(tmp_path, picture, cache):
    tmp_path.chmod(0o555)
    try:
        first = bytes_of(picture)
        assert names(tmp_path) == ["a.png"]
        assert [path.suffix for path in cache.iterdir()] == [".contrast"]
        with limen.data.open(picture) as image:
            stored = read_contrast(image.path, image.pyramid)
        assert stored is not None
        assert stored.complete
        assert np.array_equal(stored.bytes, first)
    finally:
        tmp_path.chmod(0o755)


def test_where_no_disk_takes_the_bytes_they_are_found_all_the_same(tmp_path, picture, monkeypatch, caplog):
    def refuse(path, content):
        raise StorageError(f"{path}: cannot be written")

    with limen.data.open(picture) as image:
        monkeypatch.setattr(contrast_file, "write_bytes", refuse)
        assert page_contrast(image).any()
    assert "cannot be kept" in caplog.text
    assert names(tmp_path) == ["a.png"]


# ------------------------------------------------------------------------------------------- the survey


def test_a_survey_goes_from_coarse_to_fine_and_knows_what_it_does_not(picture, monkeypatch):
    expected = bytes_of(picture)
    sidecar_of(picture).unlink()
    with limen.data.open(picture) as image:
        levels, real = [], image.read_page
        finest = image.pyramid.levels[0].page_count

        def read_page(page, gutter=4):
            if gutter:
                levels.append(image.pyramid.page_of(page)[0])
            return real(page, gutter)

        monkeypatch.setattr(image, "read_page", read_page)
        with ContrastSurvey(image) as survey:
            assert (survey.bytes[finest:] == UNKNOWN).all()
            assert not survey.bytes[:finest].any()
            assert not survey.complete
            survey.start()
            survey.start()
            deadline = time.monotonic() + 60
            while not survey.complete and time.monotonic() < deadline:
                time.sleep(0.01)
            assert survey.complete
        assert np.array_equal(survey.bytes, expected)
        assert levels == sorted(levels, reverse=True)
        assert len(levels) == image.pyramid.page_count - finest


def test_a_survey_that_is_stopped_goes_on_next_time(picture, monkeypatch):
    expected = bytes_of(picture)
    sidecar_of(picture).unlink()
    with limen.data.open(picture) as image:
        real = image.read_page
        monkeypatch.setattr(image, "read_page", lambda *a, **b: (time.sleep(0.06), real(*a, **b))[1])

        def interrupt(done):
            if done > 0:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            page_contrast(image, progress=interrupt)
        stored = read_contrast(image.path, image.pyramid)
        assert stored is not None
        assert not stored.complete
        known = stored.known.sum()
        assert known > image.pyramid.levels[0].page_count
        assert np.array_equal(stored.bytes[stored.known], expected[stored.known])
        assert (stored.bytes[~stored.known] == UNKNOWN).all()
        assert image.info().contrast == "not yet"
        monkeypatch.setattr(image, "read_page", real)
        survey = ContrastSurvey(image)
        assert survey.pages.known.sum() == known
        survey.close()  # before it was started
        done = []
        assert np.array_equal(page_contrast(image, progress=done.append), expected)
        assert done[-1] == 1.0


def test_our_own_fault_in_a_thread_is_raised(picture, monkeypatch):
    with limen.data.open(picture) as image:
        monkeypatch.setattr(image, "read_page", lambda *_, **__: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            page_contrast(image)
    assert not sidecar_of(picture).exists()


def test_pages_that_cannot_be_read_may_hold_anything_and_are_tried_again(tmp_path, picture, caplog, monkeypatch):
    path = tmp_path / "a.tif"
    limen.data.ingest(picture, path)
    good = bytes_of(path)
    content, state = path.read_bytes(), path.stat()
    with tifffile.TiffFile(path) as tiff:
        at, count = tiff.pages[1].dataoffsets[4], tiff.pages[1].databytecounts[4]  # level 1, column 1, row 1
    path.write_bytes(content[:at] + b"\0" * count + content[at + count :])
    found = bytes_of(path)
    with limen.data.open(path) as image:
        index = image.pyramid.page_index
        # Its own, those whose gutter reaches into it, and the page above it.
        lost = {index(1, x, y) for x in (0, 1, 2) for y in (0, 1, 2)} | {index(2, 0, 0)}
        stored = read_contrast(path, image.pyramid)
    kept = np.array([page not in lost for page in range(len(good))])
    assert stored is not None
    assert np.array_equal(stored.known, kept)
    assert (found[~kept] == UNKNOWN).all()
    assert np.array_equal(found[kept], good[kept])
    assert f"the contrast of {len(lost)} pages is not known" in caplog.text
    # A disk that fails for a while leaves the file what it was.
    os.utime(path, ns=(state.st_atime_ns, path.stat().st_mtime_ns))
    changed = path.stat().st_mtime_ns
    path.write_bytes(content)
    os.utime(path, ns=(changed, changed))
    with limen.data.open(path) as image:
        asked, real = set(), image.read_page
        monkeypatch.setattr(image, "read_page", lambda page, gutter=4: (asked.add(page), real(page, gutter))[1])
        assert np.array_equal(page_contrast(image), good)
        assert {page for page in asked if isinstance(page, int)} == lost


# ------------------------------------------------------------------------------------------- ingest


@pytest.mark.parametrize("bands", [3, 4], ids=["jpeg", "deflate"])
def test_ingest_leaves_two_files_and_the_bytes_are_those_of_what_is_read_back(tmp_path, bands):
    texels = np.dstack([smooth_picture(1400, 1100), noisy_picture(1400, 1100)])[..., :bands]
    pyvips.Image.new_from_array(texels).pngsave(str(tmp_path / "a.png"), compression=1)
    folder = tmp_path / "made"
    folder.mkdir()
    done = []
    limen.data.ingest(tmp_path / "a.png", folder / "a.tif", progress=done.append)
    assert names(folder) == ["a.tif", "a.tif.contrast"]
    assert done == sorted(done)
    assert done[-1] == 1.0
    with limen.data.open(folder / "a.tif") as image:
        stored = read_contrast(image.path, image.pyramid)
        assert stored is not None
        assert stored.complete
        sidecar_of(image.path).unlink()
        assert np.array_equal(page_contrast(image), stored.bytes)


@pytest.mark.parametrize("when", [0.3, 0.9], ids=["rows", "contrast"])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interruption_leaves_neither(tmp_path, picture, when, error):
    def interrupt(done):
        if done > when:
            raise error

    with pytest.raises(error):
        limen.data.ingest(picture, tmp_path / "a.tif", progress=interrupt)
    assert names(tmp_path) == ["a.png"]


def test_the_sample_has_its_bytes_and_info_tells_how_much_is_faint(tmp_path):
    limen.data.sample_image(tmp_path / "s.tif", 0.002, seed=1)
    assert names(tmp_path) == ["s.tif", "s.tif.contrast"]
    with limen.data.open(tmp_path / "s.tif") as image:
        info, found = image.info(), page_contrast(image)
        assert info.contrast == "known"
        assert info.faint_share is not None
        assert len(info.faint_share) == len(info.levels) - 1
        for level, share in zip(image.pyramid.levels[1:], info.faint_share, strict=True):
            part = found[level.first_page : level.first_page + level.page_count]
            assert share == pytest.approx((part <= byte_of_contrast(0.01)).mean(), abs=1e-4)
