"""How content lies: an image on a display's surface or on a shape, a mesh in the room, a terrain before a camera.

On the **surface** every panel shows a rectangle of the image, whoever looks from wherever: the map from
pixels to texels is a scale and an offset per panel. On a **shape** (plane, cylinder, ellipsoid) a pixel shows
what lies behind it on the ray from one eye point, so the map bends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np
from msgspec.structs import force_setattr
from numpy.typing import ArrayLike, NDArray

from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats, Vec3, as_vec3
from limen.viewing.lens import Lens
from limen.viewing.tessellation import Tessellation
from limen.viewing.viewer import Pointer

__all__ = [
    "FITS",
    "InRoom",
    "LookAt",
    "OnShape",
    "OnSurface",
    "PanelMaps",
    "Placement",
    "carried_lenses",
    "one_to_one_size_px",
    "texel_pointed_at",
]

Fit: TypeAlias = Literal["contain", "cover", "one-to-one"]
_EXACT = Tessellation()
FITS: tuple[Fit, ...] = ("contain", "cover", "one-to-one")


class PanelMaps(NamedTuple):
    """Texels of full resolution from pixels, per panel: ``texel = scale * pixel + offset``."""

    scale: Floats  # (P, 2) texels per pixel
    offset: Floats  # (P, 2) texels

    @property
    def mip_level(self) -> NDArray[np.int64]:
        """``floor(log2 A)`` of every panel, shape (P,); negative where texels are larger than pixels.

        ``A`` is the larger side of a pixel's footprint in texels (Heckbert 1983). A thousandth of tolerance keeps
        an image that is shown texel for pixel at level 0 whatever the rounding of metres.
        """
        return np.asarray(np.floor(np.log2(self.footprint) + 1e-3), dtype=np.int64)

    @property
    def footprint(self) -> Floats:
        """``A``: the larger side of every panel's pixels in texels, shape (P,)."""
        return np.asarray(np.abs(self.scale).max(axis=1))


class OnSurface(msgspec.Struct, frozen=True, tag=True, omit_defaults=True):
    """The image on the display's unrolled surface, centred.

    Parameters
    ----------
    fit
        ``contain``: all of the image is shown; ``cover``: all of the surface is filled;
        ``one-to-one``: a texel on a pixel (of the first panel); unless zoomed, exactly on it.
    zoom
        Magnification on top of the fit.
    centre
        The place of the image (0 ... 1 from its left and top edge) that lies in the middle of the surface.
    lenses
        What is looked through, from the image to the eye; see `limen.viewing.lens.Lens`.
    tessellation
        How what is seen through them is drawn.
    carried
        Lenses over these that every pointer carries to where it points, wherever they say that they are.
    """

    fit: Fit = "contain"
    zoom: float = 1.0
    centre: tuple[float, float] = (0.5, 0.5)
    lenses: tuple[Lens, ...] = ()
    tessellation: Tessellation = _EXACT
    carried: tuple[Lens, ...] = ()

    def __post_init__(self) -> None:
        if self.fit not in FITS:
            raise InputError(f"no fit is named '{self.fit}': there are {', '.join(FITS)}")
        if not (0 < self.zoom < math.inf and all(math.isfinite(value) for value in self.centre)):
            raise InputError(f"zoom must be positive and centre finite, got {self.zoom} and {self.centre}")
        for name in ("lenses", "carried"):
            given = getattr(self, name)
            lenses = given if isinstance(given, list | tuple) else (given,)
            if not all(isinstance(lens, Lens) for lens in lenses):
                raise InputError(f"{name} must be of the type limen.Lens, got {given}")
            force_setattr(self, name, tuple(lenses))

    @property
    def bends(self) -> bool:
        """Whether what is seen at a pixel has to be found for every pixel."""
        return bool(self.lenses)

    def carrying(self, display: Display, size_px: tuple[int, int], pointers: Sequence[Pointer]) -> OnSurface:
        """The same with all that pointers carry lying where they point, on a whole display."""
        if not self.carried:
            return self
        carried = carried_lenses(display, self.panel_maps(display, size_px), pointers, self.carried)
        return msgspec.structs.replace(self, lenses=self.lenses + carried, carried=())

    def texels_per_m(self, display: Display, size_px: tuple[int, int]) -> float:
        surface = display.surface
        ratios = (size_px[0] / surface.width, size_px[1] / surface.height)
        match self.fit:
            case "contain":
                density = max(ratios)
            case "cover":
                density = min(ratios)
            case _:
                density = 1 / display.pitch_m
        return density / self.zoom

    def panel_maps(self, display: Display, size_px: tuple[int, int]) -> PanelMaps:
        """Where every panel's pixels lie in an image of ``size_px`` texels."""
        density = self.texels_per_m(display, size_px)
        arrays, surface = display.arrays, display.surface
        middle = np.array([surface.left + surface.width / 2, surface.top + surface.height / 2])
        scale = arrays.pitch_m * density
        offset = (arrays.surface_m - middle) * density + np.array(self.centre) * np.array(size_px)
        if self.fit == "one-to-one" and self.zoom == 1:
            # Between two texels every pixel would be their mean.
            offset += np.round(offset[0]) - offset[0]
        return PanelMaps(scale, offset - scale * arrays.nudge_px)


