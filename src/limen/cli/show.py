"""``limen show``: draw content on a display, in a window or into files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from limen.cli.arguments import (
    AcuityOption,
    DisplayOption,
    FitOption,
    PanelsOption,
    PolicyOption,
    place,
)
from limen.cli.output import DEFAULT, Common, Output
from limen.cli.show_image import image_row, print_image_rows, write_image_frames
from limen.cli.show_mesh import MESH_DEFAULT, MeshOptions, mesh_row, print_mesh_rows, write_mesh_frames
from limen.cli.show_terrain import (
    TERRAIN_DEFAULT,
    TerrainOptions,
    opened_content,
    print_terrain_rows,
    terrain_row,
    write_terrain_frames,
)
from limen.data.image import Image
from limen.data.mesh import Mesh
from limen.data.terrain_file import Terrain
from limen.display.display import Display
from limen.draw.terrain import TerrainOverlay
from limen.errors import InputError
from limen.live import LiveSettings, Tour, run_live
from limen.live_outputs import run_live_outputs
from limen.live_scene import run_live_scene
from limen.placement import Fit, OnSurface
from limen.scene import SceneReport
from limen.stage import Exhibit, MeshExhibit
from limen.terrain import TerrainReport
from limen.terrain_stage import TerrainExhibit, nobody_points
from limen.terrain_stock import Draped
from limen.tolerance import Policy
from limen.track.stand import standing_viewer
from limen.track.walk import session_named
from limen.viewer import Pointer, Viewer

__all__ = ["show"]

_STEP_S = 0.25  # between frames of a viewer who stands


def show(
    content: Annotated[
        Path,
        Parameter(
            help="An image (a pyramid of any size, or anything smaller), a mesh (PLY, OBJ, glTF, STL, ...), or a "
            "terrain (GeoTIFF and all that GDAL reads; a large one as `limen ingest` made it ready)."
        ),
    ],
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
    overlay: Annotated[
        Literal["none", "levels", "panels", "patches"],
        Parameter(
            help="levels: tint an image by the level drawn. panels: tint a mesh by the panel that shows it, a terrain "
            "by how its panels are seen, the darker the larger the error. patches: a terrain's triangles."
        ),
    ] = "none",
    out: Annotated[Path | None, Parameter(help="Write pictures into this folder instead of opening a window.")] = None,
    frames: Annotated[int, Parameter(help="With --out: how many moments, spread over the session.")] = 1,
    scale: Annotated[float, Parameter(help="With --out: draw panels with fewer pixels (0.125: an eighth).")] = 1.0,
    picture_format: Annotated[Literal["jpg", "png"], Parameter(name="--format")] = "jpg",
    simulate: Annotated[
        bool,
        Parameter(
            negative="",
            help="With --out, of an image: also draw the room and the unrolled wall. Of a mesh or a terrain: also what "
            "the viewer's eye sees of the lit display (eye), and what is seen from elsewhere and from afar.",
        ),
    ] = False,
    seen_from: Annotated[
        str, Parameter(allow_leading_hyphen=True, help="With --simulate: X,Y,Z of the second place to look from.")
    ] = "",
    window: Annotated[
        Literal["eye", "outputs"],
        Parameter(
            help="Of a mesh or a terrain without --out: what the viewer's eye sees of the simulated display; or the "
            "display's quilts, each on the screen that it is named after in the display file."
        ),
    ] = "eye",
    seconds: Annotated[float | None, Parameter(help="Close the window after this long.")] = None,
    mesh: MeshOptions = MESH_DEFAULT,
    terrain: TerrainOptions = TERRAIN_DEFAULT,
    common: Common = DEFAULT,
) -> None:
    """Draw content on a display: a window, or files with --out.

    Without --display, a window shows an image as a viewer does (drag to move, wheel to zoom), and a mesh or a terrain
    as if it stood behind the window (drag to turn it). With --display, it shows the unrolled wall, and of a mesh or a
    terrain what the viewer's eye sees of the lit display.
    """
    out_stream = Output(common)
    if frames < 1:
        raise InputError(f"--frames must be at least 1, got {frames}")
    if session and viewer:
        raise InputError("give --session or --viewer, not both")
    if seen_from:
        place(seen_from, "--seen-from")
        if not simulate:
            raise InputError("--seen-from is a place to look at the simulated display from: give --simulate too")
    chosen = Policy.parse(policy, acuity_arcmin)
    name = display or ("desktop" if out else "")
    whole = Display.named(name) if name else None
    asked = _Asked(
        whole, panels, session, viewer, overlay, seconds, frames, scale, picture_format, simulate, seen_from, window
    )
    with ExitStack() as stack:
        opened = opened_content(out_stream, content)
        if isinstance(opened, Image):
            stack.enter_context(opened)
            _refuse(
                "image", overlay, ("levels",), {"meshes": mesh != MESH_DEFAULT, "terrains": terrain != TERRAIN_DEFAULT}
            )
            _show_image(opened, asked, chosen, fit, out, out_stream)
        elif isinstance(opened, Mesh):
            _refuse("mesh", overlay, ("panels",), {"terrains": terrain != TERRAIN_DEFAULT})
            _show_mesh(opened, asked, mesh, out, out_stream)
        else:
            _refuse("terrain", overlay, ("panels", "patches"), {"meshes": mesh != MESH_DEFAULT})
            exhibit = _exhibit(opened, asked, terrain, chosen, stack.enter_context(terrain.draped(opened)))
            _show_terrain(exhibit, asked, out, out_stream)


def _refuse(kind: str, overlay: str, overlays: Sequence[str], others: dict[str, bool]) -> None:
    """Refuse what is not for this kind of content; ``others``: whether options of other kinds were given."""
    if overlay not in ("none", *overlays):
        raise InputError(f"--overlay {overlay} is not for this {kind}: give --overlay {' or '.join(overlays)}")
    given = [name for name, was_given in others.items() if was_given]
    if given:
        raise InputError(f"this is a {kind}: leave out the options of {given[0]} (limen show --help lists them)")


@dataclass(frozen=True, slots=True)
class _Asked:
    """What is asked for whatever the content is.

    Viewers and what they look at stand where the whole display wants them, whichever panels are drawn.
    """

    whole: Display | None  # None: the window itself is the display
    panels: Sequence[str]
    session: str
    viewer: str
    overlay: Literal["none", "levels", "panels", "patches"]
    seconds: float | None
    frames: int
    scale: float
    suffix: str
    simulate: bool
    seen_from: str
    window: Literal["eye", "outputs"]

    @property
    def shown(self) -> Display | None:
        return self.whole.select(self.panels) if self.whole and self.panels else self.whole

    def stander(self) -> Viewer:
        if self.viewer:
            return Viewer(place(self.viewer, "--viewer"))
        return standing_viewer(self.whole) if self.whole else Viewer((0.0, 0.0, 0.0))

    def tour(self) -> Tour:
        """Who looks at time t, as a function; a session is run again and again."""
        if self.session and self.whole:
            recorded = session_named(self.session, self.whole)
            return lambda time_s: recorded.at(recorded.start_s + time_s % recorded.duration_s)
        person = self.stander()
        return lambda time_s: (replace(person, time_s=time_s),)

    def pointers(self) -> Callable[[float], Sequence[Pointer]]:
        """Who points where, by the viewers' clock."""
        if not (self.session and self.whole):
            return nobody_points
        return session_named(self.session, self.whole).pointers_at

    def moments(self) -> list[Sequence[Viewer]]:
        """Who looks in each frame, spread over the session."""
        if not (self.session and self.whole):
            tour = self.tour()
            return [tour(number * _STEP_S) for number in range(self.frames)]
        recorded = session_named(self.session, self.whole)
        times_s = recorded.start_s + np.linspace(0, recorded.duration_s, self.frames + 2)[1:-1]
        return [recorded.at(float(time_s)) for time_s in times_s]


