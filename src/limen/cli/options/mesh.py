"""Options of content that is a mesh, and of where points stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Group, Parameter

from limen.cli.arguments import place
from limen.errors import InputError
from limen.viewing.choices import Animation, Depth, Stereo

if TYPE_CHECKING:
    from limen.data.mesh.mesh import Mesh
    from limen.layers.common.room_placement import RoomPlacement
    from limen.layers.mesh.layer import MeshLayer
    from limen.layers.mesh.select import FoldTree
    from limen.viewing.policy import Policy

__all__ = ["MESH_DEFAULT", "MeshOptions", "Write"]

Write: TypeAlias = Literal["panels", "quilts"]


@Parameter(name="*", group=Group("Meshes, and where points stand"))
@dataclass(frozen=True, slots=True)
class MeshOptions:
    """Options of content that is a mesh; points hear those that say where it stands."""

    size_m: Annotated[
        float | None, Parameter(help="Its largest extent in the room; fitted to the display if not given.")
    ] = None
    at: Annotated[
        str,
        Parameter(
            allow_leading_hyphen=True, help="X,Y,Z of its middle, metres; inside or behind the display if not given."
        ),
    ] = ""
    up: Annotated[
        Literal["y", "z"] | None, Parameter(help="Which of the file's axes points up: y of a mesh, z of points.")
    ] = None
    turn_deg: Annotated[float, Parameter(allow_leading_hyphen=True, help="Turned about the vertical.")] = 0.0
    tilt_deg: Annotated[
        float | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Tilted toward the viewer: 90 shows it from above. By default 40 for flat points.",
        ),
    ] = None
    animate: Annotated[Animation, Parameter(help="Deform it (a mesh), or turn it, over the session's time.")] = "none"
    stereo: Annotated[
        Stereo,
        Parameter(
            help="none: one eye. anaglyph: for red-cyan glasses. side-by-side: both eyes in one picture. sequential: "
            "a picture for each eye."
        ),
    ] = "none"
    depth: Annotated[
        Depth, Parameter(help="panel: every panel's own, the faster. shared: the viewer camera's, on all panels.")
    ] = "panel"
    write: Annotated[Write, Parameter(help="With --out: a picture for every panel, or one for every quilt.")] = "panels"
    background: Annotated[str, Parameter(help="Colour where nothing is, as #rrggbb.")] = ""

    def stands(self, up: Literal["y", "z"] = "y", tilt_deg: float = 0.0) -> RoomPlacement:
        """Where it stands; ``up`` and ``tilt_deg`` are for where the options do not say."""
        from limen.layers.common.room_placement import RoomPlacement

        tilt_deg = tilt_deg if self.tilt_deg is None else self.tilt_deg
        return RoomPlacement(
            self.size_m, place(self.at, "--at") if self.at else None, self.up or up, self.turn_deg, tilt_deg,
            turning=self.animate == "turn",
        )  # fmt: skip

    def layer(self, mesh: Mesh, policy: Policy, overlay: str, tree: FoldTree | None) -> MeshLayer:
        """The mesh as it is shown; raises InputError for what cannot be."""
        from limen.data.samples.mesh import ripple
        from limen.layers.mesh.layer import MeshLayer

        if self.animate == "ripple" and tree is not None:
            raise InputError("a mesh that ripples is drawn in full: give --policy full, or --animate turn")
        if overlay == "simplified" and tree is None:
            raise InputError("--overlay simplified shows what a policy leaves out: give --policy, as contrast+gaze")
        deformed = partial(ripple, mesh) if self.animate == "ripple" else None
        return MeshLayer(mesh, self.stands(), policy, tree, deformed=deformed, depth=self.depth, overlay=overlay)

    @property
    def light(self) -> tuple[float, float, float] | None:
        """The background as linear light, if one is given."""
        from limen.show.show_file import light_of

        return light_of(self.background) if self.background else None


MESH_DEFAULT = MeshOptions()
