"""Lenses as people type them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Group, Parameter
from numpy.typing import NDArray

from limen.errors import InputError, MissingFileError
from limen.track.lens_track import lenses_at, read_lens_tracks
from limen.viewing.lens import DropOff, Lens
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.tessellation import LensMode, Tessellation

__all__ = ["LENSES_DEFAULT", "LensOptions"]

_CARRIED, _TRACKS = "pointer,", ".csv"


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
            "each other, the last nearest to the eye. pointer,RADIUS,MAGNIFICATION: where a session's pointers point. "
            "FILE.csv: lenses over time.",
        ),
    ] = field(default_factory=list)
    lens_focus: Annotated[float, Parameter(help="Share of the radius that is magnified evenly, from 0 to below 1.")] = (
        0.4
    )
    lens_drop_off: Annotated[DropOff, Parameter(help="How magnification falls from there to the rim.")] = "cosine"
    lens_shape: Annotated[Literal["radial", "rectangular"], Parameter(help="Its outline.")] = "radial"
    lens_heights: Annotated[
        Path | None, Parameter(help="A picture, white in the focus and black at the rim, in place of the last three.")
    ] = None
    lens_mode: Annotated[
        LensMode,
        Parameter(
            help="exact: every pixel looks up what it shows. In triangles: coarse, uniform, acuity as Papadopoulos and "
            "Kaufman compared them; error, as many as viewers need to see nothing drawn beside its place."
        ),
    ] = "exact"

    def check(self, *, by_hand: bool) -> None:
        """Refuse options of lenses that are not there, and of a shape that a picture has.

        Raises
        ------
        InputError
            Naming the first; ``by_hand``: a lens may come by a key, and ``--lens-mode`` is of it too.
        """
        first = LensOptions()
        shape = [
            name
            for name in ("lens_focus", "lens_drop_off", "lens_shape")
            if getattr(self, name) != getattr(first, name)
        ]
        others = [*shape, *(["lens_heights"] if self.lens_heights else [])]
        others += ["lens_mode"] if not by_hand and self.lens_mode != first.lens_mode else []
        if others and not self.lens:
            raise InputError(f"{_option(others[0])} is of a lens: give --lens too")
        if shape and self.lens_heights is not None:
            raise InputError(f"--lens-heights takes the place of {_option(shape[0])}: leave out one of them")

    def placement(self, fit: Fit) -> OnSurface:
        """An image on the surface, seen through the lenses that stay or that pointers carry.

        Raises
        ------
        InputError
            If one cannot be read, or cannot be.
        """
        still = [self._lens(text) for text in self.lens if not (text.startswith(_CARRIED) or text.endswith(_TRACKS))]
        carried = [
            self._lens(text, text.replace(_CARRIED, "0,0,", 1)) for text in self.lens if text.startswith(_CARRIED)
        ]
        return OnSurface(fit, lenses=tuple(still), carried=tuple(carried), tessellation=Tessellation(self.lens_mode))

    def moving(self) -> Callable[[float], tuple[Lens, ...]] | None:
        """Those that are elsewhere, or others, from time to time; None if there are none.

        Raises
        ------
        InputError
            If one cannot be read, or cannot be.
        """
        files = [Path(text) for text in self.lens if text.endswith(_TRACKS)]
        tracks = [track for path in files for track in read_lens_tracks(path, self._lens("", "0,0,1,1"))]
        return partial(lenses_at, tracks) if tracks else None

    def _lens(self, text: str, numbers: str = "") -> Lens:
        try:
            x, y, radius, magnification = (float(part) for part in (numbers or text).split(","))
        except ValueError:
            raise InputError(
                f"--lens {text}: give X,Y,RADIUS,MAGNIFICATION, the first three in texels, as 9500,4700,800,8 (or "
                "pointer in place of X,Y, or a .csv file of lenses over time)"
            ) from None
        heights = None if self.lens_heights is None else _heights(self.lens_heights)
        return Lens(
            (x, y), radius, magnification, self.lens_focus, self.lens_drop_off, self.lens_shape, heights=heights
        )


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


@cache
def _heights(path: Path) -> NDArray[np.float64]:
    """A picture's lightness, 0 ... 1.

    Raises
    ------
    InputError
        If it is no picture.
    """
    import pyvips

    from limen.data.store.report import one_line

    if not path.exists():
        raise MissingFileError(f"--lens-heights {path}: there is no such file")
    try:
        picture = pyvips.Image.new_from_file(str(path))
        grey = (picture[0] if picture.bands < 3 else picture[:3].colourspace("b-w")[0]).numpy()
    except pyvips.Error as error:
        raise InputError(f"--lens-heights {path}: is no picture: {one_line(error)}") from None
    most = np.iinfo(grey.dtype).max if grey.dtype.kind == "u" else 1.0
    return np.asarray(grey / most, dtype=float)


LENSES_DEFAULT = LensOptions()
