"""``limen bench``: the benchmark tables of the documentation."""

from __future__ import annotations

from typing import Annotated

import msgspec
from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError
from limen.study.bench import BENCHES, Measured
from limen.study.bench_panels import PanelsRow

__all__ = ["bench"]


class BenchReport(msgspec.Struct):
    name: str
    rows: list[Measured] | list[PanelsRow]


def bench(
    name: Annotated[str, Parameter(help=f"Which table: {', '.join(BENCHES)}.")] = "image",
    /,
    *,
    quick: Annotated[bool, Parameter(negative="", help="A minute-long run on less data.")] = False,
    common: Common = DEFAULT,
) -> None:
    """Measure on this machine. Timings are noisy on shared machines: they are medians, with peers in the same run."""
    if name not in BENCHES:
        raise InputError(f"no benchmark is named '{name}': there are {', '.join(BENCHES)}")
    out = Output(common)
    rows = BENCHES[name](quick, lambda text: out.say(f"measuring {text} ..."))
    out.table("", rows[0].columns, [row.cells() for row in rows])
    out.result(BenchReport(name, rows))
