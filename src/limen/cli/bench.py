"""``limen bench``: the benchmark tables of the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError
from limen.study.bench import BENCHES, Measured
from limen.study.bench_lens import LensRow
from limen.study.bench_mesh import MeshComparison, bench_mesh
from limen.study.bench_panels import PanelsRow
from limen.study.bench_points import PeerRow, bench_points
from limen.study.bench_terrain import TerrainRow, bench_terrain
from limen.study.mesh_plot import mesh_plot
from limen.study.observer import INSTALL, missing_packages
from limen.study.panels_plot import panels_plot
from limen.study.plots import format_of
from limen.study.terrain_frames import Table2, TerrainFrameRow
from limen.study.terrain_source import MeasuredTerrain, parse_crop

__all__ = ["bench"]

_TERRAIN, _POINTS, _MESH = "terrain", "points", "mesh"
_NAMES = (*BENCHES, _TERRAIN, _POINTS, _MESH)
_PLOTTED = ("panels", _MESH)


class BenchReport(msgspec.Struct, omit_defaults=True):
    name: str
    rows: list[Measured] | list[PanelsRow] | list[LensRow] | list[TerrainRow] | list[PeerRow]
    table2: list[Table2] = []
    """Of `terrain`: the paper's second table."""
    frames: list[TerrainFrameRow] = []
    """Of `terrain`: one panel, beside all triangles."""


def bench(
    name: Annotated[str, Parameter(help=f"Which table: {', '.join(_NAMES)}.")] = "image",
    /,
    *,
    quick: Annotated[bool, Parameter(negative="", help="A minute-long run on less data.")] = False,
    plot: Annotated[
        Path | None, Parameter(help="Draw the table of `panels`, or pictures of `mesh`, to a .png or .svg file.")
    ] = None,
    content: Annotated[
        Path | None,
        Parameter(
            help="What is measured instead of a sample: a DEM or .terrain by `terrain`, a cloud by `points`, a mesh by "
            "`mesh`."
        ),
    ] = None,
    crop: Annotated[str | None, Parameter(help="Part of the DEM: ROW,COLUMN,ROWS,COLUMNS of posts.")] = None,
    common: Common = DEFAULT,
) -> None:
    """Measure on this machine. Timings are noisy on shared machines: they are medians, with peers in the same run."""
    if name not in _NAMES:
        raise InputError(f"no benchmark is named '{name}': there are {', '.join(_NAMES)}")
    if plot is not None:
        if name not in _PLOTTED:
            raise InputError(f"--plot draws the benchmarks 'panels' and 'mesh', not '{name}'")
        format_of(plot)  # a wrong ending should not cost minutes of measuring
        if name == _MESH and missing_packages():
            raise InputError(f"--plot draws what the observer judged, and it is not installed: run {INSTALL[0]}")
    if content is not None and name not in (_TERRAIN, _POINTS, _MESH):
        raise InputError(f"--content is for the benchmarks 'terrain', 'points' and 'mesh', not '{name}'")
    if crop is not None and name != _TERRAIN:
        raise InputError(f"--crop is for the benchmark 'terrain', not '{name}'")
    if crop is not None and content is None:
        raise InputError("--crop takes part of a DEM: name it with --content")
    out = Output(common)
    report, seen = _measured(name, quick, MeasuredTerrain(content, parse_crop(crop) if crop else None), out)
    for title, rows in (("", report.rows), ("The paper's wall", report.table2), ("One panel", report.frames)):
        if rows:
            out.table(title, rows[0].columns, [row.cells() for row in rows])
    if plot is not None and seen is not None:
        mesh_plot(seen, plot)
    elif plot is not None:
        panels_plot([row for row in report.rows if isinstance(row, PanelsRow)], plot)
    out.result(report)


def _measured(
    name: str, quick: bool, content: MeasuredTerrain, out: Output
) -> tuple[BenchReport, MeshComparison | None]:
    def say(text: str) -> None:
        out.say(f"measuring {text} ...")

    if name == _POINTS:
        return BenchReport(name, bench_points(quick, say, content.path)), None
    if name == _MESH:
        found = bench_mesh(quick, say, content.path)
        return BenchReport(name, found.rows), found.seen
    if name != _TERRAIN:
        return BenchReport(name, BENCHES[name](quick, say)), None
    done = bench_terrain(quick, say, content)
    return BenchReport(name, done.rows, done.table2, done.frames), None
