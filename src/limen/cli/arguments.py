"""How arguments that several verbs share are written, and what they become."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter

from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Vec3, as_vec3
from limen.viewing.placement import Fit
from limen.viewing.policy import ignores_acuity

__all__ = [
    "AcuityOption",
    "DisplayOption",
    "FitOption",
    "PanelsOption",
    "PolicyOption",
    "TrianglesOption",
    "chosen_panels",
    "place",
    "refuse_acuity",
]

DisplayOption = Annotated[str, Parameter(help="A preset's name or a display file (TOML); see `limen display`.")]
PanelsOption = Annotated[
    list[str], Parameter(consume_multiple=True, negative="", help="Only panels whose names match, e.g. 'front/*'.")
]
PolicyOption = Annotated[
    str,
    Parameter(
        help="full: the ordinary mip level. acuity: also what distance hides. contrast: also what is too faint to be "
        "seen. snellen: acuity at 1 arcminute. With +gaze appended: also what is far from where the viewers look; "
        "with +motion, of a mesh or points: also what passes too fast. "
        "scheel: of a terrain, what Scheel and others allow each panel. budget:N and size:N: of a mesh or points, the "
        "N triangles or splats that are seen from farthest away, or that are the largest; budget:12ms: as many as that "
        "takes to draw."
    ),
]
AcuityOption = Annotated[str, Parameter(help="Smallest detail seen: arcminutes, 'human' (0.64) or 'snellen' (1).")]
FitOption = Annotated[Fit, Parameter(help="How the image lies on the display's unrolled surface.")]
TrianglesOption = Annotated[
    int,
    Parameter(help="Of a terrain: a budget for each quilt. Where more triangles would be wanted, all errors grow."),
]


def chosen_panels(display: str, panels: Sequence[str]) -> Display:
    """The display, or the part of it that was asked for."""
    whole = Display.named(display)
    return whole.select(panels) if panels else whole


def refuse_acuity(policies: Sequence[str]) -> None:
    """Refuse ``--acuity-arcmin`` where no policy goes by it.

    Raises
    ------
    InputError
        Naming the policies.
    """
    if all(ignores_acuity(policy) for policy in policies):
        raise InputError(
            f"--acuity-arcmin changes nothing under {' and '.join(policies)}: leave it out, or give --policy acuity, "
            "contrast or budget"
        )


def place(text: str, option: str) -> Vec3:
    """``X,Y,Z`` in metres.

    Raises
    ------
    InputError
        If it is anything else; ``option`` names where it came from.
    """
    try:
        return as_vec3((float(part) for part in text.split(",")), option)
    except ValueError:
        raise InputError(f"{option} takes three numbers in metres, X,Y,Z, got '{text}'") from None
