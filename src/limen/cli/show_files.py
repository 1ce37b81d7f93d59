"""``limen show`` into files: what panels, quilts and onlookers see, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.cli.asked import Asked
from limen.cli.onlookers import ONLOOKERS, lit_display, onlookers
from limen.cli.options.mesh import Write
from limen.cli.output import Output, visible_from
from limen.display.display import Display
from limen.display.quilt import pack, pieces, quilt_names
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport, LayerReport
from limen.gpu.device import open_device
from limen.layers.base import Selector
from limen.layers.registry import kind_of
from limen.pictures.files import file_stem, thumbnail, write_picture
from limen.pictures.room import draw_room, draw_surface
from limen.show.show import Show
from limen.stream.chunks import Resident
from limen.viewing.choices import Stereo
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState

__all__ = ["check_files", "check_quilts", "check_written", "frame_row", "print_rows", "write_frames"]

_ALL_FIT = 1 << 40


def check_written(show: Show, display: Display, asked: Asked, write: Write) -> tuple[str, ...]:
    """Refuse pictures that cannot be, before anything is drawn; the names of those that are written beside panels'.

    Raises
    ------
    InputError
        For what `check_quilts` and `check_files` refuse, and two eyes where one looks at a simulated display.
    """
    beside: tuple[str, ...] = ()
    if asked.files.simulate:
        beside = ("room", "surface") if _images_alone(show) else ONLOOKERS
        if show.stereo not in ("none", "anaglyph"):
            raise InputError(f"--simulate shows what one eye sees: give --stereo none or anaglyph, not {show.stereo}")
    check_quilts(write, show.stereo, display, asked.files.scale)
    check_files(display, write, beside)
    return beside


def _images_alone(show: Show) -> bool:
    return all(kind_of(layer).on_panels for layer in show.layers)


def write_frames(out: Output, show: Show, display: Display, asked: Asked, folder: Path, write: Write) -> list[Any]:
    """Write what every panel or quilt shows; the frames as ``--json`` tells them."""
    images_alone = _images_alone(show)
    moments = asked.moments()
    shown = display.scaled(asked.files.scale)
    with ExitStack() as stack:
        device = stack.enter_context(open_device())
        renderer = stack.enter_context(show.renderer(device, shown))
        lit = renderer
        if asked.files.simulate and not images_alone and lit_display(shown) is not shown:
            lit = stack.enter_context(show.renderer(device, lit_display(shown)))
        true = _TruePanels(show, display)
        step = stack.enter_context(out.progress("drawing panels", len(moments) * len(shown.panels)))
        rows = []
        for number, viewers in enumerate(moments):
            frame = show.frame(shown, viewers[0].time_s, viewers, number=number)
            target = _Folder(folder / f"frame-{number:04d}", asked.files.picture_format)
            report, seen = _write_pictures(
                renderer, frame, target, write, step, keep=images_alone and asked.files.simulate
            )
            if seen:
                target.write("room", draw_room(display, pictures=seen, viewers=viewers))
                target.write("surface", draw_surface(display, seen))
            elif asked.files.simulate:
                cameras = onlookers(lit.display, viewers[0], asked.files.seen_from)
                for name, picture in zip(cameras, lit.seen(frame, list(cameras.values())), strict=True):
                    target.write(name, picture)
            rows.append(frame_row(true.told(report, frame), target.files))
    return rows


def _write_pictures(
    renderer: Renderer, frame: FrameState, target: _Folder, write: Write, step: Any, *, keep: bool
) -> tuple[FrameReport, dict[str, NDArray[np.uint8]]]:
    """One frame's pictures; its report and, if they are to be kept, small pictures of all panels."""
    reports: dict[int, FrameReport] = {}  # one for every quilt
    small: dict[str, NDArray[np.uint8]] = {}
    for number, picture in enumerate(renderer.pictures(frame, by=write)):
        target.write(picture.name, picture.pixels)
        reports[id(picture.report)] = picture.report
        quilt = renderer.quilts[number] if write == "quilts" else None
        step(1 if quilt is None else len(quilt.panels))
        if keep:
            parts = pieces(renderer.display, quilt, picture.pixels) if quilt else {picture.name: picture.pixels}
            small |= {name: thumbnail(shot) for name, shot in parts.items()}
    return FrameReport.of(list(reports.values())), small


class _Folder:
    """Pictures of one frame, and the files that they are in."""

    def __init__(self, folder: Path, suffix: str) -> None:
        self._folder, self._suffix = folder, suffix
        self.files: list[str] = []

    def write(self, name: str, picture: NDArray[np.uint8]) -> None:
        self.files.append(str(write_picture(self._folder / f"{file_stem(name)}.{self._suffix}", picture)))