def _show_mesh(content: Mesh, asked: _Asked, options: MeshOptions, folder: Path | None, out: Output) -> None:
    settings, shown = options.settings(asked.whole), asked.shown
    if folder is None or shown is None:
        last = _show_live(MeshExhibit(content, settings), asked, out)
        out.result({"frames": [mesh_row(SceneReport.of(last), [])] if last else []})
        return
    moments = asked.moments()
    _say_who(moments[0], out)
    drawn = write_mesh_frames(
        out, content, shown.scaled(asked.scale), moments, options, settings, folder, asked.suffix,
        overlay=None if asked.overlay == "none" else "panels", simulate=asked.simulate, seen_from=asked.seen_from,
    )  # fmt: skip
    rows = [mesh_row(report, files) for report, files in drawn]
    print_mesh_rows(out, rows, folder)
    out.result({"frames": rows})


def _show_live(exhibit: Exhibit, asked: _Asked, out: Output) -> list[Any]:
    """Show it in windows until they are closed; the last report of each."""
    shown = asked.shown
    tour = asked.tour() if asked.session and shown else asked.stander()
    if isinstance(exhibit, MeshExhibit) and not isinstance(tour, Viewer):
        _say_who(tour(0.0), out)
    overlay = asked.overlay != "none"
    if asked.window == "eye":
        last = run_live_scene(exhibit, shown, tour, out.say, overlay=overlay, seconds=asked.seconds)
        return [last] if last else []
    if shown is None:
        raise InputError("--window outputs needs --display, with the quilts that go to this machine's screens")
    return run_live_outputs(exhibit, shown, tour, out.say, overlay=overlay, seconds=asked.seconds)


