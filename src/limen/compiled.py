"""How loops are compiled, and when what was compiled before may be used again.

Numba's cache asks only whether a loop's own file has changed, so a loop goes on with old code when one that it calls,
or a constant, changes in another file, though both are frozen into its code. Here the compiled loops of a file are kept
in a folder that is named after the file's **stamp**, the hash of all that their code depends on: the file, the files of
this package that it imports from, theirs in turn, and the versions and settings of the compiler. What an edit does not
reach keeps its stamp, and two checkouts of the same code share one folder.
"""

# mypy: disallow-subclassing-any=False

from __future__ import annotations

import hashlib
import logging
import os
import re
import shutil
import sys
import time
import uuid
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, overload

import llvmlite
import numba
import numpy as np
from numba.core import caching

from limen.system import cache_folder

__all__ = ["compiled"]

_log = logging.getLogger(__name__)
_PACKAGE = Path(__file__).parent
_UNUSED_DAYS = 14
_FOLDER = re.compile(rf"{_PACKAGE.name}(\.\w+)+-[0-9a-f]{{16}}")
_IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+(limen[\w.]*)[ \t]+import[ \t]*(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))".replace(
        b"limen", _PACKAGE.name.encode()
    ),
    re.MULTILINE,
)
_SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "ENABLE_AVX", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")
"""Of Numba, set by the environment, that change the code it makes and are in no key of its own."""
_complaints: list[OSError] = []
"""Why loops could not be kept; the first is said."""

_Loop = Callable[..., Any]
"""To type checkers: Numba takes a float32 where they want a float, and more so."""


@overload
def compiled(function: _Loop, /) -> _Loop: ...
@overload
def compiled(
    *,
    error_model: Literal["numpy", "python"] = "numpy",
    fastmath: bool | set[str] = False,
    inline: Literal["never", "always"] = "never",
) -> Callable[[_Loop], _Loop]: ...
def compiled(
    function: _Loop | None = None,
    /,
    *,
    error_model: str = "numpy",
    fastmath: bool | set[str] = False,
    inline: str = "never",
) -> Any:
    """Compile a function when it is first called with arguments of some types, and keep its code for later processes.

    Compiled loops run beside each other: they let go of Python's lock.

    Parameters
    ----------
    error_model
        ``"numpy"``: what is divided by zero is infinite or not a number; ``"python"``: it raises ``ZeroDivisionError``.
    fastmath
        Let sums be taken in another order, or which of LLVM's flags to set.
    inline
        ``"always"``: copied into its callers before their types are known.
    """

    def make(python: _Loop) -> Any:
        # Nobody calls a loop by its address in memory: to make it callable so would be a tenth of the compiler's work.
        options = {"nogil": True, "no_cfunc_wrapper": True}
        loop: Any = numba.njit(error_model=error_model, fastmath=fastmath, inline=inline, **options)(python)
        if loop is not python:  # as it is with NUMBA_DISABLE_JIT
            loop._cache = _KeptCode(python)
        return loop

    return make if function is None else make(function)


