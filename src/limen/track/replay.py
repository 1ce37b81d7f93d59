"""Session files: CSV with one commented header line; see docs/guide/sessions.md.

::

    # limen session 1: {"name": "A", "display": "reality-deck", "rate_hz": 120}
    time_s,viewer,x_m,y_m,z_m,direction_x,direction_y,direction_z
    0.0,v1,2.184706,1.7,-1.91234,0.6,0.0,-0.8

Pointers are told from viewers by a column ``role``. A person can read it, a spreadsheet too, and pandas with
``read_csv(path, comment="#")``.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
from msgspec import Meta

from limen.data.store.atomic import write_bytes
from limen.errors import MissingFileError, SessionError
from limen.track.session import Session, Track, find_fault

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from limen.geometry import Floats

__all__ = ["VERSION", "read_session", "session_text", "write_session"]

VERSION = 1
_MARK = "# limen session "
_REQUIRED = ("time_s", "viewer", "x_m", "y_m", "z_m", "direction_x", "direction_y", "direction_z")
_GAZE = ("gaze_x", "gaze_y", "gaze_z")
_ACUITY = "acuity_arcmin"
_ROLE = "role"
_ROLES = ("viewer", "pointer")
_WORDS = ("viewer", _ROLE)  # columns that hold no number
_EXAMPLE = f'{_MARK}{VERSION}: {{"name": "A", "display": "reality-deck", "rate_hz": 120}}'


class _Header(msgspec.Struct):
    """What the first line holds after the version."""

    name: Annotated[str, Meta(min_length=1)]
    display: str
    rate_hz: Annotated[float, Meta(gt=0, le=100_000)]


def write_session(path: str | Path, session: Session) -> None:
    """Write a session that `read_session` reads back exactly.

    Raises
    ------
    StorageError
        If the file cannot be written; what was there before stays.
    """
    write_bytes(path, session_text(session).encode())


def session_text(session: Session) -> str:
    """The content of a session's file; the same session gives the same bytes."""
    header = _Header(session.name, session.display, session.rate_hz)
    gaze = any(track.gaze is not None for track in session.tracks)
    acuity = any(track.acuity_arcmin is not None for track in session.tracks)
    role = (_ROLE,) if session.pointers else ()
    columns = (*_REQUIRED[:2], *role, *_REQUIRED[2:], *(_GAZE if gaze else ()), *((_ACUITY,) if acuity else ()))
    rows = [
        [*row[:2], *([name] if role else []), *row[2:]]
        for name, tracks in zip(_ROLES, (session.tracks, session.pointers), strict=True)
        for track in tracks
        for row in _rows(track, gaze, acuity)
    ]
    rows.sort(key=lambda row: float(row[0]))  # stable: viewers of one instant stay in their order
    out = io.StringIO()
    out.write(f"{_MARK}{VERSION}: {msgspec.json.encode(header).decode()}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


def _rows(track: Track, gaze: bool, acuity: bool) -> Iterable[list[str]]:
    count = len(track.time_s)
    parts = [track.position_m, track.direction]
    if gaze:
        parts.append(np.full((count, 3), np.nan) if track.gaze is None else track.gaze)
    if acuity:
        parts.append((np.full(count, np.nan) if track.acuity_arcmin is None else track.acuity_arcmin)[:, None])
    # Adding zero turns -0.0 into 0.0; repr is the shortest text that reads back to the same number.
    for time_s, numbers in zip(track.time_s.tolist(), (np.hstack(parts) + 0.0).tolist(), strict=True):
        yield [repr(time_s), track.viewer, *("" if number != number else repr(number) for number in numbers)]


def read_session(path: str | Path) -> Session:
    """Read a session file.

    Raises
    ------
    MissingFileError
        If the file does not exist.
    SessionError
        If the file is not a session or a sample cannot be used; the message names line, field and cure.
    """
    path = Path(path)
    lines = _text(path).splitlines()
    header = _header(path, lines)
    places, start = _columns(path, lines)
    samples: dict[tuple[str, str], list[list[float]]] = {}  # by role and name
    numbers: dict[tuple[str, str], list[int]] = {}  # the line of every sample
    for number, line in enumerate(lines[start:], start + 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = next(csv.reader([line]))
        if len(cells) != len(places):
            raise SessionError(f"{path}:{number}: {len(cells)} cells for {len(places)} columns; is the line cut off?")
        who = _role(path, number, places, cells), cells[places.index("viewer")].strip()
        samples.setdefault(who, []).append(_numbers(path, number, places, cells, who[0]))
        numbers.setdefault(who, []).append(number)
    if not samples:
        raise SessionError(
            f"{path}:{len(lines)}: no samples; a session needs at least one line below the columns' names"
        )
    wanted = [name for name in places if name not in _WORDS]
    tracks: dict[str, list[Track]] = {role: [] for role in _ROLES}
    for (role, name), rows in samples.items():
        tracks[role].append(_track(path, role, name, wanted, np.array(rows), numbers[role, name]))
    try:
        return Session(header.name, header.display, header.rate_hz, *(tuple(tracks[role]) for role in _ROLES))
    except SessionError as error:
        raise SessionError(f"{path}: {error}") from None


def _text(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise MissingFileError(
            f"{path}: no such session file; `limen walk --display D --seconds S {path}` makes one"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(f"{path}: cannot be read as a text file: {error}") from None
    if not text.strip():
        raise SessionError(f"{path}:1: the file is empty; its first line should look like: {_EXAMPLE}")
    return text


def _header(path: Path, lines: list[str]) -> _Header:
    first = lines[0]
    version, colon, settings = first.removeprefix(_MARK).partition(":")
    if not first.startswith(_MARK) or not colon:
        raise SessionError(f"{path}:1: not a session file; its first line should look like: {_EXAMPLE}")
    if version.strip() != str(VERSION):
        raise SessionError(f"{path}:1: version '{version.strip()}' of the format; this limen reads version {VERSION}")
    try:
        return msgspec.json.decode(settings, type=_Header)
    except (msgspec.ValidationError, msgspec.DecodeError) as error:
        raise SessionError(f"{path}:1: header: {error}; the line should look like: {_EXAMPLE}") from None


def _columns(path: Path, lines: list[str]) -> tuple[list[str], int]:
    """Names of the columns, and the number of lines up to and with theirs."""
    for number, line in enumerate(lines[1:], 2):
        if not line.strip() or line.startswith("#"):
            continue
        names = [name.strip() for name in next(csv.reader([line]))]
        known = {*_REQUIRED, *_GAZE, _ACUITY, _ROLE}
        missing = [name for name in _REQUIRED if name not in names]
        missing += [name for name in _GAZE if name not in names and set(names) & set(_GAZE)]
        unknown = [name for name in names if name not in known or names.count(name) > 1]
        if missing:
            raise SessionError(
                f"{path}:{number}: column {missing[0]} is missing; the columns are {','.join(_REQUIRED)}"
            )
        if unknown:
            raise SessionError(
                f"{path}:{number}: column '{unknown[0]}' is unknown or there twice; "
                f"optional are {','.join((*_GAZE, _ACUITY, _ROLE))}"
            )
        return names, number
    raise SessionError(
        f"{path}:{len(lines)}: nothing below the first line; add the columns {','.join(_REQUIRED)} and a line a sample"
    )


def _role(path: Path, line: int, names: Sequence[str], cells: Sequence[str]) -> str:
    """What a line tells of: a viewer, unless it says that it is a pointer."""
    role = cells[names.index(_ROLE)].strip() if _ROLE in names else ""
    if role not in ("", *_ROLES):
        raise SessionError(f"{path}:{line}: role is '{role}'; there are {' and '.join(_ROLES)}, and empty is a viewer")
    return role or _ROLES[0]


def _numbers(path: Path, line: int, names: Sequence[str], cells: Sequence[str], role: str) -> list[float]:
    values: list[float] = []
    for name, cell in zip(names, cells, strict=True):
        if name in _WORDS:
            continue
        text = cell.strip()
        if not text and (name in _GAZE or name == _ACUITY):
            values.append(np.nan)
            continue
        if role == "pointer" and (name in _GAZE or name == _ACUITY):
            raise SessionError(f"{path}:{line}: {name} of a pointer is '{text}': a pointer has no eyes, leave it empty")
        try:
            values.append(float(text))
        except ValueError:
            raise SessionError(
                f"{path}:{line}: {name} is '{text}', which is not a number; use a point for decimals"
            ) from None
        if not np.isfinite(values[-1]):
            raise SessionError(f"{path}:{line}: {name} is '{text}'; drop samples where the tracker lost the viewer")
    return values


def _track(path: Path, role: str, viewer: str, names: list[str], values: Floats, lines: list[int]) -> Track:
    def column(*wanted: str) -> Floats:
        return values[:, [names.index(name) for name in wanted]]

    time_s = column("time_s")[:, 0]
    position, direction = column("x_m", "y_m", "z_m"), column("direction_x", "direction_y", "direction_z")
    gaze = column(*_GAZE) if _GAZE[0] in names else None
    acuity = column(_ACUITY)[:, 0] if _ACUITY in names else None
    fault = find_fault(time_s, position, direction, gaze, acuity)
    if fault is not None:
        who = f" of {role} '{viewer}'" if viewer else ""
        raise SessionError(f"{path}:{lines[fault.sample]}: {fault.field}{who} {fault.message}")
    gaze = None if gaze is None or np.isnan(gaze).all() else gaze
    acuity = None if acuity is None or np.isnan(acuity).all() else acuity
    return Track(viewer, time_s, position, direction, gaze, acuity)
