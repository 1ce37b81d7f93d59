"""``ingest_image``: any image that is read becomes a tiled, pyramidal BigTIFF, in bounded memory and in one pass."""

from __future__ import annotations

import itertools
import os
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyvips
from numpy.typing import NDArray

from limen.data.image import vips
from limen.data.image.bigtiff import DeflateTiles, JpegTiles
from limen.data.image.deepzoom import open_deepzoom
from limen.data.image.file import unreadable_zstandard
from limen.data.image.pyramid_writer import PyramidWriter
from limen.data.image.tiff import TiffImage
from limen.data.image.tiles import TileLevel
from limen.data.pages import Pyramid
from limen.data.store.file_type import existing_file, is_tiff
from limen.data.store.ingest import Progress
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport, one_line
from limen.errors import FormatError, InputError
from limen.system import worker_count

__all__ = ["ingest_image"]

Texels = NDArray[np.uint8]

_ROWS_AT_ONCE = 128
"""Rows that are read ahead while those before are compressed."""


@dataclass(frozen=True, slots=True)
class _Source:
    """Rows of an image from top to bottom, (n, width, bands) uint8 sRGB."""

    size_px: tuple[int, int]
    bands: int
    rows: Generator[Texels, None, None]


def ingest_image(
    src: str | Path,
    dst: str | Path,
    *,
    progress: Progress | None = None,
    quality: int = 90,
    subsampling: str = "444",
    workers: int | None = None,
) -> IngestReport:
    """Write ``src`` as a pyramidal BigTIFF ``dst``: tiles of 256, JPEG (deflate where there is opacity), sRGB.

    Embedded colour profiles are applied. The contrast of the pages (:mod:`limen.data.image.contrast`) is written beside
    ``dst``. ``progress`` is called with the fraction done, 0..1. ``dst`` appears, or is replaced, only when all is
    written; on any error nothing is left behind. Raises MissingFileError, FormatError (``src`` cannot be read, or only
    in part), InputError (``dst`` is ``src``, or no .tif), StorageError.
    """
    src, dst = existing_file(src), Path(dst)
    _check_target(src, dst)
    if not 1 <= quality <= 100 or subsampling not in ("444", "422", "420"):
        raise InputError(f"quality {quality} must lie in 1 to 100 and subsampling {subsampling!r} be 444, 422 or 420")
    with Footprint() as used, ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(workers or worker_count(), thread_name_prefix="limen-read"))
        source = _open_source(src, stack, pool)
        stack.enter_context(closing(source.rows))
        coder = JpegTiles(quality, subsampling) if source.bands == 3 else DeflateTiles()
        with PyramidWriter(dst, source.size_px, coder, workers=workers, progress=progress) as writer:
            done = 0
            for rows in stack.enter_context(closing(_ahead(source.rows))):
                writer.push(rows)
                done += rows.shape[0]
            if done != source.size_px[1]:
                raise FormatError(f"{src}: ends after {done} of {source.size_px[1]} rows; copy it again")
    width, height = source.size_px
    pages = Pyramid.of(source.size_px).page_count
    return IngestReport.of("image", dst, used, size=source.size_px, pixels=width * height, pages=pages)


def _check_target(src: Path, dst: Path) -> None:
    if dst.suffix.lower() not in (".tif", ".tiff"):
        raise InputError(f"{dst}: the result is a TIFF; give it a name that ends in .tif")
    if dst.exists() and dst.samefile(src):
        raise InputError(f"{dst}: is the source itself; name another file for the result")


def _ahead(rows: Iterator[Texels]) -> Generator[Texels, None, None]:
    """The same blocks, each made in a thread while the one before is used."""
    with ThreadPoolExecutor(1, thread_name_prefix="limen-ahead") as reader:
        coming = reader.submit(next, rows, None)
        while (block := coming.result()) is not None:
            coming = reader.submit(next, rows, None)
            yield block


def _open_source(path: Path, stack: ExitStack, pool: ThreadPoolExecutor) -> _Source:
    if path.suffix.lower() == ".dzi":
        finest = open_deepzoom(path)[0]
        bands = 4 if finest.suffix.lower() not in (".jpg", ".jpeg") and not _is_opaque(path, finest) else 3
        return _Source(finest.size_px, bands, _tile_rows(path, finest, bands, pool))
    if is_tiff(path):
        tiff = stack.enter_context(TiffImage(path))
        if not tiff.obstacle:
            level = tiff.levels[0]
            bands = 4 if level.has_opacity else 3
            rows = _tile_rows(path, level, bands, pool)
            if vips.profile_name(tiff.icc_profile) == "other":
                rows = _converted(path, rows, tiff.icc_profile or b"")
            return _Source(level.size_px, bands, rows)
        if tiff.misread_by_vips:
            raise FormatError(unreadable_zstandard(path, tiff.obstacle))
    image = vips.to_srgb(vips.load(path, sequential=True))
    return _Source((image.width, image.height), image.bands, _vips_rows(path, image))


