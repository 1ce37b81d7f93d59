"""What this machine offers: cores to work with, a folder for what can be made again."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

__all__ = ["cache_folder", "place_in_cache", "worker_count"]


def worker_count() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """Where what can be made again is kept: ``$XDG_CACHE_HOME/limen``, or else a temporary folder."""
    base = os.environ.get("XDG_CACHE_HOME")
    wanted = Path(base) / "limen" if base else Path("~/.cache/limen").expanduser()
    try:
        wanted.mkdir(parents=True, exist_ok=True)
    except OSError:
        wanted = Path(tempfile.gettempdir()) / f"limen-cache-{os.getuid() if hasattr(os, 'getuid') else 0}"
        wanted.mkdir(parents=True, exist_ok=True)
    return wanted


def place_in_cache(name: str, key: str, ending: str) -> Path:
    """Where the cache keeps what ``key`` tells apart from all else; ``name`` is for people who look into it."""
    return cache_folder() / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}{ending}"
