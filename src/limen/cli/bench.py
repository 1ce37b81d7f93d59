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
from limen.study.panels_plot import panels_plot
from limen.study.plots import format_of

__all__ = ["bench"]


class BenchReport(msgspec.Struct):
    name: str
    rows: list[Measured] | list[PanelsRow]


def bench(
    name: Annotated[str, Parameter(help=f"Which table: {', '.join(BENCHES)}.")] = "image",
    /,
    *,
    quick: Annotated[bool, Parameter(negative="", help="A minute-long run on less data.")] = False,
    plot: Annotated[Path | None, Parameter(help="Draw the table of `panels` to a .png or .svg file.")] = None,
    common: Common = DEFAULT,
) -> None:
    """Measure on this machine. Timings are noisy on shared machines: they are medians, with peers in the same run."""
    if name not in BENCHES:
        raise InputError(f"no benchmark is named '{name}': there are {', '.join(BENCHES)}")
    if plot is not None:
        if name != "panels":
            raise InputError(f"--plot draws the benchmark 'panels', not '{name}'")
        format_of(plot)  # a wrong ending should not cost minutes of measuring
    out = Output(common)
    rows = BENCHES[name](quick, lambda text: out.say(f"measuring {text} ..."))
    out.table("", rows[0].columns, [row.cells() for row in rows])
    if plot is not None:
        panels_plot([row for row in rows if isinstance(row, PanelsRow)], plot)
    out.result(BenchReport(name, rows))
