"""``limen verify``: the independent observer's verdict on what limen leaves out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, cast

import msgspec
from cyclopts import Parameter

from limen.cli.arguments import AcuityOption, DisplayOption, FitOption, PanelsOption, chosen_panels, refuse_acuity
from limen.cli.heard import VERIFY, Kind, given_options, refuse_kind
from limen.cli.output import DEFAULT, Common, Output
from limen.data.image.file import Image
from limen.data.mesh.mesh import Mesh
from limen.data.opening import open_content, open_picture
from limen.display.display import Display
from limen.errors import InputError
from limen.gpu.device import open_device
from limen.layers.image.select import view_of
from limen.study.observer import Observer
from limen.study.observer_controls import Control, run_controls
from limen.study.plots import format_of
from limen.study.traffic import detail_of
from limen.study.verdict_plot import verdict_plot
from limen.study.verify import FACTORS, Judged, Trial, VerifyRow, imperceptible, judge_windows, rows_of, trials_of
from limen.study.windows import Window, choose_windows
from limen.track.walk import session_named
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer

if TYPE_CHECKING:
    from limen.data.points.file import Points

__all__ = ["verify"]

_Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True, negative="")]
_Words = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]


class WindowRow(msgspec.Struct):
    """Where a window was; rows name their worst by its number."""

    panel: str
    rect_px: tuple[int, int, int, int]
    time_s: float
    viewer: str
    distance_m: float
    pixels_per_degree: float


class VerifyReport(msgspec.Struct):
    content: str
    display: str
    session: str
    seed: int
    peak_cd_m2: list[float]
    controls: list[Control]
    rows: list[VerifyRow]
    windows: list[WindowRow]


def verify(
    content: Path,
    /,
    *,
    display: DisplayOption = "",
    panels: PanelsOption = [],  # noqa: B006 - cyclopts shows the default
    session: str | None = None,
    policy: _Words = None,
    acuity_arcmin: AcuityOption = "human",
    views: int = 40,
    distance_factors: _Numbers = None,
    eccentricity_deg: _Numbers = None,
    fit: FitOption | None = None,
    seed: int = 0,
    changes: Annotated[bool, Parameter(negative="")] = False,
    speed_deg_s: float = 0.0,
    strict: Annotated[bool, Parameter(negative="")] = False,
    plot: Path | None = None,
    common: Common = DEFAULT,
) -> None:
    """Let a published model of vision look for what limen leaves out, in random windows of a walk or random views.

    Parameters
    ----------
    content
        An image: a pyramid of any size, or anything smaller. Or a mesh or points: shown from random views on one panel,
        by default the monitor of Luebke and Hallen's study, 23 inches and 1600 x 1200 pixels at 25 inches.
    session
        Whose viewers look at an image: A (the default), B, C (made for the display) or a session file.
    policy
        Policies to judge (default: acuity contrast contrast+gaze).
    views
        How many windows; of a mesh or points, how many views, of each two windows.
    distance_factors
        How many times farther away the policies are told that the viewers are (default: 1 2 5 10; 1 is the truth).
    eccentricity_deg
        Angles between the gaze and the window (default: 0; for policies with +gaze 0 10 20, of
        meshes and points 0 20 40 from their middle).
    seed
        Other numbers choose other windows.
    changes
        Of a mesh or points: judge the moment in which all of it becomes, from one frame to the next, what a policy
        leaves, instead of pictures that stand still.
    speed_deg_s
        Of a mesh or points: how fast it passes, in a direction of its own in every view, and eyes follow it; what
        policies with +motion are told.
    strict
        Exit with code 1 unless, at the true distance, every window passes and 95 % of them strictly.
    plot
        Draw detection against the distance factor to this .png or .svg.
    """
    given = given_options(verify, locals())
    if acuity_arcmin != "human":
        refuse_acuity(policy or _POLICIES)
    if panels and not display:
        raise InputError("--panels is about a display's panels: give --display too")
    out = Output(common)
    if plot is not None:
        format_of(plot)  # a wrong ending should not cost minutes of judging
    if strict and 1 not in (distance_factors or FACTORS):
        raise InputError("--strict judges the true distance: --distance-factors must hold 1")
    chosen = [Policy.parse(name, acuity_arcmin).timeless for name in policy or _POLICIES]
    if not (0 <= speed_deg_s < 1000) or (speed_deg_s and changes):
        raise InputError(f"--speed-deg-s is from 0 to 1000, and not together with --changes; got {speed_deg_s:g}")
    opened = open_content(content)
    if not isinstance(opened, Image):
        if opened.kind == "terrain":
            open_picture(content)  # says why it is none
        refuse_kind(VERIFY, given, cast("Kind", opened.kind))
        asked = _AskedScene(
            display, panels, views, seed, distance_factors or FACTORS, eccentricity_deg, changes, speed_deg_s
        )
        report = _scene_report(out, content, cast("Mesh | Points", opened), asked, chosen)
        _finish(out, report, content, plot, strict=strict)
        return
    opened.close()
    refuse_kind(VERIFY, given, "image")
    if not display:
        raise InputError("an image is judged on a display: give --display")
    trials = trials_of(chosen, distance_factors or FACTORS, eccentricity_deg)
    report = _image_report(out, content, _AskedImage(display, panels, session or "A", fit, views, seed), trials)
    _finish(out, report, content, plot, strict=strict)


class _AskedImage(NamedTuple):
    """How an image is judged."""

    display: str
    panels: list[str]
    session: str
    fit: Fit | None
    views: int
    seed: int


def _image_report(out: Output, content: Path, asked: _AskedImage, trials: list[Trial]) -> VerifyReport:
    """The verdict on windows of a walk; ends the program where the observer cannot be believed."""
    whole, part = Display.named(asked.display), chosen_panels(asked.display, asked.panels)
    walk = session_named(asked.session, whole)
    observers = {light: Observer(light) for light in sorted({panel.luminance_cd_m2 for panel in part.panels})}
    controls = _controls(out, observers)
    report = VerifyReport(str(content), part.name, walk.name, asked.seed, list(observers), controls, [], [])
    if not all(control.holds for control in controls):
        _print_failed(out, controls)
        out.result(report)
        sys.exit(1)
    with open_picture(content) as image:
        placement = OnSurface(asked.fit or "contain")
        windows = choose_windows(view_of(part, image.pyramid, placement), walk, asked.views, asked.seed)
        judged = _judge(out, image, part, placement, windows, trials, observers)
    report.rows = rows_of(trials, judged)
    report.windows = [_window_row(part, window) for window in windows]
    return report


def _finish(out: Output, report: VerifyReport, content: Path, plot: Path | None, *, strict: bool) -> None:
    if plot is not None:
        where = f"session {report.session}" if report.session else "random views"
        verdict_plot(report.rows, f"{content.name} on {report.display}, {where}", plot)
    out.result(report)
    _print(out, report)
    if strict and not imperceptible(report.rows):
        out.say("limen: not imperceptible: some windows at the true distance do not pass (--strict)")
        sys.exit(1)


class _AskedScene(NamedTuple):
    """How a mesh or points are judged."""

    display: str
    panels: list[str]
    views: int
    seed: int
    factors: Sequence[float]
    eccentricities_deg: Sequence[float] | None
    changes: bool
    speed_deg_s: float


def _scene_report(
    out: Output, content: Path, opened: Mesh | Points, asked: _AskedScene, policies: Sequence[Policy]
) -> VerifyReport:
    from limen.study import verify_scene as scenes  # Zarr and SciPy take a second

    shown, viewer = scenes.monitor()
    if asked.display:
        shown = chosen_panels(asked.display, asked.panels)
        viewer = standing_viewer(shown)
    scenes.check_one_panel(shown)
    light = shown.panels[0].luminance_cd_m2
    observers = {light: Observer(light)}
    report = VerifyReport(str(content), shown.name, "", asked.seed, [light], _controls(out, observers), [], [])
    if not all(control.holds for control in report.controls):
        _print_failed(out, report.controls)
        out.result(report)
        sys.exit(1)
    trials = trials_of(policies, asked.factors, asked.eccentricities_deg, scenes.GAZE_DEG)
    judged: list[Judged] = []
    with open_device() as device, out.progress("judging views", asked.views) as step:
        subject = scenes.subject_of(device, opened, shown)
        try:
            poses = scenes.random_poses(asked.views, asked.seed)
            for windows in scenes.judge_views(
                subject, shown, viewer, poses, trials, observers[light], changes=asked.changes,
                speed_deg_s=asked.speed_deg_s,
            ):  # fmt: skip
                judged += windows
                step(1)
        finally:
            subject.close()
    report.rows = rows_of(trials, judged)
    return report


_POLICIES = ("acuity", "contrast", "contrast+gaze")


def _controls(out: Output, observers: dict[float, Observer]) -> list[Control]:
    with out.progress("pairs with known answers", len(observers)) as step:
        found = []
        for observer in observers.values():
            found += run_controls(observer)
            step(1)
    return found


def _judge(
    out: Output,
    image: Image,
    display: Display,
    placement: OnSurface,
    windows: list[Window],
    trials: list[Trial],
    observers: dict[float, Observer],
) -> list[Judged]:
    if any(trial.policy.name == "contrast" for trial in trials):
        with out.progress("looking for contrast", 1000) as step:
            detail_of(image, display, progress=lambda done: step.to(round(1000 * done)))
    judged = []
    with open_device() as device, out.progress("judging windows", len(windows)) as step:
        for each in judge_windows(device, image, display, placement, windows, trials, observers):
            judged.append(each)
            step(1)
    return judged


def _window_row(display: Display, window: Window) -> WindowRow:
    looker = window.viewers[window.looker]
    left, top, right, bottom = (int(side) for side in window.rect_px)
    return WindowRow(
        display.panels[window.panel].name,
        (left, top, right, bottom),
        looker.time_s,
        looker.name,
        window.distance_m,
        window.pixels_per_degree,
    )


def _print_failed(out: Output, controls: list[Control]) -> None:
    rows = [
        (control.control, control.content, f"{control.jod:.3f}", f"{control.least:g} ... {control.most:g}")
        for control in controls
        if not control.holds
    ]
    out.table("the observer fails on pairs with known answers, so nothing else is reported",
              ["control", "content", "JOD", "must be"], rows)  # fmt: skip
    out.say("limen: the observer's controls failed; its packages may have changed: `limen doctor`")


def _print(out: Output, report: VerifyReport) -> None:
    columns = ["policy", "factor", "off gaze", "JOD mean", "least", "drop", "FLIP", "strict", "practical", "detected"]
    rows = [_line(row) for row in report.rows]
    windows = report.rows[0].windows
    where = f"windows of session {report.session}" if report.session else "windows of random views"
    out.table(f"{report.content} on {report.display}, {windows} {where}", columns, rows)
    out.line()
    alarms = max(row.false_alarms for row in report.rows)
    out.line(
        "Detected: JOD under 9.80 or a drop over 0.35 (twice the threshold); strict: 9.95 and 0.10 (the threshold)."
    )
    out.line(f"Detected of the catch pairs, both with all detail: {alarms * 100:.0f} %.")
    out.line("Factor: how many times farther away than she is the policy was told that the viewer is.")


def _line(row: VerifyRow) -> tuple[object, ...]:
    return (
        row.policy if row.acuity_arcmin is None else f"{row.policy} {row.acuity_arcmin:g}'",
        f"{row.distance_factor:g}",
        f"{row.eccentricity_deg:g}°",
        f"{row.jod_mean:.3f}",
        f"{row.jod_min:.3f}",
        f"{row.drop_p99_max:.2f}",
        "-" if row.flip_p99_max is None else f"{row.flip_p99_max:.3f}",
        *(f"{share * 100:.0f} %" for share in (row.strict, row.practical, row.detected)),
    )
