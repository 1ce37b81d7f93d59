"""How what is seen through lenses is drawn: pixel by pixel, or in triangles.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.3 and 6 (the modes NGV, PRE and ADGV).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from limen.errors import InputError

__all__ = ["LENS_MODES", "LensMode", "Tessellation"]

LensMode: TypeAlias = Literal["exact", "coarse", "uniform", "acuity", "error"]
LENS_MODES: tuple[LensMode, ...] = get_args(LensMode)


@dataclass(frozen=True, slots=True)
class Tessellation:
    """How what is seen through lenses is drawn.

    Parameters
    ----------
    mode
        ``exact``: every pixel looks up what it shows. Else in triangles between whose corners places are interpolated:
        ``coarse``, two a cell (the paper's NGV); ``uniform``, every side of a cell in ``segments`` (PRE); ``acuity``,
        the more the more a lens bends and the nearer the viewers are, up to ``most`` (ADGV); ``error``, as many as it
        takes to be nowhere off by more than allowed.
    segments, most
        Parts of a cell's side, of ``uniform`` and at most of ``acuity``.
    sub_edge_px
        Length of the sides of triangles that ``acuity`` makes at the sharpest bend, for viewers who see single pixels.
    error_px
        How far ``error`` lets a place be drawn from where it belongs, in pixels or, for viewers who do not see single
        pixels, in the smallest lengths that they see.

    Raises
    ------
    InputError
        If that cannot be.
    """

    mode: LensMode = "exact"
    segments: int = 16
    most: int = 64
    sub_edge_px: float = 4.0
    error_px: float = 0.5

    def __post_init__(self) -> None:
        if self.mode not in LENS_MODES:
            raise InputError(f"no lens mode is named '{self.mode}': there are {', '.join(LENS_MODES)}")
        if not (1 <= self.segments <= self.most <= 1024):
            raise InputError(
                f"segments and most must lie from 1 to 1024, segments first, got {self.segments} and {self.most}"
            )
        if not (self.sub_edge_px > 0 and self.error_px > 0):
            raise InputError(
                f"sub_edge_px and error_px must be above 0, got {self.sub_edge_px:g} and {self.error_px:g}"
            )
