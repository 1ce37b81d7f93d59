"""From a mesh of plane polygons to panels: one panel a face, or several where a face is not convex."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.display.panel import Panel
from limen.display.polygons import STRAIGHT, are_outlines, convex_parts, flattened
from limen.errors import DisplayError
from limen.geometry import Floats

__all__ = ["PolygonMesh", "panels_of_mesh", "room_from_mesh"]

_UP = np.array([0.0, 1.0, 0.0])
_FAR = np.array([0.0, 0.0, -1.0])
"""Where the top of a panel that lies flat points: away from a viewer who looks along the room's -z."""

_AS_SMALL = 1.02
"""Bounding rectangles that are less than this larger than the smallest count as equally small."""


@dataclass(frozen=True, slots=True, eq=False)
class PolygonMesh:
    """Polygons that share corners; counter-clockwise as seen from outside.

    Parameters
    ----------
    corners
        Shape (V, 3), in the mesh's own unit and axes.
    faces
        Indices of each face's corners.
    source
        What errors call it: a file, or a shape.

    Raises
    ------
    DisplayError
        If there is no face, or one has fewer than three corners, a corner that does not exist, or one that is not
        finite.
    """

    corners: Floats
    faces: tuple[tuple[int, ...], ...]
    source: str = "mesh"

    def __post_init__(self) -> None:
        if not self.faces:
            raise DisplayError(f"{self.source}: there are no faces; a display's panels are a mesh's faces")
        finite: list[bool] = np.all(np.isfinite(self.corners), axis=1).tolist()
        for number, face in enumerate(self.faces):
            if len(face) < 3:
                raise DisplayError(
                    f"{self.source}: face {number} has {len(face)} corners, and a panel needs three: remove it"
                )
            for index in face:
                if not 0 <= index < len(self.corners):
                    raise DisplayError(
                        f"{self.source}: face {number} names corner {index} of {len(self.corners)}: mend the mesh"
                    )
                if not finite[index]:
                    raise DisplayError(
                        f"{self.source}: face {number} has a corner ({index}) that is not finite: mend the mesh"
                    )

    @property
    def bounds(self) -> Floats:
        """Smallest and largest coordinates of the corners that faces use, shape (2, 3)."""
        used = self.corners[np.unique(np.concatenate([np.array(face) for face in self.faces]))]
        return np.stack([used.min(axis=0), used.max(axis=0)])


def room_from_mesh(
    mesh: PolygonMesh,
    *,
    scale: float = 1.0,
    up: Sequence[float] = (0.0, 1.0, 0.0),
    centre_m: Sequence[float] | None = None,
) -> PolygonMesh:
    """A mesh in the room: scaled, turned so that ``up`` is the room's y, its middle moved to ``centre_m``.

    Parameters
    ----------
    scale
        Metres per unit of the mesh.
    up
        The mesh's upward direction; (0, 0, 1) where z points up.
    centre_m
        Where the middle of its bounding box goes; ``None`` leaves it where it is.

    Raises
    ------
    DisplayError
        If ``up`` has no length.
    """
    direction = np.array(up, dtype=float)
    size = float(np.linalg.norm(direction))
    if not (math.isfinite(size) and size > 0):
        raise DisplayError(f"up must be a direction, got {list(up)}; [0, 0, 1] where z points up")
    placed = PolygonMesh(scale * mesh.corners @ _turn_to_up(direction / size).T, mesh.faces, mesh.source)
    if centre_m is None:
        return placed
    moved = placed.corners - placed.bounds.mean(axis=0) + np.array(centre_m, dtype=float)
    return PolygonMesh(moved, mesh.faces, mesh.source)