def _exhibit(
    content: Terrain, asked: _Asked, options: TerrainOptions, policy: Policy, draped: Draped | None
) -> TerrainExhibit:
    reference_m = standing_viewer(asked.whole).position_m if asked.whole else (0.0, 0.0, 0.0)
    overlay: TerrainOverlay = "patches" if asked.overlay == "patches" else "panels"
    return TerrainExhibit(
        content, options.look(), options.settings(), policy, reference_m, asked.whole, draped, asked.pointers(), overlay
    )


def _show_terrain(exhibit: TerrainExhibit, asked: _Asked, folder: Path | None, out: Output) -> None:
    shown = asked.shown
    if folder is None or shown is None:
        last = _show_live(exhibit, asked, out)
        out.result({"frames": [terrain_row(TerrainReport.of(last), [])] if last else []})
        return
    drawn = write_terrain_frames(
        out, exhibit, shown.scaled(asked.scale), asked.moments(), folder, asked.suffix,
        overlay=None if asked.overlay == "none" else exhibit.overlay, simulate=asked.simulate,
        seen_from=asked.seen_from,
    )  # fmt: skip
    rows = [terrain_row(report, files) for report, files in drawn]
    print_terrain_rows(out, rows, folder)
    out.result({"frames": rows})


def _say_who(viewers: Sequence[Viewer], out: Output) -> None:
    if len(viewers) > 1:
        name = f" ('{viewers[0].name}')" if viewers[0].name else ""
        out.say(f"a mesh is drawn for one viewer: the first of {len(viewers)}{name}")


def _show_image(content: Image, asked: _Asked, policy: Policy, fit: Fit, folder: Path | None, out: Output) -> None:
    shown = asked.shown
    if folder is None or shown is None:
        settings = LiveSettings(policy=policy, fit=fit, overlay=asked.overlay == "levels", seconds=asked.seconds)
        last = run_live(content, shown, asked.tour() if shown else None, settings, out.say)
        out.result({"frames": [image_row(last, [])] if last else []})
        return
    rows = list(
        write_image_frames(out, content, shown, asked.moments(), policy, OnSurface(fit), folder, asked.suffix,
                           scale=asked.scale, overlay=asked.overlay == "levels", simulate=asked.simulate)
    )  # fmt: skip
    print_image_rows(out, rows, folder)
    out.result({"frames": rows})
