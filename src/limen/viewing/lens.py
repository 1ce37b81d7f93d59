"""Lenses: parts of an image magnified in place, with a smooth way from the focus to what lies around it.

As in the Elastic Presentation Framework the image is a sheet that a lens raises toward the eye; what is nearer looks
larger. Raised by a share ``s`` of the way to the eye, a place of the sheet at ``c + v`` appears at ``c + v / (1 - s)``
about the focus ``c``: the lens is aligned with the viewer, so its focus stays where it is. At a magnification ``M`` the
focus is raised by ``1 - 1 / M``, and from there a drop-off ``f`` falls to 0 at the rim.

The framework measures the drop-off on the sheet. Then the raised focus soon hides what is around it (a Gaussian lens
folds over beyond 5.7 times), and what a pixel shows has to be searched for. Here it is measured on the display, where
the lens is drawn: ``p = c + (q - c) (1 - (1 - 1 / M) f(q))``. Along every ray from the focus the raised sheet then
goes steadily outward, so no lens folds over at any magnification, and what a pixel shows is given in closed form.

Several lenses are looked through one after the other, like magnifying glasses: the first lies on the image, the last is
next to the eye. So they may overlap, and neither do they fold over together.

References
----------
Carpendale, Montagnese 2001, *A Framework for Unifying Presentation Space* (UIST): the framework, and its drop-offs.
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limen.errors import InputError
from limen.geometry import Floats

__all__ = [
    "DROP_OFFS",
    "DropOff",
    "Lens",
    "drop_off",
    "jacobian_of",
    "rows_of",
    "sharpest_bend",
    "shown_at",
    "source_of",
]

DropOff: TypeAlias = Literal["linear", "cosine", "quadratic", "gaussian"]
DROP_OFFS: tuple[DropOff, ...] = get_args(DropOff)

_NUMBERS = 12
"""Of a lens's row, see `rows_of`."""

STEEP = 4.5
"""Of the Gaussian: its rim lies at three standard deviations, where it is cut off and let end at 0."""

RIM = math.exp(-STEEP)

_HALVINGS = 60
"""Of the search for where a place of the image is shown: from a lens's diameter to a float64's last digit."""


_BEND = 1 / 32


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """One lens on an image; its measures are texels of full resolution, where the image shows them without lenses.

    Parameters
    ----------
    centre_px
        Its focus, x to the right and y down.
    radius_px
        From the focus to the rim, where it ends; two for an ellipse (or a rectangle that is no square).
    magnification
        In the focus, 1 or more.
    focus
        Share of the radius, from the middle, that is magnified evenly, 0 ... 1 without 1. A Gaussian lens has none.
    drop_off
        How magnification falls from the focus to the rim.
    shape
        ``radial`` or ``rectangular``.
    heights
        A table (H, W) of how far the sheet is raised, 0 ... 1, over the lens's square, in place of ``focus`` and
        ``drop_off``: interpolated by cubic B-splines, which are smooth and nowhere higher. It must not rise from the
        middle outward, and is 0 at the rim whatever it says there.

    Raises
    ------
    InputError
        If a lens like this cannot be, or would fold over.
    """

    centre_px: tuple[float, float]
    radius_px: float | tuple[float, float]
    magnification: float = 4.0
    focus: float = 0.4
    drop_off: DropOff = "cosine"
    shape: Literal["radial", "rectangular"] = "radial"
    heights: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if len(self.centre_px) != 2 or not all(math.isfinite(each) for each in self.centre_px):
            raise InputError(f"lens: centre_px must be two finite numbers, got {self.centre_px}")
        object.__setattr__(self, "centre_px", tuple(float(each) for each in self.centre_px))
        if not all(0 < each < math.inf for each in self.radii_px):
            raise InputError(f"lens: radius_px must be above 0, got {self.radius_px}: leave the lens out instead")
        if not 1 <= self.magnification < math.inf:
            raise InputError(f"lens: magnification must be 1 or more, got {self.magnification}: lenses do not shrink")
        if not 0 <= self.focus < 1:
            raise InputError(f"lens: focus must lie from 0 to below 1 (a share of the radius), got {self.focus}")
        if self.drop_off not in DROP_OFFS:
            raise InputError(f"lens: no drop-off is named '{self.drop_off}': there are {', '.join(DROP_OFFS)}")
        if self.shape not in ("radial", "rectangular"):
            raise InputError(f"lens: shape must be radial or rectangular, got '{self.shape}'")
        if self.heights is not None:
            table = np.array(self.heights, dtype=float)
            if table.ndim != 2 or min(table.shape) < 2:
                raise InputError(f"lens: heights must be a table of 2 x 2 or more, got the shape {table.shape}")
            if not (np.isfinite(table).all() and table.min() >= 0 and table.max() <= 1):
                raise InputError("lens: heights must be finite and lie from 0 to 1")
            table.setflags(write=False)
            object.__setattr__(self, "heights", table)
            _check_falls(self)

    def __eq__(self, other: object) -> bool:
        return self._values == other._values if isinstance(other, Lens) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values)

    @property
    def _values(self) -> tuple[Hashable, ...]:
        """What makes two lenses the same, though they came with different messages."""
        table = None if self.heights is None else (self.heights.shape, self.heights.tobytes())
        measures = self.centre_px, self.radius_px, self.magnification, self.focus
        return (*measures, self.drop_off, self.shape, table)

    @property
    def radii_px(self) -> tuple[float, float]:
        """Across and down."""
        if isinstance(self.radius_px, tuple):
            return self.radius_px
        return (float(self.radius_px), float(self.radius_px))

    def raised(self, place_px: ArrayLike) -> tuple[Floats, Floats]:
        """How far the sheet is raised, of the way to the eye, where it is seen at places of the display, (..., 2); and
        how that changes with the place, a texel: (...) and (..., 2).
        """
        way = (np.asarray(place_px, dtype=float) - self.centre_px) / self.radii_px
        falls, slope = self._falls(way)
        strength = 1 - 1 / self.magnification
        return strength * falls, strength * slope / self.radii_px

    def _falls(self, way: Floats) -> tuple[Floats, Floats]:
        """The drop-off at ways from the focus in radii, (..., 2), and its slope there."""
        if self.heights is not None:
            return _interpolated(self.heights, way)
        if self.shape == "radial":
            distance = np.linalg.norm(way, axis=-1)
            falls, slope = drop_off(distance, self.focus, self.drop_off)
            return falls, (slope / np.maximum(distance, 1e-300))[..., None] * way
        falls, slope = drop_off(np.abs(way), self.focus, self.drop_off)
        return falls.prod(axis=-1), np.sign(way) * slope * falls[..., ::-1]


