"""What ``limen show`` does with what was asked for, by the kind of content."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

from limen.cli.arguments import refuse_acuity
from limen.cli.asked import Asked, Overlays
from limen.cli.heard import SHOW, Kind, kind_of, noun_of, refuse_kind
from limen.cli.options.lenses import LensOptions
from limen.cli.options.mesh import MeshOptions
from limen.cli.options.points import PointsOptions
from limen.cli.options.terrain import TerrainOptions
from limen.cli.output import Output
from limen.cli.show_image import image_row, print_image_rows, write_image_frames
from limen.cli.show_live import say_who, show_live
from limen.cli.show_mesh import check_files, check_quilts, mesh_row, print_mesh_rows, simplified_mesh, write_mesh_frames
from limen.cli.show_points import show_points
from limen.cli.show_terrain import opened_content, print_terrain_rows, terrain_row, write_terrain_frames
from limen.data.image.file import Image
from limen.data.mesh.mesh import Mesh
from limen.errors import InputError
from limen.layers.image.draw.drawer import Overlay
from limen.layers.mesh.draw.drawer import SceneOverlay
from limen.layers.mesh.renderer import SceneReport, Simplified
from limen.layers.terrain.draw.drawer import TerrainOverlay
from limen.layers.terrain.renderer import TerrainReport
from limen.layers.terrain.resources import Draped
from limen.show.image_stage import ImageExhibit
from limen.show.live import LiveSettings, run_live
from limen.show.stage import MeshExhibit
from limen.show.terrain_stage import TerrainExhibit
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.tolerance import tolerance_of

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

__all__ = ["ShowOptions", "show_content"]


class ShowOptions(NamedTuple):
    """Options that are heard in one way by some kinds of content, in another by others or not at all."""

    policy: str
    acuity_arcmin: str
    fit: Fit | None
    max_triangles: int | None
    mesh: MeshOptions
    terrain: TerrainOptions
    points: PointsOptions
    lenses: LensOptions


def show_content(
    out: Output, path: Path, asked: Asked, wishes: ShowOptions, given: Sequence[str], folder: Path | None
) -> None:
    """Draw content of any kind in windows, or into a folder.

    Parameters
    ----------
    given
        The options that people gave, as they typed them: those that are not for this kind of content are refused.

    Raises
    ------
    InputError
        For options that are not for this kind of content, or would change nothing.
    """
    with ExitStack() as stack:
        opened = _opened(out, path, stack)
        kind = kind_of(opened)
        refuse_kind(SHOW, given, kind)
        _refuse_overlay(kind, asked.overlay)
        policy = _policy(kind, wishes, in_files=folder is not None, acuity_given="--acuity-arcmin" in given)
        _check_looking(kind, asked, policy, wishes.terrain)
        _draw(opened, asked, wishes, policy, folder, out, stack)


def _opened(out: Output, path: Path, stack: ExitStack) -> Image | Mesh | Points | Terrain:
    """Open content; an image is closed with the stack, also where it is refused."""
    opened = opened_content(out, path)
    if isinstance(opened, Image):
        stack.enter_context(opened)
    return opened


def _draw(
    opened: Image | Mesh | Points | Terrain,
    asked: Asked,
    wishes: ShowOptions,
    policy: Policy,
    folder: Path | None,
    out: Output,
    stack: ExitStack,
) -> None:
    """Draw content by what it is."""
    if isinstance(opened, Image):
        placement = OnSurface(
            wishes.fit or "contain", lenses=wishes.lenses.lenses(), tessellation=wishes.lenses.tessellation
        )
        _show_image(opened, asked, policy, placement, wishes, folder, out)
    elif isinstance(opened, Mesh):
        _show_mesh(opened, simplified_mesh(out, opened, policy), asked, wishes.mesh, folder, out)
    elif opened.kind == "points":
        show_points(cast("Points", opened), asked, wishes.mesh, wishes.points, policy, folder, out)
    else:
        land = cast("Terrain", opened)
        draped = stack.enter_context(wishes.terrain.draped(land))
        exhibit = _exhibit(land, asked, wishes.terrain, wishes.max_triangles, policy, draped)
        _show_terrain(exhibit, asked, folder, out)


_OVERLAYS: dict[Kind, tuple[Overlays, ...]] = {
    "image": ("levels", "error"),
    "mesh": ("panels", "simplified"),
    "points": ("panels", "simplified"),
    "terrain": ("panels", "patches"),
}


def _refuse_overlay(kind: Kind, overlay: Overlays) -> None:
    if overlay not in ("none", *_OVERLAYS[kind]):
        raise InputError(
            f"--overlay {overlay} is not for {noun_of(kind)}: give --overlay {' or '.join(_OVERLAYS[kind])}"
        )


def _policy(kind: Kind, wishes: ShowOptions, *, in_files: bool, acuity_given: bool) -> Policy:
    """The policy asked for, if content of this kind can be drawn by it."""
    text = wishes.policy or ("full" if kind == "mesh" else "acuity")
    if acuity_given:
        refuse_acuity([text])
    policy = Policy.parse(text, wishes.acuity_arcmin)
    if kind == "image" or (policy.name == "scheel") != (kind == "terrain"):
        tolerance_of((), policy)  # says what is wrong with it before a window is opened
    return policy.timeless if in_files else policy


def _check_looking(kind: Kind, asked: Asked, policy: Policy, terrain: TerrainOptions) -> None:
    """Refuse to be told where viewers look, or how that is measured, where nothing depends on it."""
    if kind != "terrain" and asked.gaze and not policy.gaze:
        raise InputError(
            f"--gaze changes nothing under the policy {policy.title}: give one with +gaze, as --policy contrast+gaze"
        )
    told = [option for option, given in (("--gaze", asked.gaze), ("--rule", terrain.rule != "exact")) if given]
    if told and kind == "terrain" and (policy.name, terrain.field_deg) == ("full", None) and asked.overlay != "panels":
        raise InputError(f"{told[0]} changes nothing under the policy full: give another --policy, or --field-deg")


def _show_mesh(
    content: Mesh, simplified: Simplified | None, asked: Asked, options: MeshOptions, folder: Path | None, out: Output
) -> None:
    settings, shown, overlay = options.settings(asked.whole), asked.shown, _scene_overlay(asked, simplified)
    if folder is None or shown is None:
        last = show_live(MeshExhibit(content, settings, simplified, overlay), asked, out)
        out.result({"frames": [mesh_row(SceneReport.of(last), [])] if last else []})
        return
    check_quilts(options, shown, asked.files.scale)
    moments = asked.moments()
    say_who(moments[0], out)
    if simplified is not None:
        asked.say_scale(out)
    drawn = write_mesh_frames(
        out, content, shown.scaled(asked.files.scale), moments, options.write, settings, folder,
        asked.files.picture_format, simplified=simplified, overlay=overlay, simulate=asked.files.simulate,
        seen_from=asked.files.seen_from,
    )  # fmt: skip
    rows = [mesh_row(report, files) for report, files in drawn]
    print_mesh_rows(out, rows, folder)
    out.result({"frames": rows})


def _scene_overlay(asked: Asked, simplified: Simplified | None) -> SceneOverlay | None:
    if asked.overlay == "simplified" and simplified is None:
        raise InputError("--overlay simplified shows what a policy leaves out: give --policy, as contrast+gaze")
    return None if asked.overlay == "none" else "simplified" if asked.overlay == "simplified" else "panels"


def _exhibit(
    content: Terrain, asked: Asked, options: TerrainOptions, max_triangles: int | None, policy: Policy,
    draped: Draped | None,
) -> TerrainExhibit:  # fmt: skip
    reference_m = standing_viewer(asked.whole).position_m if asked.whole else (0.0, 0.0, 0.0)
    overlay: TerrainOverlay = "patches" if asked.overlay == "patches" else "panels"
    return TerrainExhibit(
        content, options.look(), options.settings(max_triangles), policy, reference_m, asked.whole, draped,
        asked.pointers(), overlay,
    )  # fmt: skip


def _show_terrain(exhibit: TerrainExhibit, asked: Asked, folder: Path | None, out: Output) -> None:
    shown = asked.shown
    if folder is None or shown is None:
        last = show_live(exhibit, asked, out)
        out.result({"frames": [terrain_row(TerrainReport.of(last), [])] if last else []})
        return
    asked.say_scale(out)
    drawn = write_terrain_frames(
        out, exhibit, shown.scaled(asked.files.scale), asked.moments(), folder, asked.files.picture_format,
        overlay=None if asked.overlay == "none" else exhibit.overlay, simulate=asked.files.simulate,
        seen_from=asked.files.seen_from,
    )  # fmt: skip
    rows = [terrain_row(report, files) for report, files in drawn]
    print_terrain_rows(out, rows, folder)
    out.result({"frames": rows})


def _show_image(
    content: Image, asked: Asked, policy: Policy, placement: OnSurface, wishes: ShowOptions, folder: Path | None,
    out: Output,
) -> None:  # fmt: skip
    shown = asked.shown
    overlay: Overlay | None = "levels" if asked.overlay == "levels" else "error" if asked.overlay == "error" else None
    moves = wishes.lenses.moves()
    if moves.carried:
        # A session is made or read only where it is wanted.
        moves = moves._replace(pointers=asked.pointers())
    if moves.carried and not moves.pointers(0.0):
        raise InputError(
            "--lens pointer,...: nobody points: give a --session with pointers (limen walk --pointers 1 makes one)"
        )
    if asked.windows.window == "eye":
        raise InputError(
            "--window eye is not built of images, which are shown as they lie on a wall: give outputs, or leave it out"
        )
    if asked.windows.window == "outputs":
        exhibit = ImageExhibit(content, policy, placement, moves, overlay or "levels")
        last = show_live(exhibit, asked, out)  # of every quilt the same
        out.result({"frames": [image_row(last[0].report, [])] if last else []})
        return
    if folder is None or shown is None:
        settings = LiveSettings(
            policy,
            placement,
            overlay=overlay,
            seconds=asked.windows.seconds,
            moves=moves,
        )
        shown_last = run_live(content, shown, asked.tour() if shown or asked.gaze else None, settings, out.say)
        out.result({"frames": [image_row(shown_last, [])] if shown_last else []})
        return
    check_quilts(wishes.mesh, shown, asked.files.scale)
    check_files(shown, wishes.mesh.write, ("room", "surface") if asked.files.simulate else ())
    rows = list(
        write_image_frames(
            out, content, shown, asked.moments(), policy, placement, folder, asked.files.picture_format,
            scale=asked.files.scale, overlay=overlay, simulate=asked.files.simulate, moves=moves,
            write=wishes.mesh.write,
        )
    )  # fmt: skip
    print_image_rows(out, rows, folder)
    out.result({"frames": rows})
