"""Terrains: triangles at a true error beside peers, frames on the paper's wall, and frames beside VTK's full grid.

References
----------
Scheel, Löffler, Lehmann, Schumann, Staadt 2014, *Dynamic Level of Detail for Tiled Large High-Resolution Displays*.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from limen.errors import InputError
from limen.gpu.device import open_device
from limen.study.baselines.packages import is_skipped
from limen.study.baselines.triangulators import PEERS, Made
from limen.study.bench.table import Row, Say, Table
from limen.study.bench.terrain_frames import FRAMES, frame_aims, frame_rows
from limen.study.bench.terrain_source import parse_crop, posts_of, prepared
from limen.study.bench.terrain_table import TABLE2, table2
from limen.study.bench.timing import timed
from limen.study.triangulations import Posts, build_trees, drawn, patches_at, true_error_m

__all__ = ["ERRORS_M", "aims", "bench_terrain", "ladder_m", "triangle_rows"]

ERRORS_M = (200.0, 100.0, 50.0, 20.0)
_SAMPLE, _QUICK_SAMPLE = 4097, 1025
_FINEST_M = 8.0
"""Limen's trees are built down to here, as ingesting would, whatever errors are asked for."""

_COLUMNS = {"method": "", "max_error_m": "g", "true_error_m": ".2f", "triangles": ",", "build_s": ".2f"}
"""The error wanted, and that at all posts, measured by the same rasteriser for all. Building is processor time, of all
threads; limen's and the grid's is that of all errors at once, the same in all rows."""


def bench_terrain(quick: bool, say: Say, content: Path | None = None, crop: str | None = None) -> list[Table]:
    """The tables of ``limen bench terrain``.

    Parameters
    ----------
    content, crop
        A raster of heights or a ``.terrain`` instead of the sample, and a part of the raster:
        ``ROW,COLUMN,ROWS,COLUMNS`` of posts.
    """
    if crop is not None and content is None:
        raise InputError("--crop takes part of a DEM: name it with --content")
    part, size = parse_crop(crop) if crop else None, _QUICK_SAMPLE if quick else _SAMPLE
    with open_device() as device, prepared(content, part, size, say) as terrain:
        say(f"{terrain.name}: {terrain.size_posts[0]} x {terrain.size_posts[1]} posts, on {device.adapter_name}")
        posts = posts_of(terrain)
        frames = frame_rows(device, terrain, posts, 3 if quick else 5, say)
        wall = table2(device, terrain, 1 if quick else 3, say)
        rows = triangle_rows(posts, ERRORS_M, say)
    return [
        Table(_COLUMNS, rows, aims(rows)),
        Table(TABLE2, wall, name="table2", title="The paper's wall"),
        Table(FRAMES, frames, list(frame_aims(frames)), name="frames", title="One panel"),
    ]


def ladder_m(relief_m: float, errors_m: Sequence[float] = ERRORS_M) -> list[float]:
    """Errors in steps of the square root of 2, as limen's, from half of the relief down to 8 m, and those asked for."""
    finest_m = min(_FINEST_M, *errors_m)
    steps = [finest_m]
    while steps[-1] * 2**0.5 < max(relief_m / 2, *errors_m):
        steps.append(steps[-1] * 2**0.5)
    return sorted({*steps, *errors_m}, reverse=True)


def triangle_rows(posts: Posts, errors_m: Sequence[float], say: Say) -> list[Row]:
    """Rows of all ways; those that are not installed, or cannot work with this terrain, are named and skipped."""
    tiny = Posts(posts.heights_m[:9, :9].copy(), None)
    for _ in _limen_rows(tiny, errors_m):
        pass  # compiles the kernels, which is not to be timed
    say("limen")
    rows = [*_limen_rows(posts, errors_m)]
    for peer, prepare in PEERS.items():
        if is_skipped(peer, say):
            continue
        say(peer)
        try:
            make = prepare(posts)
        except InputError as error:
            say(f"{peer}: skipped, {error}")
            continue
        rows += [_row(peer, error_m, make(error_m)) for error_m in errors_m]
    return rows


def _limen_rows(posts: Posts, errors_m: Sequence[float]) -> Iterator[Row]:
    relief_m = float(posts.heights_m.max() - posts.heights_m.min())
    trees, spent = timed(lambda: build_trees(posts, ladder_m(relief_m, errors_m)))
    rows, columns = posts.heights_m.shape
    for error_m in errors_m:
        triangles = drawn(patches_at(posts, trees, error_m), (columns, rows))
        made = Made(len(triangles), true_error_m(posts, triangles), spent.cpu_ms / 1e3)
        yield _row("limen", error_m, made)


def _row(method: str, error_m: float, made: Made) -> Row:
    return {"method": method, "max_error_m": error_m, **made._asdict()}


def aims(rows: Sequence[Row]) -> list[str]:
    """What was aimed at, beside what these rows say of it."""
    triangles = {(row["method"], row["max_error_m"]): row["triangles"] for row in rows}
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
