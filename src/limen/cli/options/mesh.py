"""Options of content that is a mesh, and of where points stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
from cyclopts import Group, Parameter

from limen.cli.arguments import place
from limen.data.store.resample import linear_of_srgb
from limen.errors import InputError
from limen.viewing.choices import Animation, Depth, Stereo

if TYPE_CHECKING:
    from limen.display.display import Display
    from limen.show.stage import SceneSettings

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

    def settings(self, display: Display | None, up: Literal["y", "z"] = "y", tilt_deg: float = 0.0) -> SceneSettings:
        """The options as a scene's settings, for a whole display if there is one.

        ``up`` and ``tilt_deg`` are for where they do not say.
        """
        from limen.layers.mesh.renderer import BACKGROUND
        from limen.show.stage import SceneSettings

        at_m = place(self.at, "--at") if self.at else None
        background = _light_of(self.background) if self.background else BACKGROUND
        tilt_deg = tilt_deg if self.tilt_deg is None else self.tilt_deg
        settings = SceneSettings(
            self.stereo, self.animate, self.size_m, at_m, self.up or up, self.turn_deg, background, tilt_deg, self.depth
        )
        return settings if display is None else settings.standing_in(display)


MESH_DEFAULT = MeshOptions()


def _light_of(colour: str) -> tuple[float, float, float]:
    """Linear light of ``#rrggbb``."""
    digits = colour.removeprefix("#")
    try:
        codes = np.array(list(bytes.fromhex(digits))) / 255.0
    except ValueError:
        codes = np.zeros(0)
    if len(digits) != 6 or len(codes) != 3:
        raise InputError(f"--background takes a colour as #rrggbb, got '{colour}'")
    red, green, blue = (float(light) for light in linear_of_srgb(codes))
    return (red, green, blue)
