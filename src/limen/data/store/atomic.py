"""A file, or a folder, that is either complete or not there."""

from __future__ import annotations

import abc
import contextlib
import errno
import os
import shutil
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Generic, TypeVar

from limen.errors import LimenError, MissingFileError, StorageError

__all__ = ["PartialFile", "PartialFolder", "is_disk_full", "write_bytes"]

_Made = TypeVar("_Made")


def is_disk_full(error: OSError) -> bool:
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


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
        with PartialFile(path) as file:
            file.write(content)
    except LimenError:
        raise
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {error.strerror or error}; choose another place") from error
    return path


class _Partial(abc.ABC, Generic[_Made]):
    """What is made beside ``path`` and moved there at the end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.partial = path.with_name(f".{path.name}.partial-{os.getpid()}")

    def __enter__(self) -> _Made:
        if not self.path.parent.is_dir():
            raise MissingFileError(f"{self.path}: the folder {self.path.parent} does not exist; make it first")
        try:
            return self._begun()
        except LimenError:
            raise
        except OSError as error:
            raise StorageError(f"{self.path}: cannot be written: {error.strerror}") from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._move()
        except OSError as problem:
            self._explain(problem)
            raise
        finally:
            self._remove()
        if isinstance(error, OSError):
            self._explain(error)

    def _explain(self, error: OSError) -> None:
        """Say of a disk that is full what to do; other errors are left as they are."""
        if is_disk_full(error):
            raise StorageError(f"{self.path}: the disk is full; free some space in {self.path.parent}") from error

    @abc.abstractmethod
    def _begun(self) -> _Made: ...

    @abc.abstractmethod
    def _move(self) -> None: ...

    @abc.abstractmethod
    def _remove(self) -> None: ...


class PartialFile(_Partial[BinaryIO]):
    """``with PartialFile(path) as file:`` writes beside ``path`` and moves there at the end, after the disk has it.

    Whatever goes wrong in between (an error, Ctrl-C, a full disk) leaves nothing behind, and an older file at
    ``path`` as it was. MissingFileError if the folder does not exist, StorageError if it cannot be written to, or the
    disk is full.
    """

    def _begun(self) -> BinaryIO:
        if self.path.is_dir():
            raise StorageError(f"{self.path}: is a folder; name a file")
        self._file = self.partial.open("wb", buffering=1 << 20)
        return self._file

    def _move(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self.partial.replace(self.path)
        self._sync_folder()

    def _remove(self) -> None:
        # Closing flushes, which fails again on a full disk; the file is thrown away in any case.
        with contextlib.suppress(OSError):
            self._file.close()
        with contextlib.suppress(OSError):
            self.partial.unlink(missing_ok=True)

    def _sync_folder(self) -> None:
        """Make the new name itself durable, where folders can be opened (not on Windows)."""
        if not hasattr(os, "O_DIRECTORY"):
            return
        handle = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            with contextlib.suppress(OSError):  # some network file systems refuse
                os.fsync(handle)
        finally:
            os.close(handle)


class PartialFolder(_Partial[Path]):
    """``with PartialFolder(path) as folder:`` fills a folder beside ``path`` and moves it there at the end.

    Whatever goes wrong in between leaves nothing behind, and an older folder at ``path`` as it was. The caller has
    checked that an older one may be replaced. MissingFileError if the parent does not exist, StorageError if it cannot
    be written to, or the disk is full.
    """

    def _begun(self) -> Path:
        shutil.rmtree(self.partial, ignore_errors=True)
        self.partial.mkdir()
        return self.partial

    def _move(self) -> None:
        """A folder that is not empty cannot be replaced at once, so for a moment there is none at ``path``."""
        old = self.path.with_name(f".{self.path.name}.old-{os.getpid()}")
        try:
            if self.path.exists():
                self.path.replace(old)
            self.partial.replace(self.path)
        except OSError as error:
            if old.exists() and not self.path.exists():
                old.replace(self.path)
            raise StorageError(f"{self.path}: cannot be put in place: {error.strerror}") from error
        shutil.rmtree(old, ignore_errors=True)

    def _remove(self) -> None:
        shutil.rmtree(self.partial, ignore_errors=True)
