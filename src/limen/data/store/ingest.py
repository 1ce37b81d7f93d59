"""What making data ready has in common, whatever it is: a folder that is whole or not there, kept in the cache."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, TypeAlias, TypeVar

from limen.data.store.atomic import partial_folder
from limen.data.store.zarr_group import MadeOf, is_group_folder
from limen.errors import FormatError, InputError, MissingFileError, NeedsIngestError
from limen.system import place_in_cache

__all__ = ["Progress", "kept_in_cache", "needs_ingest", "new_folder"]

Progress: TypeAlias = Callable[[float], None]
"""Is called with the fraction of the work that is done, 0 ... 1."""


class _Header(Protocol):
    @property
    def source(self) -> MadeOf | None: ...


class _Ready(Protocol):
    @property
    def header(self) -> _Header: ...


_Content = TypeVar("_Content", bound=_Ready)


@contextlib.contextmanager
def new_folder(path: Path, ending: str, noun: str) -> Iterator[Path]:
    """Where the files of a folder are written that appears at ``path``, or replaces one, only when all are.

    Parameters
    ----------
    ending
        Of the names of such folders.
    noun
        What is in one, for messages.

    Raises
    ------
    InputError
        If the name ends otherwise, or something else is there.
    MissingFileError
        If its parent does not exist.
    StorageError
        If it cannot be written to, or the disk is full.
    """
    if path.suffix.lower() != ending:
        raise InputError(f"{path}: the result is a folder that holds {noun}; give it a name that ends in {ending}")
    if path.exists() and not is_group_folder(path):
        raise InputError(f"{path}: is there already, and no {noun.split(' ', 1)[-1]}; remove it, or name another")
    with partial_folder(path) as folder:
        yield folder


def kept_in_cache(
    source: Path, key: str, ending: str, open_folder: Callable[[Path], _Content], make: Callable[[Path], object]
) -> _Content:
    """What was made of a file, from the cache, where it is made first unless it was made of the file as it is now.

    Parameters
    ----------
    key
        What it depends on besides the file's content.
    ending
        Of the folder's name.
    """
    place = place_in_cache(source.stem, key, ending)
    with contextlib.suppress(FormatError, MissingFileError):
        content = open_folder(place)
        made_of = content.header.source
        if made_of is not None and made_of.still(source):
            return content
    make(place)
    return open_folder(place)


def needs_ingest(path: Path, why: str, ending: str) -> NeedsIngestError:
    """What to raise where a file is too large to be made ready when it is opened: with the command that does it."""
    target = path.with_name(path.stem + ending)
    name, wanted = (f'"{each}"' if " " in str(each) else str(each) for each in (path, target))
    return NeedsIngestError(f"{path}: {why}; make it ready with: limen ingest {name} {wanted}")
