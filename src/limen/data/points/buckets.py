"""More points than memory holds, along Hilbert's curve, a bucket at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.points.hilbert_kernels import KEY_LEVELS, hilbert_keys

__all__ = ["BUCKET_POINTS", "Spool", "along_curve"]

BUCKET_POINTS = 4_000_000
"""What is sorted in memory at once."""

_LEVELS = 5
"""Of the curve that are told apart at a time: 32,768 cells."""

_BLOCK = 1_000_000


class Spool:
    """A nameless file in ``folder`` that arrays are appended to, of rows of ``shape`` items of ``dtype``.

    A context manager: what was mapped stays when it is closed.
    """

    def __init__(self, folder: Path, dtype: np.dtype[Any], *shape: int) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - closed on exit
        self._dtype, self._shape, self._rows = dtype, shape, 0

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return self._rows

    def append(self, rows: NDArray[Any]) -> None:
        self._file.write(np.ascontiguousarray(rows, self._dtype).data)
        self._rows += len(rows)

    def array(self) -> NDArray[Any]:
        """All rows, mapped: they are read as they are wanted, and written through."""
        self._file.flush()
        return _mapped(self._file, self._dtype, (self._rows, *self._shape))


def _mapped(file: Any, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.memmap(file, dtype=dtype, mode="r+", shape=shape).view(np.ndarray)


def along_curve(points: NDArray[Any], folder: Path, level: int = 0, most: int | None = None) -> Iterator[NDArray[Any]]:
    """Points (N,) of dtype `POINT` in buckets that follow the curve, of at most ``most`` (`BUCKET_POINTS`), unsorted.

    All lie in one cell of ``level``. A bucket holds cells that follow each other; a cell that is too full is split
    the same way, and one that cannot be split any more (so many points in one place) is cut.
    """
    most = most or BUCKET_POINTS
    if len(points) <= most:
        yield np.array(points)
        return
    if level >= KEY_LEVELS:
        for begin in range(0, len(points), most):
            yield np.array(points[begin : begin + most])
        return
    finer = min(level + _LEVELS, KEY_LEVELS)
    cells = 1 << 3 * (finer - level)
    counts = np.zeros(cells, np.int64)
    for begin in range(0, len(points), _BLOCK):
        counts += np.bincount(_cells(points[begin : begin + _BLOCK], finer, cells), minlength=cells)
    bucket_of = _grouped(counts, most)
    sizes = np.bincount(bucket_of, weights=counts).astype(np.int64)
    ends = np.cumsum(sizes)
    apart = _scattered(points, finer, bucket_of, ends - sizes, folder)
    for size, end in zip(sizes.tolist(), ends.tolist(), strict=True):
        if size:
            yield from along_curve(apart[end - size : end], folder, finer, most)


def _cells(points: NDArray[Any], level: int, cells: int) -> NDArray[np.int64]:
    """Which cell of ``level``, below the one that holds all, points are in."""
    keys = np.empty(len(points), np.uint64)
    hilbert_keys(points["place"], level, keys)
    return (keys & np.uint64(cells - 1)).astype(np.int64)


def _grouped(counts: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Buckets of consecutive cells, as many as go in; a cell beyond ``most`` has one of its own."""
    bucket_of = np.empty(len(counts), np.int64)
    bucket, held = 0, 0
    for cell, count in enumerate(counts.tolist()):
        if held and held + count > most:
            bucket, held = bucket + 1, 0
        bucket_of[cell] = bucket
        held += count
    return bucket_of


def _scattered(
    points: NDArray[Any], level: int, bucket_of: NDArray[np.int64], begins: NDArray[np.int64], folder: Path
) -> NDArray[Any]:
    """The same points with those of a bucket together, in a file of their own."""
    with tempfile.TemporaryFile(dir=folder) as file:
        file.truncate(points.nbytes)
        apart = _mapped(file, points.dtype, points.shape)
    cursors = begins.copy()
    for begin in range(0, len(points), _BLOCK):
        block = np.array(points[begin : begin + _BLOCK])
        buckets = bucket_of[_cells(block, level, len(bucket_of))]
        order = np.argsort(buckets, kind="stable")
        block, held = block[order], np.bincount(buckets, minlength=len(begins))
        first = 0
        for bucket in np.flatnonzero(held).tolist():
            count = int(held[bucket])
            to = int(cursors[bucket])
            apart[to : to + count] = block[first : first + count]
            cursors[bucket] += count
            first += count
    return apart
