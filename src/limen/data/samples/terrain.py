"""``sample_terrain``: imaginary mountains of any size, as another program's GeoTIFF would hold them."""

from __future__ import annotations

import itertools
import logging
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.errors import RasterioError
from rasterio.windows import Window

from limen.data.samples.seeds import check_seed
from limen.data.samples.terrain_kernels import heights_of_block
from limen.data.store.atomic import partial_file
from limen.data.store.ingest import Progress
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport, one_line
from limen.errors import InputError, StorageError
from limen.system import worker_count

__all__ = ["SAMPLE_SPACING_M", "sample_heights", "sample_terrain"]

SAMPLE_SPACING_M = 30.0

_BLOCK = 512
_CRS, _WEST_M, _NORTH_M = 32611, 300_000.0, 4_400_000.0  # UTM zone 11 north
_LARGEST = 1 << 20
_WORLDS_APART = 100_003

logging.getLogger("rasterio").addHandler(logging.NullHandler())


def sample_heights(seed: int, column: int, row: int, columns: int, rows: int) -> NDArray[np.float32]:
    """Heights in metres (rows, columns) from post (column, row) on, both multiples of 4."""
    heights_m = np.empty((rows, columns), np.float32)
    heights_of_block(seed * _WORLDS_APART, column, row, SAMPLE_SPACING_M, heights_m)
    return heights_m


def sample_terrain(
    path: str | Path,
    size: int = 4096,
    seed: int = 0,
    *,
    dtype: Literal["int16", "float32"] = "int16",
    workers: int | None = None,
    progress: Progress | None = None,
) -> IngestReport:
    """Write ``size`` x ``size`` posts of the mountains number ``seed``, 30 m apart, as a tiled GeoTIFF.

    The same heights on every run, with any number of workers; a larger size continues a smaller one. Raises InputError
    for what cannot be meant, StorageError or MissingFileError where ``path`` cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise InputError(f"{path}: the sample is a GeoTIFF; give it a name that ends in .tif")
    if not 2 <= size <= _LARGEST:
        raise InputError(f"{size} x {size} posts cannot be made; give 2 to {_LARGEST:,}")
    check_seed(seed)
    if dtype not in ("int16", "float32"):
        raise InputError(f"heights as {dtype} are not made; give int16 or float32")
    with Footprint() as used, partial_file(path) as file:
        try:
            _write(Path(file.name), size, seed, dtype, workers or worker_count(), progress or (lambda _: None))
        except (RasterioError, OSError) as error:
            raise StorageError(
                f"{path}: cannot be written ({one_line(error.__cause__ or error)}); free some space"
            ) from error
    return IngestReport.of("terrain", path, used, size=(size, size), seed=seed, spacing_m=SAMPLE_SPACING_M)


def _write(path: Path, size: int, seed: int, dtype: str, workers: int, progress: Progress) -> None:
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "width": size,
        "height": size,
        "count": 1,
        "dtype": dtype,
        "crs": CRS.from_epsg(_CRS),
        "transform": rasterio.Affine(SAMPLE_SPACING_M, 0.0, _WEST_M, 0.0, -SAMPLE_SPACING_M, _NORTH_M),
        "tiled": True,
        "blockxsize": _BLOCK,
        "blockysize": _BLOCK,
        "compress": "deflate",
        "zlevel": 4,
        "predictor": 3 if dtype == "float32" else 2,
        "bigtiff": "if_safer",
    }
    blocks = -(-size // _BLOCK)
    with rasterio.Env(GDAL_CACHEMAX=64), rasterio.open(path, "w", **profile) as file:
        file.set_band_description(1, "elevation")
        file.set_band_unit(1, "metre")
        with ThreadPoolExecutor(workers, thread_name_prefix="limen-sample") as pool:
            for count, (place, heights) in enumerate(_ahead(pool, size, seed, dtype, workers)):
                file.write(heights, 1, window=place)
                progress((count + 1) / blocks**2)


def _ahead(
    pool: ThreadPoolExecutor, size: int, seed: int, dtype: str, workers: int
) -> Iterator[tuple[Window, NDArray[Any]]]:
    """All blocks in the order of the file's tiles, made while those before are written."""
    waiting: deque[tuple[Window, Future[NDArray[Any]]]] = deque()
    for row, column in itertools.product(range(0, size, _BLOCK), repeat=2):
        place = Window(column, row, min(_BLOCK, size - column), min(_BLOCK, size - row))
        waiting.append((place, pool.submit(_block, seed, place, dtype)))
        if len(waiting) > 2 * workers:
            first, made = waiting.popleft()
            yield first, made.result()
    for place, made in waiting:
        yield place, made.result()


def _block(seed: int, place: Window, dtype: str) -> NDArray[Any]:
    heights_m = sample_heights(seed, place.col_off, place.row_off, place.width, place.height)
    return np.rint(heights_m).astype(np.int16) if dtype == "int16" else heights_m
