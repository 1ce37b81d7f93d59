"""An image as everybody else sees it: pages of a power-of-two pyramid, from whatever the file holds.

How a page finds its texels: a level of the file whose texels span exactly ``2**l`` base texels is cut into pages as it
is. Any other page level is reduced in linear light from the next finer one there is, at the exact quotient of the two
scales (:func:`limen.data.image.tiles.scales_of` tells how a file level's scale is found), texel centres on texel
centres.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal, Protocol

import msgspec
import numpy as np
import pyvips
from numpy.typing import NDArray

from limen.data.image import vips
from limen.data.image.bigtiff import SOFTWARE
from limen.data.image.contrast_file import faint_shares
from limen.data.image.deepzoom import DeepZoomLevel, open_deepzoom
from limen.data.image.pyramid_filter import soft_from
from limen.data.image.tiff import TiffImage, TiffLevel
from limen.data.image.tiles import ArrayLevel, DerivedLevel, TileLevel, read_rectangle
from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.data.store.file_type import existing_file, is_tiff
from limen.data.store.ingest import needs_ingest
from limen.data.store.report import Description, amount, one_line
from limen.data.store.tile_cache import CACHE_BYTES, TileCache
from limen.errors import FormatError, NeedsIngestError, PageError

__all__ = [
    "LARGEST_IN_MEMORY_PX",
    "Image",
    "ImageInfo",
    "image_info",
    "open_image",
    "unreadable_zstandard",
]

Texels = NDArray[np.uint8]


LARGEST_IN_MEMORY_PX = 100_000_000
"""An image without levels is opened in memory up to this size (about half a gigabyte); beyond it wants ``ingest``."""

_ON_DEMAND_PX = 1 << 24
"""A coarsest file level up to this size is reduced page by page when first asked for (about 2 s of work in all)."""

_LARGEST_GAP = 16.0
_ALMOST = 1.03
"""A file level up to 3 % coarser than a page level is still used for it: nobody sees so slight an enlargement."""


class ImageInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What ``limen info`` says about an image; sizes are [width, height] in texels.

    ``faint_share`` is, for each level but the finest, the share of its pages to which the next finer level adds less
    than 1 % contrast in every window of 32 x 32 texels (see :mod:`limen.data.image.contrast`); None while that is not
    known.
    """

    kind: str = "image"
    path: str
    size: tuple[int, int]
    levels: list[tuple[int, int]]
    page_px: int
    pages: int
    format: str
    compression: str
    colour: str
    bits: int
    tile_px: tuple[int, int]
    file_levels: list[tuple[int, int]]
    in_place: bool
    soft_from_level: int | None
    bytes: int
    mean_page_bytes: float | None
    contrast: Literal["known", "not yet"]
    faint_share: list[float] | None

    def described(self) -> Description:
        (width, height), (tile_w, tile_h) = self.size, self.tile_px
        facts = {
            "size": f"{width} x {height} texels, {width * height / 1e9:.3f} gigapixels, {self.pages} pages of "
            f"{self.page_px}",
            "colour": self.colour,
            "tiles": f"{tile_w} x {tile_h}, {'read in place' if self.in_place else 'decoded into memory'}; "
            f"levels in the file: {len(self.file_levels)}",
        }
        if self.mean_page_bytes is not None:
            facts["a page"] = f"{amount(self.mean_page_bytes)} at full resolution"
        facts["contrast that finer levels add, over 32 x 32 texels"] = self.contrast
        edge, columns = self.page_px, ["level", "texels", "pages"]
        rows = [
            [str(level), f"{w} x {h}", str(-(-w // edge) * -(-h // edge))] for level, (w, h) in enumerate(self.levels)
        ]
        if self.faint_share is not None:
            columns.append("finer adds < 1 %")
            for row, share in zip(rows, ["", *(f"{100 * share:.1f} %" for share in self.faint_share)], strict=True):
                row.append(share)
        stored = f"{self.format} ({self.compression}, {self.bits} bits), {amount(self.bytes)}"
        return Description(stored, facts, columns=columns, rows=rows)


@dataclass(frozen=True, slots=True)
class _Facts:
    format: str
    compression: str
    colour: str
    bits: int
    in_place: bool = True
    own: bool = False
    mean_page_bytes: float | None = None


class _Closable(Protocol):
    def close(self) -> None: ...


class Image:
    """Pages of one image. A context manager; any number of threads may read at once.

    ``pyramid`` is the page grid, ``size_px`` = (width, height), ``mean_page_bytes`` the mean stored bytes of a page's
    area at full resolution (None where the image was not read in place).
    """

    kind: ClassVar[str] = "image"

    def __init__(
        self, path: Path, levels: Sequence[TileLevel], facts: _Facts, *, cache_bytes: int, owner: _Closable | None
    ) -> None:
        self.path = path
        self.size_px: tuple[int, int] = levels[0].size_px
        self.mean_page_bytes = facts.mean_page_bytes
        self._facts = facts
        self._file_levels = tuple(levels)
        self._cache = TileCache(cache_bytes)
        self.pyramid = replace(Pyramid.of(self.size_px), soft_from=self._soft_from())
        self._owner = owner
        self._closing = threading.Lock()
        self._levels = _page_levels(self.pyramid, levels, self._cache)

    def _soft_from(self) -> int | None:
        """The first level of pages that comes from texels softer than our own kernel would have made them."""
        if self._facts.own or not self._facts.in_place:
            return None
        try:
            scale = soft_from(self._file_levels, self._cache)
        except (ValueError, OSError):
            return None  # whoever reads these tiles next hears of it
        return None if scale is None else max(1, round(math.log2(scale)))

    def read_page(self, page: int | tuple[int, int, int], gutter: int = GUTTER) -> Texels:
        """One page with its gutter: RGBA, sRGB, uint8 (PAGE + 2 gutter, PAGE + 2 gutter, 4), the caller's own.

        ``page`` is a linear number or (level, column, row). Beyond the image's edge the edge texel is repeated.
        Raises InputError for a page that does not exist, PageError where the file's tiles cannot be read.
        """
        if not isinstance(page, tuple):
            page = self.pyramid.page_of(int(page))
        level, column, row = page
        self.pyramid.page_index(level, column, row)
        edge = PAGE + 2 * gutter
        stored = self._levels[level]
        try:
            return read_rectangle(stored, level, self._cache, column * PAGE - gutter, row * PAGE - gutter, edge, edge)
        except (ValueError, OSError) as error:
            raise PageError(
                f"{self.path}: the page at level {level}, column {column}, row {row} cannot be read "
                f"({one_line(error)}); copy the file again"
            ) from error

    def info(self) -> ImageInfo:
        """What the file is."""
        facts = self._facts
        shares = faint_shares(self.path, self.pyramid)
        return ImageInfo(
            path=str(self.path),
            size=self.size_px,
            levels=[level.size_px for level in self.pyramid.levels],
            page_px=PAGE,
            pages=self.pyramid.page_count,
            format=facts.format,
            compression=facts.compression,
            colour=facts.colour,
            bits=facts.bits,
            tile_px=self._file_levels[0].tile_px,
            file_levels=[level.size_px for level in self._file_levels],
            in_place=facts.in_place,
            soft_from_level=self.pyramid.soft_from,
            bytes=self.path.stat().st_size,
            mean_page_bytes=facts.mean_page_bytes,
            contrast="not yet" if shares is None else "known",
            faint_share=shares,
        )

    def close(self) -> None:
        """Free the file and the decoded tiles; reading afterwards raises PageError. May be called twice."""
        with self._closing:
            owner, self._owner = self._owner, None
        if owner is not None:
            owner.close()
        self._cache.clear()

    def __enter__(self) -> Image:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_image(path: str | Path, *, cache_bytes: int = CACHE_BYTES) -> Image:
    """Open any image: pyramids in place, others up to 100 megapixels in memory.

    Raises MissingFileError, FormatError (not an image, cut short, or so large that it wants ``limen ingest`` first).
    """
    path = existing_file(path)
    if path.suffix.lower() == ".dzi":
        return _open_deepzoom(path, cache_bytes)
    if is_tiff(path):
        return _open_tiff(path, cache_bytes)
    return _open_decoded(path, cache_bytes)


def image_info(path: str | Path) -> ImageInfo:
    """What an image is. Raises what `open_image` raises."""
    with open_image(path) as image:
        return image.info()


def _page_levels(pyramid: Pyramid, stored: Sequence[TileLevel], cache: TileCache) -> list[TileLevel]:
    """For every page level the file's level that equals it, or one derived from the next finer."""
    found: list[TileLevel] = []
    sources = [(level, -1 - number) for number, level in enumerate(stored)]
    for number, level in enumerate(pyramid.levels):
        target = 2.0**number
        parent, key = min(sources, key=lambda source: _unfitness(source[0], target))
        exact = all(abs(s - target) * size < target / 16 for s, size in zip(parent.scale, level.size_px, strict=True))
        # Derived levels are cached under their own number, so that a page is reduced once.
        chosen = parent if exact else DerivedLevel(level.size_px, (target, target), parent, key, cache)
        found.append(chosen)
        if not exact:
            sources.append((chosen, number))
    return found


def _unfitness(level: TileLevel, target: float) -> float:
    """How much finer than wanted a level is; too coarse is no choice at all."""
    coarsest = max(level.scale)
    return float("inf") if coarsest > target * _ALMOST else target / coarsest


def _open_deepzoom(path: Path, cache_bytes: int) -> Image:
    levels: list[DeepZoomLevel] = open_deepzoom(path)
    suffix = levels[0].suffix[1:].lower()
    compression = "JPEG" if suffix in ("jpg", "jpeg") else suffix.upper()
    facts = _Facts("Deep Zoom", compression, "taken as sRGB", 8, mean_page_bytes=levels[0].mean_page_bytes())
    return _assemble(path, levels, facts, cache_bytes, None)


def _open_tiff(path: Path, cache_bytes: int) -> Image:
    tiff = TiffImage(path)
    try:
        if tiff.obstacle:
            if tiff.misread_by_vips:
                raise FormatError(unreadable_zstandard(path, tiff.obstacle))
            tiff.close()
            return _open_decoded(path, cache_bytes)
        return _assemble(path, tiff.levels, _tiff_facts(tiff), cache_bytes, tiff)
    except BaseException:
        tiff.close()
        raise


def _tiff_facts(tiff: TiffImage) -> _Facts:
    base = tiff.base
    profile = vips.profile_name(tiff.icc_profile)
    colour = {
        "none": "taken as sRGB",
        "sRGB": "sRGB",
        "other": "taken as sRGB; its embedded profile is not applied (limen ingest applies it)",
    }[profile]
    finest: TiffLevel = tiff.levels[0]
    compression = getattr(base.compression, "name", str(base.compression))
    return _Facts(
        "TIFF",
        compression,
        colour,
        int(base.bitspersample),
        own=tiff.software == SOFTWARE,
        mean_page_bytes=finest.mean_page_bytes(),
    )


def _assemble(
    path: Path, levels: Sequence[TileLevel], facts: _Facts, cache_bytes: int, owner: _Closable | None
) -> Image:
    """An image in place, with its coarse end in memory where the file's own levels stop too early."""
    width, height = levels[-1].size_px
    gaps = [max(coarse.scale) / max(fine.scale) for fine, coarse in itertools.pairwise(levels)]
    if width * height > LARGEST_IN_MEMORY_PX or any(gap > _LARGEST_GAP for gap in gaps):
        why = "lacks the reduced levels that a picture of its size needs"
        raise _needs_ingest(path, levels[0].size_px, why)
    complete: list[TileLevel] = list(levels)
    if width * height > _ON_DEMAND_PX:
        complete[-1:] = _in_memory(path, levels[-1])
    return Image(path, complete, facts, cache_bytes=cache_bytes, owner=owner)


def _in_memory(path: Path, level: TileLevel) -> list[TileLevel]:
    """The level itself (still read in place) and its halvings, decoded once."""
    width, height = level.size_px
    try:
        texels = read_rectangle(level, 0, TileCache(CACHE_BYTES), 0, 0, width, height)
    except (ValueError, OSError) as error:
        why = one_line(error)
        raise FormatError(f"{path}: its coarsest level cannot be read ({why}); copy it again") from error
    reduced = vips.halvings(texels, len(Pyramid.of(level.size_px).levels) - 1)[1:]
    scales = ((level.scale[0] * 2.0**k, level.scale[1] * 2.0**k) for k in range(1, len(reduced) + 1))
    return [level, *(ArrayLevel(part, scale) for part, scale in zip(reduced, scales, strict=True))]


def _open_decoded(path: Path, cache_bytes: int) -> Image:
    image = vips.load(path, sequential=True)
    if image.width * image.height > LARGEST_IN_MEMORY_PX:
        raise _needs_ingest(path, (image.width, image.height), "is too large to open in memory")
    facts = _decoded_facts(image)
    try:
        texels = vips.texels_of(vips.to_srgb(image))
    except pyvips.Error as error:
        why = one_line(error)
        raise FormatError(f"{path}: cannot be decoded, it is damaged or cut short ({why}); copy it again") from error
    arrays = vips.halvings(texels, len(Pyramid.of((image.width, image.height)).levels) - 1)
    levels = [ArrayLevel(part, (2.0**k, 2.0**k)) for k, part in enumerate(arrays)]
    return Image(path, levels, facts, cache_bytes=cache_bytes, owner=None)


def _decoded_facts(image: pyvips.Image) -> _Facts:
    name = str(image.get("vips-loader")).removesuffix("load").upper() if image.get_typeof("vips-loader") else "?"
    profile = image.get("icc-profile-data") if image.get_typeof("icc-profile-data") else None
    colours = {"none": "taken as sRGB", "sRGB": "sRGB", "other": "converted to sRGB from its embedded profile"}
    colour = colours[vips.profile_name(profile)]
    return _Facts(name, name, colour, 16 if image.format == "ushort" else 8, in_place=False)


def unreadable_zstandard(path: Path, obstacle: str) -> str:
    return f"{path}: Zstandard TIFF with {obstacle} cannot be read; export it with another compression"


def _needs_ingest(path: Path, size_px: tuple[int, int], why: str) -> NeedsIngestError:
    return needs_ingest(path, f"{size_px[0]} x {size_px[1]} texels; it {why}", ".pyramid.tif")