def _is_opaque(path: Path, level: TileLevel) -> bool:
    try:
        return bool((level.decode(0, 0)[..., 3] == 255).all())
    except (ValueError, OSError) as error:
        raise FormatError(f"{path}: its first tile cannot be read ({one_line(error)}); copy it again") from error


def _vips_rows(path: Path, image: pyvips.Image) -> Generator[Texels, None, None]:
    """One run of libvips' pipeline, its texels through a pipe: the only way that suits every sequential loader.

    (Cropping block after block starts a pipeline for each, and some loaders cannot resume.)
    """
    width, height, bands = image.width, image.height, image.bands
    outlet, inlet = os.pipe()
    with ThreadPoolExecutor(1, thread_name_prefix="limen-vips") as runner, os.fdopen(outlet, "rb", 0) as stream:
        running = runner.submit(_run_pipeline, image, inlet)
        for y in range(0, height, _ROWS_AT_ONCE):
            rows = np.empty((min(_ROWS_AT_ONCE, height - y), width, bands), dtype=np.uint8)
            if not _fill(rows, stream):
                break
            yield rows
        stream.close()  # a pipeline that still wants to write ends with an error of its own, which nobody waits for
        problem = running.exception()
    if isinstance(problem, pyvips.Error) and y + _ROWS_AT_ONCE < height:
        raise FormatError(
            f"{path}: cannot be decoded beyond row {y}, it is damaged or cut short ({one_line(problem)}); copy it again"
        ) from problem


def _run_pipeline(image: pyvips.Image, inlet: int) -> None:
    def write(chunk: bytes) -> int:
        try:
            return os.write(inlet, chunk)
        except OSError:  # nobody reads any more; libvips takes this for a failure and stops
            return -1

    target = pyvips.TargetCustom()
    target.on_write(write)
    try:
        image.rawsave_target(target)
    finally:
        os.close(inlet)


def _fill(rows: Texels, stream: BinaryIO) -> bool:
    """Whether the stream held enough to fill the rows."""
    view, done = rows.reshape(-1).data, 0
    while done < len(view):
        count = stream.readinto(view[done:])  # type: ignore[attr-defined]
        if not count:
            return False
        done += count
    return True


def _tile_rows(path: Path, level: TileLevel, bands: int, pool: ThreadPoolExecutor) -> Generator[Texels, None, None]:
    """Blocks of whole rows of tiles, decoded by many threads straight into place."""
    (width, height), (tile_w, tile_h) = level.size_px, level.tile_px
    tiles_down = max(1, _ROWS_AT_ONCE // tile_h)
    for top in range(0, height, tile_h * tiles_down):
        block = np.empty((min(tile_h * tiles_down, height - top), width, bands), dtype=np.uint8)

        def place(column: int, row: int, top: int = top, block: Texels = block) -> None:
            try:
                tile = level.decode(column, row)
            except (ValueError, OSError) as error:
                raise FormatError(
                    f"{path}: the tile in column {column}, row {row} cannot be read ({one_line(error)}); copy it again"
                ) from error
            y, x = row * tile_h - top, column * tile_w
            block[y : y + tile.shape[0], x : x + tile.shape[1]] = tile[..., :bands]

        first = top // tile_h
        grid = itertools.product(range(-(-width // tile_w)), range(first, first + -(-block.shape[0] // tile_h)))
        for done in [pool.submit(place, column, row) for column, row in grid]:
            done.result()
        yield block


def _converted(path: Path, blocks: Iterator[Texels], profile: bytes) -> Generator[Texels, None, None]:
    for rows in blocks:
        height, width, bands = rows.shape
        image = pyvips.Image.new_from_memory(rows.data, width, height, bands, "uchar").copy(interpretation="srgb")
        image.set_type(pyvips.GValue.blob_type, "icc-profile-data", profile)
        try:
            yield vips.texels_of(vips.to_srgb(image))
        except pyvips.Error as error:
            raise FormatError(f"{path}: its colour profile cannot be applied ({one_line(error)})") from error
