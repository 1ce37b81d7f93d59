"""Folders that are Zarr groups of ours: how arrays are stored, and whether a copy is whole.

Zarr takes a third of a second to import; whoever only asks whether a folder is one does without.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import msgspec
import numpy as np

from limen.data.store.atomic import write_bytes
from limen.data.store.report import one_line
from limen.errors import FormatError, MissingFileError, PageError

if TYPE_CHECKING:
    import zarr

__all__ = [
    "FILES", "MadeOf", "checked_header", "create_array", "create_table", "is_group_folder", "list_files",
    "opening", "reading", "seal", "table_of",
]  # fmt: skip

FILES = "files.json"
"""Lists all other files of a folder with their sizes."""

_Header = TypeVar("_Header", bound=msgspec.Struct)


def _codecs(item_bytes: int) -> list[Any]:
    """Bytes of equal weight side by side, then Zstandard: what differs little from item to item becomes small."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    return [BloscCodec(typesize=item_bytes, cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()]


def create_array(
    group: zarr.Group, name: str, shape: Any, dtype: Any, chunks: Any, shards: Any, item_bytes: int
) -> Any:
    """An array of zeros whose items of ``item_bytes`` bytes are much alike."""
    return group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks,
        shards=shards,
        compressors=_codecs(item_bytes),
        fill_value=0,
        # An absent chunk would read as zeros: as if there were data.
        config={"write_empty_chunks": True},
    )


def create_table(group: zarr.Group, name: str, table: Any) -> None:
    """An array that is read and written as a whole."""
    array = create_array(group, name, table.shape, table.dtype, table.shape, None, table.dtype.itemsize)
    array[...] = table


def table_of(group: zarr.Group, name: str) -> Any:
    """All of an array."""
    array: Any = group[name]
    return np.asarray(array[...])


def list_files(folder: Path) -> dict[str, int]:
    """Every file below ``folder`` but the list itself, and its size in bytes."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != FILES)
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in files}


def seal(folder: Path) -> int:
    """List the files of a folder that is complete, so that a copy in part is found out; returns their bytes."""
    files = list_files(folder)
    write_bytes(folder / FILES, msgspec.json.encode(files))
    return sum(files.values())


class MadeOf(msgspec.Struct, frozen=True, kw_only=True):
    """The file that a folder was made of, as it was then; kinds add how they read it."""

    name: str
    bytes: int
    mtime_ns: int

    @classmethod
    def of(cls, path: Path, **more: Any) -> Self:
        """A file as it is now, and what else there is to say of it."""
        state = path.stat()
        return cls(name=path.name, bytes=state.st_size, mtime_ns=state.st_mtime_ns, **more)

    def still(self, path: Path) -> bool:
        """Whether a file is as it was."""
        state = path.stat()
        return (self.bytes, self.mtime_ns) == (state.st_size, state.st_mtime_ns)


def is_group_folder(path: Path) -> bool:
    """Whether ``path`` is a folder that says it is one of ours."""
    return path.is_dir() and (path / FILES).is_file() and (path / "zarr.json").is_file()


def checked_header(path: Path, kind: type[_Header], version: int, what: str, make: str) -> _Header:
    """The attribute ``limen`` of the group at ``path``, after all its files were found as they were listed.

    Parameters
    ----------
    what, make
        What it should be, and the command that makes one, for messages.

    Raises
    ------
    MissingFileError
        If there is no such folder.
    FormatError
        If it is something else, damaged, incomplete, or of another version.
    """
    if not path.exists():
        raise MissingFileError(f"{path}: there is no such folder")
    if not is_group_folder(path):
        raise FormatError(f"{path}: is no {what}, or copied in part; make one with: {make}")
    try:
        listed = msgspec.json.decode((path / FILES).read_bytes(), type=dict[str, int])
        attributes = msgspec.json.decode((path / "zarr.json").read_bytes())["attributes"]
        if attributes["limen"]["version"] != version:
            raise FormatError(f"{path}: was made by another version of limen; ingest its source again")
        header = msgspec.convert(attributes["limen"], type=kind)
    except (msgspec.DecodeError, msgspec.ValidationError, KeyError, TypeError, OSError) as error:
        raise FormatError(f"{path}: its description is damaged ({one_line(error)}); copy it again") from error
    found = list_files(path)
    wrong = sorted(name for name, size in listed.items() if found.get(name) != size)
    if wrong:
        raise FormatError(
            f"{path}: {len(wrong)} of its {len(listed)} files are missing or cut short ({wrong[0]}); copy it again"
        )
    return header


@contextlib.contextmanager
def opening(path: Path) -> Iterator[None]:
    """Whatever goes wrong inside is a FormatError of ``path``."""
    try:
        yield
    except Exception as error:  # Zarr and its codecs raise whatever they like
        raise FormatError(f"{path}: its tables cannot be read ({one_line(error)}); copy it again") from error


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Whatever goes wrong inside is a PageError that names ``what``."""
    try:
        yield
    except Exception as error:
        raise PageError(f"{path}: {what} cannot be read ({one_line(error)}); copy it again") from error
