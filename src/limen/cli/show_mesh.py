"""``limen show`` for meshes: through the panels as through windows, to files; and from where displays are looked at."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from limen.cli.arguments import place
from limen.cli.options.mesh import MeshOptions, Write
from limen.cli.output import Output
from limen.cli.show_image import FrameRow
from limen.data.mesh.mesh import Mesh
from limen.display.display import Display
from limen.display.quilt import quilt_names
from limen.errors import InputError
from limen.geometry import Floats
from limen.gpu.device import Device, open_device
from limen.layers.mesh.draw.drawer import SceneOverlay
from limen.layers.mesh.renderer import SceneRenderer, SceneReport, Simplified
from limen.layers.mesh.select import FoldTree
from limen.pictures.files import file_stem, write_picture
from limen.show.live_scene import eye_camera
from limen.show.stage import SceneSettings, check_still, posed
from limen.viewing.arrangement import arrangement_of, facing_of_wall
from limen.viewing.camera import Camera
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

__all__ = [
    "check_files",
    "check_quilts",
    "lit_display",
    "mesh_row",
    "onlooker_names",
    "onlookers",
    "print_mesh_rows",
    "simplified_mesh",
    "visible_from",
    "write_mesh_frames",
]

_SEEN_PX = (1440, 1080)
_ASIDE_DEG = 35.0
_LIT_PX = 1 << 26
"""Pixels of a simulated display in all, which lie in memory together: more are not seen in a picture."""


def write_mesh_frames(
    out: Output,
    mesh: Mesh,
    display: Display,
    moments: Sequence[Sequence[Viewer]],
    write: Write,
    settings: SceneSettings,
    folder: Path,
    suffix: str,
    *,
    simplified: Simplified | None = None,
    overlay: SceneOverlay | None,
    simulate: bool,
    seen_from: str,
) -> Iterator[tuple[SceneReport, list[str]]]:
    """Write what every panel shows, frame by frame: the frame's report, and the files.

    ``settings`` have the mesh standing where the whole display wants it.
    """
    _check_simulation(settings, simulate)
    check_files(display, write, onlooker_names(simulate))
    check_still(settings, simplified)
    with ExitStack() as stack:
        device = stack.enter_context(open_device())
        renderer = stack.enter_context(_renderer(device, display, mesh, settings, simplified))
        simulated = renderer
        if simulate and lit_display(display) is not display:
            simulated = stack.enter_context(_renderer(device, lit_display(display), mesh, settings, simplified))
        step = stack.enter_context(out.progress("drawing", len(moments)))
        for number, viewers in enumerate(moments):
            for each in {renderer, simulated}:
                posed(each, mesh, settings, viewers[0].time_s)
            target = folder / f"frame-{number:04d}"
            files: list[str] = []
            reports: dict[int, SceneReport] = {}  # one for every quilt
            draw = renderer.quilt_pictures if write == "quilts" else renderer.pictures
            for name, picture, report in draw(viewers, overlay=overlay):
                files.append(str(write_picture(target / f"{file_stem(name)}.{suffix}", picture)))
                reports[id(report)] = report
            if simulate:
                cameras = onlookers(simulated.display, viewers[0], seen_from)
                pictures = simulated.seen(viewers, list(cameras.values()), overlay=overlay)
                for name, seen in zip(cameras, pictures, strict=True):
                    files.append(str(write_picture(target / f"{name}.{suffix}", seen)))
            step(1)
            yield SceneReport.of(list(reports.values())), files


def _renderer(
    device: Device,
    display: Display,
    mesh: Mesh,
    settings: SceneSettings,
    simplified: Simplified | None,
) -> SceneRenderer:
    return SceneRenderer(
        device, display, mesh, room_from_mesh=settings.room_from_mesh(mesh, display), stereo=settings.stereo,
        depth=settings.depth, background=settings.background, simplified=simplified,
    )  # fmt: skip


def onlooker_names(simulate: bool) -> tuple[str, ...]:
    """What `onlookers` are called, where there are any."""
    return ("eye", "elsewhere", "afar") if simulate else ()


def onlookers(display: Display, viewer: Viewer, seen_from: str = "") -> dict[str, Camera]:
    """Cameras at the viewer's eye, at another place (``seen_from``, or a few steps on), and where all is in sight."""
    eye_m = np.array(viewer.position_m)
    elsewhere = np.array(place(seen_from, "--seen-from")) if seen_from else _aside(eye_m, display)
    corners = np.concatenate([panel.outline_m for panel in display.panels])
    is_wall = arrangement_of(display) == "wall"
    onlooker = facing_of_wall(display) + np.array([0.5, 0.3, 0.0]) if is_wall else np.array([0.45, 0.35, 1.0])
    eye, beside = (eye_camera(display, each, _SEEN_PX, viewer.direction) for each in (eye_m, elsewhere))
    return {"eye": eye, "elsewhere": beside, "afar": Camera.framing(corners, onlooker, _SEEN_PX)}


