"""``limen bench``: the benchmark tables of the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError
from limen.study.bench import BENCHES, Measured
from limen.study.bench_panels import PanelsRow
from limen.study.bench_points import PointsRow, bench_points
from limen.study.bench_terrain import TerrainRow, bench_terrain
from limen.study.panels_plot import panels_plot
from limen.study.plots import format_of
from limen.study.terrain_frames import FrameRow, Table2
from limen.study.terrain_source import Content, parse_crop

__all__ = ["bench"]

_TERRAIN, _POINTS = "terrain", "points"
_NAMES = (*BENCHES, _TERRAIN, _POINTS)


class BenchReport(msgspec.Struct, omit_defaults=True):
    name: str
    rows: list[Measured] | list[PanelsRow] | list[TerrainRow] | list[PointsRow]
    table2: list[Table2] = []
    """Of `terrain`: the paper's second table."""
    frames: list[FrameRow] = []
    """Of `terrain`: one panel, beside all triangles."""


def bench(
    name: Annotated[str, Parameter(help=f"Which table: {', '.join(_NAMES)}.")] = "image",
    /,
    *,
    quick: Annotated[bool, Parameter(negative="", help="A minute-long run on less data.")] = False,
    plot: Annotated[Path | None, Parameter(help="Draw the table of `panels` to a .png or .svg file.")] = None,
    content: Annotated[
        Path | None,
        Parameter(
            help="What `terrain` measures, a DEM or a .terrain, or the cloud that `points` makes ready; else a sample."
        ),
    ] = None,
    crop: Annotated[str | None, Parameter(help="Part of the DEM: ROW,COLUMN,ROWS,COLUMNS of posts.")] = None,
    common: Common = DEFAULT,
) -> None:
    """Measure on this machine. Timings are noisy on shared machines: they are medians, with peers in the same run."""
    if name not in _NAMES:
        raise InputError(f"no benchmark is named '{name}': there are {', '.join(_NAMES)}")
    if plot is not None:
        if name != "panels":
            raise InputError(f"--plot draws the benchmark 'panels', not '{name}'")
        format_of(plot)  # a wrong ending should not cost minutes of measuring
    if content is not None and name not in (_TERRAIN, _POINTS):
        raise InputError(f"--content is for the benchmarks 'terrain' and 'points', not '{name}'")
    if crop is not None and name != _TERRAIN:
        raise InputError(f"--crop is for the benchmark 'terrain', not '{name}'")
    if crop is not None and content is None:
        raise InputError("--crop takes part of a DEM: name it with --content")
    out = Output(common)
    report = _measured(name, quick, Content(content, parse_crop(crop) if crop else None), out)
    for title, rows in (("", report.rows), ("The paper's wall", report.table2), ("One panel", report.frames)):
        if rows:
            out.table(title, rows[0].columns, [row.cells() for row in rows])
    if plot is not None:
        panels_plot([row for row in report.rows if isinstance(row, PanelsRow)], plot)
    out.result(report)


def _measured(name: str, quick: bool, content: Content, out: Output) -> BenchReport:
    def say(text: str) -> None:
        out.say(f"measuring {text} ...")

    if name == _POINTS:
        return BenchReport(name, bench_points(quick, say, content.path))
    if name != _TERRAIN:
        return BenchReport(name, BENCHES[name](quick, say))
    done = bench_terrain(quick, say, content)
    return BenchReport(name, done.rows, done.table2, done.frames)
