"""Rows in, a complete pyramidal TIFF out: all levels in one pass, each holding only its last 268 rows.

Every level is the halving, in linear light, of the 8-bit level above it before compression; sizes round up and the
texels of level ``l`` span exactly ``2**l`` base texels.

The contrast of the pages is measured on the finished file before it gets its name: what its tiles decode to is what
will be drawn, JPEG's artefacts included. Doing so while rows pass would hold four more rows of decoded tiles a level.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from limen.data.image.bigtiff import SOFTWARE, BigTiffWriter, TileCoder
from limen.data.image.contrast import ContrastSurvey
from limen.data.image.contrast_file import write_contrast
from limen.data.image.file import open_image
from limen.data.image.halving_kernels import HALO, halve_rows
from limen.data.pages import PAGE, Pyramid
from limen.data.store.atomic import partial_file
from limen.data.store.ingest import Progress
from limen.data.store.resample import HALVING_TAPS, LINEAR_OF_SRGB, SRGB_OF_LINEAR
from limen.errors import StorageError
from limen.system import worker_count

__all__ = ["PyramidWriter"]

Texels = NDArray[np.uint8]

_KEPT = 12
"""Rows kept from before: a row not yet halved reaches back 11 at most."""
_HALVED_COLUMNS = 1024
_TILES_PER_TASK = 8
_LARGEST_ROWS_IN_MEMORY_BYTES = 192 << 20
_SURVEY_CACHE_BYTES = 32 << 20
_SHARE_OF_ROWS = 0.7
"""Of the time until all is done, about; the rest is measuring contrast."""


class PyramidWriter:
    """Takes an image's rows from top to bottom and writes ``path`` when the last has come; a context manager.

    ``push`` takes uint8 (n, width, bands) with the coder's bands. The contrast of the pages is written beside ``path``.
    ``progress`` is called with the fraction done, 0 .. 1. StorageError names the bytes needed if the disk is full.
    Nothing is left behind unless all rows came.
    """

    def __init__(
        self,
        path: Path,
        size_px: tuple[int, int],
        coder: TileCoder,
        *,
        workers: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.path = path
        self._progress = progress or (lambda _: None)
        self.pyramid = Pyramid.of(size_px)
        self._partial = partial_file(path)
        self._workers = workers or worker_count()
        self._coder = coder
        self._rows_done = 0

    def __enter__(self) -> PyramidWriter:
        self._file = self._partial.__enter__()
        self._tiff = BigTiffWriter(self._file, self._coder, PAGE)
        self.pool = ThreadPoolExecutor(self._workers, thread_name_prefix="limen-pyramid")
        self._finest = _LevelRows(self, 0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.pool.shutdown(wait=True, cancel_futures=True)
        if kind is None and self._rows_done != self.pyramid.size_px[1]:
            error = AssertionError(f"{self._rows_done} of {self.pyramid.size_px[1]} rows were pushed")
            self._partial.__exit__(type(error), error, None)
            raise error
        try:
            self._partial.__exit__(kind, error, trace)
        except StorageError as full:
            needed = int(self.bytes_written * self.pyramid.size_px[1] / max(self._rows_done, 1))
            raise StorageError(
                f"{self.path}: the disk is full; about {needed:,} bytes are needed in {self.path.parent} "
                f"({self.bytes_written:,} were written and are removed again)"
            ) from full.__cause__
        if kind is None:
            write_contrast(self.path, self.pyramid, self._contrast)

    def push(self, rows: Texels) -> None:
        self._finest.push(rows)
        self._rows_done += rows.shape[0]
        if self._rows_done == self.pyramid.size_px[1]:
            self._finest.finish()
            self._tiff.finish([level.size_px for level in self.pyramid.levels], SOFTWARE)
            self._measure_contrast()
        else:
            self._progress(_SHARE_OF_ROWS * self._rows_done / self.pyramid.size_px[1])

    def _measure_contrast(self) -> None:
        with open_image(self._file.name, cache_bytes=_SURVEY_CACHE_BYTES) as image:
            with ContrastSurvey(image, workers=self._workers, keep=False) as survey:
                survey.run(lambda done: self._progress(_SHARE_OF_ROWS + (1 - _SHARE_OF_ROWS) * done))
            self._contrast = survey.pages

    def write(self, level: int, tiles: list[bytes]) -> None:
        for tile in tiles:
            self._tiff.add(level, tile)

    @property
    def coder(self) -> TileCoder:
        return self._coder

    @property
    def bytes_written(self) -> int:
        return self._tiff.bytes_written


class _LevelRows:
    """The rolling rows of one level: encodes each full row of tiles and passes halved rows on to the next level."""

    def __init__(self, writer: PyramidWriter, level: int) -> None:
        self._writer, self._level = writer, level
        self._width, self._height = writer.pyramid.levels[level].size_px
        # Kept rows, one row of tiles, and room to repeat the last row below the image.
        self._rows = _rows_buffer((_KEPT + PAGE + HALO + 1, self._width, writer.coder.bands), writer.path.parent)
        self._first = 0  # image row of the buffer's row _KEPT
        self._filled = 0
        self._halved = 0
        last = level + 1 == len(writer.pyramid.levels)
        self._next = None if last else _LevelRows(writer, level + 1)

    def push(self, rows: Texels) -> None:
        done = 0
        while done < rows.shape[0]:
            take = min(PAGE - self._filled, rows.shape[0] - done)
            at = _KEPT + self._filled
            self._rows[at : at + take] = rows[done : done + take]
            if self._first == 0 and self._filled == 0:
                self._rows[:_KEPT] = rows[done]  # above the image its first row is repeated
            self._filled += take
            done += take
            if self._filled == PAGE and self._first + PAGE < self._height:
                self._flush()

    def finish(self) -> None:
        """All rows have come."""
        end = _KEPT + self._filled
        self._rows[end : end + HALO + 1] = self._rows[end - 1]
        self._flush()
        if self._next is not None:
            self._next.finish()

    def _flush(self) -> None:
        encoded = self._encode()
        halved = self._halve()
        self._writer.write(self._level, [tile for task in encoded for tile in task.result()])
        self._rows[:_KEPT] = self._rows[self._filled : self._filled + _KEPT]
        self._first += self._filled
        self._filled = 0
        if self._next is not None:
            self._next.push(halved)

    def _encode(self) -> list[Future[list[bytes]]]:
        columns = self._writer.pyramid.levels[self._level].columns
        starts = range(0, columns, _TILES_PER_TASK)
        return [self._writer.pool.submit(self._encode_tiles, a, min(a + _TILES_PER_TASK, columns)) for a in starts]

    def _encode_tiles(self, first: int, last: int) -> list[bytes]:
        found = []
        for column in range(first, last):
            part = self._rows[_KEPT : _KEPT + self._filled, column * PAGE : (column + 1) * PAGE]
            missing = (PAGE - part.shape[0], PAGE - part.shape[1])
            if any(missing):
                part = np.pad(part, ((0, missing[0]), (0, missing[1]), (0, 0)), mode="edge")
            found.append(self._writer.coder.encode(np.ascontiguousarray(part)))
        return found

    def _halve(self) -> Texels:
        """Rows of the next level that can be made by now: (n, width / 2 rounded up, bands)."""
        if self._next is None:
            return self._rows[:0]
        known = self._first + self._filled
        until = -(-self._height // 2) if known == self._height else (known - HALO) // 2
        start = 2 * self._halved - HALO - self._first + _KEPT
        fine = self._rows[start : start + 2 * (until - self._halved) + 2 * HALO]
        width = self._next._width
        coarse = np.empty((until - self._halved, width, fine.shape[2]), dtype=np.uint8)
        self._halved = until
        tasks = [
            self._writer.pool.submit(
                halve_rows,
                fine,
                coarse,
                a,
                min(a + _HALVED_COLUMNS, width),
                HALVING_TAPS,
                LINEAR_OF_SRGB,
                SRGB_OF_LINEAR,
            )
            for a in range(0, width, _HALVED_COLUMNS)
        ]
        for task in tasks:
            task.result()
        return coarse


def _rows_buffer(shape: tuple[int, int, int], folder: Path) -> Texels:
    """Memory for rows; for extremely wide images a nameless file beside the result, so that memory stays bounded."""
    if shape[0] * shape[1] * shape[2] <= _LARGEST_ROWS_IN_MEMORY_BYTES:
        return np.empty(shape, dtype=np.uint8)
    with tempfile.TemporaryFile(dir=folder) as file:
        return np.memmap(file, dtype=np.uint8, mode="w+", shape=shape)
