"""What ``limen show`` does with what was asked for: layers of all contents, in windows or into files."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, NamedTuple, cast

from limen.cli.arguments import refuse_acuity
from limen.cli.asked import Asked
from limen.cli.content import opened_content
from limen.cli.heard import OF_SHOW_FILES, SHOW, Kind, refuse_kind
from limen.cli.options.lenses import LensOptions
from limen.cli.options.mesh import MeshOptions
from limen.cli.options.points import PointsOptions
from limen.cli.options.terrain import TerrainOptions
from limen.cli.output import Output
from limen.cli.show_files import check_written, frame_row, print_rows, write_frames
from limen.errors import InputError
from limen.layers.base import Layer
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.select import FoldTree
from limen.layers.registry import KINDS, kind_of, layer_of
from limen.layers.terrain.layer import TerrainLayer
from limen.show.app import run_show
from limen.show.show import Show, Tour
from limen.show.show_file import is_show_file, open_show
from limen.track.tracker import open_tracker, stamped
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

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
    out: Output, paths: Sequence[Path], asked: Asked, wishes: ShowOptions, given: Sequence[str], folder: Path | None
) -> None:
    """Draw contents of any kind in windows, or into a folder.

    Parameters
    ----------
    given
        The options that people gave, as they typed them: those that are for none of these kinds of content are refused.

    Raises
    ------
    InputError
        For options that are not for this kind of content, or would change nothing.
    """
    with ExitStack() as stack:
        if any(is_show_file(path) for path in paths):
            show = _show_of_file(out, paths, asked, given, stack)
        else:
            show = _show_of_contents(out, paths, asked, wishes, given, stack, in_files=folder is not None)
        _refuse_unheard(show, asked)
        if folder is not None and asked.shown is not None:
            check_written(show, asked.shown, asked, wishes.mesh.write)
            _say_what_is_told(show, asked, out)
            rows = write_frames(out, show, asked.shown, asked, folder, wishes.mesh.write)
            print_rows(out, rows, folder)
        else:
            show.check_one_picture()
            last = _show_live(show, asked, out, stack)
            rows = [] if last is None else [frame_row(last)]
        out.result({"frames": rows})


def _show_of_contents(
    out: Output,
    paths: Sequence[Path],
    asked: Asked,
    wishes: ShowOptions,
    given: Sequence[str],
    stack: ExitStack,
    *,
    in_files: bool,
) -> Show:
    """Contents as layers, by the options of their kinds."""
    contents = [_opened(out, path, stack) for path in paths]
    kinds = cast("list[Kind]", [content.kind for content in contents])
    refuse_kind(SHOW, given, *kinds)
    acuity_given = "--acuity-arcmin" in given
    policies = [_policy(kind, wishes, in_files=in_files, acuity_given=acuity_given) for kind in kinds]
    _check_looking(kinds, asked, policies, wishes.terrain)
    makers = [_Maker(out, asked, wishes, policy, stack) for policy in policies]
    layers = tuple(maker.layer(content) for maker, content in zip(makers, contents, strict=True))
    fixed = "terrain" in kinds and wishes.terrain.camera == "fixed"
    return Show(
        layers, asked.whole, stereo=wishes.mesh.stereo, background=wishes.mesh.light,
        eye_m=_reference_m(asked) if fixed else None, pointers=asked.pointers(),
    )  # fmt: skip


def _show_of_file(out: Output, paths: Sequence[Path], asked: Asked, given: Sequence[str], stack: ExitStack) -> Show:
    """What a show file says; raises InputError for options that it says, too."""
    if len(paths) > 1:
        raise InputError("a show file says all that is shown: give it alone, or name the other contents in it")
    for option in given:
        if option not in OF_SHOW_FILES:
            raise InputError(f"{option} is said in a show file, for each layer: leave it out")
    with out.progress("opening what is shown", 1000) as step:
        show = open_show(paths[0], asked.whole, stack, lambda _, done: step.to(round(1000 * done)))
    show.pointers = asked.pointers()
    return show


def _opened(out: Output, path: Path, stack: ExitStack) -> Any:
    """Open content; an image is closed with the stack, also where it is refused."""
    opened = opened_content(out, path)
    if hasattr(opened, "close"):
        stack.callback(opened.close)
    return opened


class _Maker(NamedTuple):
    """Makes layers of contents, each by the options of its kind."""

    out: Output
    asked: Asked
    wishes: ShowOptions
    policy: Policy
    stack: ExitStack

    def layer(self, content: Any) -> Layer:
        """Raises InputError for what its kind cannot be shown as."""
        overlay = self._overlay(content.kind)
        make = {"image": self._image, "mesh": self._mesh, "points": self._points, "terrain": self._terrain}
        if content.kind not in make:  # of another package, which has no options here
            return layer_of(content, policy=self.policy, overlay=overlay)
        return make[content.kind](content, overlay)

    def _overlay(self, kind: str) -> str:
        word = "" if self.asked.overlay == "none" else self.asked.overlay
        if word and word not in KINDS[kind].overlays:
            raise InputError(
                f"--overlay {word} is not for {KINDS[kind].noun}: give --overlay {' or '.join(KINDS[kind].overlays)}"
            )
        return word

    def _image(self, image: Any, overlay: str) -> Layer:
        lenses = self.wishes.lenses
        placement = lenses.placement(self.wishes.fit or "contain")
        return ImageLayer(image, placement, self.policy, lenses.moving(), overlay=overlay)

    def _mesh(self, mesh: Any, overlay: str) -> Layer:
        tree = None
        if self.policy.name != "full":
            from limen.data.mesh.store import tree_of  # Numba and SciPy take a second

            with self.out.progress("joining vertices to a tree", 1) as step:
                tree = FoldTree(tree_of(mesh))
                step(1)
        return self.wishes.mesh.layer(mesh, self.policy, overlay, tree)

    def _points(self, points: Any, overlay: str) -> Layer:
        return self.wishes.points.layer(points, self.wishes.mesh, self.policy, overlay)

    def _terrain(self, terrain: Any, overlay: str) -> Layer:
        options = self.wishes.terrain
        draped = self.stack.enter_context(options.draped(terrain))
        return TerrainLayer(
            terrain, options.look(), options.settings(self.wishes.max_triangles), self.policy,
            _reference_m(self.asked), draped, overlay,
        )  # fmt: skip


def _reference_m(asked: Asked) -> tuple[float, float, float]:
    """The eye that terrains stand before; a window that is itself the display is looked at from its own."""
    return standing_viewer(asked.whole).position_m if asked.whole else (0.0, 0.0, 0.0)


def _policy(kind: Kind, wishes: ShowOptions, *, in_files: bool, acuity_given: bool) -> Policy:
    """The policy asked for, if content of this kind can be drawn by it."""
    text = wishes.policy or KINDS[kind].default_policy
    if acuity_given:
        refuse_acuity([text])
    policy = Policy.parse(text, wishes.acuity_arcmin)
    if kind == "image" or (policy.name == "scheel") != (kind == "terrain"):
        tolerance_of((), policy)  # says what is wrong with it before a window is opened
    return policy.timeless if in_files else policy


def _check_looking(kinds: Sequence[Kind], asked: Asked, policies: Sequence[Policy], terrain: TerrainOptions) -> None:
    """Refuse to be told where viewers look, or how that is measured, where nothing depends on it."""
    if "terrain" not in kinds:
        if asked.gaze and not any(policy.gaze for policy in policies):
            raise InputError(
                f"--gaze changes nothing under the policy {policies[0].title}: give one with +gaze, as --policy "
                "contrast+gaze"
            )
        return
    told = [option for option, given in (("--gaze", asked.gaze), ("--rule", terrain.rule != "exact")) if given]
    policy = policies[kinds.index("terrain")]
    if told and (policy.name, terrain.field_deg) == ("full", None) and asked.overlay != "panels":
        raise InputError(f"{told[0]} changes nothing under the policy full: give another --policy, or --field-deg")


def _refuse_unheard(show: Show, asked: Asked) -> None:
    """Refuse lenses that pointers carry where nobody points."""
    carried = any(isinstance(layer, ImageLayer) and _carries(layer) for layer in show.layers)
    if carried and not show.pointers(0.0):
        raise InputError(
            "--lens pointer,...: nobody points: give a --session with pointers (limen walk --pointers 1 makes one)"
        )


def _carries(layer: ImageLayer) -> bool:
    return isinstance(layer.placement, OnSurface) and bool(layer.placement.carried)


def _say_what_is_told(show: Show, asked: Asked, out: Output) -> None:
    """Say whose eyes pictures are right for, and of which panels reports tell."""
    if all(kind_of(layer).on_panels for layer in show.layers):
        return
    asked.say_scale(out)
    if show.eye_m is None:
        _say_who(show, asked.moments()[0], out)


def _say_who(show: Show, viewers: Sequence[Viewer], out: Output) -> None:
    """Say whose eyes a picture is right for, where there are several."""
    for_one = [kind_of(layer).noun for layer in show.layers if not kind_of(layer).on_panels]
    if for_one and len(viewers) > 1:
        name = f" ('{viewers[0].name}')" if viewers[0].name else ""
        out.say(f"{for_one[0]} is drawn for one viewer: the first of {len(viewers)}{name}")


def _show_live(show: Show, asked: Asked, out: Output, stack: ExitStack) -> Any:
    """Show it in windows until they are closed; the last frame's report."""
    shown, windows = asked.shown, asked.windows
    who: Tour | Viewer = asked.tour() if asked.session and shown else asked.stander()
    if asked.tracker:
        tracker = stack.enter_context(closing(open_tracker(asked.tracker)))
        who, show.pointers = stamped(tracker), tracker.pointers
    if not isinstance(who, Viewer) and show.eye_m is None:
        _say_who(show, who(0.0), out)
    return run_show(
        show, shown, who, out.say, view=windows.view, backend="browser" if windows.window == "browser" else "window",
        seconds=windows.seconds, port=windows.port,
    )  # fmt: skip
