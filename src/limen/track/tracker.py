"""Who tells live where people are and what they point at: trackers, which other packages bring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from limen.errors import InputError
from limen.extensions import extension
from limen.viewing.viewer import Pointer, Viewer

__all__ = ["Tracker", "open_tracker", "stamped"]


class Tracker(Protocol):
    """What is known of people now. Never waits: of somebody who is lost, it tells the last place."""

    def viewers(self, time_s: float) -> Sequence[Viewer]:
        """Who looks, at a time of the show in seconds."""
        ...

    def pointers(self, time_s: float) -> Sequence[Pointer]:
        """Who points where."""
        ...

    def close(self) -> None:
        """Give back what is open."""
        ...


def open_tracker(text: str) -> Tracker:
    """A tracker by its name and, after a colon, what it wants to know: an address, a file.

    Raises
    ------
    InputError
        If no installed package has an entry point of this name in the group ``limen.trackers``.
    """
    name, _, how = text.partition(":")
    made = extension("limen.trackers", name)
    if made is None:
        raise InputError(
            f"no tracker is named '{name}': install a package that has it (an entry point of the group limen.trackers)"
        )
    tracker: Tracker = made(how)
    return tracker


def stamped(tracker: Tracker) -> Callable[[float], Sequence[Viewer]]:
    """Who looks at a time of the show, with that time as theirs: what moves by the viewers' clock goes by it."""
    return lambda time_s: [replace(viewer, time_s=time_s) for viewer in tracker.viewers(time_s)]