def drop_off(distance: ArrayLike, focus: float, how: DropOff) -> tuple[Floats, Floats]:
    """1 in the focus, 0 from the rim on: at distances in radii, any shape; and its slope.

    >>> drop_off([0.0, 0.4, 0.7, 1.0, 3.0], 0.4, "cosine")[0].round(3).tolist()
    [1.0, 1.0, 0.5, 0.0, 0.0]
    """
    beyond = (np.asarray(distance, dtype=float) - focus) / (1 - focus)
    u = np.clip(beyond, 0, 1)
    match how:
        case "linear":
            falls, slope = 1 - u, np.full(u.shape, -1.0)
        case "cosine":
            falls, slope = 0.5 + 0.5 * np.cos(np.pi * u), -0.5 * np.pi * np.sin(np.pi * u)
        case "quadratic":
            falls, slope = np.where(u < 0.5, 1 - 2 * u * u, 2 * (1 - u) ** 2), -4 * np.minimum(u, 1 - u)
        case _:
            bell = np.exp(-STEEP * u * u)
            falls, slope = (bell - RIM) / (1 - RIM), -2 * STEEP * u * bell / (1 - RIM)
    falls = np.where(u < 1, falls, 0.0)
    return np.asarray(falls), np.where((beyond > 0) & (beyond < 1), slope / (1 - focus), 0.0)


def source_of(lenses: Sequence[Lens], place_px: ArrayLike) -> Floats:
    """Which place of the image is seen at places of the display, through all lenses: (..., 2) to (..., 2) texels."""
    place = np.array(place_px, dtype=float)
    for lens in reversed(lenses):
        place = place - lens.raised(place)[0][..., None] * (place - lens.centre_px)
    return place


def shown_at(lenses: Sequence[Lens], texel_px: ArrayLike) -> Floats:
    """Where places of the image are seen through all lenses: the inverse of `source_of`, (..., 2) to (..., 2).

    Along a ray from a focus, what is shown moves steadily outward: each lens is undone by halving.
    """
    place = np.array(texel_px, dtype=float)
    for lens in lenses:
        centre = np.array(lens.centre_px)
        way = place - centre
        # 1 / grown of the way to the rim, and no farther than the magnification, is where the place is to be found.
        low, high = np.ones(way.shape[:-1]), np.full(way.shape[:-1], lens.magnification)
        for _ in range(_HALVINGS):
            grown = (low + high) / 2
            beyond = grown * (1 - lens.raised(centre + grown[..., None] * way)[0]) > 1
            low, high = np.where(beyond, low, grown), np.where(beyond, grown, high)
        place = centre + ((low + high) / 2)[..., None] * way
    return place


def jacobian_of(lenses: Sequence[Lens], place_px: ArrayLike) -> Floats:
    """How what is seen moves with the place of the display: (..., 2) to (..., 2, 2).

    ``[..., i, k]`` is the image's axis ``i`` by the display's axis ``k``. A determinant that is not positive would be a
    fold.
    """
    place = np.array(place_px, dtype=float)
    along = np.broadcast_to(np.eye(2), (*place.shape, 2))
    for lens in reversed(lenses):
        raised, slope = lens.raised(place)
        way = place - lens.centre_px
        along = along - raised[..., None, None] * along - way[..., None] * (slope[..., None, :] @ along)
        place = place - raised[..., None] * way
    return np.asarray(along)


