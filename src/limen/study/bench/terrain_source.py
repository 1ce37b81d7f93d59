"""The terrain that is measured: a raster of heights, part of one, or the sample, ingested into a folder of its own."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rasterio
from rasterio.errors import RasterioError

from limen.data.store.zarr_group import is_group_folder
from limen.data.terrain.elevation import ElevationSource, PostRect
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.errors import InputError, StorageError
from limen.study.bench.table import Say
from limen.study.triangulations import Posts

__all__ = ["parse_crop", "posts_of", "prepared", "write_crop"]

_SHORT_VOID = -32768


def parse_crop(text: str) -> PostRect:
    """``ROW,COLUMN,ROWS,COLUMNS`` of posts, from 0.

    >>> parse_crop("352,2400,4097,4097")
    PostRect(column=2400, row=352, columns=4097, rows=4097)

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        row, column, rows, columns = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--crop '{text}': give ROW,COLUMN,ROWS,COLUMNS, for example 352,2400,4097,4097") from None
    if min(row, column) < 0 or min(rows, columns) < 2:
        raise InputError(f"--crop '{text}': rows and columns count from 0, and 2 x 2 posts are the least")
    return PostRect(column, row, columns, rows)


@contextmanager
def prepared(content: Path | None, crop: PostRect | None, sample_size: int, say: Say) -> Iterator[Terrain]:
    """The terrain, ready to be drawn; what had to be made for it is gone afterwards.

    Parameters
    ----------
    content, crop
        A ``.terrain``, or a raster of heights and what part of it; by default a sample.
    sample_size
        Posts along a side of the sample terrain.

    Raises
    ------
    MissingFileError, FormatError, StorageError
        If it cannot be read or made ready.
    InputError
        If the crop does not lie inside.
    """
    if content is not None and is_group_folder(content):
        if crop:
            raise InputError(f"{content}: --crop takes part of a raster of heights; name the DEM that it was made of")
        yield Terrain.open(content)
        return
    with tempfile.TemporaryDirectory(prefix="limen-bench-") as folder:
        source = content or _sample(Path(folder) / "sample.tif", sample_size, say)
        if crop:
            source = write_crop(source, crop, Path(folder) / "crop.tif")
        target = Path(folder) / "content.terrain"
        say(f"ingesting {content.name if content else 'the sample terrain'}")
        ingest_terrain(source, target)
        yield Terrain.open(target)


def _sample(path: Path, size: int, say: Say) -> Path:
    from limen.data.samples.terrain import sample_terrain  # its kernels are not needed for a DEM

    say(f"making a sample terrain of {size} x {size} posts")
    sample_terrain(path, size)
    return path


def write_crop(source: Path, crop: PostRect, target: Path) -> Path:
    """Part of a raster of heights as a GeoTIFF, where it was on Earth.

    Raises
    ------
    InputError
        If it is not all inside.
    FormatError, StorageError
        If the raster cannot be read or the GeoTIFF not written.
    """
    with ElevationSource(source) as heights:
        columns, rows = heights.size_posts
        if crop.column + crop.columns > columns or crop.row + crop.rows > rows:
            raise InputError(
                f"--crop {crop.row},{crop.column},{crop.rows},{crop.columns}: is not all inside {source}, which has "
                f"{rows} rows and {columns} columns"
            )
        values, void = heights.read(crop)
        no_data = _SHORT_VOID if heights.dtype == np.int16 else np.nan
        profile = {
            "driver": "GTiff", "count": 1, "width": crop.columns, "height": crop.rows, "dtype": heights.dtype.name,
            "tiled": True, "blockxsize": 512, "blockysize": 512,
        }  # fmt: skip
        if void.any():
            values = np.where(void, np.asarray(no_data, values.dtype), values)
            profile["nodata"] = no_data
        if heights.transform is not None:
            a, b, c, d, e, f = heights.transform
            moved = c + a * crop.column + b * crop.row, f + d * crop.column + e * crop.row
            profile |= {"crs": heights.crs or None, "transform": rasterio.Affine(a, b, moved[0], d, e, moved[1])}
    try:
        with rasterio.open(target, "w", **profile) as written:
            written.write(values, 1)
    except (RasterioError, OSError) as error:
        raise StorageError(f"{target}: cannot be written ({error})") from error
    return target


def posts_of(terrain: Terrain) -> Posts:
    """All its heights in memory."""
    return Posts(*terrain.read_posts(0, 0, *terrain.size_posts), terrain.spacing_m)
