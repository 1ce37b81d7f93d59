"""Packages that benchmarks compare limen with: an extra, never needed for anything else."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping

__all__ = ["INSTALL", "missing_of"]

INSTALL = "pip install 'limen[bench]'"


def missing_of(made_by: Mapping[str, str], peer: str) -> str | None:
    """The package that a peer needs by a table of them, and that is not installed; it may need none."""
    package = made_by.get(peer)
    return package if package and importlib.util.find_spec(package) is None else None
