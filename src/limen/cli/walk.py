"""``limen walk``: make a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.display.display import Display
from limen.study.plots import format_of, walk_plot
from limen.track.replay import write_session
from limen.track.walk import heat_map, make_walk, plan_of

__all__ = ["walk"]


def walk(
    out: Path,
    /,
    *,
    display: str,
    seconds: float,
    seed: int = 0,
    viewers: int = 1,
    rate_hz: float = 120.0,
    gaze: Annotated[bool, Parameter(negative="")] = False,
    pointers: int = 0,
    picture: Path | None = None,
    common: Common = DEFAULT,
) -> None:
    """Make a session: people who walk between places of interest in front of a display.

    Parameters
    ----------
    out
        The session file to write (CSV; see docs/guide/sessions.md).
    display
        A preset's name or a display file.
    seconds
        How long the session lasts.
    seed
        Another seed is another heat map and other paths; the same gives the same file.
    viewers
        How many people walk.
    rate_hz
        Samples a second.
    gaze
        Also make up an eye tracker: fixations within 15 degrees of where the head points.
    pointers
        How many hand-held pointers wander over the display; panels in their cones are wanted in full detail.
    picture
        Also draw the heat map, the hotspots and the paths to this .png or .svg.
    """
    output = Output(common)
    shown = Display.named(display)
    if picture is not None:
        format_of(picture)  # a wrong ending should leave no session behind
    session = make_walk(shown, seconds, seed, viewers, rate_hz, name=out.stem, gaze=gaze, pointers=pointers)
    write_session(out, session)
    if picture is not None:
        heat = heat_map(shown, seed)
        plans = [plan_of(heat, seed, number, session.length_m / viewers) for number in range(viewers)]
        walk_plot(heat, [plan.corners_m[plan.stops] for plan in plans], session, picture)
    result = {
        "path": str(out),
        "frames": session.sample_count,
        "length_m": round(session.length_m, 3),
        "seconds": session.duration_s,
        "viewers": viewers,
        "pointers": pointers,
        "rate_hz": session.rate_hz,
        "seed": seed,
        "display": shown.name,
        "picture": None if picture is None else str(picture),
    }
    output.result(result)
    people = "1 viewer" if viewers == 1 else f"{viewers} viewers"
    if pointers:
        people += ", 1 pointer" if pointers == 1 else f", {pointers} pointers"
    output.line(
        f"{out}: {session.sample_count:,} frames, {session.duration_s:g} s, {people}, {session.length_m:.1f} m walked"
    )
