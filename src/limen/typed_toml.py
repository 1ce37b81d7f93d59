"""TOML files of known fields: what is wrong in one is told with its line and its field."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from limen.errors import FormatError, MissingFileError

__all__ = ["line_of", "read_text", "schema_of", "typed"]

Struct = TypeVar("Struct", bound=msgspec.Struct)


def read_text(path: Path, what: str) -> str:
    """The text of a file; ``what`` it is to be, for errors.

    Raises
    ------
    MissingFileError, FormatError
        If there is none, or no text in it.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such {what}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as a text file: {error}") from None


def typed(path: Path, text: str, kind: type[Struct]) -> Struct:
    """A TOML file's text as a struct.

    Raises
    ------
    FormatError
        Naming the line and the field.
    """
    try:
        return msgspec.convert(tomllib.loads(text), kind)
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"{path}: not valid TOML: {error}") from None
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `")
        where = where.rstrip("`")
        unknown = re.search(r"unknown field `(\w+)`", message)
        line = line_of(text, where + (f".{unknown[1]}" if unknown else ""))
        field = f" (field {where.removeprefix('$.')})" if where and where != "$" else ""
        raise FormatError(f"{path}:{line}: {message}{field}") from None


def line_of(text: str, where: str) -> int:
    """The line that a path like ``$.grid[1].size_px[0]`` points at; of its table, if the key is not there.

    >>> line_of("[[grid]]\\nname = 'a'\\n[[grid]]\\nname = 'b'", "$.grid[1].name")
    4
    """
    parts: list[tuple[str, str]] = re.findall(r"\.(\w+)|\[(\d+)\]", where)
    keys = [name for name, _ in parts if name]
    index = next((int(number) for _, number in parts if number), 0)
    lines = text.splitlines()
    start, end = 0, len(lines)
    tables = [n for n, line in enumerate(lines) if keys and re.match(rf"\s*\[\[\s*{keys[0]}\s*\]\]", line)]
    if index < len(tables):
        start = tables[index]
        end = next((n for n in range(start + 1, end) if lines[n].lstrip().startswith("[[")), end)
        keys = keys[1:]
    found = start
    for key in keys:  # the deepest key that is named in these lines, each after the one that holds it
        pattern = rf"\s*{key}\s*=|\s*\[[\w.]*\b{key}\]|.*[{{,]\s*{key}\s*="
        found = next((n for n in range(found, end) if re.match(pattern, lines[n])), found)
    return found + 1


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """JSON Schema of a struct's files, which editors can use."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(kind)}
