"""Whether what was photographed hangs together."""

from __future__ import annotations

import numpy as np

from limen.calibrate.observations import Observations
from limen.display.display import Display
from limen.errors import InputError

__all__ = ["require_one_island"]

_NAMED = 4


def require_one_island(seen: Observations, display: Display, why: str) -> None:
    """Check that photographs link all panels of a display.

    Raises
    ------
    InputError
        If they fall apart; the message names panels of both parts and says ``why``.
    """
    _, panels = seen.islands(int(seen.photo.max()) + 1, len(display.panels))
    first = panels == np.bincount(panels).argmax()
    if not first.all():
        names = [[display.panels[n].name for n in np.flatnonzero(which)] for which in (~first, first)]
        raise InputError(
            f"the photographs do not link {_list(names[0])} to {_list(names[1])} ({why}): take one or two more that "
            "show panels of both"
        )


def _list(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(f"'{name}'" for name in names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