def lit_display(display: Display) -> Display:
    """A display with no more pixels than are seen in a picture of it, and lie in memory together."""
    return display if display.total_px <= _LIT_PX else display.scaled(math.sqrt(_LIT_PX / display.total_px))


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


def check_quilts(options: MeshOptions, display: Display, scale: float) -> None:
    """Refuse quilts that would not be as their hardware, or eyes that look one after the other, want them.

    Raises
    ------
    InputError
        If quilts are asked for in another size than the display's file has them, or pictures of each eye in them.
    """
    if options.write != "quilts":
        return
    if display.quilts and scale != 1:
        raise InputError("--write quilts: the display's [[quilt]] are of its own pixels: leave out --scale")
    if options.stereo == "sequential":
        raise InputError(
            "--stereo sequential is written for every panel: give --stereo side-by-side, or leave out --write"
        )


def _check_simulation(settings: SceneSettings, simulate: bool) -> None:
    """Refuse what cannot be simulated before anything is drawn."""
    if simulate and settings.stereo not in ("none", "anaglyph"):
        raise InputError(f"--simulate shows what one eye sees: give --stereo none or anaglyph, not {settings.stereo}")


def _aside(eye_m: Floats, display: Display) -> Floats:
    """Where the viewer would be a few steps on: around the display, or across the room."""
    low, high = display.bounds_m
    if arrangement_of(display) == "room":
        return np.asarray(eye_m + np.array([0.25 * (high[0] - low[0]), 0.0, 0.0]))
    middle = (low + high) / 2
    x, y, z = eye_m - middle
    turn = math.radians(_ASIDE_DEG)
    step = [math.cos(turn) * x + math.sin(turn) * z, y, -math.sin(turn) * x + math.cos(turn) * z]
    return np.asarray(middle + np.array(step))


def simplified_mesh(out: Output, mesh: Mesh, policy: Policy) -> Simplified | None:
    """What decides which triangles are left, for a policy that may leave out some."""
    if policy.name == "full":
        return None
    from limen.data.mesh.store import tree_of  # Numba and SciPy take a second

    with out.progress("joining vertices to a tree", 1) as step:
        foldable = FoldTree(tree_of(mesh))
        step(1)
    return Simplified(foldable, policy)


def mesh_row(report: SceneReport, files: list[str]) -> FrameRow:
    """A frame as ``--json`` tells it."""
    return FrameRow(
        time_s=report.time_s, policy=report.policy, panels_active=report.panels_active, pages=0, missing=0,
        triangles=report.triangles, splats=0, max_error_px=report.max_error_px,
        select_ms=report.select_ms + report.sort_ms, stream_ms=0.0, draw_ms=report.draw_ms, files=files,
        triangles_left=report.left, distance_factor=report.distance_factor, scale=report.scale,
    )  # fmt: skip


def print_mesh_rows(out: Output, rows: Sequence[FrameRow], folder: Path) -> None:
    columns = ["time s", "policy", "panels", "triangles", "seen from", "select ms", "draw ms", "files"]
    cells = [
        (
            f"{row.time_s:.2f}", row.policy, row.panels_active, f"{row.triangles_left or 0:,}",
            visible_from(row.distance_factor), f"{row.select_ms:.1f}", f"{row.draw_ms:.1f}", len(row.files),
        )
        for row in rows
    ]  # fmt: skip
    out.table("", columns, cells)
    out.line(f"pictures: {folder}")
    if any(row.distance_factor is not None and row.distance_factor > 1 for row in rows):
        out.line("What is left out is seen from nearer than so many times the viewers' distance.")


def visible_from(distance_factor: float | None) -> str:
    """How much farther away viewers would have to be to see nothing of what is left out."""
    return "-" if distance_factor is None or distance_factor <= 1 else f"{distance_factor:.1f} x"
