"""What other packages add to limen, by entry points: file formats, kinds of layers, trackers."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any, Literal, TypeAlias

from limen.errors import InputError

__all__ = ["Group", "extension"]

Group: TypeAlias = Literal["limen.readers", "limen.layers", "limen.trackers"]


def extension(group: Group, name: str) -> Any:
    """What an installed package has for a name in one of limen's groups; None if none does.

    Raises
    ------
    InputError
        If it cannot be imported, or several packages have something for this name: naming them.
    """
    found = list(entry_points(group=group, name=name))
    if not found:
        return None
    packages = sorted({point.dist.name if point.dist else point.value for point in found})
    if len(packages) > 1:
        raise InputError(f"'{name}' of {group} is in {' and '.join(packages)}: uninstall all but one")
    try:
        return found[0].load()
    except Exception as error:
        said = " ".join(str(error).split())
        raise InputError(f"'{name}' of {group}, in {packages[0]}, cannot be imported: {said}") from error
