"""The terrain that is made of a raster of heights, in the cache, when it is first opened.

What builds (Numba, SciPy) and what keeps (Zarr) is imported where it is needed.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from limen.data.store.file_type import existing_file
from limen.data.store.ingest import Progress, kept_in_cache, needs_ingest
from limen.data.terrain.elevation import ElevationSource
from limen.data.terrain.info import TerrainInfo, elevation_info

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain

__all__ = ["LARGEST_AT_ONCE_POSTS", "open_terrain", "terrain_info"]

LARGEST_AT_ONCE_POSTS = 64_000_000
"""A raster of heights up to this size is made ready when it is opened (some minutes); beyond it wants ``ingest``."""

_ENDING = ".terrain"


def open_terrain(
    path: str | Path,
    *,
    band: int | None = None,
    spacing_m: float | tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Terrain:
    """Open a folder that was made ready, or a raster of heights that is made ready in the cache first.

    The cache keeps it until the raster, ``band`` or ``spacing_m`` change. ``progress`` is called with the fraction of
    that work done, 0 ... 1. Raises MissingFileError, FormatError (no raster of heights, damaged; NeedsIngestError
    beyond `LARGEST_AT_ONCE_POSTS`), InputError, StorageError.
    """
    from limen.data.terrain.file import Terrain

    path = Path(path)
    if path.suffix.lower() == _ENDING:
        return Terrain.open(path)
    path = existing_file(path)
    with ElevationSource(path, band=band, spacing_m=spacing_m) as source:
        columns, rows = source.size_posts
        key = repr((str(path.resolve()), source.band, source.spacing_m))

    def make(place: Path) -> None:
        if math.prod((columns, rows)) > LARGEST_AT_ONCE_POSTS:
            raise needs_ingest(path, f"{columns} x {rows} posts take a while", _ENDING)
        from limen.data.terrain.ingest import ingest_terrain

        ingest_terrain(path, place, band=band, spacing_m=spacing_m, progress=progress)

    return kept_in_cache(path, key, _ENDING, Terrain.open, make)


def terrain_info(path: str | Path) -> TerrainInfo:
    """What a terrain is, made ready or not. Raises what `elevation_info` and `open_terrain` raise."""
    if Path(path).suffix.lower() != _ENDING:
        return elevation_info(path)
    from limen.data.terrain.file import Terrain

    return Terrain.open(path).info()
