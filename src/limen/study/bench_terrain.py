"""Terrains: triangles at a true error beside peers, frames on the paper's wall, and frames beside VTK's full grid.

References
----------
Scheel, Löffler, Lehmann, Schumann, Staadt 2014, *Dynamic Level of Detail for Tiled Large High-Resolution Displays*.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar

import msgspec

from limen.errors import InputError
from limen.gpu.device import open_device
from limen.study.terrain_frames import Table2, TerrainFrameRow, frame_aims, frame_rows, table2
from limen.study.terrain_peers import INSTALL, PEERS, Made, missing_package
from limen.study.terrain_source import SAMPLE, MeasuredTerrain, posts_of, prepared
from limen.study.triangulations import Posts, build_trees, drawn, patches_at, true_error_m

__all__ = ["ERRORS_M", "TerrainBench", "TerrainRow", "aims", "bench_terrain", "ladder_m", "triangle_rows"]

Say = Callable[[str], None]

ERRORS_M = (200.0, 100.0, 50.0, 20.0)
_SAMPLE, _QUICK_SAMPLE = 4097, 1025
_FINEST_M = 8.0
"""Limen's trees are built down to here, as ingesting would, whatever errors are asked for."""


class TerrainRow(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One way at one error."""

    method: str
    max_error_m: float
    """Wanted."""
    true_error_m: float
    """Measured at all posts, by the same rasteriser for all."""
    triangles: int
    build_s: float
    """Processor time, of all threads. Limen's and the grid's is that of all errors at once, the same in all rows."""

    columns: ClassVar[tuple[str, ...]] = ("method", "max error m", "true error m", "triangles", "build s")

    def cells(self) -> tuple[str, ...]:
        errors = f"{self.max_error_m:g}", f"{self.true_error_m:.2f}"
        return (self.method, *errors, f"{self.triangles:,}", f"{self.build_s:.2f}")


class TerrainBench(msgspec.Struct, frozen=True):
    """Three tables."""

    rows: list[TerrainRow]
    table2: list[Table2]
    frames: list[TerrainFrameRow]


def bench_terrain(quick: bool, say: Say, content: MeasuredTerrain = SAMPLE) -> TerrainBench:
    """Tables of ``limen bench terrain``."""
    with open_device() as device, prepared(content, _QUICK_SAMPLE if quick else _SAMPLE, say) as terrain:
        say(f"{terrain.name}: {terrain.size_posts[0]} x {terrain.size_posts[1]} posts, on {device.adapter_name}")
        posts = posts_of(terrain)
        frames = frame_rows(device, terrain, posts, 3 if quick else 5, say)
        wall = table2(device, terrain, 1 if quick else 3, say)
        rows = triangle_rows(posts, ERRORS_M, say)
    for text in (*aims(rows), *frame_aims(frames)):
        say(text)
    return TerrainBench(rows, wall, frames)


def ladder_m(relief_m: float, errors_m: Sequence[float] = ERRORS_M) -> list[float]:
    """Errors in steps of the square root of 2, as limen's, from half of the relief down to 8 m, and those asked for."""
    finest_m = min(_FINEST_M, *errors_m)
    steps = [finest_m]
    while steps[-1] * 2**0.5 < max(relief_m / 2, *errors_m):
        steps.append(steps[-1] * 2**0.5)
    return sorted({*steps, *errors_m}, reverse=True)


def triangle_rows(posts: Posts, errors_m: Sequence[float], say: Say) -> list[TerrainRow]:
    """Rows of all ways; those that are not installed, or cannot work with this terrain, are named and skipped."""
    tiny = Posts(posts.heights_m[:9, :9].copy(), None)
    for _ in _limen_rows(tiny, errors_m, lambda _: None):
        pass  # compiles the kernels, which is not to be timed
    rows = [*_limen_rows(posts, errors_m, say)]
    for peer, prepare in PEERS.items():
        missing = missing_package(peer)
        if missing:
            say(f"{peer}: skipped, {missing} is not installed ({INSTALL})")
            continue
        say(peer)
        try:
            make = prepare(posts)
        except InputError as error:
            say(f"{peer}: skipped, {error}")
            continue
        rows += [_row(peer, error_m, make(error_m)) for error_m in errors_m]
    return rows


def _limen_rows(posts: Posts, errors_m: Sequence[float], say: Say) -> Iterator[TerrainRow]:
    say("limen")
    begin = time.process_time()
    trees = build_trees(posts, ladder_m(float(posts.heights_m.max() - posts.heights_m.min()), errors_m))
    build_s = time.process_time() - begin
    rows, columns = posts.heights_m.shape
    for error_m in errors_m:
        triangles = drawn(patches_at(posts, trees, error_m), (columns, rows))
        yield _row("limen", error_m, Made(len(triangles), true_error_m(posts, triangles), build_s))


def _row(method: str, error_m: float, made: Made) -> TerrainRow:
    return TerrainRow(
        method=method, max_error_m=error_m, true_error_m=made.true_error_m, triangles=made.triangles,
        build_s=made.build_s,
    )  # fmt: skip


def aims(rows: Sequence[TerrainRow]) -> list[str]:
    """What was aimed at, beside what these rows say of it."""
    triangles = {(row.method, row.max_error_m): row.triangles for row in rows}
    found = []
    for peer, aim in (("delatin", "at most 1.35"), ("martini", "at most 0.40"), ("grid", "")):
        ratios = {
            error_m: count / triangles[peer, error_m]
            for (method, error_m), count in triangles.items()
            if method == "limen" and (peer, error_m) in triangles
        }
        if ratios:
            each = ", ".join(f"{ratio:.2f} at {error_m:g} m" for error_m, ratio in ratios.items())
            found.append(f"triangles, limen / {peer}: {each}" + (f" (aim: {aim})" if aim else ""))
    return found
