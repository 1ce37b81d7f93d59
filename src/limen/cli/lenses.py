"""Lenses as people type them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from limen.errors import InputError
from limen.lens import DropOff, Lens

__all__ = ["LENSES_DEFAULT", "LensOptions"]

_CARRIED = "pointer,"


@Parameter(name="*", group=Group("Lenses (on images)"))
@dataclass(frozen=True, slots=True)
class LensOptions:
    """What an image is looked through."""

    lens: Annotated[
        list[str],
        Parameter(
            consume_multiple=True,
            negative="",
            help="X,Y,RADIUS,MAGNIFICATION: its focus and how far it reaches, in texels of the image; several lie on "
            "each other, the last nearest to the eye. pointer,RADIUS,MAGNIFICATION: where a session's pointers point.",
        ),
    ] = field(default_factory=list)
    lens_focus: Annotated[float, Parameter(help="Share of the radius that is magnified evenly, from 0 to below 1.")] = (
        0.4
    )
    lens_drop_off: Annotated[DropOff, Parameter(help="How magnification falls from there to the rim.")] = "cosine"
    lens_shape: Annotated[Literal["radial", "rectangular"], Parameter(help="Its outline.")] = "radial"

    def lenses(self) -> tuple[Lens, ...]:
        """From the image to the eye.

        Raises
        ------
        InputError
            If one cannot be read, or cannot be.
        """
        return tuple(self._lens(text) for text in self.lens if not text.startswith(_CARRIED))

    def carried(self) -> tuple[Lens, ...]:
        """Those that pointers carry, wherever.

        Raises
        ------
        InputError
            If one cannot be read, or cannot be.
        """
        return tuple(
            self._lens(text, text.replace(_CARRIED, "0,0,", 1)) for text in self.lens if text.startswith(_CARRIED)
        )

    def _lens(self, text: str, numbers: str = "") -> Lens:
        try:
            x, y, radius, magnification = (float(part) for part in (numbers or text).split(","))
        except ValueError:
            raise InputError(
                f"--lens {text}: give X,Y,RADIUS,MAGNIFICATION, the first three in texels, as 9500,4700,800,8 (or "
                "pointer in place of X,Y)"
            ) from None
        return Lens((x, y), radius, magnification, self.lens_focus, self.lens_drop_off, self.lens_shape)


LENSES_DEFAULT = LensOptions()
