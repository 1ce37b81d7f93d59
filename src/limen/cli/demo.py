"""``limen demo``: the main job on sample data, with a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from limen.cli.arguments import FitOption
from limen.cli.output import DEFAULT, Common, Output
from limen.cli.traffic import print_traffic
from limen.study.demo import run_demo
from limen.study.traffic import Traffic
from limen.viewing.placement import OnSurface

__all__ = ["demo"]


class DemoReport(msgspec.Struct):
    report: str
    pictures: list[str]
    traffic: Traffic
    traffic_one_to_one: Traffic
    seconds: float


def demo(
    *,
    content: Annotated[Path | None, Parameter(help="An image of yours instead of the sample.")] = None,
    out: Annotated[Path, Parameter(help="Folder for the report and the pictures.")] = Path("limen-demo"),
    fit: FitOption | None = None,
    common: Common = DEFAULT,
) -> None:
    """Walk a visitor through the Reality Deck and write an illustrated report."""
    output = Output(common)
    result = run_demo(content, out, output.progress, OnSurface(fit) if fit else None)
    own, paper = (report.summary() for report in result.traffic)
    output.result(
        DemoReport(
            report=str(result.report.resolve()),
            pictures=[str(path) for path in result.pictures],
            traffic=own,
            traffic_one_to_one=paper,
            seconds=result.seconds,
        )
    )
    for report in result.traffic:
        print_traffic(output, report)
    output.line(f"\nreport: {result.report.resolve()}")
