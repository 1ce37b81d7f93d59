"""What there is to tell people of data: what was written, and what a file is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec

from limen.data.store.memory import Footprint

__all__ = ["Description", "Info", "IngestReport", "amount", "crs_name", "one_line", "spans"]

_CRS_NAME = re.compile(r'^[A-Z_]+\["([^"]+)"')
_AXES = "xyz"


class IngestReport(msgspec.Struct, frozen=True, kw_only=True):
    """What ``ingest`` or ``sample`` wrote, and what that took.

    Parameters
    ----------
    size
        Texels or posts as (columns, rows), or how many triangles or points.
    bytes
        Of the file, or of all files of the folder.
    peak_rss_mib
        The process's peak of anonymous resident memory: mapped files are not its own.
    notes
        What had to be assumed or left out, a line each.
    facts
        What else there is to say of this kind, by names that carry their units.
    """

    kind: str
    path: str
    size: int | tuple[int, int]
    bytes: int
    seconds: float
    peak_rss_mib: float
    notes: tuple[str, ...]
    facts: dict[str, Any]

    @classmethod
    def of(
        cls,
        kind: str,
        path: Path,
        used: Footprint,
        *,
        size: int | tuple[int, int],
        bytes: int | None = None,
        notes: tuple[str, ...] = (),
        **facts: Any,
    ) -> IngestReport:
        """The report of what was written to ``path`` while ``used`` was watching; ``bytes`` are a file's by default."""
        return cls(
            kind=kind, path=str(path), size=size, bytes=path.stat().st_size if bytes is None else bytes,
            seconds=round(used.seconds, 3), peak_rss_mib=round(used.peak_mib, 1), notes=notes, facts=facts,
        )  # fmt: skip

    def flat(self) -> dict[str, Any]:
        """All there is to say, facts beside the rest, as ``--json`` prints it."""
        return {name: getattr(self, name) for name in self.__struct_fields__ if name != "facts"} | self.facts


class Description(NamedTuple):
    """What a file is, for people: a summary, facts by their names, what had to be assumed, and a table."""

    summary: str
    facts: Mapping[str, Any]
    notes: Sequence[str] = ()
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


class Info(Protocol):
    """What a file is: a value for ``--json``, and a description for people."""

    @property
    def kind(self) -> str: ...

    @property
    def path(self) -> str: ...

    def described(self) -> Description: ...


def amount(size_bytes: float) -> str:
    """
    >>> amount(236_000), amount(3.27e12)
    ('236 kB', '3.27e+03 GB')
    """
    for unit in ("bytes", "kB", "MB"):
        if size_bytes < 1000:
            return f"{size_bytes:.3g} {unit}"
        size_bytes /= 1000
    return f"{size_bytes:.3g} GB"


def one_line(error: BaseException) -> str:
    """What an error says, in one line.

    >>> one_line(ValueError("cannot load\\n   file  x")), one_line(KeyError())
    ('cannot load; file x', 'KeyError')
    """
    lines = (" ".join(line.split()) for line in str(error).splitlines())
    return "; ".join(line for line in lines if line) or type(error).__name__


def crs_name(wkt: str) -> str:
    """What people call a coordinate system.

    >>> crs_name('LOCAL_CS["hall",UNIT["metre",1]]'), crs_name("")
    ('hall', 'none')
    """
    found = _CRS_NAME.match(wkt)
    return found[1] if found else "none"


def spans(bounds: tuple[tuple[float, ...], tuple[float, ...]], digits: int, unit: str) -> dict[str, str]:
    """From where to where something reaches along each axis.

    >>> spans(((0.0, 1.0), (0.5, 3.0)), 6, "m")
    {'x': '0 to 0.5, 0.5 in m', 'y': '1 to 3, 2 in m'}
    """
    return {
        axis: f"{low:.{digits}g} to {high:.{digits}g}, {high - low:.6g} in {unit}"
        for axis, low, high in zip(_AXES, *bounds, strict=False)
    }
