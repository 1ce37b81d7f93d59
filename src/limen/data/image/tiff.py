"""Pyramidal TIFFs in place: parsed once by tifffile, then single tiles by one ``pread`` each.

JPEG tiles in YCbCr or grey have the file's tables spliced in and go straight to RGBA; every other compression, and
JPEG in RGB (which a JPEG decoder would take for YCbCr), goes through tifffile's ``page.decode``. Levels may be
sub-images of the first page (OME-TIFF) or further pages (slides, cloud-optimised GeoTIFF, vips).
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import simplejpeg
import tifffile
from numpy.typing import NDArray

from limen.data.image.tiles import scales_of
from limen.data.pages import PAGE
from limen.errors import FormatError, StorageError

__all__ = ["ByteFile", "TiffImage", "TiffLevel"]

Texels = NDArray[np.uint8]

_OLD_JPEG, _JPEG, _ZSTD = 6, 7, (50000, 34926)
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE, _YCBCR = 0, 1, 2, 3, 6
_GDAL_TAGS = (33550, 34264, 34735, 42112, 42113)
"""Geographic tags: such levels are nearly always GDAL's, which stretches them over the whole image."""
_REDUCED, _MASK = 1, 4
_LARGEST_TILE_PX = 1 << 24
_MOST_PAGES = 64


