"""``limen show`` for terrains: every panel at the level of detail that nobody can tell from the original."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from limen.cli.output import Output
from limen.cli.show_image import FrameRow
from limen.cli.show_mesh import check_files, lit_display, onlooker_names, onlookers
from limen.data.image.file import Image
from limen.data.mesh.mesh import Mesh
from limen.data.opening import open_content
from limen.display.display import Display
from limen.gpu.device import open_device
from limen.layers.terrain.draw.drawer import TerrainOverlay
from limen.layers.terrain.renderer import TerrainReport
from limen.pictures.files import file_stem, write_picture
from limen.show.terrain_stage import TerrainExhibit
from limen.viewing.viewer import Viewer

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

__all__ = [
    "opened_content",
    "print_terrain_rows",
    "terrain_row",
    "write_terrain_frames",
]


def opened_content(out: Output, path: str | Path) -> Image | Mesh | Points | Terrain:
    """Open a file as what it is, with a bar while heights or points are made ready."""
    with out.progress(f"making {Path(path).name} ready", 1000) as step:
        return open_content(path, progress=lambda done: step.to(round(1000 * done)))


def write_terrain_frames(
    out: Output,
    exhibit: TerrainExhibit,
    display: Display,
    moments: Sequence[Sequence[Viewer]],
    folder: Path,
    suffix: str,
    *,
    overlay: TerrainOverlay | None,
    simulate: bool,
    seen_from: str,
) -> Iterator[tuple[TerrainReport, list[str]]]:
    """Write what every panel shows, frame by frame: the frame's report, and the files."""
    check_files(display, "panels", onlooker_names(simulate))
    with ExitStack() as stack:
        device = stack.enter_context(open_device())
        renderer = stack.enter_context(exhibit.renderer(device, display))
        simulated = renderer
        if simulate and lit_display(display) is not display:
            simulated = stack.enter_context(exhibit.renderer(device, lit_display(display)))
        step = stack.enter_context(out.progress("drawing", len(moments)))
        for number, viewers in enumerate(moments):
            time_s = viewers[0].time_s
            pointers = exhibit.pointers(time_s)
            target = folder / f"frame-{number:04d}"
            files: list[str] = []
            reports: dict[int, TerrainReport] = {}  # one for every quilt
            renderer.pose(time_s)
            for name, picture, report in renderer.pictures(viewers, exhibit.policy, pointers=pointers, overlay=overlay):
                files.append(str(write_picture(target / f"{file_stem(name)}.{suffix}", picture)))
                reports[id(report)] = report
            if simulate:
                simulated.pose(time_s)
                cameras = onlookers(display, viewers[0], seen_from)
                seen = simulated.seen(
                    viewers, exhibit.policy, list(cameras.values()), pointers=pointers, overlay=overlay
                )
                for name, picture in zip(cameras, seen, strict=True):
                    files.append(str(write_picture(target / f"{name}.{suffix}", picture)))
            step(1)
            yield TerrainReport.of(list(reports.values())), files


def terrain_row(report: TerrainReport, files: list[str]) -> FrameRow:
    """A frame as ``--json`` tells it."""
    return FrameRow(
        time_s=report.time_s, policy=report.policy, panels_active=report.panels_active, pages=report.pages,
        missing=report.missing, triangles=report.triangles, splats=0, max_error_px=report.max_error_px,
        select_ms=report.select_ms, stream_ms=report.stream_ms, draw_ms=report.draw_ms, files=files,
        patches=report.patches, min_allowed_px=report.min_allowed_px, max_allowed_px=report.max_allowed_px,
        scale=report.scale,
    )  # fmt: skip


def print_terrain_rows(out: Output, rows: Sequence[FrameRow], folder: Path) -> None:
    columns = ["time s", "policy", "panels", "triangles", "patches", "pages", "allowed px", "error px", "select ms",
               "stream ms", "draw ms", "files"]  # fmt: skip
    cells = [
        (
            f"{row.time_s:.2f}", row.policy, row.panels_active, f"{row.triangles:,}", row.patches, row.pages,
            _range(row.min_allowed_px, row.max_allowed_px), f"{row.max_error_px:.2f}", f"{row.select_ms:.1f}",
            f"{row.stream_ms:.0f}", f"{row.draw_ms:.0f}", len(row.files),
        )
        for row in rows
    ]  # fmt: skip
    out.table("", columns, cells)
    out.line(f"pictures: {folder}")


def _range(low: float | None, high: float | None) -> str:
    if low is None or high is None or not math.isfinite(high):
        return "-"
    return f"{low:.2f} - {high:.2f}"