class _KeptCode(caching._Cache):
    """One loop's compiled code on disk. Whatever is wrong with the disk, the loop is compiled, then in memory."""

    def __init__(self, function: _Loop) -> None:
        self._function = function
        # Now and not when it is first called: by then the file may say something else than what was imported.
        self._stamp = _stamp(Path(function.__code__.co_filename))

    @cached_property
    def _kept(self) -> caching._Cache:
        return caching.NullCache() if self._stamp is None else _Code(self._function)

    @property
    def cache_path(self) -> Any:
        return self._kept.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._kept.load_overload(sig, target_context)
        except Exception as error:  # as for the index below
            _log.debug("%s of %s cannot be read: %s", sig, self._function.__qualname__, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            self._kept.save_overload(sig, data)
            _prune()
        except OSError as error:
            self._kept = caching.NullCache()
            if not _complaints:
                _log.warning("compiled loops are not kept, so every process compiles them anew: %s", error)
            _complaints.append(error)

    def enable(self) -> None:
        self._kept.enable()

    def disable(self) -> None:
        self._kept.disable()

    def flush(self) -> None:
        self._kept.flush()


class _Locator(caching._CacheLocator):
    """Where Numba keeps the code of a function. It is never stale there: the folder has the stamp's name."""

    def __init__(self, function: _Loop, file: str) -> None:
        self._py_file, self._line = file, function.__code__.co_firstlineno
        self._folder = _folder(Path(file))

    def ensure_cache_path(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: _Loop, py_file: str) -> _Locator:
        return cls(py_func, py_file)


class _Impl(caching.CompileResultCacheImpl):
    _locator_classes: ClassVar = [_Locator]


class _CodeFile(caching.IndexDataCacheFile):
    """Numba numbers the files of a function's signatures, by what the index says: two processes that compile two
    signatures at once would both take the same number, and the index of one could then lead to the code of the other.
    """

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception as error:  # cut short by a full disk, say: a pickle may raise anything
            _log.debug("%s cannot be read: %s", self._index_path, error)
            return {}

    def _data_name(self, number: int) -> str:
        return str(self._data_name_pattern.format(number=number)).replace(".nbc", f".{uuid.uuid4().hex[:16]}.nbc")


class _Code(caching.FunctionCache):
    _impl_class = _Impl

    def __init__(self, function: _Loop) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _CodeFile(self._cache_path, self._impl.filename_base, locator.get_source_stamp())


@cache
def _folder(file: Path) -> Path:
    """Where the compiled loops of a file are kept; that it is used today is noted at most once a day."""
    name = ".".join((_PACKAGE.name, *file.relative_to(_PACKAGE).with_suffix("").parts))
    folder = _base() / f"{name}-{_stamp(file)}"
    try:
        if time.time() - folder.stat().st_mtime > 24 * 3600:
            os.utime(folder)
    except OSError:
        pass  # not there yet, or read only
    return folder


@cache
def _base() -> Path:
    return Path(numba.config.CACHE_DIR) if numba.config.CACHE_DIR else cache_folder() / "numba"


@cache
def _prune() -> None:
    """Remove, once a process and only by one that has compiled something, folders that were not used for long.

    Another process that needs one of them just now compiles again: to Numba a file that is gone is one that never was.
    """
    oldest = time.time() - _UNUSED_DAYS * 24 * 3600
    for entry in os.scandir(_base()):
        try:
            if _FOLDER.fullmatch(entry.name) and entry.stat().st_mtime < oldest:
                shutil.rmtree(entry, ignore_errors=True)
        except FileNotFoundError:
            continue  # another process was first


@cache
def _stamp(file: Path) -> str | None:
    """Of a file and all that the code of its loops depends on; None where sources cannot be read."""
    try:
        reached, todo = {file}, [file]
        while todo:
            new = _source(todo.pop())[1] - reached
            reached |= new
            todo += new
        sources = sorted((path.relative_to(_PACKAGE).as_posix(), _source(path)[0]) for path in reached)
    except (OSError, ValueError):  # ValueError: a file that is not in this package
        return None
    settings = [getattr(numba.config, name, None) for name in _SETTINGS]
    versions = (numba.__version__, llvmlite.__version__, np.__version__, sys.implementation.cache_tag)
    return hashlib.sha256(repr((sources, settings, versions)).encode()).hexdigest()[:16]


@cache
def _source(file: Path) -> tuple[bytes, frozenset[Path]]:
    """The hash of a file, and the files of this package that it imports from."""
    text = file.read_bytes()
    # This file's own imports are left out: they tell where code is kept, and not what it does.
    found = frozenset() if file == Path(__file__) else frozenset(_imported(text))
    return hashlib.sha256(text).digest(), found


def _imported(text: bytes) -> set[Path]:
    """Files of this package that a source imports from; a regular expression takes a fiftieth of the time of `ast`."""
    files: set[Path] = set()
    for module, names, modules in _IMPORT.findall(text):
        for name in re.findall(rb"[\w.]+", modules):
            files |= _files_of(name.decode())
        for name in re.findall(rb"\w+", names) if module else ():
            files |= _files_of(f"{module.decode()}.{name.decode()}")
    return files


@cache
def _files_of(name: str) -> frozenset[Path]:
    """The file of a module, or of the module that a name is imported from."""
    first, *inner = name.split(".")
    if first != _PACKAGE.name:
        return frozenset()
    for parts in (inner, inner[:-1]):
        for path in (_PACKAGE.joinpath(*parts).with_suffix(".py"), _PACKAGE.joinpath(*parts, "__init__.py")):
            if parts and path.is_file():
                return frozenset({path})
    return frozenset({_PACKAGE / "__init__.py"})
