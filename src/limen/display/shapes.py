"""Shapes that limen makes itself: the displays of the literature, with panels that are exactly flat.

All are closed or open meshes of polygons, in metres around the origin, y up, counter-clockwise as seen from outside.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 4 (which displays, and how many
panels each has).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from limen.display.mesh import PolygonMesh
from limen.display.teapot import teapot
from limen.errors import DisplayError
from limen.geometry import Floats

__all__ = [
    "SHAPES",
    "cylinder",
    "desk",
    "disdyakis_triacontahedron",
    "icosahedron",
    "knot",
    "shape",
    "sphere",
    "spring",
]

_GOLDEN = (1 + math.sqrt(5)) / 2
_Faces = list[tuple[int, ...]]


def shape(name: str, **parameters: float) -> PolygonMesh:
    """One of `SHAPES` by its name; whole numbers may come as floats.

    Raises
    ------
    DisplayError
        If there is no such shape, or it has no such parameter, or cannot be made with its value.
    """
    if name not in SHAPES:
        raise DisplayError(f"no shape is named '{name}': there are {', '.join(sorted(SHAPES))}")
    make = SHAPES[name]
    defaults = dict(make.__kwdefaults__ or {})
    for key, value in parameters.items():
        if key not in defaults:
            known = ", ".join(defaults) or "none"
            raise DisplayError(f"shape '{name}' has no parameter '{key}': it has {known}")
        if isinstance(defaults[key], int) and value != int(value):
            raise DisplayError(f"shape '{name}': {key} must be a whole number, got {value}")
        if not (math.isfinite(value) and value > 0):
            raise DisplayError(f"shape '{name}': {key} must be above 0, got {value}")
        defaults[key] = type(defaults[key])(value)
    return make(**defaults)


def icosahedron(*, radius_m: float = 0.4) -> PolygonMesh:
    """Twenty equal triangles with corners on a sphere."""
    corners, faces = _icosahedron()
    return PolygonMesh(radius_m * corners, tuple(faces), "shape 'icosahedron'")


def disdyakis_triacontahedron(*, radius_m: float = 0.4) -> PolygonMesh:
    """120 equal triangles, six on every face of an icosahedron; the outermost corners lie on a sphere.

    It is the dual of the truncated icosidodecahedron: a corner stands for a face of that solid, a decagon, hexagon or
    square, and lies on the same axis of symmetry at the inverse of its distance (Conway, Burgiel, Goodman-Strauss 2008,
    chapter 21).
    """
    corners, faces = _icosahedron()
    circumradius = math.sqrt(31 + 12 * math.sqrt(5)) / 2  # of the truncated icosidodecahedron with edge 1
    distance = {sides: math.sqrt(circumradius**2 - 0.25 / math.sin(math.pi / sides) ** 2) for sides in (4, 6, 10)}
    found: dict[tuple[int, ...], int] = {}
    points: list[Floats] = []

    def corner(over: tuple[int, ...], sides: int) -> int:
        key = tuple(sorted(over))
        if key not in found:
            found[key] = len(points)
            axis = corners[list(over)].sum(axis=0)
            points.append(axis / np.linalg.norm(axis) * distance[10] / distance[sides])
        return found[key]

    split: _Faces = []
    for face in faces:
        middle = corner(face, 6)
        for a, b in zip(face, (*face[1:], face[0]), strict=True):
            half = corner((a, b), 4)
            split += [(middle, corner((a,), 10), half), (middle, half, corner((b,), 10))]
    return PolygonMesh(radius_m * np.array(points), tuple(split), "shape 'disdyakis-triacontahedron'")


def sphere(*, radius_m: float = 0.45, columns: int = 54, rows: int = 30) -> PolygonMesh:
    """Panels between meridians and parallels, corners on the sphere: 1,620, or 840 with 40 columns and 21 rows."""
    latitude = np.linspace(-math.pi / 2, math.pi / 2, rows + 1)
    profile = radius_m * np.stack([np.cos(latitude), np.sin(latitude)], axis=1)
    profile[[0, -1], 0] = 0
    return _revolved(profile, columns, source="shape 'sphere'")


def cylinder(*, radius_m: float = 0.3, height_m: float = 0.7, columns: int = 24, rows: int = 9) -> PolygonMesh:
    """Upright rectangles on a circle, open at both ends: 216."""
    height = np.linspace(-height_m / 2, height_m / 2, rows + 1)
    profile = np.stack([np.full_like(height, radius_m), height], axis=1)
    return _revolved(profile, columns, source="shape 'cylinder'")


def desk(
    *,
    inner_radius_m: float = 0.3,
    depth_m: float = 0.35,
    bend_m: float = 0.15,
    height_m: float = 0.3,
    columns: int = 48,
    flat_rows: int = 7,
    bend_rows: int = 6,
    back_rows: int = 4,
) -> PolygonMesh:
    """A desk that reaches half around its user: a level top, bent up into an upright back: 816 panels, open.

    Parameters
    ----------
    inner_radius_m
        From the user to the edge of the desk.
    depth_m, bend_m, height_m
        Depth of the level top, radius of the bend, height of the upright back.
    """
    turn = np.linspace(0, math.pi / 2, bend_rows + 1)
    edge = inner_radius_m + depth_m
    flat = np.stack([np.linspace(inner_radius_m, edge, flat_rows + 1), np.zeros(flat_rows + 1)], axis=1)
    bend = np.array([edge, bend_m]) + bend_m * np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    up = np.linspace(bend_m, bend_m + height_m, back_rows + 1)
    back = np.stack([np.full_like(up, edge + bend_m), up], axis=1)
    profile = np.concatenate([flat, bend[1:], back[1:]])
    # The user stands at the axis and sees what a surface of revolution calls its inside.
    return _revolved(profile, columns, arc=math.pi, inside=True, source="shape 'desk'")


def spring(
    *,
    radius_m: float = 0.3,
    height_m: float = 0.8,
    tube_m: float = 0.06,
    turns: int = 5,
    columns: int = 6,
    rows: int = 150,
) -> PolygonMesh:
    """A coil of prisms with mitred joints and a lid at both ends: 902 panels."""
    along = np.linspace(0, 1, rows + 1)
    angle = 2 * math.pi * turns * along
    path = np.stack([radius_m * np.sin(angle), height_m * (along - 0.5), radius_m * np.cos(angle)], axis=1)
    rings = _mitred(path, columns, tube_m, np.array([0.0, 1.0, 0.0]), "shape 'spring'")
    return _tube(rings, closed=False, source="shape 'spring'")


def knot(*, radius_m: float = 0.32, tube_m: float = 0.09, columns: int = 8, rows: int = 150) -> PolygonMesh:
    """A trefoil of prisms with mitred joints, without an end: 1,200 panels.

    Carried once around a closed path of mitres, a ring of corners comes back turned by some angle. The knot's small
    radius, about 0.45 of the large one, is chosen such that this angle is a whole number of corners, for then the last
    ring meets the first, and no panel is twisted.
    """
    from scipy.optimize import brentq

    source, corner = "shape 'knot'", 2 * math.pi / columns

    def path(small: float) -> Floats:
        angle = np.linspace(0, 2 * math.pi, rows, endpoint=False)
        out = 1 + small * np.cos(3 * angle)
        return radius_m * np.stack(
            [out * np.sin(2 * angle), out * np.cos(2 * angle), small * np.sin(3 * angle)], axis=1
        )

    whole = round(_turn_around(path(0.45), source) / corner)

    def mismatch(small: float) -> float:
        return math.remainder(_turn_around(path(small), source) - whole * corner, 2 * math.pi)

    low, high = 0.33, 0.57  # thinner and thicker ones turn by half a circle more or less: room for any whole corner
    if mismatch(low) * mismatch(high) > 0:
        raise DisplayError(f"{source}: cannot be closed with {columns} columns and {rows} rows; try more rows")
    small = float(brentq(mismatch, low, high, xtol=1e-14))
    closed = path(small)
    looped = np.concatenate([closed[-1:], closed, closed[:1]])
    rings = _mitred(looped, columns, tube_m, _ARBITRARY, source)[1:-1]
    return _tube(rings, closed=True, offset=whole, source=source)


# ---------------------------------------------------------------------- how they are made

_ARBITRARY = np.array([0.0, 0.0, 1.0])


def _icosahedron() -> tuple[Floats, _Faces]:
    """Twelve corners on the unit sphere, one of them at the top, and twenty triangles."""
    height, ring = 1 / math.sqrt(5), 2 / math.sqrt(5)
    angle = 2 * math.pi / 5 * np.arange(5)
    above = np.stack([ring * np.sin(angle), np.full(5, height), ring * np.cos(angle)], axis=1)
    corners = np.concatenate([[[0.0, 1.0, 0.0]], above, -above, [[0.0, -1.0, 0.0]]])
    faces: _Faces = []
    for k in range(5):
        a, b = 1 + k, 1 + (k + 1) % 5  # neighbours on the upper ring
        below, beside = 6 + (k + 3) % 5, 6 + (k + 4) % 5  # on the lower ring: below the edge, and to its right
        faces += [(0, a, b), (b, a, below), (below, beside, b), (11, beside, below)]
    return corners, faces


def _revolved(
    profile: Floats, columns: int, *, arc: float = 2 * math.pi, inside: bool = False, source: str
) -> PolygonMesh:
    """A surface of revolution around y as plane trapezoids, triangles where it meets the axis.

    Parameters
    ----------
    profile
        Distance from the axis and height, from the bottom up, shape (N, 2).
    arc
        How far around, centred on -z.
    """
    around = arc >= 2 * math.pi
    if columns < (3 if around else 1):
        raise DisplayError(f"{source}: needs at least {3 if around else 1} columns, got {columns}")
    count = columns if around else columns + 1
    angle = arc * (np.arange(count) / columns - 0.5) + math.pi
    corners: list[Floats] = []
    rings: list[list[int]] = []
    for distance, height in profile:
        points = np.stack([distance * np.sin(angle), np.full(count, height), distance * np.cos(angle)], axis=1)
        points = points[: 1 if distance == 0 else count]
        rings.append([len(corners) + k % len(points) for k in range(columns + 1)])
        corners += list(points)
    faces: _Faces = []
    for lower, upper in pairwise(rings):
        for k in range(columns):
            loop = tuple(dict.fromkeys((lower[k], lower[k + 1], upper[k + 1], upper[k])))
            faces.append(loop[::-1] if inside else loop)
    return PolygonMesh(np.array(corners), tuple(faces), source)


def _mitred(path: Floats, columns: int, radius: float, guide: Floats, source: str) -> Floats:
    """Rings of corners on the mitre planes of a polyline, shape (N, columns, 3): sides between two rings are plane.

    Prisms meet on the plane that halves their angle; a prism mirrored by that plane is its neighbour, so the section
    stays a regular polygon all the way (the double reflection of Wang, Jüttler, Zheng, Liu 2008).
    """
    steps = np.diff(path, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    if not (steps[1:] * steps[:-1]).sum(axis=1).min(initial=1.0) > 0:
        raise DisplayError(f"{source}: bends by more than a right angle from one row to the next; give it more rows")
    side = np.cross(steps[0], guide)
    side /= np.linalg.norm(side)
    angle = 2 * math.pi * np.arange(columns) / columns
    section = radius * (np.outer(np.cos(angle), side) + np.outer(np.sin(angle), np.cross(steps[0], side)))
    rings = [path[0] + section]
    for place, before, after in zip(path[1:], steps, [*steps[1:], steps[-1]], strict=True):
        plane = before + after
        # Every corner goes on along its prism's edge until it meets the mitre plane.
        ahead = (place - rings[-1]) @ plane / (before @ plane)
        rings.append(rings[-1] + np.outer(ahead, before))
    return np.array(rings)


def _turn_around(path: Floats, source: str) -> float:
    """The angle by which a ring comes back turned after one way around a closed polyline, radians, -pi to pi."""
    looped = np.concatenate([path[-1:], path, path[:2]])
    rings = _mitred(looped, 1, 1e-3, _ARBITRARY, source)
    axis = looped[2] - looped[1]
    axis = axis / np.linalg.norm(axis)
    start, end = (ring[0] - place for ring, place in zip(rings[[1, -2]], looped[[1, -2]], strict=True))
    start, end = start - (start @ axis) * axis, end - (end @ axis) * axis
    return math.atan2(float(np.cross(start, end) @ axis), float(start @ end))


def _tube(rings: Floats, *, closed: bool, offset: int = 0, source: str) -> PolygonMesh:
    """Quadrilaterals between rings of corners, and a lid at both ends where the tube does not close.

    ``offset`` is by how many corners the ring after the last is turned against the first.
    """
    count, columns = rings.shape[:2]
    if columns < 3:
        raise DisplayError(f"{source}: needs at least 3 columns, got {columns}")
    index = np.arange(count * columns).reshape(count, columns)
    loops = list(index)
    if closed:
        loops.append(np.roll(index[0], -offset))
    faces: _Faces = [
        (int(a[k]), int(a[(k + 1) % columns]), int(b[(k + 1) % columns]), int(b[k]))
        for a, b in pairwise(loops)
        for k in range(columns)
    ]
    if not closed:
        faces += [tuple(index[0, ::-1].tolist()), tuple(index[-1].tolist())]
    return PolygonMesh(rings.reshape(-1, 3), tuple(faces), source)


SHAPES: dict[str, Callable[..., PolygonMesh]] = {
    "cylinder": cylinder,
    "desk": desk,
    "disdyakis-triacontahedron": disdyakis_triacontahedron,
    "icosahedron": icosahedron,
    "knot": knot,
    "sphere": sphere,
    "spring": spring,
    "teapot": teapot,
}
"""All shapes by the name that display files use."""