class ByteFile:
    """A file whose bytes any thread may read by position."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        self._lock = threading.Lock()
        self.size_bytes = os.fstat(self._file.fileno()).st_size

    def read(self, offset: int, count: int) -> bytes:
        """``count`` bytes at ``offset``; ValueError where the file ends before."""
        if hasattr(os, "pread"):
            data = os.pread(self._file.fileno(), count, offset)
        else:  # Windows has no positioned read
            with self._lock:
                self._file.seek(offset)
                data = self._file.read(count)
        if len(data) != count:
            raise ValueError(f"{count} bytes wanted, the file ends after {len(data)}")
        return data

    def close(self) -> None:
        self._file.close()


@dataclass(frozen=True, slots=True)
class TiffLevel:
    """One page of a TIFF; strips are tiles as wide as the image."""

    page: Any
    file: ByteFile
    scale: tuple[float, float]
    offsets: NDArray[np.int64] = field(repr=False)
    counts: NDArray[np.int64] = field(repr=False)

    @property
    def size_px(self) -> tuple[int, int]:
        return (int(self.page.imagewidth), int(self.page.imagelength))

    @property
    def tile_px(self) -> tuple[int, int]:
        return _tile_px(self.page)

    @property
    def has_opacity(self) -> bool:
        return _opacity_band(self.page) is not None

    def mean_page_bytes(self) -> float:
        """Mean stored bytes of a page's area."""
        width, height = self.tile_px
        return float(self.counts.mean()) * PAGE * PAGE / (width * height)

    def decode(self, column: int, row: int) -> Texels:
        (width, height), (tile_w, tile_h) = self.size_px, self.tile_px
        w, h = min(tile_w, width - column * tile_w), min(tile_h, height - row * tile_h)
        index = row * -(-width // tile_w) + column
        count = int(self.counts[index])
        if count == 0:  # a hole of a sparse file: black, or nothing where the image has opacity
            return _empty(w, h, self.page)
        data = self.file.read(int(self.offsets[index]), count)
        rgba = self._jpeg(data) if _is_plain_jpeg(self.page) else self._any(data, index)
        if rgba.shape[0] < h or rgba.shape[1] < w:
            raise ValueError(f"it holds {rgba.shape[1]} x {rgba.shape[0]} texels instead of {w} x {h}")
        return rgba[:h, :w]

    def _jpeg(self, data: bytes) -> Texels:
        tables = self.page.jpegtables
        if tables:
            data = tables[:-2] + data[2:]
        rgba: Texels = simplejpeg.decode_jpeg(data, colorspace="RGBA")
        return rgba

    def _any(self, data: bytes, index: int) -> Texels:
        try:
            samples, _, _ = self.page.decode(data, index, jpegtables=self.page.jpegtables)
        except Exception as error:  # each codec has errors of its own, most derive from RuntimeError
            raise ValueError(f"{type(error).__name__}: {error}") from error
        return _rgba_of(samples[0], self.page)


class TiffImage:
    """The base page of a TIFF and the levels that belong to it, finest first; a context manager.

    Raises FormatError where the file is no TIFF or cut short. ``obstacle`` says why tiles cannot be read in place
    ('' if they can); then ``levels`` is empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.file = ByteFile(path)
        except OSError as error:
            raise StorageError(f"{path}: cannot be opened: {error.strerror}") from error
        self._tiff: Any = None
        try:
            pages = self._parse()
            self.base = pages[0]
            self.obstacle = _obstacle(self.base)
            self.levels = [] if self.obstacle else [self._level(page) for page in pages]
        except BaseException:
            self.close()
            raise

    @property
    def misread_by_vips(self) -> bool:
        """libvips builds without Zstandard read such tiles as black, without a word."""
        return self.base.compression in _ZSTD

    @property
    def icc_profile(self) -> bytes | None:
        tag = self.base.tags.get(34675)
        return bytes(tag.value) if tag is not None and isinstance(tag.value, bytes) else None

    @property
    def software(self) -> str:
        """The program that wrote the file, if it says so."""
        tag = self.base.tags.get(305)
        return str(tag.value) if tag is not None else ""

    def close(self) -> None:
        if self._tiff is not None:
            self._tiff.close()
        self.file.close()

    def __enter__(self) -> TiffImage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _parse(self) -> list[Any]:
        try:
            self._tiff = tifffile.TiffFile(self.path)
            base = self._tiff.pages[0]
            pages = [base, *_reductions_of(base, self._tiff)]
            self._check_chain(self._tiff.pages)
        except (tifffile.TiffFileError, struct.error, IndexError, ValueError, KeyError, OSError, TypeError) as error:
            if isinstance(error, FormatError):
                raise
            raise FormatError(
                f"{self.path}: cannot be read as TIFF: its directory is damaged or the file is cut short "
                f"({error}); copy it again"
            ) from error
        for page in pages:
            self._check_length(page)
        return pages

    def _check_chain(self, pages: Any) -> None:
        """tifffile stops without an error where the next directory lies beyond the end of the file."""
        last, kind = pages[-1], self._tiff.tiff
        (entries,) = struct.unpack(kind.tagnoformat, self.file.read(last.offset, kind.tagnosize))
        position = last.offset + kind.tagnosize + entries * kind.tagsize
        (following,) = struct.unpack(kind.offsetformat, self.file.read(position, kind.offsetsize))
        if following >= self.file.size_bytes:
            self._cut_short(following)

    def _check_length(self, page: Any) -> None:
        offsets, counts = np.asarray(page.dataoffsets, np.int64), np.asarray(page.databytecounts, np.int64)
        if offsets.size == 0 or offsets.size != counts.size:
            raise FormatError(f"{self.path}: cannot be read as TIFF: a page lists no tiles; copy or export it again")
        stop = int((offsets + counts).max())
        if stop > self.file.size_bytes:
            self._cut_short(stop)

    def _cut_short(self, wanted_bytes: int) -> None:
        raise FormatError(
            f"{self.path}: is cut short: it has {self.file.size_bytes:,} bytes and its directory points to byte "
            f"{wanted_bytes:,}; copy it again"
        )

    def _level(self, page: Any) -> TiffLevel:
        base = (int(self.base.imagewidth), int(self.base.imagelength))
        stretched = any(tag in self.base.tags for tag in _GDAL_TAGS)
        scale = scales_of(base, (int(page.imagewidth), int(page.imagelength)), stretched=stretched)
        offsets, counts = np.asarray(page.dataoffsets, np.int64), np.asarray(page.databytecounts, np.int64)
        return TiffLevel(page, self.file, scale, offsets, counts)


def _reductions_of(base: Any, tiff: Any) -> list[Any]:
    """Pages that hold the base page at smaller sizes, finest first."""
    candidates = list(base.pages) if base.subifds else []
    for number in range(1, _MOST_PAGES):
        with contextlib.suppress(IndexError):
            candidates.append(tiff.pages[number])
    found: dict[int, Any] = {}
    for page in candidates:
        if _is_reduction(base, page):
            found.setdefault(int(page.imagewidth), page)
    return sorted(found.values(), key=lambda page: -int(page.imagewidth))


def _is_reduction(base: Any, page: Any) -> bool:
    same = ("is_tiled", "samplesperpixel", "dtype", "planarconfig", "photometric")
    if any(getattr(page, name) != getattr(base, name) for name in same) or int(page.subfiletype) & _MASK:
        return False
    x, y = base.imagewidth / page.imagewidth, base.imagelength / page.imagelength
    # One texel of rounding on either side: anything farther off is another picture (a label, a macro photograph).
    slack = 2.0 * (1.0 / page.imagewidth + 1.0 / page.imagelength)
    marked = bool(base.subifds) or bool(int(page.subfiletype) & _REDUCED)
    return max(x, y) > (1.0 if marked else 1.5) and abs(x / y - 1.0) <= slack and not _obstacle(page)


def _tile_px(page: Any) -> tuple[int, int]:
    if page.is_tiled:
        return (int(page.tilewidth), int(page.tilelength))
    return (int(page.imagewidth), min(int(page.rowsperstrip), int(page.imagelength)))


def _obstacle(page: Any) -> str:
    width, height = _tile_px(page)
    if page.dtype is None or page.dtype.kind not in "ub" or page.dtype.itemsize > 2:
        return f"samples of type {page.dtype or 'unknown'}"
    if page.photometric not in (_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE, _YCBCR):
        return f"colours of kind {getattr(page.photometric, 'name', page.photometric)}"
    if page.photometric == _YCBCR and page.compression not in (_OLD_JPEG, _JPEG):
        return "YCbCr colours without JPEG"
    if page.samplesperpixel > 1 and page.planarconfig != 1:
        return "colour planes stored one after the other"
    if page.imagedepth > 1 or page.imagewidth < 1 or page.imagelength < 1:
        return "more than two dimensions"
    if width * height > _LARGEST_TILE_PX:
        return f"tiles of {width} x {height} texels"
    return ""


def _is_plain_jpeg(page: Any) -> bool:
    plain = (page.photometric == _YCBCR and page.samplesperpixel == 3) or (
        page.photometric == _BLACK_IS_ZERO and page.samplesperpixel == 1
    )
    return bool(plain and page.compression == _JPEG and page.dtype == np.uint8)


def _opacity_band(page: Any) -> int | None:
    """Number of the sample that holds opacity, if one does."""
    colours = 3 if page.photometric in (_RGB, _YCBCR) else 1
    kinds = tuple(int(kind) for kind in page.extrasamples or ())
    return next((colours + k for k, kind in enumerate(kinds) if kind in (1, 2)), None)


def _empty(width: int, height: int, page: Any) -> Texels:
    out = np.zeros((height, width, 4), dtype=np.uint8)
    if _opacity_band(page) is None:
        out[..., 3] = 255
    return out


def _rgba_of(samples: NDArray[Any], page: Any) -> Texels:
    """RGBA (h, w, 4) of decoded samples (h, w, n)."""
    if page.photometric == _PALETTE:
        table = np.asarray(page.colormap)  # (3, 2**bits) of 16 bits
        colours, extra = _to_8_bit(table.T[samples[..., 0]], 16), samples[..., 1:]
    else:
        few = 3 if page.photometric in (_RGB, _YCBCR) else 1
        bits = 1 if samples.dtype == np.bool_ else int(page.bitspersample)
        whole = _to_8_bit(samples, bits)
        colours, extra = whole[..., :few], whole[..., few:]
        if page.photometric == _WHITE_IS_ZERO:
            colours = 255 - colours
    out = np.full((*samples.shape[:2], 4), 255, dtype=np.uint8)
    out[..., :3] = colours
    band = _opacity_band(page)
    if band is not None:
        out[..., 3] = extra[..., band - (samples.shape[-1] - extra.shape[-1])]
    return out


def _to_8_bit(samples: NDArray[Any], bits: int) -> Texels:
    if bits == 8:
        return samples.astype(np.uint8, copy=False)
    top = (1 << bits) - 1
    return ((samples.astype(np.uint32) * 255 + top // 2) // top).astype(np.uint8)
