"""Rasters of heights as other programs write them, read through rasterio (GDAL)."""

from __future__ import annotations

import contextlib
import logging
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from limen.data.store.report import one_line
from limen.data.terrain.georeference import bounds_of, metres_of_unit, spacing_of
from limen.errors import FormatError, InputError

__all__ = ["ElevationSource", "PostRect"]

# GDAL's remarks come through this logger; without a handler Python itself would print them on stderr.
logging.getLogger("rasterio").addHandler(logging.NullHandler())

_HEIGHTS = re.compile(r"\b(heights?|elevations?|altitudes?|dem|dsm|dtm|dhm|topography|bathymetry|z)\b", re.IGNORECASE)
_SHORT_VOID = -32768
"""What SRTM and many after it write where there is no data, declared or not; no place is so deep."""
_LARGEST = 1e30
"""Beyond are the limits of float types, which stand for no data, declared or not."""
_CACHE_MIB = 64


class PostRect(NamedTuple):
    """A rectangle of posts."""

    column: int
    row: int
    columns: int
    rows: int


@dataclass(frozen=True, slots=True)
class _Coding:
    """How numbers in the file become metres."""

    band: int
    dtype: np.dtype[Any]
    scale: float
    offset: float
    metres: float
    masked: bool

    @property
    def as_stored(self) -> bool:
        return (self.scale, self.offset, self.metres) == (1.0, 0.0, 1.0)


class ElevationSource:
    """One band of heights. A context manager; for one thread at a time.

    Rows run towards the south (or what is down in a raster without georeference): a raster whose rows run north is
    turned over, or the land would be mirrored.

    Parameters
    ----------
    path
        Any raster that GDAL reads: GeoTIFF, COG, VRT, HGT, ASC, ...
    band
        Which one, from 1; None for the only one, or the only one whose description says that it holds heights.
    spacing_m
        Metres between posts along columns and rows, where the file does not say it or is wrong.

    Attributes
    ----------
    size_posts
        Columns and rows, at least 2 x 2.
    dtype
        What `read` gives: int16 where the file holds whole metres of 16 bits, otherwise float32.
    exact
        Whether every height of the file is a ``dtype``; 64-bit ones and large whole numbers are rounded.
    spacing_m
        Metres between posts along columns and rows.
    crs
        The coordinate system as WKT, or "".
    transform
        Six numbers a ... f of the affine map from column and row to coordinates (of pixels' corners); None if there is
        no georeference.
    notes
        What had to be assumed, a line each, with its cure.

    Raises
    ------
    FormatError
        If it is no raster, or its heights cannot be used.
    InputError
        If ``band`` or ``spacing_m`` do not fit.
    """

    def __init__(
        self, path: str | Path, *, band: int | None = None, spacing_m: float | tuple[float, float] | None = None
    ) -> None:
        self.path = Path(path)
        with _quiet():
            try:
                self._dataset = rasterio.open(self.path)
            except RasterioError as error:
                raise FormatError(f"{self.path}: is no raster that can be read ({_reason(error)})") from error
        try:
            self._describe(band, spacing_m)
        except BaseException:
            self._dataset.close()
            raise

    def _describe(self, band: int | None, spacing_m: float | tuple[float, float] | None) -> None:
        raster = self._dataset
        self.size_posts: tuple[int, int] = raster.width, raster.height
        self._coding, notes = _coding(self.path, raster, band)
        if min(self.size_posts) < 2:
            columns, rows = self.size_posts
            raise FormatError(f"{self.path}: {columns} x {rows} posts are no surface; at least 2 x 2 are needed")
        kept = np.dtype(np.int16), np.dtype(np.uint8), np.dtype(np.int8)
        self.dtype: np.dtype[Any] = np.dtype(
            np.int16 if self._coding.as_stored and self._coding.dtype in kept else np.float32
        )
        self.exact = np.can_cast(self._coding.dtype, self.dtype) and self._coding.as_stored
        if not self.exact:
            notes.append(f"heights ({self._coding.dtype}) are kept as float32, rounded to its 24 bits")
        a, b, c, d, e, f = tuple(raster.transform)[:6]
        located = not raster.transform.is_identity
        self._turned = bool(located and a * e - b * d > 0.0)
        if self._turned:
            b, c, e, f = -b, c + b * raster.height, -e, f + e * raster.height
        self.transform: tuple[float, ...] | None = (a, b, c, d, e, f) if located else None
        self.crs: str = raster.crs.to_wkt() if raster.crs else ""
        if spacing_m is None:
            self.spacing_m, note = spacing_of(raster.crs, self.transform, self.size_posts, str(self.path))
            notes += [note] if note else []
        else:
            self.spacing_m = _checked_spacing(spacing_m)
        self.notes = tuple(notes)

    @property
    def band(self) -> int:
        return self._coding.band

    @property
    def format(self) -> str:
        """GDAL's name of the file's format."""
        return str(self._dataset.driver)

    @property
    def bounds(self) -> tuple[float, ...] | None:
        """West, south, east, north in the units of ``crs``, of the pixels' outer borders; None if not georeferenced."""
        return bounds_of(self.transform, self.size_posts)

    def read(self, window: PostRect) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Heights in metres (rows, columns) of ``dtype``, and True where there are none (the height is 0 there).

        Raises FormatError where the file is damaged or cut short.
        """
        column, row, columns, rows = window
        first = self.size_posts[1] - row - rows if self._turned else row
        place = rasterio.windows.Window(column, first, columns, rows)
        with _quiet():
            try:
                stored = self._dataset.read(self._coding.band, window=place)
                mask = self._dataset.read_masks(self._coding.band, window=place) if self._coding.masked else None
            except (RasterioError, OSError) as error:
                raise FormatError(
                    f"{self.path}: the posts of rows {row} to {row + rows - 1}, columns {column} to "
                    f"{column + columns - 1} cannot be read, it is damaged or cut short ({_reason(error)}); "
                    "copy it again"
                ) from error
        heights, void = _decoded(stored, mask, self._coding, self.dtype)
        return (heights[::-1], void[::-1]) if self._turned else (heights, void)

    def close(self) -> None:
        self._dataset.close()

    def __enter__(self) -> ElevationSource:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Nothing of GDAL's on stderr, and its cache small: every block is read once."""
    with warnings.catch_warnings(), rasterio.Env(GDAL_CACHEMAX=_CACHE_MIB):
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


