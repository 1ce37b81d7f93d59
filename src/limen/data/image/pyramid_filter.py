"""Whether a file's coarser levels are softer than ours: most programs average squares of texels.

A box costs about a level: seen at the distance where texels merge, what it lost is visible in noise and text, where a
Lanczos pyramid passes (docs/explain/observer.md). What is known to be soft is therefore drawn one level finer.

The kernel is recognised: patches with detail are reduced from the next finer stored level by a box and by Lanczos, in
light and in codes, and whichever lies nearest to the stored texels made them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from limen.data.image.tiles import TileLevel, read_rectangle
from limen.data.store.resample import LINEAR_OF_SRGB, linear_of_srgb, weights
from limen.data.store.tile_cache import TileCache

__all__ = ["soft_from"]

_PATCH = 48
_PATCHES = 12
_LIVELY_CODES = 3.0
"""Root mean square by which box and Lanczos must differ for a patch to tell them apart through JPEG's noise."""

Planes = NDArray[np.float64]


def soft_from(levels: Sequence[TileLevel], cache: TileCache) -> float | None:
    """The scale of the first stored level that was made by averaging, or by leaving texels out; ``None`` if none was.

    Levels after the first soft one are taken to be made like it. Where nothing in the image tells, the answer is
    ``None``: there is nothing to be lost. Raises ValueError or OSError where tiles cannot be read.
    """
    for number in range(1, len(levels)):
        fine, coarse = levels[number - 1], levels[number]
        ratio = coarse.scale[0] / fine.scale[0]
        if ratio == coarse.scale[1] / fine.scale[1] and ratio == int(ratio) and ratio >= 2:
            soft = _is_soft(fine, coarse, number, int(ratio), cache)
            if soft is not None:
                return max(coarse.scale) if soft else None
    return None


def _is_soft(fine: TileLevel, coarse: TileLevel, number: int, ratio: int, cache: TileCache) -> bool | None:
    """Whether one level was made from the next finer by something softer than Lanczos; ``None`` if nothing tells."""
    errors: list[Planes] = []
    margin = 4
    width, height = (size - 2 * margin for size in coarse.size_px)
    size = (min(_PATCH, width), min(_PATCH, height))
    if min(size) < 8:
        return None
    places = np.random.default_rng(0).random((_PATCHES, 2)) * (np.array([width, height]) - size)
    for x, y in (places.astype(int) + margin).tolist():
        # Stored levels are cached under negative numbers, see `limen.data.image.file`.
        stored = read_rectangle(coarse, -1 - number, cache, x, y, *size)[..., :3].astype(float)
        around = (x - margin) * ratio, (y - margin) * ratio
        extent = [(side + 2 * margin) * ratio for side in size]
        codes = read_rectangle(fine, -number, cache, *around, *extent)[..., :3].astype(float)
        made = [reduce(codes, ratio, margin, size) for reduce in _WAYS]
        if np.sqrt(np.mean((made[0] - made[-1]) ** 2)) > _LIVELY_CODES:
            errors.append(np.array([np.mean((each - stored) ** 2) for each in made]))
    if not errors:
        return None
    return int(np.argmin(np.sum(errors, axis=0))) < _SOFT_WAYS


def _box(codes: Planes, ratio: int, margin: int, size: tuple[int, int]) -> Planes:
    inner = codes[margin * ratio : (margin + size[1]) * ratio, margin * ratio : (margin + size[0]) * ratio]
    return np.asarray(inner.reshape(size[1], ratio, size[0], ratio, 3).mean(axis=(1, 3)))


def _left_out(codes: Planes, ratio: int, margin: int, size: tuple[int, int]) -> Planes:
    first = margin * ratio
    return np.asarray(codes[first : first + size[1] * ratio : ratio, first : first + size[0] * ratio : ratio])


def _lanczos(codes: Planes, ratio: int, margin: int, size: tuple[int, int]) -> Planes:
    start_x, across = weights(margin, size[0], float(ratio), codes.shape[1])
    start_y, down = weights(margin, size[1], float(ratio), codes.shape[0])
    part = codes[start_y : start_y + down.shape[1], start_x : start_x + across.shape[1]]
    return np.clip(np.tensordot(np.tensordot(down, part, (1, 0)), across, (1, 1)).transpose(0, 2, 1), 0.0, 255.0)


def _in_light(way: Callable[..., Planes]) -> Callable[..., Planes]:
    def reduced(codes: Planes, *more: object) -> Planes:
        light = np.clip(way(linear_of_srgb(codes / 255.0), *more), 0.0, 1.0)
        return np.asarray(np.interp(light, _LIGHT, np.arange(256.0)))

    return reduced


_LIGHT = LINEAR_OF_SRGB.astype(float)
_WAYS = (_box, _in_light(_box), _left_out, _lanczos, _in_light(_lanczos))
_SOFT_WAYS = 3