def panels_of_mesh(
    mesh: PolygonMesh,
    name: str,
    pitch_m: float,
    *,
    inward: bool = False,
    bezel_m: float = 0.0,
    surface_left_m: float = 0.0,
    **fields: Any,
) -> list[Panel]:
    """A panel for every face, named ``name/face``; parts of a face that had to be split are ``name/face.part``.

    A panel's rows run along or across that edge of its polygon that needs the fewest pixels; among edges that need as
    few, such that its columns hang down the most. A triangle's rows run along its longest edge.

    Parameters
    ----------
    mesh
        In metres, in the room; open or closed.
    pitch_m
        From one pixel to the next.
    inward
        The panels are looked at from the other side than their winding says.
    bezel_m
        Width of the frame inside of every face, by which its lit polygon is smaller.
    surface_left_m
        Where the mesh begins on the unrolled surface. It is unrolled like the label of a can: around the vertical
        through its middle.
    fields
        Those of `Panel` that are the same for all faces.

    Raises
    ------
    DisplayError
        If a face cannot be a panel; the message names mesh and face.
    """
    can = _Can.around(mesh.bounds, surface_left_m)
    panels: dict[tuple[int, int], Panel] = {}

    def add(keys: list[tuple[int, int]], names: list[str], outlines: _Faces) -> None:
        if bezel_m > 0:
            outlines = outlines.inset(bezel_m, lambda row: f"{mesh.source}: panel '{names[row]}'")
        fitted = _fitted(outlines, pitch_m)
        surface = can.places(outlines.corners.mean(axis=1), outlines.normal) - fitted.middle_m
        for row, (key, full_name) in enumerate(zip(keys, names, strict=True)):
            panels[key] = fitted.panel(row, name=full_name, surface_m=_pair(surface[row]), bezel_m=bezel_m, **fields)

    for numbers, corners in _by_size(mesh):

        def what(row: int, numbers: list[int] = numbers) -> str:
            return f"{mesh.source}: face {numbers[row]}"

        flat, normal = flattened(corners, what)
        faces = _Faces(flat[:, ::-1], -normal) if inward else _Faces(flat, normal)
        plane = faces.plane()
        whole = are_outlines(plane)
        kept = [numbers[row] for row in np.flatnonzero(whole)]
        if kept:
            add([(number, 0) for number in kept], [f"{name}/{number}" for number in kept], faces.rows(whole))
        for row in np.flatnonzero(~whole).tolist():
            parts = convex_parts(plane[row], what(row))
            for part, indices in enumerate(parts):
                full_name = f"{name}/{numbers[row]}" + (f".{part}" if len(parts) > 1 else "")
                add([(numbers[row], part)], [full_name], _Faces(faces.corners[[row]][:, indices], faces.normal[[row]]))
    return [panels[key] for key in sorted(panels)]


def _by_size(mesh: PolygonMesh) -> Iterator[tuple[list[int], Floats]]:
    """Faces of equally many corners together: their numbers, and their corners of shape (F, K, 3)."""
    numbers: dict[int, list[int]] = {}
    for number, face in enumerate(mesh.faces):
        numbers.setdefault(len(face), []).append(number)
    for same in numbers.values():
        yield same, mesh.corners[np.array([mesh.faces[number] for number in same])]


@dataclass(frozen=True, slots=True)
class _Faces:
    """Plane faces of equally many corners."""

    corners: Floats  # (F, K, 3)
    normal: Floats  # (F, 3), unit

    def rows(self, chosen: NDArray[np.bool_]) -> _Faces:
        return _Faces(self.corners[chosen], self.normal[chosen])

    def upright(self) -> Floats:
        """Right and down of panels that hang as upright as their planes allow, shape (F, 2, 3)."""
        guide = np.where(np.abs(self.normal[:, 1:2]) < 0.999, _UP, _FAR)
        right = np.cross(guide, self.normal)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        return np.stack([right, np.cross(right, self.normal)], axis=1)

    def inset(self, width_m: float, name: Callable[[int], str]) -> _Faces:
        """Convex faces made smaller by a frame: every edge moved inward, every corner where two edges then meet."""
        edges = np.roll(self.corners, -1, axis=1) - self.corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        before = np.roll(edges, 1, axis=1)
        # Both edges at a corner are moved by as much, so the corner moves along their bisector.
        slant = (np.cross(before, edges) * self.normal[:, None]).sum(axis=2, keepdims=True)
        corners = self.corners + width_m * (edges - before) / slant
        left = ((np.roll(corners, -1, axis=1) - corners) * edges).sum(axis=2).min(axis=1)
        too_small = left <= STRAIGHT
        if too_small.any():
            raise DisplayError(
                f"{name(int(np.argmax(too_small)))} has no lit area left inside a frame of {width_m * 1000:g} mm: "
                "make bezel_mm smaller"
            )
        return _Faces(corners, self.normal)

    def plane(self) -> Floats:
        """The corners in that frame, shape (F, K, 2)."""
        return np.asarray(self.corners @ self.upright().transpose(0, 2, 1))


