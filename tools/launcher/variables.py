"""The environment variables of the process that a start becomes."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

__all__ = ["home_is_writable", "merged", "runtime_variables"]


def home_is_writable() -> bool:
    """Whether caches can live where programs put them; a service's user often has no home."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or "~").expanduser()
    return home.is_dir() and os.access(home, os.W_OK)


def merged(base: Mapping[str, str], found: Mapping[str, str]) -> dict[str, str]:
    """The base with ours on top; our library path goes in front of the one that is there."""
    variables = {**base, **found}
    before = base.get("LD_LIBRARY_PATH", "")
    if found.get("LD_LIBRARY_PATH") and before:
        variables["LD_LIBRARY_PATH"] = found["LD_LIBRARY_PATH"] + os.pathsep + before
    return variables


def runtime_variables(root: Path) -> dict[str, str]:
    """Folders that programs want and this session lacks.

    Mesa complains on every start without a private XDG_RUNTIME_DIR; Matplotlib without a home.
    """
    variables = {}
    if not home_is_writable() and "MPLCONFIGDIR" not in os.environ:
        variables["MPLCONFIGDIR"] = str(root / ".cache" / "matplotlib")
    if os.name != "nt" and not os.environ.get("XDG_RUNTIME_DIR"):
        folder = Path(tempfile.gettempdir()) / f"limen-{os.getuid()}"
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            if folder.stat().st_uid == os.getuid() and not folder.is_symlink():
                variables["XDG_RUNTIME_DIR"] = str(folder)
        except OSError:
            pass
    return variables
