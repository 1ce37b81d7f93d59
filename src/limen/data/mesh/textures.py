"""Pictures of any size as layers of one array texture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray

__all__ = ["LARGEST_TEXTURE_PX", "as_layers", "rgba_of"]

LARGEST_TEXTURE_PX = 2048
"""Longest side of a layer; larger pictures are reduced to it."""

Texels = NDArray[np.uint8]


def rgba_of(picture: Any, opaque: bool) -> Texels:
    """A Pillow picture as uint8 (H, W, 4); ``opaque`` drops its opacity."""
    texels = np.array(picture.convert("RGBA"))
    if opaque:
        texels[..., 3] = 255
    return texels


def as_layers(pictures: Sequence[Texels]) -> Texels:
    """All pictures, each uint8 (h, w, 4), at one size: uint8 (L, H, W, 4).

    Each side is the smallest power of two that no picture exceeds, at most `LARGEST_TEXTURE_PX`. Resampled in linear
    light, colours weighed by opacity.
    """
    if not pictures:
        return np.zeros((0, 1, 1, 4), np.uint8)
    height, width = (_power_of_two(max(picture.shape[axis] for picture in pictures)) for axis in (0, 1))
    return np.stack([_resized(picture, width, height) for picture in pictures])


def _power_of_two(side_px: int) -> int:
    """
    >>> [_power_of_two(side) for side in (1, 2, 3, 640, 5000)]
    [1, 2, 4, 1024, 2048]
    """
    return int(min(1 << (side_px - 1).bit_length(), LARGEST_TEXTURE_PX))


def _resized(picture: Texels, width: int, height: int) -> Texels:
    if picture.shape[:2] == (height, width):
        return picture
    image = pyvips.Image.new_from_array(np.ascontiguousarray(picture), interpretation="srgb")
    return np.asarray(image.thumbnail_image(width, height=height, size="force", linear=True).numpy(), np.uint8)