class OnShape(msgspec.Struct, frozen=True, tag=True, omit_defaults=True):
    """The image on a shape in the room, seen through the panels from one eye point.

    Parameters
    ----------
    kind
        ``plane``: the image spans ``across`` and ``down`` from its top left corner ``origin_m``.
        ``cylinder``: around the axis through ``origin_m`` along ``-down``; ``across`` points at the image's
        middle, its length is the radius; the image's height is the length of ``down``, centred.
        ``ellipsoid``: centred on ``origin_m``; ``across`` is the half axis toward the image's middle, ``down``
        the half axis to its lower edge; the image is equirectangular.
    depth
        The third half axis (cylinder, ellipsoid), toward the image's right; ``None`` for a round shape.
    turn_deg
        How much of the circle the image's width covers (cylinder, ellipsoid).
    eye_m
        The eye point; ``None`` takes the first viewer's.
    """

    kind: Literal["plane", "cylinder", "ellipsoid"]
    origin_m: Vec3
    across: Vec3
    down: Vec3
    depth: Vec3 | None = None
    turn_deg: float = 360.0
    eye_m: Vec3 | None = None

    def __post_init__(self) -> None:
        try:
            for name in ("origin_m", "across", "down", "depth", "eye_m"):
                given = getattr(self, name)
                if given is not None:
                    force_setattr(self, name, as_vec3(given, name))
        except ValueError as error:
            raise InputError(f"placement on a {self.kind}: {error}") from None
        if not 0 < self.turn_deg <= 360:
            raise InputError(
                f"placement on a {self.kind}: turn_deg must lie above 0 and at most at 360, got {self.turn_deg}"
            )
        with np.errstate(all="ignore"):
            volume = abs(float(np.linalg.det(self.frame())))
        if not 1e-12 <= volume < math.inf:
            raise InputError(
                f"placement on a {self.kind}: across, down and depth must not lie in one plane or be too long"
            )

    @property
    def bends(self) -> bool:
        """Whether what is seen at a pixel has to be found for every pixel."""
        return True

    def frame(self) -> Floats:
        """Columns: unit axes of the shape's own frame (x right, y down, z toward the image's middle), shape (3, 3)."""
        across, down = np.array(self.across), np.array(self.down)
        if self.kind == "plane":
            normal = np.cross(across, down)
            return np.stack([across, down, normal / max(float(np.linalg.norm(normal)), 1e-300)], axis=1)
        if self.depth is not None:
            right = np.array(self.depth)
        else:
            right = np.cross(down, across)
            right = right / max(float(np.linalg.norm(right)), 1e-300) * np.linalg.norm(across)
        return np.stack([right, down / (2 if self.kind == "cylinder" else 1), across], axis=1)

    def local_from_room(self) -> Floats:
        """4 x 4 affine map to the shape's own frame, where plane, cylinder and sphere have size one."""
        inverse = np.linalg.inv(self.frame())
        matrix = np.eye(4)
        matrix[:3, :3] = inverse
        matrix[:3, 3] = -inverse @ np.array(self.origin_m)
        return matrix

    def local_eye(self, eye_m: Vec3 | None) -> Floats:
        """The eye point (the shape's own, else ``eye_m``) in the shape's frame, shape (3,).

        Raises
        ------
        InputError
            If there is neither.
        """
        eye = self.eye_m or eye_m
        if eye is None:
            raise InputError(f"an image on a {self.kind} needs an eye point: give the placement's eye_m or a viewer")
        local = self.local_from_room()
        return np.asarray(local[:3, :3] @ np.array(eye) + local[:3, 3])


