"""What every verb shares: --json, -q, -v, and the one place that writes to the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from limen.data.store.report import IngestReport

__all__ = ["DEFAULT", "Common", "Output", "visible_from"]


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class Common:
    """Options that every verb takes."""

    json: Annotated[bool, Parameter(negative="", help="Print one JSON object on stdout and nothing else there.")] = (
        False
    )
    quiet: Annotated[bool, Parameter(alias="-q", negative="", help="No progress, no remarks.")] = False
    verbose: Annotated[
        bool, Parameter(alias="-v", negative="", help="Say more; tracebacks for limen's own faults.")
    ] = False


DEFAULT = Common()
_UNITS = {"_m": " m"}
"""Of facts, by the end of their names."""


class Output:
    """Results go to stdout, everything else (progress, remarks) to stderr.

    Rich takes a sixth of a second to import in all, so each part of it is imported when it is used.
    """

    def __init__(self, common: Common) -> None:
        self.common = common

    @cached_property
    def _out(self) -> Console:
        from rich.console import Console

        # A table in a pipe or a file must not be cut to the 80 columns of a terminal that is not there.
        width = None if sys.stdout.isatty() else 200
        return Console(file=sys.stdout, highlight=False, soft_wrap=True, width=width)

    @cached_property
    def _err(self) -> Console:
        from rich.console import Console

        return Console(file=sys.stderr, highlight=False, soft_wrap=True)

    def say(self, text: str) -> None:
        """A remark, unless ``-q``."""
        if not self.common.quiet:
            self._err.print(text, markup=False)

    def detail(self, text: str) -> None:
        """A remark that only ``-v`` shows."""
        if self.common.verbose:
            self._err.print(text, markup=False)

    def line(self, text: str = "") -> None:
        """A line of the result (not with ``--json``)."""
        if not self.common.json:
            self._out.print(text, markup=False)

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table of the result (not with ``--json``); columns after the first are right-aligned."""
        if self.common.json:
            return
        from rich.table import Table

        table = Table(title=title or None, title_justify="left", box=None, pad_edge=False, padding=(0, 2, 0, 0))
        for number, column in enumerate(columns):
            table.add_column(column, justify="left" if number == 0 else "right", no_wrap=True)
        for row in rows:
            table.add_row(*(str(cell) for cell in row))
        self._out.print(table)

    def result(self, value: Any) -> None:
        """The JSON object (only with ``--json``); ``value`` is anything msgspec can encode."""
        if self.common.json:
            sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")
            sys.stdout.flush()

    def facts(self, facts: Mapping[str, Any]) -> None:
        """Lines of the result by their names (not with ``--json``); units are taken from how a name ends."""
        for name, value in facts.items():
            title, unit = next(
                ((name.removesuffix(end), unit) for end, unit in _UNITS.items() if name.endswith(end)), (name, "")
            )
            self.line(f"  {title.replace('_', ' ')}: {_of_people(value)}{unit}")

    def report(self, report: IngestReport, items: str) -> None:
        """What was written, and what that took; ``items`` is what its size counts."""
        self.result(report.flat())
        self.line(
            f"{report.path}: {_of_people(report.size)} {items}, {report.bytes:,} bytes, in {report.seconds:.1f} s with "
            f"{report.peak_rss_mib:.0f} MiB"
        )
        self.facts(report.facts)

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator[_Step]:
        """A progress bar on stderr: ``with out.progress("reading", n) as step: step(1)``."""
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn()
            if total is None or float(total).is_integer()
            else TextColumn("{task.percentage:>3.0f} %"),
            TimeRemainingColumn(compact=True),
        )
        with Progress(
            *columns, console=self._err, transient=True, disable=self.common.quiet or not self._err.is_terminal
        ) as bar:
            yield _Step(bar, bar.add_task(what, total=total))


class _Step:
    """Advances a progress bar; ``step.to(value)`` sets it."""

    def __init__(self, bar: Progress, task: Any) -> None:
        self._bar, self._task = bar, task

    def __call__(self, amount: float = 1) -> None:
        self._bar.advance(self._task, amount)

    def to(self, completed: float, total: float | None = None) -> None:
        self._bar.update(self._task, completed=completed, total=total)


def _of_people(value: Any) -> str:
    """
    >>> _of_people(60048), _of_people((600, 400)), _of_people(0.03125), _of_people("none")
    ('60,048', '600 x 400', '0.03125', 'none')
    """
    if isinstance(value, tuple):
        return " x ".join(str(each) for each in value)
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}" if isinstance(value, float) else str(value)


def visible_from(distance_factor: float | None) -> str:
    """How much farther away viewers would have to be to see nothing of what is left out."""
    return "-" if distance_factor is None or distance_factor <= 1 else f"{distance_factor:.1f} x"
