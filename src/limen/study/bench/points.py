"""Clouds of points: how fast they are built, beside peers in the same run, and made ready from a file.

References
----------
Rusinkiewicz, Levoy 2000, *QSplat: A Multiresolution Point Rendering System for Large Meshes*.
Schütz, Ohrhallinger, Wimmer 2020, *Fast Out-of-Core Octree Generation for Massive Point Clouds* (PotreeConverter).
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
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
from limen.geometry import Floats
from limen.study.bench.table import FIGURES, Row, Say, Table, figure
from limen.study.bench.timing import T, timed
from limen.vision.luminance import Photometry

__all__ = ["bench_points"]

_POINTS, _QUICK_POINTS = 4_000_000, 300_000
_WARM_POINTS = 20_000
_RATE = "million points/s"
_PROGRAMS = {"QSplat": "qsplat_make", "PotreeConverter": "PotreeConverter"}
"""Peers that are programs, and what they are called."""


def bench_points(quick: bool, say: Say, content: Path | None = None) -> list[Table]:
    """The table of ``limen bench points``: rates of what runs in memory are of processor time, of one core.

    ``content``: a file to be made ready instead of the sample.
    """
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
    return [Table(FIGURES, rows)]


def _built(hall: Scanned, *, estimate: bool) -> Iterator[Row]:
    """What each part of building costs, and the whole; ``estimate``: normals are made instead of given."""
    count, parts_ms = len(hall.rgb), {}

    def part(name: str, call: Callable[[], T]) -> T:
        made, spent = timed(call)
        parts_ms[name] = spent.cpu_ms
        return made

    def places() -> tuple[Lattice, Floats, NDArray[Any]]:
        lattice, (least, most) = Lattice.holding(hall.positions)
        normals = None if estimate else hall.normals
        return lattice, (least + most) / 2, pack_points(lattice, hall.positions, hall.rgb, hall.intensity, normals)

    def nodes() -> tuple[Any, Any]:
        chunks = chunks_of(points, radii, lattice, middle, estimate)
        return chunks, tops_of(chunks.nodes[:, LEVEL_BEGIN[CHUNK_LEVEL]], chunks.frames, count, estimate)

    lattice, middle, packed = part("packing", places)
    order = part("order", lambda: hilbert_order(packed["place"]))
    groups = "groups, radii" + (" and normals" if estimate else "")
    points, radii = part(groups, lambda: arranged(packed, order, lattice.step, estimate=estimate))
    chunks, tops = part("nodes", nodes)
    part("contrasts", lambda: fill_contrasts(chunks, tops, count, Photometry.srgb()))
    how = "normals estimated" if estimate else "normals given"
    for name, ms in parts_ms.items():
        yield figure(f"build, {how}: {name}", ms / count * 1e6, "ns/point", "limen")
    yield figure(f"build in memory, {how}", count / sum(parts_ms.values()) / 1e3, _RATE, "limen")


def _peers(hall: Scanned) -> Iterator[Row]:
    """What others do with the same points: a sort alone, and a tree without colours, radii or contrasts."""
    count = len(hall.rgb)
    keys = np.empty(count, np.uint64)
    lattice, _ = Lattice.holding(hall.positions)
    hilbert_keys(lattice.places_of(hall.positions), KEY_LEVELS, keys)
    _, spent = timed(lambda: np.argsort(keys))
    yield figure("sort of the curve's keys alone", count / spent.cpu_ms / 1e3, _RATE, "numpy argsort")
    _, spent = timed(lambda: cKDTree(hall.positions, leafsize=8))
    yield figure("kd-tree alone, 8 points a leaf", count / spent.cpu_ms / 1e3, _RATE, "scipy cKDTree")


def _ingested(path: Path, target: Path) -> Iterator[Row]:
    cloud = open_cloud(path)
    read, spent = timed(lambda: sum(len(batch.positions) for batch in cloud.batches(1_000_000)))
    reader = "laspy" if cloud.format.startswith("LAS") else "limen"
    yield figure(f"{path.name}: reading alone", read / spent.clock_ms / 1e3, _RATE, reader)
    report, points = ingest_points(path, target), Points.open(target)
    for what, value, unit in (
        ("made ready", points.size / report.seconds / 1e6, _RATE),
        ("most anonymous memory", report.peak_rss_mib, "MiB"),
        ("stored", report.bytes / points.size, "bytes/point"),
        ("a chunk read", _chunk_ms(points), "ms"),
    ):
        yield figure(f"{path.name}: {what}", value, unit, "limen")


def _chunk_ms(points: Points) -> float:
    """Mean of up to a hundred chunks all over the cloud."""
    chunks = np.unique(np.linspace(0, points.chunks - 1, 100).astype(int)).tolist()
    return timed(lambda: [points.read_chunk(chunk) for chunk in chunks])[1].clock_ms / len(chunks)
