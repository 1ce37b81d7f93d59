"""Options of content that is a cloud of points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from limen.errors import InputError

if TYPE_CHECKING:
    from limen.cli.options.mesh import MeshOptions
    from limen.data.points.file import Points
    from limen.layers.points.layer import PointsLayer
    from limen.viewing.policy import Policy

__all__ = ["POINTS_DEFAULT", "PointsOptions"]


@Parameter(name="*", group=Group("Points"))
@dataclass(frozen=True, slots=True)
class PointsOptions:
    """Options of content that is a cloud of points; `limen.cli.options.mesh.MeshOptions` say where it stands."""

    splats: Annotated[
        Literal["round", "square"], Parameter(help="Discs that face the eye, or squares, which cost less.")
    ] = "round"
    lit: Annotated[
        bool | None,
        Parameter(
            help="Light points that have normals, or show all as coloured. By default, where there are no colours."
        ),
    ] = None

    def layer(self, points: Points, stood: MeshOptions, policy: Policy, overlay: str) -> PointsLayer:
        """The cloud as it is shown; raises InputError for an animation that is for meshes."""
        from limen.layers.points.layer import PointsLayer

        if stood.animate == "ripple":
            raise InputError("a cloud of points does not ripple: --animate turn, or none")
        stands = stood.stands(points.up, points.tilt_deg)
        return PointsLayer(points, stands, policy, self.lit, self.splats, overlay=overlay)


POINTS_DEFAULT = PointsOptions()
