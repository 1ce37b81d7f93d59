"""Clouds of points: how fast they are built, beside peers in the same run, and made ready from a file.

References
----------
Rusinkiewicz, Levoy 2000, *QSplat: A Multiresolution Point Rendering System for Large Meshes*.
Schütz, Ohrhallinger, Wimmer 2020, *Fast Out-of-Core Octree Generation for Massive Point Clouds* (PotreeConverter).
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from limen.data.points.build import fill_contrasts
from limen.data.points.cloud import open_cloud
from limen.data.points.file import Points
from limen.data.points.hilbert_kernels import KEY_LEVELS, hilbert_keys
from limen.data.points.ingest import ingest_points
from limen.data.points.nodes import CHUNK_LEVEL, LEVEL_BEGIN
from limen.data.points.tree import Lattice, arranged, chunks_of, hilbert_order, pack_points
from limen.data.points.upper_nodes import tops_of
from limen.data.samples.points import Scanned, sample_points, scanned_hall
from limen.vision.luminance import Photometry

__all__ = ["PeerRow", "bench_points"]

Say = Callable[[str], None]

_POINTS, _QUICK_POINTS = 4_000_000, 300_000
_WARM_POINTS = 20_000
_PROGRAMS = {"QSplat": "qsplat_make", "PotreeConverter": "PotreeConverter"}
"""Peers that are programs, and what they are called."""


class PeerRow(msgspec.Struct, frozen=True, kw_only=True):
    """One figure. Rates of what runs in memory are of processor time, of one core."""

    what: str
    peer: str
    value: float
    unit: str

    columns: ClassVar[tuple[str, ...]] = ("what", "peer", "value", "unit")

    def cells(self) -> tuple[str, ...]:
        return (self.what, self.peer, f"{self.value:,.3g}", self.unit)


def bench_points(quick: bool, say: Say, content: Path | None = None) -> list[PeerRow]:
    """Rows of ``limen bench points``; ``content`` is a file to be made ready instead of the sample."""
    count = _QUICK_POINTS if quick else _POINTS
    for name, program in _PROGRAMS.items():
        reason = "is not installed" if shutil.which(program) is None else "is a program of its own: time it yourself"
        say(f"{name}: skipped, {program} {reason}")
    say(f"a hall of {count:,} points in memory")
    hall = Scanned._make(np.concatenate(part) for part in zip(*scanned_hall(count), strict=True))
    for _ in _built(Scanned._make(part[:_WARM_POINTS] for part in hall), estimate=True):
        pass  # compiles the kernels, which is not to be timed
    rows = [*_built(hall, estimate=False), *_built(hall, estimate=True), *_peers(hall)]
    with tempfile.TemporaryDirectory() as folder:
        path = content or Path(folder) / "hall.laz"
        if content is None:
            sample_points(path, count)
        say(f"{path.name} made ready")
        rows += _ingested(path, Path(folder) / "made.points")
    return rows


def _built(hall: Scanned, *, estimate: bool) -> Iterator[PeerRow]:
    """What each part of building costs, and the whole; ``estimate``: normals are made instead of given."""
    count, times = len(hall.rgb), {}

    def timed(part: str, begin: float) -> float:
        now = time.process_time()
        times[part] = now - begin
        return now

    clock = time.process_time()
    lattice, (least, most) = Lattice.holding(hall.positions)
    packed = pack_points(lattice, hall.positions, hall.rgb, hall.intensity, None if estimate else hall.normals)
    clock = timed("packing", clock)
    order = hilbert_order(packed["place"])
    clock = timed("order", clock)
    points, radii = arranged(packed, order, lattice.step, estimate=estimate)
    clock = timed("groups, radii" + (" and normals" if estimate else ""), clock)
    chunks = chunks_of(points, radii, lattice, (least + most) / 2, estimate)
    tops = tops_of(chunks.nodes[:, LEVEL_BEGIN[CHUNK_LEVEL]], chunks.frames, count, estimate)
    clock = timed("nodes", clock)
    fill_contrasts(chunks, tops, count, Photometry.srgb())
    timed("contrasts", clock)
    how = "normals estimated" if estimate else "normals given"
    for part, seconds in times.items():
        yield PeerRow(what=f"build, {how}: {part}", peer="limen", value=seconds / count * 1e9, unit="ns/point")
    whole = sum(times.values())
    yield PeerRow(what=f"build in memory, {how}", peer="limen", value=count / whole / 1e6, unit="million points/s")


def _peers(hall: Scanned) -> Iterator[PeerRow]:
    """What others do with the same points: a sort alone, and a tree without colours, radii or contrasts."""
    count = len(hall.rgb)
    keys = np.empty(count, np.uint64)
    lattice, _ = Lattice.holding(hall.positions)
    hilbert_keys(lattice.places_of(hall.positions), KEY_LEVELS, keys)
    ways: dict[str, tuple[str, Callable[[], object]]] = {
        "numpy argsort": ("sort of the curve's keys alone", lambda: np.argsort(keys)),
        "scipy cKDTree": ("kd-tree alone, 8 points a leaf", lambda: cKDTree(hall.positions, leafsize=8)),
    }
    for peer, (what, way) in ways.items():
        begin = time.process_time()
        way()
        value = count / (time.process_time() - begin) / 1e6
        yield PeerRow(what=what, peer=peer, value=value, unit="million points/s")


def _ingested(path: Path, target: Path) -> Iterator[PeerRow]:
    cloud = open_cloud(path)
    begin = time.perf_counter()
    read = sum(len(batch.positions) for batch in cloud.batches(1_000_000))
    seconds = time.perf_counter() - begin
    what, reader = f"{path.name}: reading alone", "laspy" if cloud.format.startswith("LAS") else "limen"
    yield PeerRow(what=what, peer=reader, value=read / seconds / 1e6, unit="million points/s")
    report, points = ingest_points(path, target), Points.open(target)
    for what, value, unit in (
        ("made ready", points.size / report.seconds / 1e6, "million points/s"),
        ("most anonymous memory", report.peak_rss_mib, "MiB"),
        ("stored", report.bytes / points.size, "bytes/point"),
        ("a chunk read", _chunk_ms(points), "ms"),
    ):
        yield PeerRow(what=f"{path.name}: {what}", peer="limen", value=value, unit=unit)


def _chunk_ms(points: Points) -> float:
    """Mean of up to a hundred chunks all over the cloud."""
    chunks = np.unique(np.linspace(0, points.chunks - 1, 100).astype(int))
    begin = time.perf_counter()
    for chunk in chunks.tolist():
        points.read_chunk(chunk)
    return (time.perf_counter() - begin) / len(chunks) * 1e3
