"""A file, or a folder, that is either complete or not there."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from limen.errors import LimenError, MissingFileError, StorageError

__all__ = ["partial_file", "partial_folder", "write_bytes"]


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a whole file or nothing; returns the path.

    Raises
    ------
    MissingFileError
        If the folder does not exist.
    StorageError
        If the disk refuses; the message names the file and what to do.
    """
    path = Path(path)
    try:
        with partial_file(path) as file:
            file.write(content)
    except LimenError:
        raise
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {error.strerror or error}; choose another place") from error
    return path


@contextlib.contextmanager
def partial_file(path: Path) -> Iterator[BinaryIO]:
    """A file that is written beside ``path``, where ``name`` says, and moves there at the end, after the disk has it.

    Whatever goes wrong in between (an error, Ctrl-C, a full disk) leaves nothing behind, and an older file at
    ``path`` as it was. MissingFileError if the folder does not exist, StorageError if it cannot be written to, or the
    disk is full.
    """
    with _beside(path) as partial:
        if path.is_dir():
            raise StorageError(f"{path}: is a folder; name a file")
        with _first_written(path):
            file = partial.open("wb", buffering=1 << 20)
        try:
            yield file
            file.flush()
            os.fsync(file.fileno())
            file.close()
            partial.replace(path)
            _sync_folder(path.parent)
        finally:
            # Closing flushes, which fails again on a full disk; the file is thrown away in any case.
            with contextlib.suppress(OSError):
                file.close()
            with contextlib.suppress(OSError):
                partial.unlink(missing_ok=True)


@contextlib.contextmanager
def partial_folder(path: Path) -> Iterator[Path]:
    """A folder that is filled beside ``path``, and moves there at the end.

    Whatever goes wrong in between leaves nothing behind, and an older folder at ``path`` as it was. The caller has
    checked that an older one may be replaced. MissingFileError if the parent does not exist, StorageError if it cannot
    be written to, or the disk is full.
    """
    with _beside(path) as partial:
        shutil.rmtree(partial, ignore_errors=True)
        with _first_written(path):
            partial.mkdir()
        try:
            yield partial
            _move(partial, path)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Where what is to be at ``path`` is made; a disk that is full while it is made is a StorageError."""
    if not path.parent.is_dir():
        raise MissingFileError(f"{path}: the folder {path.parent} does not exist; make it first")
    try:
        yield path.with_name(f".{path.name}.partial-{os.getpid()}")
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise StorageError(f"{path}: the disk is full; free some space in {path.parent}") from error
        raise


@contextlib.contextmanager
def _first_written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {error.strerror}") from error


def _sync_folder(folder: Path) -> None:
    """Make a new name in it durable, where folders can be opened (not on Windows)."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # some network file systems refuse
            os.fsync(handle)
    finally:
        os.close(handle)


def _move(partial: Path, path: Path) -> None:
    """A folder that is not empty cannot be replaced at once, so for a moment there is none at ``path``."""
    old = path.with_name(f".{path.name}.old-{os.getpid()}")
    try:
        if path.exists():
            path.replace(old)
        partial.replace(path)
    except OSError as error:
        if old.exists() and not path.exists():
            old.replace(path)
        raise StorageError(f"{path}: cannot be put in place: {error.strerror}") from error
    shutil.rmtree(old, ignore_errors=True)
