"""``limen show`` in windows, whatever it shows but an image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from limen.cli.asked import Asked
from limen.cli.output import Output
from limen.show.live_outputs import run_live_outputs
from limen.show.live_scene import run_live_scene
from limen.show.stage import Exhibit, MeshExhibit
from limen.viewing.viewer import Viewer

__all__ = ["say_who", "show_live"]


def show_live(exhibit: Exhibit, asked: Asked, out: Output) -> list[Any]:
    """Show it in windows until they are closed; the last report of each."""
    shown = asked.shown
    tour = asked.tour() if asked.session and shown else asked.stander()
    if isinstance(exhibit, MeshExhibit) and not isinstance(tour, Viewer):
        say_who(tour(0.0), out)
    overlay = asked.overlay != "none"
    if asked.windows.window != "outputs":
        last = run_live_scene(exhibit, shown, tour, out.say, overlay=overlay, seconds=asked.windows.seconds)
        return [last] if last else []
    assert shown is not None  # refused before anything is opened
    return run_live_outputs(exhibit, shown, tour, out.say, overlay=overlay, seconds=asked.windows.seconds)


def say_who(viewers: Sequence[Viewer], out: Output) -> None:
    """Say whose eyes a picture is right for, where there are several."""
    if len(viewers) > 1:
        name = f" ('{viewers[0].name}')" if viewers[0].name else ""
        out.say(f"a mesh is drawn for one viewer: the first of {len(viewers)}{name}")
