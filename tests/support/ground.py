"""A small terrain for the tests of everything above its file: hills with a lake, 321 x 257 posts, 30 m apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import Affine

SIZE = (321, 257)
LAKE_M = 120.0


def hills() -> NDArray[np.int16]:
    """Heights, shape (257, 321): rising to the east, a ridge from north-west to south-east, a flat lake in the west."""
    row, column = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    ridge = 900 * np.exp(-(((row - column * 0.8) / 30) ** 2))
    waves = 60 * np.sin(column / 7) * np.cos(row / 9) + 25 * np.sin(column / 2.3 + row / 3.1)
    heights = np.maximum(200 + 2.0 * column + ridge + waves, LAKE_M)
    heights[((column - 40) / 30) ** 2 + ((row - 180) / 40) ** 2 < 1] = LAKE_M
    return np.round(heights).astype(np.int16)


def write_dem(path: Path) -> Path:
    """The hills as a GeoTIFF in UTM zone 11 north."""
    heights = hills()
    with rasterio.open(
        path, "w", driver="GTiff", width=SIZE[0], height=SIZE[1], count=1, dtype="int16", crs="EPSG:32611",
        transform=Affine(30, 0, 300_000, 0, -30, 4_200_000), nodata=-32768,
    ) as dem:  # fmt: skip
        dem.write(heights, 1)
    return path