@dataclass(frozen=True, slots=True)
class _Fitted:
    """The smallest pixel grids around polygons."""

    pitch_m: float
    frame: Floats  # (F, 2, 3): right and down
    origin_m: Floats  # (F, 3)
    outline_px: Floats  # (F, K, 2)
    middle_m: Floats  # (F, 2), of the corners, from the origin along the frame

    def panel(self, row: int, **fields: Any) -> Panel:
        # A grid that ends within a thousandth of a pixel of the polygon needs no further pixel.
        width, height = np.maximum(np.ceil(self.outline_px[row].max(axis=0) - 1e-3), 1).astype(int).tolist()
        right, down = self.frame[row].tolist()
        return Panel(
            size_px=(width, height),
            origin_m=tuple(self.origin_m[row].tolist()),
            right=tuple(right),
            down=tuple(down),
            pitch_m=(self.pitch_m, self.pitch_m),
            outline_px=tuple(map(tuple, self.outline_px[row].tolist())),
            **fields,
        )


def _fitted(faces: _Faces, pitch_m: float) -> _Fitted:
    """Pixel grids around convex polygons, with rows along one of their edges.

    The smallest rectangle around a convex polygon has a side along one of its edges (Freeman, Shapira 1975).
    """
    upright, plane = faces.upright(), faces.plane()
    edges = np.roll(plane, -1, axis=1) - plane
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    # A rectangle can stand on an edge in four ways. The first axis of each, in the upright frame; the second is a
    # quarter turn clockwise from it.
    turned = edges[:, :, ::-1] * [-1, 1]
    ways = np.concatenate([edges, -edges, turned, -turned], axis=1)
    extents = [np.ptp(plane @ axis.transpose(0, 2, 1), axis=1) for axis in (ways, ways[:, :, ::-1] * [-1, 1])]
    area = extents[0] * extents[1]
    small = area <= _AS_SMALL * area.min(axis=1, keepdims=True)
    # A triangle's rectangles are all as small: on its longest edge it is lowest, and such pack best.
    lowest = np.round(extents[0] / pitch_m) if faces.corners.shape[1] == 3 else 0.0
    best = np.argmax(np.where(small, lowest + ways[:, :, 0], -np.inf), axis=1)
    x, y = ways[np.arange(len(best)), best].T
    frame = np.stack([np.stack([x, y], axis=1), np.stack([-y, x], axis=1)], axis=1) @ upright
    middle = faces.corners.mean(axis=1)
    local = (faces.corners - middle[:, None]) @ frame.transpose(0, 2, 1)
    low = local.min(axis=1)
    origin = middle + (low[:, None] @ frame)[:, 0]
    return _Fitted(pitch_m, frame, origin, (local - low[:, None]) / pitch_m, -low)


@dataclass(frozen=True, slots=True)
class _Can:
    """The cylinder around a mesh, whose unrolled label is the mesh's place on the display's surface."""

    centre_m: Floats
    radius_m: float
    left_m: float

    @classmethod
    def around(cls, bounds_m: Floats, left_m: float) -> _Can:
        low, high = bounds_m
        return cls((low + high) / 2, max(float((high - low)[[0, 2]].mean()) / 2, 1e-3), left_m)

    def places(self, positions_m: Floats, normals: Floats) -> Floats:
        """Where positions lie on the unrolled surface, shape (F, 2), as seen from where the normals point."""
        x, y, z = (positions_m - self.centre_m).T
        inside = x * normals[:, 0] + z * normals[:, 2] < 0
        turn = np.arctan2(x, z) * np.where(inside, -1, 1)
        return np.stack([self.left_m + self.radius_m * (math.pi + turn), -y], axis=1)


def _pair(values: Floats) -> tuple[float, float]:
    return (float(values[0]), float(values[1]))


def _turn_to_up(up: Floats) -> Floats:
    """The smallest rotation, shape (3, 3), that takes a unit vector to the room's y (Rodrigues)."""
    axis, cosine = np.cross(up, _UP), float(up @ _UP)
    sine2 = float(axis @ axis)
    if cosine < 0 and sine2 < 1e-24:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # 1 / (1 + cosine), which near -1 has no digits left.
    share = 1 / (1 + cosine) if cosine >= 0 else (1 - cosine) / sine2
    return np.asarray(np.eye(3) + skew + share * skew @ skew)
