"""``limen bench``: the benchmark tables of the documentation."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError
from limen.study.bench.registry import BENCHMARKS
from limen.study.bench.table import Table
from limen.study.plots import format_of

__all__ = ["bench"]


def bench(
    name: Annotated[
        str, Parameter(help=f"Which: {'; '.join(f'`{name}`: {row.help}' for name, row in BENCHMARKS.items())}.")
    ] = "image",
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
    if name not in BENCHMARKS:
        raise InputError(f"no benchmark is named '{name}': there are {', '.join(BENCHMARKS)}")
    asked = {"plot": plot, "content": content, "crop": crop}
    options = {option: value for option, value in asked.items() if value is not None}
    for option in options:
        if option not in BENCHMARKS[name].options:
            having = [f"'{each}'" for each, row in BENCHMARKS.items() if option in row.options]
            noun = "benchmarks " + ", ".join(having[:-1]) + " and " if having[1:] else "benchmark "
            raise InputError(f"--{option} is for the {noun}{having[-1]}, not '{name}'")
    if plot is not None:
        format_of(plot)  # a wrong ending should not cost minutes of measuring
    out = Output(common)
    tables = _measured(name, quick, options, out)
    for table in tables:
        if table.rows:
            out.table(table.title, table.headings, table.cells)
        for note in table.notes:
            out.say(note)
    notes = [note for table in tables for note in table.notes]
    out.result({"name": name, **{table.name: table.rows for table in tables}, "notes": notes})


def _measured(name: str, quick: bool, options: Mapping[str, Any], out: Output) -> list[Table]:
    module, _, function = BENCHMARKS[name].function.partition(":")
    tables: list[Table] = getattr(import_module(module), function)(quick, out.say, **options)
    return tables
