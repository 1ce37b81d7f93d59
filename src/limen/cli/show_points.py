"""``limen show`` for clouds of points: through the panels as through windows, to files or live."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from limen.cli.asked import Asked
from limen.cli.options.mesh import MeshOptions, Write
from limen.cli.options.points import PointsOptions
from limen.cli.output import Output
from limen.cli.show_image import FrameRow
from limen.cli.show_live import say_who, show_live
from limen.cli.show_mesh import check_files, check_quilts, lit_display, onlooker_names, onlookers, visible_from
from limen.gpu.device import open_device
from limen.pictures.files import file_stem, write_picture
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.display.display import Display
    from limen.layers.points.draw.drawer import PointsOverlay
    from limen.layers.points.renderer import PointsReport
    from limen.show.points_stage import PointsExhibit

__all__ = ["points_row", "show_points", "write_points_frames"]


def show_points(
    content: Points,
    asked: Asked,
    mesh: MeshOptions,
    options: PointsOptions,
    policy: Policy,
    folder: Path | None,
    out: Output,
) -> None:
    """Draw a cloud in windows, or into a folder."""
    from limen.layers.points.renderer import PointsReport  # Zarr and Numba take a second
    from limen.show.points_stage import PointsExhibit

    shown = asked.shown
    overlay: PointsOverlay = "panels" if asked.overlay == "panels" else "simplified"
    settings = mesh.settings(asked.whole, up=content.up, tilt_deg=content.tilt_deg)
    exhibit = PointsExhibit(content, settings, policy, options.lit, options.splats, overlay)
    if folder is None or shown is None:
        last = show_live(exhibit, asked, out)
        out.result({"frames": [points_row(PointsReport.of(last), [])] if last else []})
        return
    check_quilts(mesh, shown, asked.files.scale)
    asked.say_scale(out)
    moments = asked.moments()
    say_who(moments[0], out)
    drawn = write_points_frames(
        out, exhibit, shown.scaled(asked.files.scale), moments, folder, asked.files.picture_format, write=mesh.write,
        overlay=None if asked.overlay == "none" else overlay, simulate=asked.files.simulate,
        seen_from=asked.files.seen_from,
    )  # fmt: skip
    rows = [points_row(report, files) for report, files in drawn]
    _print_rows(out, rows, folder)
    out.result({"frames": rows})


def write_points_frames(
    out: Output,
    exhibit: PointsExhibit,
    display: Display,
    moments: Sequence[Sequence[Viewer]],
    folder: Path,
    suffix: str,
    *,
    write: Write,
    overlay: PointsOverlay | None,
    simulate: bool,
    seen_from: str,
) -> Iterator[tuple[PointsReport, list[str]]]:
    """Write what every panel or quilt shows, frame by frame: the frame's report, and the files."""
    from limen.layers.points.renderer import PointsReport

    check_files(display, write, onlooker_names(simulate))
    with ExitStack() as stack:
        device = stack.enter_context(open_device())
        renderer = stack.enter_context(exhibit.renderer(device, display))
        simulated = renderer
        if simulate and lit_display(display) is not display:
            simulated = stack.enter_context(exhibit.renderer(device, lit_display(display)))
        step = stack.enter_context(out.progress("drawing", len(moments)))
        for number, viewers in enumerate(moments):
            for each in {renderer, simulated}:
                exhibit.pose(each, viewers[0].time_s)
            target = folder / f"frame-{number:04d}"
            files: list[str] = []
            reports: dict[int, PointsReport] = {}  # one for every quilt
            draw = renderer.quilt_pictures if write == "quilts" else renderer.pictures
            for name, picture, report in draw(viewers, exhibit.policy, overlay=overlay):
                files.append(str(write_picture(target / f"{file_stem(name)}.{suffix}", picture)))
                reports[id(report)] = report
            if simulate:
                cameras = onlookers(simulated.display, viewers[0], seen_from)
                seen = simulated.seen(viewers, exhibit.policy, list(cameras.values()), overlay=overlay)
                for name, picture in zip(cameras, seen, strict=True):
                    files.append(str(write_picture(target / f"{name}.{suffix}", picture)))
            step(1)
            yield PointsReport.of(list(reports.values())), files


def points_row(report: PointsReport, files: list[str]) -> FrameRow:
    """A frame as ``--json`` tells it."""
    return FrameRow(
        time_s=report.time_s, policy=report.policy, panels_active=report.panels_active, pages=report.chunks,
        missing=report.missing, triangles=0, splats=report.splats, max_error_px=report.max_error_px,
        select_ms=report.select_ms, stream_ms=report.stream_ms, draw_ms=report.draw_ms, files=files,
        distance_factor=report.distance_factor, scale=report.scale,
    )  # fmt: skip


def _print_rows(out: Output, rows: Sequence[FrameRow], folder: Path) -> None:
    columns = [
        "time s",
        "policy",
        "panels",
        "splats",
        "chunks",
        "seen from",
        "select ms",
        "stream ms",
        "draw ms",
        "files",
    ]
    cells = [
        (
            f"{row.time_s:.2f}", row.policy, row.panels_active, f"{row.splats:,}", row.pages,
            visible_from(row.distance_factor), f"{row.select_ms:.1f}", f"{row.stream_ms:.0f}", f"{row.draw_ms:.0f}",
            len(row.files),
        )
        for row in rows
    ]  # fmt: skip
    out.table("", columns, cells)
    out.line(f"pictures: {folder}")
