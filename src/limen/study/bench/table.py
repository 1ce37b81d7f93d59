"""What benchmarks find: rows of figures, for people as text and for programs as JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

__all__ = ["FIGURES", "Row", "Say", "Table", "figure"]

Say: TypeAlias = Callable[[str], None]
"""Told what is being measured, and what is skipped."""

Row: TypeAlias = dict[str, Any]
"""Figures by their columns."""

FIGURES = {"what": "", "peer": "", "value": ",.3g", "unit": ""}
"""Columns of tables whose rows have units of their own."""


def figure(what: str, value: float, unit: str, peer: str = "") -> Row:
    """A row of `FIGURES`; a peer is named where there are several."""
    return {"what": what, **({"peer": peer} if peer else {}), "value": value, "unit": unit}


@dataclass(frozen=True, slots=True)
class Table:
    """One table of a benchmark.

    Parameters
    ----------
    columns
        What may be in a row, units included (``frame_ms``), and Python's format of its numbers for people (``",.1f"``).
    rows
        Every row's figures; what was not measured is missing or None.
    notes
        What was aimed at, beside what the rows say of it.
    name
        By which programs find it among several.
    title
        By which people do.
    """

    columns: Mapping[str, str]
    rows: Sequence[Row]
    notes: Sequence[str] = ()
    name: str = "rows"
    title: str = ""

    def __post_init__(self) -> None:
        unknown = {name for row in self.rows for name in row} - set(self.columns)
        if unknown:
            raise ValueError(f"table '{self.name}' has no columns {sorted(unknown)}")

    @property
    def shown(self) -> list[str]:
        """The columns that any row has something in."""
        return [name for name in self.columns if any(row.get(name) not in (None, "") for row in self.rows)]

    @property
    def headings(self) -> list[str]:
        """Of the shown columns: their names as people write them."""
        return [name.replace("_", " ") for name in self.shown]

    @property
    def cells(self) -> list[list[str]]:
        """Of every row, as text; empty where nothing was measured."""
        return [
            [
                "" if (value := row.get(name)) is None else format(value, self.columns[name])
                for name in self.shown
            ]
            for row in self.rows
        ]  # fmt: skip
