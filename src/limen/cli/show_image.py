"""``limen show`` for images: the pages that viewers can see, to files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.cli.options.mesh import Write
from limen.cli.output import Output
from limen.data.image.file import Image
from limen.display.display import Display
from limen.display.quilt import pieces
from limen.gpu.device import open_device
from limen.layers.image.draw.drawer import Overlay
from limen.layers.image.renderer import FrameReport, LensMoves, Renderer
from limen.pictures.files import file_stem, thumbnail, write_picture
from limen.pictures.room import draw_room, draw_surface
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

__all__ = ["FrameRow", "image_row", "print_image_rows", "write_image_frames"]


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
    patches: int = 0
    min_allowed_px: float | None = None
    max_allowed_px: float | None = None
    triangles_left: int | None = None
    """Of a mesh: those that are not folded, each counted once; ``triangles`` counts them on every panel they touch."""
    scale: float = 1.0
    """Panels were drawn with so many times their true pixels along each side. Triangles, splats and errors in pixels
    are of what was drawn; of an image in files, pages and error are those of the true panels."""
    distance_factor: float | None = None
    """How many times farther away viewers would have to be for nobody to see what is left out of a mesh or points."""


def write_image_frames(
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
    overlay: Overlay | None,
    simulate: bool,
    moves: LensMoves,
    write: Write = "panels",
) -> Iterator[FrameRow]:
    """Write what panels or quilts show, frame by frame; pages and errors are told of the true panels at any scale."""
    shown = display if scale == 1.0 else display.scaled(scale)
    with open_device() as device, Renderer(device, shown, image, placement) as renderer:
        total = len(moments) * len(display.panels)
        with out.progress("drawing panels", total) as step:
            for number, viewers in enumerate(moments):
                target = folder / f"frame-{number:04d}"
                if moves.any:
                    moves.place(renderer, placement, viewers[0].time_s)
                cut = renderer.wanted(viewers, policy, display)
                files: list[str] = []
                seen: dict[str, NDArray[np.uint8]] = {}
                reports: list[FrameReport] = []
                drawn = renderer.quilt_pictures(viewers, policy, overlay=overlay)
                for quilt, (name, picture, report) in zip(renderer.quilts, drawn, strict=True):
                    parts = pieces(shown, quilt, picture) if write == "panels" or simulate else {}
                    for part, shot in ({name: picture} if write == "quilts" else parts).items():
                        files.append(str(write_picture(target / f"{file_stem(part)}.{suffix}", shot)))
                    if simulate:
                        seen |= {part: thumbnail(shot) for part, shot in parts.items()}
                    reports.append(report)
                    step(len(quilt.panels))
                if simulate:
                    room = draw_room(display, pictures=seen, viewers=viewers)
                    files.append(str(write_picture(target / f"room.{suffix}", room)))
                    files.append(str(write_picture(target / f"surface.{suffix}", draw_surface(display, seen))))
                yield _summary(reports, len(cut), cut.error_px, files)


def _summary(reports: Sequence[FrameReport], pages: int, error_px: float, files: list[str]) -> FrameRow:
    """One row for all quilts of a frame."""
    row = image_row(reports[0], files)
    row.panels_active = sum(report.panels_active for report in reports)
    row.pages, row.max_error_px = pages, error_px
    for part in ("triangles", "missing", "select_ms", "stream_ms", "draw_ms"):
        setattr(row, part, sum(getattr(report, part) for report in reports))
    return row


def image_row(report: FrameReport, files: list[str]) -> FrameRow:
    fields = {key: value for key, value in asdict(report).items() if key in FrameRow.__struct_fields__}
    return FrameRow(**fields, splats=0, files=files)


def print_image_rows(out: Output, rows: Sequence[FrameRow], folder: Path) -> None:
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