class InRoom(msgspec.Struct, frozen=True, tag=True):
    """Content that stands in the room.

    Parameters
    ----------
    room_from_content
        Affine map from its coordinates to the room, metres: three rows of four numbers, one after the other.

    Raises
    ------
    InputError
        If these are no twelve finite numbers.
    """

    room_from_content: tuple[float, ...]

    def __post_init__(self) -> None:
        numbers = tuple(float(number) for number in self.room_from_content)
        if len(numbers) != 12 or not all(math.isfinite(number) for number in numbers):
            raise InputError(f"content is placed by finite numbers of the shape (4, 4) or (3, 4), got {numbers}")
        force_setattr(self, "room_from_content", numbers)

    @classmethod
    def of(cls, matrix: ArrayLike) -> InRoom:
        """By a matrix of the shape (4, 4), or (3, 4) without its last row."""
        try:
            rows = np.asarray(matrix, dtype=float)
        except ValueError:  # rows of several lengths
            rows = np.zeros(0)
        if rows.shape not in ((4, 4), (3, 4)):
            raise InputError(f"content is placed by finite numbers of the shape (4, 4) or (3, 4), not {rows.shape}")
        return cls(tuple(rows[:3].ravel().tolist()))

    @property
    def matrix(self) -> Floats:
        """Shape (4, 4)."""
        return np.append(np.reshape(self.room_from_content, (3, 4)), [[0.0, 0.0, 0.0, 1.0]], axis=0)


Placement: TypeAlias = OnSurface | OnShape

_GRAZING = 1e-6
_BEZEL_M = 0.1
"""How far beside a panel a pointer still points at it: across bezels, lenses go on."""


def texel_pointed_at(display: Display, maps: PanelMaps, pointer: Pointer) -> tuple[float, float] | None:
    """The place of an image on the display's surface, without lenses, that a pointer points at; None beside it.

    Of several panels in line the one whose pixels are nearest to the line, and of these the first.
    """
    hand, line = np.array(pointer.position_m), np.array(pointer.direction)
    front = np.flatnonzero(display.normals @ line < -_GRAZING)
    arrays = display.arrays
    origin, normal, pitch = arrays.origin_m[front], display.normals[front], arrays.pitch_m[front]
    away = ((origin - hand) * normal).sum(axis=1) / (normal @ line)
    meets = hand + away[:, None] * line - origin
    axes = np.stack([arrays.right[front], arrays.down[front]], axis=1)
    place = np.einsum("pki,pi->pk", axes, meets) / pitch
    beside_m = np.linalg.norm(np.maximum(np.maximum(-place, place - arrays.size_px[front]), 0) * pitch, axis=1)
    hit = np.flatnonzero((away > 0) & (beside_m <= _BEZEL_M))
    if not len(hit):
        return None
    first = hit[np.lexsort((away[hit], beside_m[hit]))[0]]
    x, y = place[first] * maps.scale[front[first]] + maps.offset[front[first]]
    return float(x), float(y)


def carried_lenses(
    display: Display, maps: PanelMaps, pointers: Sequence[Pointer], lenses: Sequence[Lens]
) -> tuple[Lens, ...]:
    """Lenses, each moved to where each pointer points; none for a pointer that points beside the display."""
    places = [texel_pointed_at(display, maps, pointer) for pointer in pointers]
    return tuple(replace(lens, centre_px=place) for place in places if place is not None for lens in lenses)


def one_to_one_size_px(display: Display) -> tuple[int, int]:
    """Size of the image that covers a display's surface texel for pixel."""
    pitch = display.pitch_m
    surface = display.surface
    return (max(1, round(surface.width / pitch)), max(1, round(surface.height / pitch)))


class LookAt(msgspec.Struct, frozen=True, tag=True, omit_defaults=True):
    """From where a terrain is looked at.

    Parameters
    ----------
    target
        The place in the middle: 0 ... 1 from the terrain's first column and first row.
    heading_deg
        Where the camera looks, clockwise from north (the first row).
    pitch_deg
        How far it looks down: 0 along the ground, 90 straight down.
    range_m
        How far it is from the target; ``None``: just so far that all of the terrain is seen.
    exaggeration
        Heights are multiplied by it.

    Raises
    ------
    InputError
        For numbers that cannot be.
    """

    target: tuple[float, float] = (0.5, 0.5)
    heading_deg: float = 0.0
    pitch_deg: float = 40.0
    range_m: float | None = None
    exaggeration: float = 1.0

    def __post_init__(self) -> None:
        if not all(0 <= part <= 1 for part in self.target):
            raise InputError(f"target must be two numbers from 0 to 1, got {self.target}")
        if not math.isfinite(self.heading_deg):
            raise InputError(f"heading_deg must be finite, got {self.heading_deg}")
        if not 0 <= self.pitch_deg <= 90:
            raise InputError(f"pitch_deg must be from 0 (along the ground) to 90 (straight down), got {self.pitch_deg}")
        if self.range_m is not None and not 0 < self.range_m < math.inf:
            raise InputError(f"range_m must be a positive number of metres, got {self.range_m}")
        if not 0 < self.exaggeration <= 1000:
            raise InputError(f"exaggeration must lie above 0 and at most at 1000, got {self.exaggeration}")
