"""``limen calibrate``: where panels really hang, from photographs of the boards that they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import App, Parameter

from limen.calibrate.boards import boards_of_part, draw_board
from limen.calibrate.camera import Intrinsics
from limen.calibrate.opencv import load
from limen.calibrate.overlay import draw_sheet
from limen.calibrate.rehearse import Rehearsal, rehearse
from limen.calibrate.solve import Calibration, PanelFit, PhotoFit, calibrate
from limen.cli.arguments import DisplayOption, PanelsOption, chosen_panels
from limen.cli.output import DEFAULT, Common, Output
from limen.data.store.atomic import write_bytes
from limen.display.display import Display
from limen.errors import InputError, MissingFileError
from limen.pictures.files import check_picture_name, file_stem, write_picture

__all__ = ["app"]

_PHOTO_ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")

app = App(name="calibrate")


class BoardRow(msgspec.Struct):
    panel: str
    file: str
    markers: int
    first_id: int
    marker_mm: float


class BoardsReport(msgspec.Struct):
    display: str
    boards: list[BoardRow]


class CameraRow(msgspec.Struct):
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    given: bool


class CalibrateReport(msgspec.Struct):
    path: str
    rms_px: float
    worst_px: float
    camera: CameraRow
    panels: list[PanelFit]
    photos: list[PhotoFit]
    warnings: list[str]
    report: str | None


@app.command
def boards(
    *,
    display: DisplayOption,
    panels: PanelsOption = [],  # noqa: B006 - cyclopts shows the default
    out: Path,
    common: Common = DEFAULT,
) -> None:
    """Write the board of markers that each panel has to show, one PNG of the panel's own pixels each.

    Example: limen calibrate boards --display wall.toml --out boards

    Parameters
    ----------
    out
        Folder for the pictures.
    """
    output = Output(common)
    load()
    part = chosen_panels(display, panels)
    rows = []
    with output.progress("drawing boards", len(part.panels)) as step:
        for board, panel in zip(boards_of_part(Display.named(display), part), part.panels, strict=True):
            path = write_picture(out / f"{file_stem(panel.name)}.png", draw_board(board, panel))
            marker_mm = 8 * board.module_px * panel.pitch_m[0] * 1000
            rows.append(BoardRow(panel.name, str(path), len(board.ids), board.first_id, marker_mm))
            step()
    output.result(BoardsReport(part.name, rows))
    output.table(
        "",
        ["panel", "markers", "ids", "side mm", "file"],
        [
            (r.panel, r.markers, f"{r.first_id}..{r.first_id + r.markers - 1}", f"{r.marker_mm:.1f}", r.file)
            for r in rows
        ],
    )
    output.line("Show each at full screen, pixel for pixel; then photograph them and run `limen calibrate solve`.")


@app.command
def solve(
    photos: Annotated[list[Path], Parameter(help="Photographs, or folders of them.")],
    /,
    *,
    display: DisplayOption,
    panels: PanelsOption = [],  # noqa: B006 - cyclopts shows the default
    out: Path,
    camera: Path | None = None,
    save_camera: Path | None = None,
    fix: str | None = None,
    report: Path | None = None,
    common: Common = DEFAULT,
) -> None:
    """Find where the panels hang, and write the display with their new poses.

    Example: limen calibrate solve photos/*.jpg --display wall.toml --out calibrated.toml --report found.jpg

    Parameters
    ----------
    out
        The display file (TOML) to write.
    camera
        The camera's intrinsics (TOML), if known; else they are found too.
    save_camera
        Write the camera that was found, for the next time.
    fix
        The panel that keeps its pose. By default all panels together move as little as possible.
    report
        Draw photographs with the markers, and the panels before and after, to this file (.png, .jpg).
    """
    output = Output(common)
    load()
    if report is not None:
        check_picture_name(report)  # a wrong ending should not cost the reading of all photographs
    whole, part = Display.named(display), chosen_panels(display, panels)
    known = None if camera is None else Intrinsics.load(camera)
    paths, shown = _paths(photos), boards_of_part(whole, part)
    with output.progress("reading photographs", len(paths)) as step:
        found = calibrate(part, paths, boards=shown, camera=known, fix=fix, step=step)
    hung = {panel.name: panel for panel in found.display.panels}
    calibrated = replace(whole, panels=tuple(hung.get(panel.name, panel) for panel in whole.panels))
    if report is not None:
        write_picture(report, draw_sheet(part, shown, found))
    if save_camera is not None:
        write_bytes(save_camera, found.camera.to_toml().encode())
    write_bytes(out, calibrated.to_toml().encode())
    lens = found.camera
    row = CameraRow(lens.size_px, lens.focal_px, lens.centre_px, lens.distortion, camera is not None)
    output.result(
        CalibrateReport(
            str(out),
            found.rms_px,
            found.worst_px,
            row,
            list(found.panels),
            list(found.photos),
            list(found.warnings),
            None if report is None else str(report),
        )
    )
    _print_found(output, found)
    output.line(f"display file: {out}")


@app.command(name="rehearse")
def rehearsal(
    *,
    display: DisplayOption,
    panels: PanelsOption = [],  # noqa: B006 - cyclopts shows the default
    photos: int = 12,
    megapixels: float = 12.0,
    off_mm: float = 20.0,
    off_deg: float = 3.0,
    seed: int = 0,
    out: Path | None = None,
    common: Common = DEFAULT,
) -> None:
    """Calibrate from synthetic photographs of panels that hang a little off, and say how well it went.

    Example: limen calibrate rehearse --display cube --photos 10

    Parameters
    ----------
    photos
        How many photographs, from places all around.
    megapixels
        Their size.
    off_mm, off_deg
        How far the panels hang from where the display file has them, at most.
    seed
        Of places, noise, and what is off.
    out
        Folder to leave the photographs in.
    """
    output = Output(common)
    load()
    part = chosen_panels(display, panels)
    with output.progress("photographing", photos) as step:
        found = rehearse(
            part,
            photos=photos,
            megapixels=megapixels,
            off_m=off_mm / 1000,
            off_deg=off_deg,
            seed=seed,
            folder=out,
            step=step,
        )
    output.result(found)
    _print_rehearsal(output, found)


def _paths(given: Sequence[Path]) -> list[Path]:
    """The photographs, with folders replaced by what is in them."""
    paths: list[Path] = []
    for path in given:
        if path.is_dir():
            inside = sorted(each for each in path.iterdir() if each.suffix.lower() in _PHOTO_ENDINGS)
            if not inside:
                raise InputError(f"{path}: no photographs in this folder ({', '.join(_PHOTO_ENDINGS)})")
            paths += inside
        elif path.exists():
            paths.append(path)
        else:
            raise MissingFileError(f"{path}: no such photograph")
    return paths


def _print_found(output: Output, found: Calibration) -> None:
    output.table(
        "",
        ["panel", "photos", "RMS px", "worst", "moved mm", "turned deg", "known to mm", "deg"],
        [
            (
                p.panel,
                p.photos,
                f"{p.rms_px:.2f}",
                f"{p.worst_px:.2f}",
                f"{p.moved_mm:.2f}",
                f"{p.turned_deg:.3f}",
                f"{p.position_std_mm:.3f}",
                f"{p.angle_std_deg:.4f}",
            )
            for p in found.panels
        ],
    )
    output.line()
    output.table(
        "",
        ["photograph", "panels", "corners", "left out", "RMS px", "worst"],
        [(p.photo, p.panels, p.corners, p.left_out, f"{p.rms_px:.2f}", f"{p.worst_px:.2f}") for p in found.photos],
    )
    output.line()
    for warning in found.warnings:
        output.line(f"note: {warning}")
    focal = found.camera.focal_px[0]
    output.line(
        f"corners fit to {found.rms_px:.2f} px RMS, {found.worst_px:.2f} px at worst; focal length {focal:.0f} px"
    )


def _print_rehearsal(output: Output, found: Rehearsal) -> None:
    output.table(
        "",
        ["panel", "photos", "RMS px", "off by mm", "deg", "expected mm", "deg"],
        [
            (
                row.panel,
                row.photos,
                f"{row.rms_px:.3f}",
                f"{row.position_error_mm:.3f}",
                f"{row.angle_error_deg:.4f}",
                f"{row.position_std_mm:.3f}",
                f"{row.angle_std_deg:.4f}",
            )
            for row in found.panels
        ],
    )
    for warning in found.warnings:
        output.line(f"note: {warning}")
    width, height = found.size_px
    output.line(
        f"{found.photos} synthetic photographs of {width} x {height} px, corners fit to {found.rms_px:.3f} px RMS; "
        f"panels off by at most {max(row.position_error_mm for row in found.panels):.3f} mm and "
        f"{max(row.angle_error_deg for row in found.panels):.4f} degrees"
    )
