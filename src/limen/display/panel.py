"""One flat polygonal display surface with a pixel grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from limen.errors import DisplayError
from limen.geometry import Floats, Vec3, as_vec3, cross, dot, normalised, signed_area

__all__ = ["MAX_OUTLINE_CORNERS", "Panel"]

MAX_OUTLINE_CORNERS = 8
"""Octagons: the number of clip distances that every graphics adapter offers."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One flat display surface, in the room frame.

    Parameters
    ----------
    name
        ``wall/column,row`` for panels of a grid; unique in a display.
    size_px
        Width and height of the pixel grid.
    origin_m
        The outer corner of the grid's first pixel, top left as a viewer sees it.
    right, down
        Unit vectors along a row and along a column of pixels; perpendicular.
    pitch_m
        Distance from one pixel to the next along ``right`` and along ``down``.
    surface_m
        Where ``origin_m`` lies on the display's unrolled surface: metres to the right and downward.
    outline_px
        Corners of the lit polygon on the pixel grid (convex, at most eight); empty for the whole grid.
    nudge_px
        Moves the picture on this panel right and down, to make up for a panel mounted a little off.
    node
        The machine that draws this panel.
    true_px
        How many of the panel's true pixels one pixel stands for, along a row: more than 1 in previews only.
    luminance_cd_m2
        Of white, as the viewer sees it. The default is the condition under which people's resolution was measured
        (Ashraf, Chapiro, Mantiuk 2025). Models of vision clamp it to 0.0113 ... 10,000.
    gain
        Linear factor on the light of this panel, 0 < gain <= 1, to match panels with each other.
    falloff
        Exponent k >= 0 of the panel's luminance, which falls as cos(angle from the normal)^k; 0 is Lambertian.
    bezel_m
        Width of the dark frame around the lit outline.

    Raises
    ------
    DisplayError
        If any of this does not describe a flat panel; the message names the panel and the field.
    """

    name: str
    size_px: tuple[int, int]
    origin_m: Vec3
    right: Vec3
    down: Vec3
    pitch_m: tuple[float, float]
    surface_m: tuple[float, float] = (0.0, 0.0)
    outline_px: tuple[tuple[float, float], ...] = ()
    nudge_px: tuple[float, float] = (0.0, 0.0)
    node: str = ""
    true_px: float = 1.0
    luminance_cd_m2: float = 100.0
    gain: float = 1.0
    falloff: float = 0.0
    bezel_m: float = 0.0

    def __post_init__(self) -> None:
        try:
            self._check()
        except ValueError as error:
            raise DisplayError(f"panel '{self.name}': {error}") from None

    def _check(self) -> None:
        if not self.name:
            raise ValueError("name must not be empty")
        if min(self.size_px) < 1 or max(self.size_px) > 65_535:
            raise ValueError(f"size_px must be from 1 to 65535 pixels, got {list(self.size_px)}")
        if not all(math.isfinite(pitch) and pitch > 0 for pitch in self.pitch_m):
            raise ValueError(f"pitch must be positive, got {list(self.pitch_m)}")
        if not (math.isfinite(self.luminance_cd_m2) and self.luminance_cd_m2 > 0):
            raise ValueError(f"luminance_cd_m2 of white must be above 0, got {self.luminance_cd_m2}; 100 is common")
        if not 0 < self.gain <= 1:
            raise ValueError(f"gain must lie above 0 and at most at 1, got {self.gain}: the dimmest panel has 1")
        for field, value in (("falloff", self.falloff), ("bezel", self.bezel_m)):
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{field} must be 0 or more, got {value}")
        object.__setattr__(self, "origin_m", as_vec3(self.origin_m, "origin"))
        object.__setattr__(self, "right", normalised(as_vec3(self.right, "right"), "right"))
        object.__setattr__(self, "down", normalised(as_vec3(self.down, "down"), "down"))
        if abs(dot(self.right, self.down)) > 1e-3:
            raise ValueError("its rows and columns of pixels are not perpendicular; check its corners")
        if self.outline_px:
            _check_outline(self.outline_px)

    @property
    def normal(self) -> Vec3:
        """Unit vector toward the viewers."""
        return cross(self.down, self.right)

    @property
    def size_m(self) -> tuple[float, float]:
        return (self.size_px[0] * self.pitch_m[0], self.size_px[1] * self.pitch_m[1])

    @property
    def grid_name(self) -> str:
        """The part of the name before ``/``: the grid that the panel belongs to."""
        return self.name.split("/", 1)[0]

    @property
    def corners_m(self) -> Floats:
        """Top left, top right, bottom right, bottom left of the pixel grid: shape (4, 3)."""
        width, height = self.size_px
        return self.position_m(np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float))

    @property
    def lit_outline_px(self) -> Floats:
        """Corners of the lit polygon on the pixel grid, clockwise as the viewer sees it: shape (K, 2)."""
        width, height = self.size_px
        corners = np.array(self.outline_px or ((0, 0), (width, 0), (width, height), (0, height)), dtype=float)
        return corners if signed_area(corners) > 0 else corners[::-1]

    @property
    def outline_m(self) -> Floats:
        """Room positions of the lit polygon's corners, clockwise as the viewer sees it: shape (K, 3)."""
        return self.position_m(self.lit_outline_px)

    @property
    def centre_m(self) -> Floats:
        """Middle of the pixel grid, shape (3,)."""
        return self.position_m(np.array(self.size_px) / 2)

    def position_m(self, position_px: Floats) -> Floats:
        """Room positions of places on the pixel grid: (..., 2) pixels to (..., 3) metres.

        The centre of the first pixel is (0.5, 0.5).
        """
        along = np.asarray(position_px, dtype=float) * np.array(self.pitch_m)
        frame = np.array([self.right, self.down])
        return np.asarray(np.array(self.origin_m) + along @ frame)


def _check_outline(outline_px: tuple[tuple[float, float], ...]) -> None:
    if not 3 <= len(outline_px) <= MAX_OUTLINE_CORNERS:
        raise ValueError(
            f"outline must have 3 to {MAX_OUTLINE_CORNERS} corners, got {len(outline_px)}: split the panel"
        )
    if not all(math.isfinite(value) for corner in outline_px for value in corner):
        raise ValueError("outline holds a number that is not finite")
    # Not with NumPy: a display of thousands of small panels would wait for it.
    count = len(outline_px)
    edges = [(x - outline_px[k - 1][0], y - outline_px[k - 1][1]) for k, (x, y) in enumerate(outline_px)]
    turns = [edges[k - 1][0] * edges[k][1] - edges[k - 1][1] * edges[k][0] for k in range(count)]
    if not (min(turns) > 0 or max(turns) < 0):
        raise ValueError("outline must be convex and have no repeated corner: split the panel")
