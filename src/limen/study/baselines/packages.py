"""Packages that limen is compared with: an extra, never needed for anything else."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

__all__ = ["INSTALL", "MADE_BY", "is_skipped", "missing_package"]

INSTALL = "pip install 'limen[bench]'"

MADE_BY = {
    "delatin": "pydelatin",
    "martini": "pymartini",
    "vtk": "pyvista",
    "meshoptimizer": "meshoptimizer",
    "meshoptimizer, normals": "meshoptimizer",
    "fast-simplification": "fast_simplification",
}
"""The packages that peers need; others need none."""


def missing_package(peer: str) -> str | None:
    """The package that a peer needs and that is not installed."""
    package = MADE_BY.get(peer)
    return package if package and importlib.util.find_spec(package) is None else None


def is_skipped(peer: str, say: Callable[[str], None]) -> bool:
    """Whether a peer's package is not installed; then that is said."""
    package = missing_package(peer)
    if package:
        say(f"{peer}: skipped, {package} is not installed ({INSTALL})")
    return package is not None
