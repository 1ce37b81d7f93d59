"""``limen show``: draw content on a display, in a window or into files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from cyclopts import Parameter

from limen.cli.arguments import (
    AcuityOption,
    DisplayOption,
    FitOption,
    PanelsOption,
    PolicyOption,
    chosen_panels,
    place,
)
from limen.cli.output import DEFAULT, Common, Output
from limen.data.image import Image, open_image
from limen.display.display import Display
from limen.errors import InputError
from limen.frame import FrameReport, Renderer
from limen.gpu.device import open_device
from limen.live import LiveSettings, Tour, run_live
from limen.placement import OnSurface
from limen.present.file import write_picture
from limen.present.room import draw_room, draw_surface
from limen.select.image import select
from limen.tolerance import Policy, tolerance_of
from limen.track.stand import standing_viewer
from limen.track.walk import session_named
from limen.viewer import Viewer

__all__ = ["show"]


class FrameRow(msgspec.Struct):
    time_s: float
    policy: str
    panels_active: int
    pages: int
    missing: int
    triangles: int
    splats: int
    max_error_px: float
    select_ms: float
    stream_ms: float
    draw_ms: float
    files: list[str]


def show(
    content: Annotated[Path, Parameter(help="An image: a pyramid of any size, or anything smaller.")],
    /,
    *,
    display: DisplayOption = "",
    panels: PanelsOption = [],  # noqa: B006 - cyclopts shows the default
    session: Annotated[str, Parameter(help="A, B or C (made for the display), or a session file.")] = "",
    viewer: Annotated[
        str, Parameter(allow_leading_hyphen=True, help="X,Y,Z of one viewer's eyes in metres, instead of a session.")
    ] = "",
    policy: PolicyOption = "acuity",
    acuity_arcmin: AcuityOption = "human",
    fit: FitOption = "contain",
    overlay: Annotated[Literal["none", "levels"], Parameter(help="levels: tint by the level drawn.")] = "none",
    out: Annotated[Path | None, Parameter(help="Write pictures into this folder instead of opening a window.")] = None,
    frames: Annotated[int, Parameter(help="With --out: how many moments, spread over the session.")] = 1,
    scale: Annotated[float, Parameter(help="With --out: draw panels with fewer pixels (0.125: an eighth).")] = 1.0,
    picture_format: Annotated[Literal["jpg", "png"], Parameter(name="--format")] = "jpg",
    simulate: Annotated[
        bool, Parameter(negative="", help="With --out: also draw the room and the unrolled wall.")
    ] = False,
    seconds: Annotated[float | None, Parameter(help="Close the window after this long.")] = None,
    common: Common = DEFAULT,
) -> None:
    """Draw content on a display: a window, or files with --out.

    Without --display, a window shows the image as a viewer does: drag to move, wheel to zoom.
    """
    out_stream = Output(common)
    if frames < 1:
        raise InputError(f"--frames must be at least 1, got {frames}")
    if session and viewer:
        raise InputError("give --session or --viewer, not both")
    chosen = Policy.parse(policy, acuity_arcmin)
    with open_image(content) as image:
        if out is None:
            settings = LiveSettings(policy=chosen, fit=fit, overlay=overlay == "levels", seconds=seconds)
            shown = chosen_panels(display, panels) if display else None
            last = run_live(image, shown, _tour(shown, session, viewer) if shown else None, settings, out_stream.say)
            out_stream.result({"frames": [_row(last, [])] if last else []})
            return
        shown = chosen_panels(display or "desktop", panels)
        moments = _moments(shown, session, viewer, frames)
        rows = list(
            _write_frames(out_stream, image, shown, moments, chosen, OnSurface(fit), out, picture_format,
                          scale=scale, overlay=overlay == "levels", simulate=simulate)
        )  # fmt: skip
    _print(out_stream, rows, out)
    out_stream.result({"frames": rows})


def _tour(display: Display, session: str, viewer: str) -> Tour:
    """Who looks at time t, as a function."""
    if session:
        recorded = session_named(session, display)
        return lambda time_s: recorded.at(recorded.start_s + time_s % recorded.duration_s)
    person = Viewer(place(viewer, "--viewer")) if viewer else standing_viewer(display)
    return lambda time_s: (person,)


def _moments(display: Display, session: str, viewer: str, frames: int) -> list[Sequence[Viewer]]:
    if not session:
        return [_tour(display, "", viewer)(0.0)] * frames
    recorded = session_named(session, display)
    times_s = recorded.start_s + np.linspace(0, recorded.duration_s, frames + 2)[1:-1]
    return [recorded.at(float(time_s)) for time_s in times_s]


def _write_frames(
    out: Output,
    image: Image,
    display: Display,
    moments: Sequence[Sequence[Viewer]],
    policy: Policy,
    placement: OnSurface,
    folder: Path,
    suffix: str,
    *,
    scale: float,
    overlay: bool,
    simulate: bool,
) -> Iterator[FrameRow]:
    shown = display if scale == 1.0 else display.scaled(scale)
    with open_device() as device, Renderer(device, shown, image, placement) as renderer:
        total = len(moments) * len(display.panels)
        with out.progress("drawing panels", total) as step:
            for number, viewers in enumerate(moments):
                target = folder / f"frame-{number:04d}"
                cut = select(renderer.view, tolerance_of(viewers, policy))
                files, pictures, reports = [], {}, []
                drawn = renderer.pictures(viewers, policy, overlay="levels" if overlay else None)
                for name, picture, report in drawn:
                    files.append(str(write_picture(target / f"{name.replace('/', '-')}.{suffix}", picture)))
                    reports.append(report)
                    if simulate:
                        pictures[name] = _small(picture)
                    step(1)
                if simulate:
                    room = draw_room(display, pictures=pictures, viewers=viewers)
                    files.append(str(write_picture(target / f"room.{suffix}", room)))
                    files.append(str(write_picture(target / f"surface.{suffix}", draw_surface(display, pictures))))
                yield _summary(reports, len(cut), cut.error_px, files)


def _small(picture: Any, width_px: int = 160) -> Any:
    """Every n-th pixel is enough for a picture of the room."""
    step = max(1, picture.shape[1] // width_px)
    return picture[::step, ::step].copy()


def _summary(reports: Sequence[FrameReport], pages: int, error_px: float, files: list[str]) -> FrameRow:
    """One row for all quilts of a frame (a report comes with every panel; those of one quilt are one object)."""
    quilts = list({id(report): report for report in reports}.values())
    row = _row(quilts[0], files)
    row.panels_active = sum(report.panels_active for report in quilts)
    row.pages, row.max_error_px = pages, error_px
    for part in ("select_ms", "stream_ms", "draw_ms"):
        setattr(row, part, sum(getattr(report, part) for report in quilts))
    return row


def _row(report: FrameReport, files: list[str]) -> FrameRow:
    fields = {key: value for key, value in asdict(report).items() if key in FrameRow.__struct_fields__}
    return FrameRow(**fields, triangles=0, splats=0, files=files)


def _print(out: Output, rows: Sequence[FrameRow], folder: Path) -> None:
    columns = ["time s", "policy", "panels", "pages", "error px", "select ms", "stream ms", "draw ms", "files"]
    cells = [
        (
            f"{row.time_s:.2f}", row.policy, row.panels_active, row.pages, f"{row.max_error_px:.1f}",
            f"{row.select_ms:.1f}", f"{row.stream_ms:.0f}", f"{row.draw_ms:.0f}", len(row.files),
        )
        for row in rows
    ]  # fmt: skip
    out.table("", columns, cells)
    out.line(f"pictures: {folder}")
