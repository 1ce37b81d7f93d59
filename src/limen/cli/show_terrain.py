"""``limen show`` for terrains: every panel at the level of detail that nobody can tell from the original."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from limen.cli.output import Output
from limen.cli.show_image import FrameRow
from limen.cli.show_mesh import lit_display, onlookers
from limen.data.image import Image
from limen.data.mesh import Mesh
from limen.data.opening import open_content, open_picture
from limen.display.display import Display
from limen.draw.terrain import TerrainOverlay
from limen.draw.terrain_look import Colours, TerrainLook
from limen.errors import InputError
from limen.gpu.device import open_device
from limen.look_at import Flight, LookAt
from limen.present.file import write_picture
from limen.select.terrain import Mode
from limen.select.visibility import Rule
from limen.terrain import TerrainReport
from limen.terrain_choice import CameraKind, TerrainSettings
from limen.terrain_stage import TerrainExhibit
from limen.terrain_stock import Draped
from limen.viewer import Viewer

if TYPE_CHECKING:
    from limen.data.points_file import Points
    from limen.data.terrain_file import Terrain

__all__ = [
    "TERRAIN_DEFAULT",
    "TerrainOptions",
    "opened_content",
    "print_terrain_rows",
    "terrain_row",
    "write_terrain_frames",
]


@Parameter(name="*", group=Group("Terrains"))
@dataclass(frozen=True, slots=True)
class TerrainOptions:
    """Options of content that is a terrain."""

    target: Annotated[
        str, Parameter(help="X,Y of the place in the middle: 0 to 1 from the west and from the north edge.")
    ] = "0.5,0.5"
    heading_deg: Annotated[
        float, Parameter(allow_leading_hyphen=True, help="Where the camera looks, clockwise from north.")
    ] = 0.0
    pitch_deg: Annotated[float, Parameter(help="How far it looks down: 90 is a map.")] = 40.0
    range_m: Annotated[float | None, Parameter(help="How far it is from the target; if not given, all is seen.")] = None
    exaggeration: Annotated[float, Parameter(help="Heights are multiplied by it.")] = 1.0
    flight: Annotated[Flight, Parameter(help="orbit: around the target. traverse: low over all of it.")] = "none"
    camera: Annotated[
        CameraKind,
        Parameter(
            help="window: panels are windows for the first viewer. fixed: one picture for the whole display, whose "
            "detail viewers decide about."
        ),
    ] = "window"
    cut: Annotated[
        Mode, Parameter(help="adaptive: the fewest triangles. level: one error in metres for each panel.")
    ] = "adaptive"
    rule: Annotated[
        Rule, Parameter(help="A panel's angle from the line of sight: the smallest of any place, or its middle's.")
    ] = "exact"
    field_deg: Annotated[
        float | None, Parameter(help="Panels beyond this angle are not drawn; if not given, the policy's own limit.")
    ] = None
    colours: Annotated[Colours | None, Parameter(help="By height unless there is a --drape.")] = None
    drape: Annotated[Path | None, Parameter(help="An image that lies on the terrain.")] = None
    contours: Annotated[str, Parameter(help="Metres between contour lines, 'auto', or 0 for none.")] = "0"
    sun_azimuth_deg: Annotated[float, Parameter(allow_leading_hyphen=True, help="Clockwise from north.")] = 315.0
    sun_altitude_deg: Annotated[float, Parameter(help="Above the horizon.")] = 45.0

    def settings(self, most_triangles: int | None) -> TerrainSettings:
        """From where it is looked at, and how detail is chosen; raises InputError for what cannot be."""
        look_at = LookAt(_pair(self.target), self.heading_deg, self.pitch_deg, self.range_m, self.exaggeration)
        return TerrainSettings(look_at, self.flight, self.camera, self.cut, self.rule, self.field_deg, most_triangles)

    def look(self) -> TerrainLook:
        """Its colours and light; raises InputError for what cannot be."""
        colours = self.colours or ("drape" if self.drape else "hypsometric")
        interval = _interval(self.contours)
        return TerrainLook(colours, self.sun_azimuth_deg, self.sun_altitude_deg, contour_interval_m=interval)

    @contextmanager
    def draped(self, terrain: Terrain) -> Iterator[Draped | None]:
        """The image that lies on a terrain, opened."""
        if self.drape is None:
            if self.colours == "drape":
                raise InputError("--colours drape needs --drape IMAGE")
            yield None
            return
        if self.colours not in (None, "drape"):
            raise InputError(f"--colours {self.colours} would hide the --drape: leave out one of them")
        from limen.data.drape import texel_from_post  # GDAL takes a quarter of a second

        with open_picture(self.drape) as image:
            yield Draped(image, texel_from_post(terrain, self.drape, image.size_px))


TERRAIN_DEFAULT = TerrainOptions()


def opened_content(out: Output, path: str | Path) -> Image | Mesh | Points | Terrain:
    """Open a file as what it is, with a bar while heights or points are made ready."""
    with out.progress(f"making {Path(path).name} ready", 1000) as step:
        return open_content(path, progress=lambda done: step.to(round(1000 * done)))


def _interval(text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--contours takes metres, 'auto' or 0, got '{text}'") from None


def _pair(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--target takes two numbers from 0 to 1, X,Y, got '{text}'") from None
    return x, y


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
                files.append(str(write_picture(target / f"{name.replace('/', '-')}.{suffix}", picture)))
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