@lru_cache(maxsize=256)
def sharpest_bend(lens: Lens) -> float:
    """The largest change of the slope of what the lens raises, a texel, over `_BEND` of its radii: by it, bends of all
    lenses are compared (Papadopoulos, Kaufman 2013, section 3.3).
    """
    axis = np.arange(-1, 1 + _BEND, _BEND)
    place = np.stack(np.meshgrid(axis, axis), axis=-1) * lens.radii_px + lens.centre_px
    slope = lens.raised(place)[1]
    step = np.array(lens.radii_px) * _BEND
    bends = [np.linalg.norm(np.diff(slope, axis=1 - axis), axis=-1).max() / step[axis] for axis in range(2)]
    return float(max(bends))


def rows_of(lenses: Sequence[Lens]) -> tuple[Floats, Floats]:
    """Lenses as kernels and shaders read them: one row each, (K, 12), and all heights behind each other, (N,).

    Numbers are the focus (2), one over the radii (2), how far the focus is raised, ``focus``, the drop-off's place in
    `DROP_OFFS`, 0 where the lens is radial, 1 rectangular, 2 a table, of that where it begins, columns and rows; the
    last is free.
    """
    rows, tables, begin = np.zeros((len(lenses), _NUMBERS)), [np.zeros(0)], 0
    for row, lens in zip(rows, lenses, strict=True):
        across, down = lens.radii_px
        kind = 2 if lens.heights is not None else int(lens.shape == "rectangular")
        row[:8] = (
            *lens.centre_px, 1 / across, 1 / down, 1 - 1 / lens.magnification, lens.focus,
            DROP_OFFS.index(lens.drop_off), kind,
        )  # fmt: skip
        if lens.heights is not None:
            row[8:11] = begin, lens.heights.shape[1], lens.heights.shape[0]
            tables.append(lens.heights.ravel())
            begin += lens.heights.size
    return rows, np.concatenate(tables)


def _interpolated(heights: NDArray[np.float64], way: Floats) -> tuple[Floats, Floats]:
    """A table over the square from -1 to 1, by uniform cubic B-splines, and its slope; 0 from the square's edge on."""
    size = np.array([heights.shape[1], heights.shape[0]])
    at = (way + 1) / 2 * (size - 1)
    first = np.floor(at)
    taps = [_cubic(at[..., axis] - first[..., axis]) for axis in range(2)]
    height, slope = np.zeros(way.shape[:-1]), np.zeros(way.shape)
    for down, across in np.ndindex(4, 4):
        row = np.clip(first[..., 1].astype(int) + down - 1, 0, size[1] - 1)
        column = np.clip(first[..., 0].astype(int) + across - 1, 0, size[0] - 1)
        (w, dw), (v, dv) = taps[0][across], taps[1][down]
        height += w * v * heights[row, column]
        slope += np.stack([dw * v, w * dv], axis=-1) * heights[row, column][..., None]
    slope = slope * (size - 1) / 2
    # Toward the edge all heights are let end at 0, by how far out the farther axis is.
    edge, edge_slope = drop_off(np.abs(way).max(axis=-1), TO_RIM, "cosine")
    farther = np.abs(way) >= np.abs(way[..., ::-1])
    return height * edge, slope * edge[..., None] + (height * edge_slope)[..., None] * np.sign(way) * farther


def _cubic(t: Floats) -> list[tuple[Floats, Floats]]:
    """Weights of four knots around a place ``t`` behind the second, and how they change with it."""
    s = 1 - t
    return [
        (s**3 / 6, -(s**2) / 2),
        ((4 - 6 * t**2 + 3 * t**3) / 6, (3 * t**2 - 4 * t) / 2),
        ((4 - 6 * s**2 + 3 * s**3) / 6, (4 * s - 3 * s**2) / 2),
        (t**3 / 6, t**2 / 2),
    ]


TO_RIM = 0.9
"""From there to the rim a table's heights are let end at 0."""

_RAYS, _PLACES = 256, 256


def _check_falls(lens: Lens) -> None:
    """Raises
    ------
    InputError
        If a table makes the sheet come back along a ray from the focus: the lens would fold over.
    """
    assert lens.heights is not None
    if _folds_over(lens.heights.tobytes(), lens.heights.shape, lens.magnification):
        raise InputError(
            "lens: its heights rise again, away from the middle, so that it would fold over: let them fall outward, or "
            "magnify less"
        )


@lru_cache(maxsize=64)
def _folds_over(table: bytes, shape: tuple[int, ...], magnification: float) -> bool:
    """Kept, because the same lens comes with the message of every frame."""
    turn = np.linspace(0, 2 * np.pi, _RAYS, endpoint=False)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    way /= np.abs(way).max(axis=-1, keepdims=True)
    along = np.linspace(0, 1, _PLACES)
    falls, _ = _interpolated(np.frombuffer(table).reshape(shape), along[:, None, None] * way)
    seen = along[:, None] * (1 - (1 - 1 / magnification) * falls)
    return bool((np.diff(seen, axis=0) <= 0).any())
