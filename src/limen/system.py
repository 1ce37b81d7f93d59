"""What this machine offers: cores to work with, a folder for what can be made again; and when Ctrl-C comes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import stat
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

__all__ = ["cache_folder", "interrupts_later", "place_in_cache", "worker_count"]


def worker_count() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """Where what can be made again is kept: ``$XDG_CACHE_HOME/limen``, ``~/.cache/limen``, or else a temporary folder.

    Raises
    ------
    OSError
        If none of them can be written to.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        wanted = (Path(base) if base else Path("~/.cache").expanduser()) / "limen"
        wanted.mkdir(parents=True, exist_ok=True)
        if os.access(wanted, os.W_OK):
            return wanted
    except (OSError, RuntimeError):  # RuntimeError: this user has no home at all
        pass
    return _temporary_folder()


def _temporary_folder() -> Path:
    """A folder of this user's alone: everybody may write beside it, and what is kept in it is run."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"limen-cache-{user}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = folder.lstat()
    if hasattr(os, "getuid") and (not stat.S_ISDIR(found.st_mode) or found.st_uid != user or found.st_mode & 0o022):
        raise PermissionError(f"{folder} can be written to by others; remove it, or set XDG_CACHE_HOME")
    return folder


def place_in_cache(name: str, key: str, ending: str) -> Path:
    """Where the cache keeps what ``key`` tells apart from all else; ``name`` is for people who look into it."""
    return cache_folder() / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}{ending}"


@contextlib.contextmanager
def interrupts_later() -> Iterator[None]:
    """Ctrl-C waits until the end of what would swallow it, as packages do that try what they can import."""
    if threading.current_thread() is not threading.main_thread():  # which alone is interrupted
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        if came:
            signal.raise_signal(signal.SIGINT)
