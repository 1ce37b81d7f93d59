"""``limen traffic``: what would have to move, per frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from cyclopts import Parameter

from limen.cli.arguments import chosen_panels, refuse_acuity
from limen.cli.content import opened_content
from limen.cli.heard import TRAFFIC, Kind, given_options, refuse_kind
from limen.cli.options.terrain import TERRAIN_DEFAULT, TerrainOptions
from limen.cli.output import DEFAULT, Common, Output
from limen.cli.traffic_scene import scene_traffic
from limen.cli.traffic_terrain import terrain_traffic
from limen.data.mesh.mesh_type import is_mesh
from limen.data.opening import open_picture
from limen.data.points.cloud_type import is_points
from limen.data.terrain.elevation_type import is_terrain
from limen.display.display import Display
from limen.errors import InputError
from limen.layers.common.page_detail import Detail
from limen.layers.image.select import ImageOnDisplay, view_of
from limen.study import traffic as study
from limen.study.plots import format_of, traffic_plot
from limen.study.traffic import Report, Row, SessionTraffic
from limen.track.walk import session_named
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.policy import Policy
from limen.vision.acuity import HUMAN_ARCMIN

if TYPE_CHECKING:
    from limen.data.mesh.mesh import Mesh
    from limen.data.points.file import Points

__all__ = ["print_traffic", "traffic"]

ONE_TO_ONE = "one-to-one"
_ACUITIES = ("1", "0.64", "0.5")
_Words = Annotated[list[str], Parameter(consume_multiple=True, negative="")]


def traffic(
    content: str,
    /,
    *,
    display: str,
    panels: Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")] = None,
    session: _Words | None = None,
    policy: _Words | None = None,
    acuity_arcmin: _Words | None = None,
    rate_hz: float = 30.0,
    fit: Fit | None = None,
    max_triangles: int | None = None,
    per_node: Annotated[bool, Parameter(negative="")] = False,
    plot: Path | None = None,
    terrain: TerrainOptions = TERRAIN_DEFAULT,
    common: Common = DEFAULT,
) -> None:
    """Count what every frame of a session needs, policy by policy, with nothing kept between frames.

    Of an image that is pages; of a terrain, patches (and their triangles) and pages; of a mesh triangles; of points
    splats.

    Parameters
    ----------
    content
        An image, terrain, mesh or points, or one-to-one: a made-up image with a texel on every pixel of the whole
        display.
    display
        A preset's name or a display file.
    panels
        Count only panels whose names match any of these patterns; the image still lies on the whole display.
    session
        A, B, C (the default: all three) or session files.
    policy
        full, acuity, contrast, snellen, all but full also with +gaze appended; for a terrain also scheel (default: full
        acuity; for an image file also acuity+gaze contrast contrast+gaze; for a terrain full scheel acuity
        acuity+gaze; for a mesh or points full acuity contrast contrast+gaze; there is also budget:N).
    acuity_arcmin
        A row of each policy for each of these (human and snellen are names). By default acuity has rows for 1 0.64 0.5,
        the others for 0.64.
    rate_hz
        Frames of the session to look at, per second.
    fit
        How an image file lies on the display: contain (the default), cover, one-to-one.
    max_triangles
        Of a terrain: a budget. Where a frame would want more of them, all errors grow.
    per_node
        Count a page once for every node that shows it, instead of once for the wall.
    plot
        Draw pages over time to this .png or .svg.
    """
    given = given_options(traffic, locals())
    kind: Kind = "one-to-one" if content == ONE_TO_ONE else _kind_of_file(content)
    refuse_kind(TRAFFIC, given, kind)
    if acuity_arcmin is not None and policy:
        refuse_acuity(policy)
    out = Output(common)
    whole, part = Display.named(display), chosen_panels(display, panels or [])
    sessions = [session_named(name, whole) for name in session or ["A", "B", "C"]]
    for walked in sessions:
        if walked.display != whole.name:
            out.say(f"session '{walked.name}' was made for '{walked.display}', and is counted on '{whole.name}'")
    if per_node and set(part.nodes) == {""}:
        raise InputError(f"--per-node: no panel of '{part.name}' names the node that draws it; leave it out")
    if kind == "terrain":
        chosen = study.policies_of(
            policy or ["full", "scheel", "acuity", "acuity+gaze"], acuity_arcmin or [HUMAN_ARCMIN]
        )
        terrain_traffic(out, content, whole, part, sessions, chosen, terrain, max_triangles, rate_hz)
        return
    if kind in ("mesh", "points"):
        opened = opened_content(out, content)
        names = policy or ["full", "acuity", "contrast", "contrast+gaze"]
        counted = study.policies_of(names, acuity_arcmin or [HUMAN_ARCMIN])
        scene_traffic(out, cast("Mesh | Points", opened), content, whole, part, sessions, counted, rate_hz)
        return
    policies = _policies(content, policy, acuity_arcmin)
    if plot is not None:
        format_of(plot)  # a wrong ending should not cost a minute of counting
    view, page_bytes, detail = _view(out, content, part, fit or "contain", policies)
    with out.progress("counting pages", study.frames_of(sessions, rate_hz)) as step:
        counts = tuple(
            study.count_traffic(view, walked, policies, rate_hz=rate_hz, per_node=per_node, detail=detail, advance=step)
            for walked in sessions
        )
    report = study.Report(content, view, rate_hz, page_bytes, per_node, counts)
    if plot is not None:
        traffic_plot(report, plot)
    out.result(report.summary())
    print_traffic(out, report)


def _kind_of_file(path: str) -> Kind:
    """What a file is, without opening it: an image, if nothing else."""
    if is_terrain(path):
        return "terrain"
    return "points" if is_points(path) else "mesh" if is_mesh(path) else "image"


def _policies(content: str, names: Sequence[str] | None, acuities: Sequence[str] | None) -> tuple[Policy, ...]:
    if names:
        return study.policies_of(names, acuities or _ACUITIES)
    more = ["acuity+gaze"] if content == ONE_TO_ONE else ["acuity+gaze", "contrast", "contrast+gaze"]
    found = study.policies_of(["full", "acuity"], acuities or _ACUITIES)
    return found + study.policies_of(more, acuities or [HUMAN_ARCMIN])


def _view(
    out: Output, content: str, display: Display, fit: Fit, policies: Sequence[Policy]
) -> tuple[ImageOnDisplay, float, Detail | None]:
    if content == ONE_TO_ONE:
        return study.one_to_one_view(display), study.PAPER_PAGE_BYTES, None
    with open_picture(content) as image:
        view, detail = view_of(display, image.pyramid, OnSurface(fit)), None
        if any(policy.name == "contrast" for policy in policies):
            with out.progress("looking for contrast", 1000) as step:
                detail = study.detail_of(image, display, progress=lambda done: step.to(round(1000 * done)))
        return view, study.page_bytes_of(image), detail


def print_traffic(out: Output, report: Report) -> None:
    summary = report.summary()
    where = f"{summary.display}, {summary.panels} panels, {summary.total_px / 1e9:.3g} gigapixels"
    columns = ("", "policy", "pages", "99 %", "MB", "MB/s", "saved", "x floor")
    rows = [line for session in summary.sessions for line in _lines(session)]
    out.table(f"{summary.content} on {where}: a frame needs", columns, rows)
    out.line()
    for session in summary.sessions:
        people = "1 viewer" if session.viewers == 1 else f"{session.viewers} viewers"
        floor = f"{session.floor_samples_mean / 1e6:.1f} million samples a frame"
        out.line(
            f"{session.name}: {session.frames:,} frames, {session.duration_s:g} s, {people}; human eyes resolve {floor}"
        )
    out.line(
        f"A page is 256 x 256 texels, {summary.page_bytes / 1000:.3g} kB; nothing is kept from frame to frame"
        + (",\nand every node fetches for itself" if summary.per_node else "")
        + "; MB/s at 30 frames/s;\nx floor: texels moved over what eyes of that acuity resolve."
    )


def _lines(session: SessionTraffic) -> list[Sequence[object]]:
    return [_line(session.name if number == 0 else "", row) for number, row in enumerate(session.rows)]


def _line(name: str, row: Row) -> Sequence[object]:
    return (
        name,
        row.policy if row.acuity_arcmin is None else f"{row.policy} {row.acuity_arcmin:g}'",
        f"{row.pages_mean:,.0f}",
        f"{row.pages_p99:,.0f}",
        f"{row.bytes_mean / 1e6:,.1f}",
        f"{row.bytes_per_s / 1e6:,.0f}",
        "-" if row.policy == "full" else f"{row.saving * 100:.1f} %",
        f"{row.texels_over_floor:.2f}",
    )
