"""What every stored level of an image answers, wherever its tiles come from, and reading rectangles across tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import PAGE
from limen.data.store.resample import resample, weights
from limen.data.store.tile_cache import TileCache

__all__ = ["ArrayLevel", "DerivedLevel", "TileLevel", "read_rectangle", "scales_of"]

Texels = NDArray[np.uint8]
Pair = tuple[float, float]


class TileLevel(Protocol):
    """One level as it is stored: a grid of tiles that can be decoded one by one, from any thread."""

    @property
    def size_px(self) -> tuple[int, int]: ...

    @property
    def scale(self) -> Pair:
        """Base texels that one texel spans, along x and y."""

    @property
    def tile_px(self) -> tuple[int, int]: ...

    def decode(self, column: int, row: int) -> Texels:
        """RGBA (h, w, 4) of one tile without what lies beyond the level's edge; ValueError or OSError if it is bad."""


def scales_of(base_px: tuple[int, int], size_px: tuple[int, int], *, stretched: bool = False) -> Pair:
    """Base texels per texel of a level, exactly.

    Files store sizes, not scales, and a size is rounded. Nearly all writers (vips, Deep Zoom, Aperio, OME) halve
    texels in pairs and then cut (or pad) the odd rest, so the scale is the whole number, a power of two where one
    fits, that this size could have been rounded from, down or up. GDAL instead stretches the level over the whole
    image (``stretched``): its scale is the quotient of the sizes, as is that of a level which no whole number fits.
    Taking the quotient where the whole number is right shifts the far edge by up to a texel of the level.

    >>> scales_of((1001, 999), (500, 499)), scales_of((1001, 999), (501, 500))
    ((2.0, 2.0), (2.0, 2.0))
    >>> scales_of((1001, 1000), (501, 500), stretched=True)
    (1.998003992015968, 2.0)
    """
    quotient = (base_px[0] / size_px[0], base_px[1] / size_px[1])
    if stretched:
        return quotient
    nearest = max(quotient)
    powers = sorted((2**k for k in range(1 + max(base_px).bit_length())), key=lambda p: abs(p / nearest - 1.0))
    for whole in (*powers[:3], round(quotient[0]), round(quotient[1])):
        if whole >= 1 and all(_rounded_from(b, s, whole) for b, s in zip(base_px, size_px, strict=True)):
            return (float(whole), float(whole))
    return quotient


def _rounded_from(base_px: int, size_px: int, whole: int) -> bool:
    return size_px in (max(1, base_px // whole), -(-base_px // whole))


def read_rectangle(level: TileLevel, key: int, cache: TileCache, x: int, y: int, width: int, height: int) -> Texels:
    """RGBA (height, width, 4) of a level's texels from (x, y) on; beyond its edge the edge texel is repeated.

    ``key`` is the level's name in ``cache``.
    """
    limit_x, limit_y = level.size_px
    left, right = min(max(x, 0), limit_x - 1), max(min(x + width, limit_x), 1)
    top, bottom = min(max(y, 0), limit_y - 1), max(min(y + height, limit_y), 1)
    right, bottom = max(right, left + 1), max(bottom, top + 1)
    tile_w, tile_h = level.tile_px
    out = np.empty((bottom - top, right - left, 4), dtype=np.uint8)
    for row in range(top // tile_h, (bottom - 1) // tile_h + 1):
        for column in range(left // tile_w, (right - 1) // tile_w + 1):
            tile = cache.get((key, column, row), lambda c=column, r=row: level.decode(c, r))  # type: ignore[misc]
            x0, y0 = column * tile_w, row * tile_h
            xa, xb = max(left, x0), min(right, x0 + tile_w)
            ya, yb = max(top, y0), min(bottom, y0 + tile_h)
            out[ya - top : yb - top, xa - left : xb - left] = tile[ya - y0 : yb - y0, xa - x0 : xb - x0]
    if out.shape[:2] == (height, width):
        return out
    rows = np.clip(np.arange(y, y + height), top, bottom - 1) - top
    columns = np.clip(np.arange(x, x + width), left, right - 1) - left
    return out[rows[:, None], columns[None, :]]


@dataclass(frozen=True, slots=True)
class ArrayLevel:
    """A level held in memory: ``texels`` is (h, w, 3 or 4)."""

    texels: Texels
    scale: Pair
    tile_px: tuple[int, int] = (PAGE, PAGE)

    @property
    def size_px(self) -> tuple[int, int]:
        return (self.texels.shape[1], self.texels.shape[0])

    def decode(self, column: int, row: int) -> Texels:
        part = self.texels[row * PAGE : (row + 1) * PAGE, column * PAGE : (column + 1) * PAGE]
        if part.shape[2] == 4:
            return part
        out = np.full((*part.shape[:2], 4), 255, dtype=np.uint8)
        out[..., :3] = part
        return out


@dataclass(frozen=True, slots=True)
class DerivedLevel:
    """A level that the file lacks: pages reduced on demand, in linear light, from the next finer level."""

    size_px: tuple[int, int]
    scale: Pair
    parent: TileLevel
    parent_key: int
    cache: TileCache
    tile_px: tuple[int, int] = (PAGE, PAGE)

    def decode(self, column: int, row: int) -> Texels:
        parts = []
        for axis, page in ((0, column), (1, row)):
            first = page * PAGE
            count = min(PAGE, self.size_px[axis] - first)
            ratio = self.scale[axis] / self.parent.scale[axis]
            parts.append(weights(first, count, ratio, self.parent.size_px[axis]))
        (x, across), (y, down) = parts
        fine = read_rectangle(self.parent, self.parent_key, self.cache, x, y, across.shape[1], down.shape[1])
        return resample(fine, down, across)
