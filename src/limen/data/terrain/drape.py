"""Where a picture lies on a terrain."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from limen.data.terrain.file import Terrain
from limen.errors import InputError
from limen.geometry import Floats

__all__ = ["texel_from_post"]


def texel_from_post(terrain: Terrain, picture: str | Path, size_px: tuple[int, int]) -> Floats:
    """Affine map from (column, row) of a terrain's posts to texels of a picture, shape (2, 3); by their georeference.

    Texel (i, j) covers i to i + 1 and j to j + 1. A picture without georeference, or on a terrain without one, spans
    the terrain's pixels from corner to corner.

    Parameters
    ----------
    picture
        An image file; one that rasterio does not read has no georeference.
    size_px
        Its width and height.

    Raises
    ------
    InputError
        If the two are in different coordinate systems.
    """
    centre = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # the corner-based pixel coordinates of a post
    placed = _georeference(Path(picture))
    if placed is None or terrain.transform is None or not terrain.crs:
        spans = np.array(size_px) / np.array(terrain.size_posts)
        return np.asarray((np.diag([*spans, 1.0]) @ centre)[:2])
    crs, world_from_texel = placed
    if crs != rasterio.crs.CRS.from_wkt(terrain.crs):
        raise InputError(
            f"{picture} is in another coordinate system than the terrain: `rio warp {picture} warped.tif --like DEM` "
            "(or gdalwarp) brings it into the DEM's"
        )
    world_from_pixel = np.array([terrain.transform[:3], terrain.transform[3:], (0, 0, 1)])
    return np.asarray((np.linalg.inv(world_from_texel) @ world_from_pixel @ centre)[:2])


def _georeference(path: Path) -> tuple[rasterio.crs.CRS, Floats] | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as source:
                if not source.crs or source.transform.is_identity:
                    return None
                return source.crs, np.array(source.transform).reshape(3, 3)
    except RasterioError:
        return None
