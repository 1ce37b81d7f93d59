"""What every reader asks of a file before it imports what reads it."""

from __future__ import annotations

from pathlib import Path

from limen.errors import FormatError, InputError, MissingFileError

__all__ = ["existing_file", "is_tiff"]

_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def existing_file(path: str | Path) -> Path:
    """The path of a file that exists and holds something; MissingFileError, InputError or FormatError otherwise."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file in it")
    if not path.exists():
        raise MissingFileError(f"{path}: there is no such file")
    if path.stat().st_size == 0:
        raise FormatError(f"{path}: is empty; copy it again")
    return path


def is_tiff(path: Path) -> bool:
    """By its first bytes."""
    with path.open("rb") as file:
        return file.read(4) in _MAGICS
