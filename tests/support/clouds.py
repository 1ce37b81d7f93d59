"""A small cloud for the tests of everything above its file: a bumpy, coloured ball, scanned unevenly."""

from __future__ import annotations

import numpy as np

from limen.data.points.build import build_points
from limen.data.points.file import Points


def ball(count: int = 20_000, seed: int = 3, *, normals: bool = True) -> Points:
    """Points on a ball of about 1 m, with stripes; denser near its top."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3)) + np.array([0, 0.4, 0])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    bumps = 1 + 0.05 * np.sin(9 * way[:, 0]) * np.cos(7 * way[:, 2])
    shade = np.where(np.sin(25 * way[:, 1]) > 0, 200, 90) + rng.integers(-10, 10, count)
    rgb = np.stack([shade, shade * 0.8, 255 - shade], axis=1).clip(0, 255).astype(np.uint8)
    return build_points(way * bumps[:, None], rgb, way if normals else None)
