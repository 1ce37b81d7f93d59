"""Rasters of heights for tests."""

from __future__ import annotations

import warnings

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning

UTM = {"crs": "EPSG:32611", "transform": rasterio.Affine(30.0, 0.0, 500_000.0, 0.0, -20.0, 4_400_000.0)}


def write_dem(path, heights, **profile):
    """A GeoTIFF of (rows, columns), or (bands, rows, columns), heights; ``profile`` as rasterio takes it."""
    bands = heights if heights.ndim == 3 else heights[None]
    names = {key: profile.pop(key) for key in ("descriptions", "units", "scales", "offsets") if key in profile}
    wanted = {"driver": "GTiff", "dtype": bands.dtype, "count": bands.shape[0], **profile}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path, "w", width=bands.shape[2], height=bands.shape[1], **wanted) as file:
            file.write(bands)
            for key, value in names.items():
                setattr(file, key, value)
    return path


def hills(columns, rows, seed=0, dtype=np.int16):
    """Smooth hills with a rough surface."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:rows, 0:columns]
    smooth = 900 + 400 * np.sin(x / 37.0 + seed) * np.cos(y / 23.0) + 0.1 * x
    return (smooth + rng.normal(0, 2, (rows, columns))).astype(dtype)