def _reason(error: BaseException) -> str:
    return one_line(error.__cause__ or error)


def _checked_spacing(spacing_m: float | tuple[float, float]) -> tuple[float, float]:
    x, y = spacing_m if isinstance(spacing_m, tuple) else (spacing_m, spacing_m)
    if not (0.0 < x < np.inf and 0.0 < y < np.inf):
        raise InputError(f"--spacing-m {x:g} by {y:g}: give metres between posts, more than 0")
    return float(x), float(y)


def _chosen_band(path: Path, raster: Any, band: int | None) -> int:
    """The number of the band of heights."""
    if raster.count == 0:
        inside = f"; it holds {len(raster.subdatasets)} rasters, name one: {raster.subdatasets[0]}"
        raise FormatError(f"{path}: holds no band of heights{inside if raster.subdatasets else ''}")
    if band is not None:
        if not 1 <= band <= raster.count:
            raise InputError(f"{path}: --band {band}: it has bands 1 to {raster.count}")
        return band
    opacities = (ColorInterp.alpha,)
    bands = [n for n, meaning in zip(raster.indexes, raster.colorinterp, strict=True) if meaning not in opacities]
    if len(bands) == 1:
        return int(bands[0])
    named = [n for n in bands if _HEIGHTS.search(raster.descriptions[n - 1] or "")]
    if len(named) == 1:
        return int(named[0])
    told = ", ".join(f"{n} ({raster.descriptions[n - 1] or raster.dtypes[n - 1]})" for n in bands)
    raise InputError(f"{path}: which of its bands are the heights? give --band, one of {told}")


def _coding(path: Path, raster: Any, band: int | None) -> tuple[_Coding, list[str]]:
    chosen = _chosen_band(path, raster, band)
    name = str(raster.dtypes[chosen - 1])
    if "complex" in name:
        raise FormatError(f"{path}: band {chosen} holds complex numbers, not heights; give another --band")
    unit = raster.units[chosen - 1]
    metres = metres_of_unit(unit)
    notes = [] if metres is not None else [f"the unit of heights, '{unit}', is not known; they are taken as metres"]
    masked = MaskFlags.all_valid not in raster.mask_flag_enums[chosen - 1]
    scale, offset = float(raster.scales[chosen - 1]), float(raster.offsets[chosen - 1])
    if not (np.isfinite([scale, offset]).all() and scale != 0.0):
        raise FormatError(f"{path}: band {chosen} has scale {scale:g} and offset {offset:g}; mend its metadata")
    return _Coding(chosen, np.dtype(name), scale, offset, metres or 1.0, masked), notes


def _decoded(
    stored: NDArray[Any], mask: NDArray[np.uint8] | None, coding: _Coding, dtype: np.dtype[Any]
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    void = np.zeros(stored.shape, dtype=np.bool_) if mask is None else mask == 0
    if coding.dtype == np.int16:
        void |= stored == _SHORT_VOID
    elif coding.dtype.kind == "f":
        void |= ~(np.abs(stored) < _LARGEST)  # NaN is not less
    if coding.as_stored:
        heights = stored.astype(dtype, copy=True)
    else:
        exact = stored.astype(np.float64)
        heights = ((exact * coding.scale + coding.offset) * coding.metres).astype(dtype)
    heights[void] = 0
    return heights, void
