"""The points that are made of a file, in the cache, when it is first opened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from limen.data.points.cloud import open_cloud
from limen.data.points.file import Points
from limen.data.store.file_type import existing_file
from limen.data.store.zarr_group import is_made_of
from limen.errors import FormatError, MissingFileError, NeedsIngestError
from limen.system import place_in_cache

__all__ = ["LARGEST_AT_ONCE_POINTS", "open_points"]

LARGEST_AT_ONCE_POINTS = 20_000_000
"""A file of up to so many points is made ready when it is opened (a minute); beyond it wants ``ingest``."""


def open_points(path: str | Path, *, progress: Callable[[float], None] | None = None) -> Points:
    """Open a folder that was made ready, or a cloud of points that is made ready in the cache first.

    The cache keeps it until the file changes. ``progress`` is called with the fraction of that work done, 0 ... 1.
    Raises MissingFileError, FormatError (no cloud of points, damaged; NeedsIngestError beyond
    `LARGEST_AT_ONCE_POINTS`), StorageError.
    """
    path = Path(path)
    if path.suffix.lower() == ".points":
        return Points.open(path)
    path = existing_file(path)
    place = place_in_cache(path.stem, str(path.resolve()), ".points")
    if (kept := _kept(place, path)) is not None:
        return kept
    count = open_cloud(path).count
    if count > LARGEST_AT_ONCE_POINTS:
        name, target = (f'"{p}"' if " " in str(p) else str(p) for p in (path, path.with_suffix(".points")))
        raise NeedsIngestError(
            f"{path}: {count:,} points take a while; make it ready with: limen ingest {name} {target}"
        )
    from limen.data.points.ingest import ingest_points  # with Numba and SciPy, which what was made ready has no use for

    ingest_points(path, place, progress=progress)
    return Points.open(place)


def _kept(place: Path, source: Path) -> Points | None:
    """What the cache holds, if it was made of the file as it is now."""
    try:
        points = Points.open(place)
    except (FormatError, MissingFileError):
        return None
    return points if is_made_of(points.header.source, source) else None
