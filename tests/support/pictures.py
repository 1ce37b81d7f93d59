"""Pictures and plain references for the tests of limen.data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

Texels = NDArray[np.uint8]


def smooth_picture(width: int, height: int, seed: int = 0) -> Texels:
    """RGB (h, w, 3) whose texels all differ from their neighbours, yet JPEG keeps it well."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    rng = np.random.default_rng(seed)
    out = np.empty((height, width, 3))
    for band in range(3):
        a, b, c, d = rng.uniform(0.004, 0.03, 4)
        out[..., band] = 128 + 60 * np.sin(a * x + b * y + band) + 50 * np.cos(c * x - d * y)
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)


def noisy_picture(width: int, height: int, bands: int = 3, seed: int = 0) -> Texels:
    return np.random.default_rng(seed).integers(0, 256, (height, width, bands), dtype=np.uint8)


def light_of(codes: NDArray[Any]) -> NDArray[np.float64]:
    c = codes / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def codes_of(light: NDArray[np.float64]) -> Texels:
    c = np.clip(light, 0, 1)
    return np.rint(255 * np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)).astype(np.uint8)


def halved(picture: Texels, gives_back: bool = False) -> Texels:
    """Plain NumPy halving of RGB by a two-lobed Lanczos in linear light, edges repeated, sizes rounding up.

    ``gives_back``: what no display can show of a texel goes to its four neighbours.
    """
    place = (np.arange(8) - 3.5) / 2.0
    taps = np.sinc(place) * np.sinc(place / 2.0)
    taps /= taps.sum()
    light = light_of(picture.astype(np.float64))
    for axis in (0, 1):
        light = np.moveaxis(light, axis, 0)
        padded = np.concatenate([light[:1]] * 5 + [light] + [light[-1:]] * 7)
        size = -(-light.shape[0] // 2) + 2  # a texel more at either end, for what it gives
        light = sum(taps[k] * padded[k : k + 2 * size : 2] for k in range(8))
        light = np.moveaxis(light, 0, axis)
    shown = np.clip(light, 0, 1)
    excess = light - shown
    inner = shown[1:-1, 1:-1]
    if gives_back:
        inner = inner + (excess[:-2, 1:-1] + excess[2:, 1:-1] + excess[1:-1, :-2] + excess[1:-1, 2:]) / 4
    return codes_of(inner)


def repeated(picture: Texels, x: int, y: int, edge: int) -> Texels:
    """A square of a picture that may reach beyond it, where the edge texel is repeated."""
    rows = np.clip(np.arange(y, y + edge), 0, picture.shape[0] - 1)
    columns = np.clip(np.arange(x, x + edge), 0, picture.shape[1] - 1)
    return picture[rows[:, None], columns[None, :]]


def write_tiff(path: Path, levels: list[NDArray[Any]], *, subifds: bool = False, **options: Any) -> Path:
    """A tiled TIFF with tifffile: levels as sub-images or as further pages marked as reduced."""
    options = {"tile": (256, 256), "photometric": "rgb" if levels[0].ndim == 3 else "minisblack", **options}
    with tifffile.TiffWriter(path, bigtiff=True, ome=False) as file:
        file.write(levels[0], subifds=len(levels) - 1 if subifds else None, metadata=None, **options)
        for level in levels[1:]:
            file.write(level, subfiletype=1, metadata=None, **options)
    return path
