"""Which of limen's modules pytest looks into for doctests: those that have some. It would import all others, too."""

from __future__ import annotations

from pathlib import Path

__all__ = ["PACKAGE", "has_doctests", "pytest_ignore_collect"]

PACKAGE = Path(__file__).resolve().parents[2] / "src/limen"
_PROMPT = b">>> "


def has_doctests(path: Path) -> bool:
    return _PROMPT in path.read_bytes()


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """True of a module of limen without doctests; others are for pytest to decide."""
    of_limen = collection_path.suffix == ".py" and collection_path.is_relative_to(PACKAGE)
    return True if of_limen and not has_doctests(collection_path) else None
