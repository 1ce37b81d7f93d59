"""``ingest_points``: a file of points of any size becomes a folder that is drawn from.

The source is read once, into a nameless file. What is in memory at a time is a **bucket** of up to four million points
that follow each other along the curve; buckets become chunks in a second nameless file. When all tops are known, every
chunk gets its contrasts, to which its neighbours belong, and is stored. Anonymous memory stays below 1 GiB.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.points.buckets import Spool, along_curve
from limen.data.points.cloud import Batch, Cloud, open_cloud
from limen.data.points.contrast import ChunkContrasts, Neighbourhood, ranges_of
from limen.data.points.nodes import CHUNK_LEVEL, CHUNK_NODES, CHUNK_POINTS, LEVEL_BEGIN, NODE, ChunkFrame
from limen.data.points.store import CHUNKS_A_SHARD, CloudSource, PointsHeader, create_chunks
from limen.data.points.tree import NEUTRAL, POINT, Lattice, arranged, chunks_of, hilbert_order, pack_points
from limen.data.points.upper_nodes import tops_of
from limen.data.store.ingest import Progress, new_folder
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport
from limen.data.store.zarr_group import create_table, seal
from limen.geometry import Floats
from limen.system import worker_count
from limen.vision.luminance import Photometry

__all__ = ["ingest_points"]

_BATCH = 1_000_000
_PIECE = _BATCH // CHUNK_POINTS * CHUNK_POINTS
_INNER = LEVEL_BEGIN[0]
_READ, _BUILT = 0.35, 0.7
"""Of the time until all is done, about, when the first two passes end."""

_MARGIN = 1e-3
"""Headers round: points may lie outside of what they say by so much of the widest side."""


def ingest_points(
    src: str | Path,
    dst: str | Path,
    *,
    photometry: Photometry | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> IngestReport:
    """Make points of a file ready, in a folder ``dst`` that ends in ``.points``.

    Parameters
    ----------
    photometry
        Of the display that contrasts are meant for; one of 100 cd/m2 that follows sRGB if not given.
    progress
        Is called with the fraction done, 0 ... 1.

    ``dst`` appears, or is replaced, only when all is written; on any error nothing is left behind. Raises
    MissingFileError, FormatError (``src`` is no cloud, damaged or cut short), InputError (``dst`` is something else
    already), StorageError.
    """
    dst, tell = Path(dst), progress or (lambda _: None)
    cloud = open_cloud(src)
    with Footprint() as used, new_folder(dst, ".points", "a cloud of points") as folder:
        header = _Ingest(cloud, folder, photometry or Photometry.srgb(), threads or worker_count(), tell).run()
        size = seal(folder)
    assert header.source is not None
    return IngestReport.of(
        "points",
        dst,
        used,
        size=header.points,
        bytes=size,
        notes=header.source.notes,
        chunks=-(-header.points // CHUNK_POINTS),
        colours=header.colours,
        normals=header.normals,
    )


class _Outside(Exception):
    """A point lies outside of what the header said."""


class _Read(NamedTuple):
    """What the first pass leaves."""

    points: NDArray[Any]  # (N,) of dtype `POINT`, in a file
    lattice: Lattice
    least: Floats
    most: Floats


class _Built(NamedTuple):
    """What the second pass leaves: chunks in a file."""

    nodes: NDArray[np.uint8]  # (C, 4681, 16)
    ranges: NDArray[np.float32]  # (C, 2)
    frames: ChunkFrame
    tops: tuple[NDArray[Any], ...]


class _Ingest:
    def __init__(self, cloud: Cloud, folder: Path, photometry: Photometry, threads: int, progress: Progress) -> None:
        self.cloud, self.folder, self.photometry = cloud, folder, photometry
        self.threads, self.progress = threads, progress
        self.two_sided = not cloud.has_normals

    def run(self) -> PointsHeader:
        group = zarr.open_group(self.folder, mode="w", zarr_format=3)
        read = self._read()
        origin = (read.least + read.most) / 2
        header = self._header(read, origin)
        built = self._build(read, origin)
        del read
        self._store(group, built, header.points)
        for k, level in enumerate(built.tops):
            create_table(group, f"tops/{CHUNK_LEVEL + k}", level.view(np.uint8).reshape(len(level), -1))
        for name, table in built.frames._asdict().items():
            create_table(group, f"frames/{name}", table)
        group.attrs["limen"] = msgspec.to_builtins(header)
        self.progress(1.0)
        return header

    def _read(self) -> _Read:
        """The only pass over the source, or two where it does not say where its points lie, or is wrong."""
        if self.cloud.bounds is not None:
            widest = float((self.cloud.bounds[1] - self.cloud.bounds[0]).max())
            try:
                return self._copy(self.cloud.bounds + np.array([[-1.0], [1.0]]) * _MARGIN * widest)
            except _Outside:
                pass
        return self._copy(self.cloud.found_bounds())

    def _copy(self, bounds: Floats) -> _Read:
        lattice = Lattice.around(*bounds)
        least, most = np.full(3, np.inf), np.full(3, -np.inf)
        with Spool(self.folder, POINT) as spool:
            for batch in self.cloud.batches(_BATCH):
                low, high = batch.box()
                if (low < bounds[0]).any() or (high > bounds[1]).any():
                    raise _Outside
                least, most = np.minimum(least, low), np.maximum(most, high)
                spool.append(_packed(lattice, batch))
                self.progress(_READ * min(1.0, len(spool) / self.cloud.count))
            if not len(spool):
                raise self.cloud.nothing_left()
            return _Read(spool.array(), lattice, least, most)

    def _build(self, read: _Read, origin: Floats) -> _Built:
        frames, roots, ranges, total, done = [], [], [], len(read.points), 0
        with Spool(self.folder, NODE, CHUNK_NODES) as nodes:
            for points, order in self._ordered(read):
                tidy, radii = arranged(points, order, read.lattice.step, estimate=self.two_sided)
                chunks = chunks_of(tidy, radii, read.lattice, origin, self.two_sided)
                nodes.append(chunks.nodes)
                ranges.append(ranges_of(chunks.stored, len(order), self.photometry))
                frames.append(chunks.frames)
                roots.append(chunks.nodes[:, LEVEL_BEGIN[CHUNK_LEVEL]].copy())
                done += len(order)
                self.progress(_READ + (_BUILT - _READ) * done / total)
            frame = ChunkFrame._make(np.concatenate(field) for field in zip(*frames, strict=True))
            tops = tops_of(np.concatenate(roots), frame, total, self.two_sided)
            every = nodes.array().view(np.uint8).reshape(-1, CHUNK_NODES, NODE.itemsize)
            return _Built(every, np.concatenate(ranges), frame, tops)

    def _ordered(self, read: _Read) -> Iterator[tuple[NDArray[Any], NDArray[np.uint32]]]:
        """Points, and numbers of some of them along the curve: whole chunks, but for the last.

        Where a bucket ends within a chunk, the next one goes on with it.
        """
        carried = np.empty(0, POINT)
        for bucket, last in _with_last(along_curve(read.points, self.folder)):
            points = np.concatenate([carried, bucket])
            order = np.arange(len(points), dtype=np.uint32)
            order[len(carried) :] = hilbert_order(bucket["place"]) + np.uint32(len(carried))
            whole = len(points) if last else len(points) // CHUNK_POINTS * CHUNK_POINTS
            for begin in range(0, whole, _PIECE):
                yield points, order[begin : min(begin + _PIECE, whole)]
            carried = points[order[whole:]]

    def _store(self, group: zarr.Group, built: _Built, points: int) -> None:
        """Contrasts of all chunks, and the chunks themselves, a shard at a time in each thread."""
        near = Neighbourhood(built.nodes, built.ranges, built.frames, built.tops, points, self.photometry)
        array = create_chunks(group, len(built.nodes))
        readers = threading.local()

        def store(begin: int) -> None:
            if not hasattr(readers, "own"):
                readers.own = near.reader()
            reader: ChunkContrasts = readers.own
            block = np.array(built.nodes[begin : begin + CHUNKS_A_SHARD])
            block[:, :_INNER, 7] = reader.of(begin, begin + len(block))
            built.tops[0]["contrast"][begin : begin + len(block)] = block[:, LEVEL_BEGIN[CHUNK_LEVEL], 7]
            array[begin : begin + len(block)] = block

        begins = range(0, len(built.nodes), CHUNKS_A_SHARD)
        with ThreadPoolExecutor(self.threads, thread_name_prefix="limen-points") as pool:
            try:
                for count, _ in enumerate(pool.map(store, begins)):
                    self.progress(_BUILT + (1.0 - _BUILT) * (count + 1) / len(begins))
            except BaseException:
                pool.shutdown(cancel_futures=True)  # on Ctrl-C, what has not begun never does
                raise

    def _header(self, read: _Read, origin: Floats) -> PointsHeader:
        cloud = self.cloud
        left_out = cloud.count - len(read.points)
        note = f"{left_out:,} points left out: withheld, invalid, or without a finite position"
        return PointsHeader(
            points=len(read.points),
            bounds=(_triple(read.least), _triple(read.most)),
            origin=_triple(origin),
            two_sided=self.two_sided,
            colours=cloud.colours,
            normals="given" if cloud.has_normals else "estimated",
            has_intensity=cloud.has_intensity,
            crs=cloud.crs,
            unit_m=cloud.unit_m,
            white_cd_m2=self.photometry.white_cd_m2,
            black_cd_m2=self.photometry.dark_cd_m2,
            source=CloudSource.of(
                cloud.path, format=cloud.format, notes=(*cloud.notes, note) if left_out > 0 else cloud.notes
            ),
        )


def _packed(lattice: Lattice, batch: Batch) -> NDArray[Any]:
    rgb = np.full((len(batch.positions), 3), NEUTRAL, np.uint8) if batch.rgb is None else batch.rgb
    return pack_points(lattice, batch.positions, rgb, batch.intensity, batch.normals)


def _with_last(items: Iterator[NDArray[Any]]) -> Iterator[tuple[NDArray[Any], bool]]:
    """Every item, and whether it is the last one."""
    held = next(items)
    for item in items:
        yield held, False
        held = item
    yield held, True


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
