"""Points from files: LAS, LAZ, COPC, PLY and E57, read a batch at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.cloud_type import cloud_type
from limen.data.store.file_type import existing_file
from limen.data.store.report import one_line
from limen.errors import FormatError
from limen.geometry import Floats

__all__ = ["Batch", "Cloud", "Stretch", "open_cloud", "stretch_of", "unreadable_cloud"]


_BATCH = 1_000_000


class Batch(NamedTuple):
    """Some points, in the file's coordinates and unit; what the file does not have is None."""

    positions: Floats  # (N, 3)
    rgb: NDArray[np.uint8] | None  # (N, 3), sRGB
    intensity: NDArray[np.uint8] | None  # (N,)
    normals: NDArray[Any] | None  # (N, 3) of any length

    def box(self) -> Floats:
        """Lowest and highest coordinates, (2, 3)."""
        columns = self.positions.T  # several times as fast, column by column, as along rows of three
        return np.array([[column.min() for column in columns], [column.max() for column in columns]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Cloud:
    """A file of points.

    ``count`` is what the file says; fewer may come, for those that are marked as withheld or invalid, or have no
    finite position, are left out. ``bounds`` (2, 3) are what the file says, None if it does not. ``colours`` says
    where they come from. ``read`` gives about so many points at a time, and before each batch how many the file has for
    it; it may raise anything. ``unit_m`` is None where nobody knows it, ``crs`` WKT or empty.
    """

    path: Path
    format: str
    count: int
    bounds: Floats | None
    colours: str
    has_normals: bool
    has_intensity: bool
    read: Callable[[int], Iterator[tuple[int, Batch]]]
    crs: str = ""
    unit_m: float | None = None
    notes: tuple[str, ...] = ()

    def batches(self, size: int) -> Iterator[Batch]:
        """All points, about ``size`` at a time; memory does not grow with the file.

        Raises FormatError, naming the file and what to do, where it is damaged or cut short.
        """
        reading, done = self.read(size), 0
        while True:
            try:
                stored, batch = next(reading, (0, None))
            except Exception as error:  # whoever reads a damaged file raises what they like
                raise self._damaged(error, done) from error
            if batch is None:
                break
            done += stored
            known = np.isfinite(batch.positions).all(axis=1)
            if known.all():
                yield batch
            elif known.any():
                yield Batch._make(None if part is None else part[known] for part in batch)
        if done < self.count:
            raise self._damaged(EOFError("the end of the file"), done)

    def _damaged(self, error: BaseException, done: int) -> FormatError:
        reason = one_line(error)[:200]
        return FormatError(
            f"{self.path}: is damaged or cut short after {done:,} of {self.count:,} points ({reason}); copy it again"
        )

    def found_bounds(self) -> Floats:
        """Where points lie, (2, 3): all are read for it. Raises FormatError if none is left, as `batches` does else."""
        bounds = np.array([[np.inf] * 3, [-np.inf] * 3])
        for batch in self.batches(_BATCH):
            low, high = batch.box()
            bounds = np.array([np.minimum(bounds[0], low), np.maximum(bounds[1], high)])
        if not np.isfinite(bounds).all():
            raise self.nothing_left()
        return bounds

    def nothing_left(self) -> FormatError:
        """What to raise where no point came."""
        return FormatError(
            f"{self.path}: none of its {self.count:,} points has a finite position and is valid; export it again"
        )


class Stretch(NamedTuple):
    """What becomes black and white of intensities."""

    low: float
    high: float

    def apply(self, values: NDArray[Any]) -> NDArray[np.uint8]:
        scaled = (np.asarray(values, dtype=float) - self.low) * (255.0 / (self.high - self.low))
        return np.clip(np.rint(np.nan_to_num(scaled)), 0, 255).astype(np.uint8)


def stretch_of(sample: NDArray[Any]) -> Stretch:
    """From the 1st to the 99th percentile: a few glints would make all else black."""
    values = np.asarray(sample, dtype=float)
    values = values[np.isfinite(values)]
    low, high = np.percentile(values, [1, 99]) if len(values) else (0.0, 1.0)
    return Stretch(float(low), float(high) if high > low else float(low) + 1.0)


def open_cloud(path: str | Path) -> Cloud:
    """A file of points, of which only the description has been read.

    Raises MissingFileError, or FormatError if it is no cloud of points, damaged, or needs a package.
    """
    path = existing_file(path)
    kind = cloud_type(path)
    if kind == "las":
        from limen.data.points.las import open_las

        return open_las(path)
    if kind == "e57":
        from limen.data.points.e57 import open_e57

        return open_e57(path)
    if kind == "ply":
        from limen.data.points.ply import open_ply

        return open_ply(path)
    raise FormatError(f"{path}: is no cloud of points; name a LAS, LAZ, COPC, E57, or a PLY without faces")


def unreadable_cloud(path: Path, name: str, error: BaseException) -> FormatError:
    """What to raise where a file of a format is damaged at its beginning."""
    return FormatError(f"{path}: cannot be read as {name} ({one_line(error)[:200]}); copy or export it again")
