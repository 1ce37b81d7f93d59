"""Options of content that is a cloud of points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from cyclopts import Group, Parameter

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


POINTS_DEFAULT = PointsOptions()
