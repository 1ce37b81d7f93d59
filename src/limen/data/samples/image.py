"""``sample_image``: an imaginary world of any size, with something to see at every distance."""

from __future__ import annotations

import functools
import math
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from limen.data.image.bigtiff import JpegTiles
from limen.data.image.pyramid_writer import PyramidWriter
from limen.data.samples.noise import BLOCK, FIELDS, land_at
from limen.data.samples.painting import paint_block
from limen.data.samples.seeds import check_seed
from limen.data.store.ingest import Progress
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport
from limen.errors import InputError

__all__ = ["WALL_ASPECT", "sample_image", "sample_size_px"]

Texels = NDArray[np.uint8]

WALL_ASPECT = 133_120 / 11_520
"""Width by height of the unrolled wall of a room of 416 panels."""

_LARGEST_GIGAPIXELS = 10_000.0
_ATTEMPTS = 32
_LEAST_LAND, _MOST_LAND = 0.4, 0.75


def sample_size_px(gigapixels: float, aspect: float, width_px: int | None = None) -> tuple[int, int]:
    """(width, height) nearest to what is asked for.

    >>> sample_size_px(1.5335424, WALL_ASPECT)
    (133120, 11520)
    """
    if not (0.0 < gigapixels <= _LARGEST_GIGAPIXELS):
        raise InputError(
            f"{gigapixels} gigapixels cannot be drawn; give more than 0 and at most {_LARGEST_GIGAPIXELS:.0f}"
        )
    if not (0.01 <= aspect <= 100.0):
        raise InputError(f"an aspect of {aspect} is no picture; give a width by height between 0.01 and 100")
    if width_px is not None and not 1 <= width_px <= 10_000_000:
        raise InputError(f"a width of {width_px} texels cannot be drawn; give 1 to 10,000,000")
    width = width_px if width_px is not None else max(1, round(math.sqrt(gigapixels * 1e9 * aspect)))
    return width, max(1, round(width / aspect))


def sample_image(
    path: str | Path,
    gigapixels: float | None = None,
    seed: int = 0,
    aspect: float | None = None,
    progress: Progress | None = None,
    *,
    size: int | None = None,
    quality: int = 90,
    workers: int | None = None,
) -> IngestReport:
    """Draw the world number ``seed`` into a pyramidal TIFF; the same texels on every run, with any number of workers.

    ``gigapixels`` are 1 unless given, or ``size``, the width in texels. ``aspect`` is width by height,
    :data:`WALL_ASPECT` unless given. The image is never held in memory. Raises InputError for sizes that cannot be
    meant, StorageError or MissingFileError where ``path`` cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise InputError(f"{path}: the sample is a TIFF; give it a name that ends in .tif")
    if size is not None and gigapixels is not None:
        raise InputError("--size and --gigapixels both say how large; give one of them")
    check_seed(seed)
    aspect = WALL_ASPECT if aspect is None else aspect
    size_px = sample_size_px(1.0 if gigapixels is None else gigapixels, aspect, size)
    coder = JpegTiles(quality)
    with Footprint() as used, PyramidWriter(path, size_px, coder, workers=workers, progress=progress) as writer:
        for top in range(0, size_px[1], BLOCK):
            writer.push(paint_rows(seed, top, size_px, writer.pool))
    pixels, pages = size_px[0] * size_px[1], writer.pyramid.page_count
    return IngestReport.of("image", path, used, size=size_px, seed=seed, pixels=pixels, pages=pages)


@functools.cache
def _world_of(seed: int, size_px: tuple[int, int]) -> int:
    """The number of a world that shows both land and sea on its day side.

    Seeds of the noises are small numbers counted up from a world's, so worlds must lie far apart.
    """
    width, height = size_px
    fields = np.empty(FIELDS, dtype=np.float64)
    worlds = [seed * 100_003 + 1_009 * attempt for attempt in range(_ATTEMPTS)]
    for world in worlds:
        dry = []
        for y in np.linspace(0.1, 0.9, 6) * height:
            for x in np.linspace(0.05, 0.6, max(6, round(4 * width / height))) * width:
                land_at(world, float(x), float(y), float(height), fields)
                dry.append(fields[0] > 0.0)
        if _LEAST_LAND <= np.mean(dry) <= _MOST_LAND:
            return world
    return worlds[0]


def paint_rows(seed: int, top: int, size_px: tuple[int, int], pool: Executor) -> Texels:
    """Rows ``top`` (a multiple of 256) and up to 255 more: (n, width, 3) uint8."""
    width, height = size_px
    rows = np.empty((min(BLOCK, height - top), width, 3), dtype=np.uint8)
    world = _world_of(seed, size_px)
    blocks = [
        pool.submit(paint_block, world, left, top, width, height, rows[:, left : left + BLOCK])
        for left in range(0, width, BLOCK)
    ]
    for block in blocks:
        block.result()
    return rows
