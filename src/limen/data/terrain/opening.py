"""The terrain that is made of a raster of heights, in the cache, when it is first opened."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from limen.data.store.file_type import existing_file
from limen.data.store.zarr_group import is_made_of
from limen.data.terrain.elevation import ElevationSource
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.errors import FormatError, MissingFileError, NeedsIngestError
from limen.system import place_in_cache

__all__ = ["LARGEST_AT_ONCE_POSTS", "open_terrain"]

LARGEST_AT_ONCE_POSTS = 64_000_000
"""A raster of heights up to this size is made ready when it is opened (some minutes); beyond it wants ``ingest``."""


def open_terrain(
    path: str | Path,
    *,
    band: int | None = None,
    spacing_m: float | tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Terrain:
    """Open a folder that was made ready, or a raster of heights that is made ready in the cache first.

    The cache keeps it until the raster, ``band`` or ``spacing_m`` change. ``progress`` is called with the fraction of
    that work done, 0 ... 1. Raises MissingFileError, FormatError (no raster of heights, damaged; NeedsIngestError
    beyond `LARGEST_AT_ONCE_POSTS`), InputError, StorageError.
    """
    path = Path(path)
    if path.suffix.lower() == ".terrain":
        return Terrain.open(path)
    path = existing_file(path)
    with ElevationSource(path, band=band, spacing_m=spacing_m) as source:
        size = source.size_posts
        key = repr((str(path.resolve()), source.band, source.spacing_m))
    place = place_in_cache(path.stem, key, ".terrain")
    if (kept := _kept(place, path)) is not None:
        return kept
    if math.prod(size) > LARGEST_AT_ONCE_POSTS:
        name, target = (f'"{p}"' if " " in str(p) else str(p) for p in (path, path.with_suffix(".terrain")))
        raise NeedsIngestError(
            f"{path}: {size[0]} x {size[1]} posts take a while; make it ready with: limen ingest {name} {target}"
        )
    ingest_terrain(path, place, band=band, spacing_m=spacing_m, progress=progress)
    return Terrain.open(place)


def _kept(place: Path, source: Path) -> Terrain | None:
    """What the cache holds, if it was made of the file as it is now."""
    try:
        terrain = Terrain.open(place)
    except (FormatError, MissingFileError):
        return None
    return terrain if is_made_of(terrain.header.source, source) else None