class _TruePanels:
    """What lies on panels is told of as of the true ones, at whatever scale they were drawn."""

    def __init__(self, show: Show, display: Display) -> None:
        whole = show.display or display
        self._selectors: list[Selector[Any] | None] = [
            layer.selector(display, whole) if kind_of(layer).on_panels else None for layer in show.layers
        ]
        self._panels = [QuiltPanels(display, quilt) for quilt in pack(display)] if any(self._selectors) else []

    def told(self, report: FrameReport, frame: FrameState) -> FrameReport:
        """The report with pages and errors of the true panels."""
        eyes_m = [frame.viewers[0].position_m] if frame.viewers else []
        views = [QuiltView.of(panels, eyes_m) for panels in self._panels]
        rows = [
            row if selector is None else self._of(selector, row, views, frame, number)
            for number, (row, selector) in enumerate(zip(report.layers, self._selectors, strict=True))
        ]
        return replace(report, layers=tuple(rows))

    def _of(
        self, selector: Selector[Any], row: LayerReport, views: Sequence[QuiltView], frame: FrameState, number: int
    ) -> LayerReport:
        state = frame.layers[number]
        selector.complete(state)
        nothing = np.zeros(0)
        everything_fits = Resident(np.zeros((0, 1), np.int64), nothing, np.inf, 0, _ALL_FIT)
        cut = selector.select(views, state, frame, [everything_fits], live=False)
        chunks = sum(len(wanted) for wanted in cut.wanted)
        return replace(row, items=cut.counts.items, chunks=chunks, error_px=cut.counts.error_px)


def frame_row(report: FrameReport, files: Sequence[str] = ()) -> dict[str, Any]:
    """A frame as ``--json`` tells it."""
    return {**asdict(report), "files": list(files)}


def print_rows(out: Output, rows: Sequence[dict[str, Any]], folder: Path) -> None:
    columns = ["time s", "layer", "policy", "panels", "shows", "missing", "error px", "seen from", "select ms",
               "stream ms", "draw ms", "files"]  # fmt: skip
    cells = [
        (
            f"{row['time_s']:.2f}", layer["name"], layer["policy"], layer["panels_active"], _shows(layer),
            layer["missing"], _error(layer), visible_from(layer["distance_factor"]), f"{layer['select_ms']:.1f}",
            f"{layer['stream_ms']:.0f}", f"{layer['draw_ms']:.0f}", len(row["files"]),
        )
        for row in rows
        for layer in row["layers"]
    ]  # fmt: skip
    out.table("", columns, cells)
    out.line(f"pictures: {folder}")
    if any((layer["distance_factor"] or 0.0) > 1 for row in rows for layer in row["layers"]):
        out.line("What is left out is seen from nearer than so many times the viewers' distance.")


def _shows(layer: dict[str, Any]) -> str:
    """What there is of a layer, in words."""
    match layer["kind"]:
        case "image":
            return f"{layer['items']:,} pages"
        case "points":
            return f"{layer['drawn']:,} splats"
        case "terrain":
            return f"{layer['items']:,} patches, {layer['drawn']:,} triangles"
    return f"{layer['items']:,} triangles"


def _error(layer: dict[str, Any]) -> str:
    error = f"{layer['error_px']:.2f}"
    if layer["allowed_px"] is None or not np.isfinite(layer["allowed_px"][1]):
        return error
    low, high = layer["allowed_px"]
    return f"{error} of {low:.2f} - {high:.2f}"


def check_files(display: Display, write: Write, simulated: Sequence[str]) -> None:
    """Refuse pictures that would be written over each other: ``simulated`` are those that are written beside.

    Raises
    ------
    InputError
        Naming two panels or outputs whose names differ in nothing that a file's name may have.
    """
    names = quilt_names(display.quilts) if write == "quilts" else [panel.name for panel in display.panels]
    what, homes = "outputs" if write == "quilts" else "panels", dict.fromkeys(simulated, "--simulate")
    for name in names:
        stem = file_stem(name).casefold()
        if stem in homes:
            raise InputError(
                f"{what}: the pictures of '{name}' and of '{homes[stem]}' would be one file: rename one of them"
            )
        homes[stem] = name


def check_quilts(write: Write, stereo: Stereo, display: Display, scale: float) -> None:
    """Refuse quilts that would not be as their hardware, or eyes that look one after the other, want them.

    Raises
    ------
    InputError
        If quilts are asked for in another size than the display's file has them, or pictures of each eye in them.
    """
    if write != "quilts":
        return
    if display.quilts and scale != 1:
        raise InputError("--write quilts: the display's [[quilt]] are of its own pixels: leave out --scale")
    if stereo == "sequential":
        raise InputError(
            "--stereo sequential is written for every panel: give --stereo side-by-side, or leave out --write"
        )
