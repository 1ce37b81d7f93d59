"""The points that are made of a file, in the cache, when it is first opened.

What builds (Numba, SciPy) and what keeps (Zarr) is imported where it is needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from limen.data.points.cloud import open_cloud
from limen.data.points.info import PointsInfo, cloud_info
from limen.data.store.file_type import existing_file
from limen.data.store.ingest import Progress, kept_in_cache, needs_ingest

if TYPE_CHECKING:
    from limen.data.points.file import Points

__all__ = ["LARGEST_AT_ONCE_POINTS", "open_points", "points_info"]

LARGEST_AT_ONCE_POINTS = 20_000_000
"""A file of up to so many points is made ready when it is opened (a minute); beyond it wants ``ingest``."""

_ENDING = ".points"


def open_points(path: str | Path, *, progress: Progress | None = None) -> Points:
    """Open a folder that was made ready, or a cloud of points that is made ready in the cache first.

    The cache keeps it until the file changes. ``progress`` is called with the fraction of that work done, 0 ... 1.
    Raises MissingFileError, FormatError (no cloud of points, damaged; NeedsIngestError beyond
    `LARGEST_AT_ONCE_POINTS`), StorageError.
    """
    from limen.data.points.file import Points

    path = Path(path)
    if path.suffix.lower() == _ENDING:
        return Points.open(path)
    source = existing_file(path)

    def make(place: Path) -> None:
        count = open_cloud(source).count
        if count > LARGEST_AT_ONCE_POINTS:
            raise needs_ingest(source, f"{count:,} points take a while", _ENDING)
        from limen.data.points.ingest import ingest_points

        ingest_points(source, place, progress=progress)

    return kept_in_cache(source, str(source.resolve()), _ENDING, Points.open, make)


def points_info(path: str | Path) -> PointsInfo:
    """What a cloud of points is, made ready or not. Raises what `cloud_info` and `open_points` raise."""
    if Path(path).suffix.lower() != _ENDING:
        return cloud_info(path)
    from limen.data.points.file import Points

    return Points.open(path).info()
