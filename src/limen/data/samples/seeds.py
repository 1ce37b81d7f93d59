"""Numbers that tell one sample from another."""

from __future__ import annotations

from limen.errors import InputError

__all__ = ["check_seed"]

_END = 1 << 31


def check_seed(seed: int) -> None:
    """Raises InputError for a seed that is no whole number of 31 bits."""
    if not 0 <= seed < _END:
        raise InputError(f"seed {seed} must lie between 0 and {_END - 1}")
