"""``limen show``: draw content on a display, in a window or into files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from limen.cli.arguments import AcuityOption, DisplayOption, PanelsOption, PolicyOption, TrianglesOption
from limen.cli.asked import FILES_DEFAULT, WINDOWS_DEFAULT, Asked, FileOptions, Overlays, WindowOptions
from limen.cli.heard import SHOW, Way, given_options, refuse_way
from limen.cli.options.lenses import LENSES_DEFAULT, LensOptions
from limen.cli.options.mesh import MESH_DEFAULT, MeshOptions
from limen.cli.options.points import POINTS_DEFAULT, PointsOptions
from limen.cli.options.terrain import TERRAIN_DEFAULT, TerrainOptions
from limen.cli.output import DEFAULT, Common, Output
from limen.display.display import Display
from limen.viewing.placement import Fit

__all__ = ["show"]


def show(
    contents: Annotated[
        list[Path],
        Parameter(
            help="What is shown: an image (a pyramid of any size, or anything smaller), a mesh (PLY, OBJ, glTF, STL, "
            "...), a terrain (GeoTIFF and all that GDAL reads) or points (LAS, LAZ, COPC, PLY, E57); large ones as "
            "`limen ingest` made them ready. Several are layers of one picture. Or a show file (.toml)."
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
    tracker: Annotated[
        str,
        Parameter(help="NAME or NAME:HOW of a tracker that an installed package brings, instead of a session."),
    ] = "",
    gaze: Annotated[
        str, Parameter(allow_leading_hyphen=True, help="X,Y,Z of the place that viewers look at, metres.")
    ] = "",
    policy: PolicyOption = "",
    acuity_arcmin: AcuityOption = "human",
    fit: Annotated[
        Fit | None, Parameter(help="How an image lies on the unrolled surface: contain if not given.")
    ] = None,
    max_triangles: TrianglesOption | None = None,
    overlay: Annotated[
        Overlays,
        Parameter(
            help="levels: tint an image by the level drawn. error: by how far lenses draw it from its place (grey "
            "below 0.1 pixel, blue 0.5, green 1, else red). panels: tint a mesh by the panel that shows it, a terrain "
            "by how its panels are seen, the darker the larger the error. patches: a terrain's triangles. simplified: "
            "of a mesh or points, what stands for much, and in other colours on silhouettes."
        ),
    ] = "none",
    out: Annotated[Path | None, Parameter(help="Write pictures into this folder instead of opening a window.")] = None,
    files: FileOptions = FILES_DEFAULT,
    windows: WindowOptions = WINDOWS_DEFAULT,
    mesh: MeshOptions = MESH_DEFAULT,
    terrain: TerrainOptions = TERRAIN_DEFAULT,
    points: PointsOptions = POINTS_DEFAULT,
    lenses: LensOptions = LENSES_DEFAULT,
    common: Common = DEFAULT,
) -> None:
    """Draw content on a display: a window, or files with --out.

    Without --display, a window shows an image as a viewer does (drag to move, wheel to zoom), and anything else as if
    it stood behind the window (drag to turn it). With --display, it shows the unrolled wall, and of anything but an
    image what the viewer's eye sees of the lit display. The policy is acuity unless another is given, of a mesh full.
    """
    given = given_options(show, locals())
    way: Way = "files" if out else "browse" if not display else "outputs" if windows.window == "outputs" else "wall"
    refuse_way(SHOW, given, way)
    name = display or ("desktop" if out else "")
    asked = Asked(
        Display.named(name) if name else None, panels, session, viewer, overlay, files, windows, gaze, tracker
    )
    lenses.check(by_hand=way in ("browse", "wall"))
    from limen.cli.show_content import ShowOptions, show_content  # renderers, which no help text needs

    wishes = ShowOptions(policy, acuity_arcmin, fit, max_triangles, mesh, terrain, points, lenses)
    show_content(Output(common), contents, asked, wishes, given, out)
