"""How a terrain stands behind a display: what lies in the middle, and from where it is looked at.

A terrain is kilometres wide and a display metres. One eye before the display, the reference eye, sees the terrain as a
camera would that looks at the ``target`` from ``range_m`` away, in the direction ``heading_deg`` and ``pitch_deg``
downward (the terms of KML's LookAt). How large the terrain is in the room, changes nothing for that eye; for others it
says how much the picture moves when they do. The target lies `BEHIND` times as far from the reference eye as the
display does, so that the ground before it stays behind the panels too.
"""

from __future__ import annotations

import math
from typing import Literal, Protocol, TypeAlias, get_args

import msgspec
import numpy as np

from limen.data.terrain.model import Nodes, metric_from_posts
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.layers.common.room_placement import mesh_in_room
from limen.viewing.arrangement import arrangement_of, middle_of_wall
from limen.viewing.placement import LookAt

__all__ = ["BEHIND", "FLIGHTS", "Flight", "Land", "check_stands", "fitted_range_m", "in_flight", "room_from_posts"]

BEHIND = 3.0

Flight: TypeAlias = Literal["none", "orbit", "traverse"]
FLIGHTS: tuple[Flight, ...] = get_args(Flight)

_ORBIT_DEG_PER_S = 6.0
_LAP_S = 120.0
"""How long a traverse takes to come back to where it began."""
_LOW_RANGE = 0.12
"""Range of a traverse, in extents of the terrain."""
_LEAST_SLOPE = 0.05
"""Of what is seen to a side of the axis: nothing fits where there is hardly anything."""
_CLEARANCE = 0.08
"""How far above the ground the reference eye stays at least, in ranges."""


class Land(Protocol):
    """What is asked of a terrain here; `limen.Terrain` is one."""

    @property
    def size_posts(self) -> tuple[int, int]: ...
    @property
    def spacing_m(self) -> tuple[float, float]: ...
    @property
    def nodes(self) -> Nodes: ...


def check_stands(display: Display, look: LookAt, flight: Flight) -> None:
    """Raises
    ------
    InputError
        For what is said of a camera where there is none: around an object, the whole terrain stands inside.
    """
    if arrangement_of(display) != "object":
        return
    plain = LookAt()
    idle = [name for name in ("target", "pitch_deg", "range_m") if getattr(look, name) != getattr(plain, name)]
    idle += ["flight traverse"] if flight == "traverse" else []
    if idle:
        raise InputError(
            f"{idle[0]} changes nothing: a terrain stands whole inside '{display.name}', whose panels face outward; "
            "heading_deg and the flight orbit turn it"
        )


def in_flight(look: LookAt, flight: Flight, land: Land, time_s: float) -> LookAt:
    """Where the camera is at a time.

    ``orbit`` turns about the target, a full turn a minute. ``traverse`` flies low along a figure of eight over the
    terrain, heading where it goes.
    """
    if flight == "none":
        return look
    if flight == "orbit":
        return msgspec.structs.replace(look, heading_deg=look.heading_deg + _ORBIT_DEG_PER_S * time_s)
    turn = 2 * math.pi * time_s / _LAP_S
    extent = _extent_m(land)
    x, y = 0.3 * math.sin(turn), 0.3 * math.sin(2 * turn)  # Gerono's figure of eight
    east, south = 0.3 * math.cos(turn) * extent[0], 0.6 * math.cos(2 * turn) * extent[1]
    range_m = look.range_m or _LOW_RANGE * float(extent.max())
    return msgspec.structs.replace(
        look,
        target=(0.5 + x, 0.5 + y),
        heading_deg=look.heading_deg + math.degrees(math.atan2(east, -south)),
        range_m=range_m,
    )


def room_from_posts(land: Land, display: Display, eye_m: Vec3, look: LookAt | None = None) -> Floats:
    """Affine map from (column, row, height in metres) to the room, metres: shape (4, 4).

    Parameters
    ----------
    display
        The whole installation: what a part of it shows must not depend on which part it is.
    eye_m
        The reference eye. Around an object, the terrain stands inside, and there is none.

    Raises
    ------
    InputError
        If the eye is in the middle of the display.
    """
    look = look or LookAt()
    metric = metric_from_posts(land.spacing_m, look.exaggeration)
    if arrangement_of(display) == "object":
        corners = _corners(land) @ metric[:3, :3].T
        bounds = np.array([corners.min(axis=0), corners.max(axis=0)])
        return np.asarray(mesh_in_room(bounds, display, turn_deg=look.heading_deg) @ metric)
    axis, distance_m = _axis(display, eye_m, look.pitch_deg)
    turned = _room_from_metric(axis, look)
    target = _target_m(land, look)
    range_m = look.range_m or fitted_range_m(land, display, eye_m, look)
    rise_m = _rise_m(land, target, turned, axis, range_m, look) if look.range_m else 0.0
    matrix = np.eye(4)
    matrix[:3, :3] = turned * (BEHIND * distance_m / range_m)
    far = axis * BEHIND * distance_m
    matrix[:3, 3] = np.array(eye_m) + far - matrix[:3, :3] @ (target + np.array([0.0, rise_m, 0.0]))
    return np.asarray(matrix @ metric)


def fitted_range_m(land: Land, display: Display, eye_m: Vec3, look: LookAt) -> float:
    """The smallest range from which all of a terrain is seen within the display, metres."""
    corners = _corners(land) @ metric_from_posts(land.spacing_m, look.exaggeration)[:3, :3].T
    axis, _ = _axis(display, eye_m, look.pitch_deg)
    above = _above(axis)
    frame = np.stack([np.cross(axis, above), above, axis])
    ways = (np.concatenate([panel.outline_m for panel in display.panels]) - eye_m) @ frame.T
    ahead = ways[ways[:, 2] > 1e-6]
    from scipy.spatial import ConvexHull  # slow to import, and images have no use for it

    edges = ConvexHull(ahead[:, :2] / ahead[:, 2:]).equations  # a x + b y + c <= 0 inside, of slopes
    box = (corners - _target_m(land, look)) @ _room_from_metric(axis, look).T @ frame.T
    # The same times depth, range + z: a x + b y + c (range + z) <= 0 at every corner, and c < 0 around the axis.
    needed = box @ edges.T / np.maximum(-edges[:, 2], _LEAST_SLOPE)
    return max(float(np.max(needed)), float(np.linalg.norm(np.ptp(corners, axis=0))) * 1e-3)


def _extent_m(land: Land) -> Floats:
    return np.asarray((np.array(land.size_posts) - 1) * np.array(land.spacing_m))


def _corners(land: Land) -> Floats:
    """Corners of the box around all posts, (column, row, height): shape (8, 3)."""
    low, high = _low_high_m(land)
    columns, rows = np.array(land.size_posts) - 1.0
    return np.array(np.meshgrid([0, columns], [0, rows], [low, high])).reshape(3, -1).T


def _low_high_m(land: Land) -> tuple[float, float]:
    roots = land.nodes.low_high_m[: land.nodes.roots]
    return float(roots[:, 0].min()), float(roots[:, 1].max())


def _axis(display: Display, eye_m: Vec3, pitch_deg: float) -> tuple[Floats, float]:
    """The camera's axis in the room, unit (3,), and how far the display is along it.

    To the middle of a wall, whose picture may be tilted; in a room, downward by the pitch from straight ahead (-z), so
    that the ground stays level.
    """
    is_wall = arrangement_of(display) == "wall"
    middle = middle_of_wall(display) if is_wall else np.array([eye_m[0], eye_m[1], display.bounds_m[0][2]])
    way = middle - np.array(eye_m)
    distance_m = float(np.linalg.norm(way))
    if distance_m < 1e-3:
        raise InputError("the reference eye is in the middle of the display: give --viewer another place")
    pitch = math.radians(pitch_deg)
    axis = way / distance_m if is_wall else np.array([0.0, -math.sin(pitch), -math.cos(pitch)])
    return axis, distance_m


def _above(axis: Floats) -> Floats:
    """What is up in the camera's picture: as near to the room's up as can be, unit (3,)."""
    up = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.999 else np.array([0.0, 0.0, -1.0])
    above = up - axis * (up @ axis)
    return np.asarray(above / np.linalg.norm(above))


def _room_from_metric(axis: Floats, look: LookAt) -> Floats:
    """The rotation from metres east, up and south to the room, shape (3, 3)."""
    above = _above(axis)
    right = np.cross(axis, above)
    pitch, heading = math.radians(look.pitch_deg), math.radians(look.heading_deg)
    forward = math.cos(pitch) * axis + math.sin(pitch) * above
    risen = math.cos(pitch) * above - math.sin(pitch) * axis
    east = math.sin(heading) * forward + math.cos(heading) * right
    north = math.cos(heading) * forward - math.sin(heading) * right
    return np.stack([east, risen, -north], axis=1)


def _target_m(land: Land, look: LookAt) -> Floats:
    """The target in metres east, up and south; as high as the ground there."""
    post = np.array(look.target) * (np.array(land.size_posts) - 1)
    low, high = _around(land, post, look.range_m)
    height = (low + high) / 2 * look.exaggeration
    return np.array([post[0] * land.spacing_m[0], height, post[1] * land.spacing_m[1]])


def _around(land: Land, post: Floats, range_m: float | None) -> tuple[float, float]:
    """Lowest and highest post of the smallest node around a place that is no smaller than a tenth of the range."""
    nodes = land.nodes
    low_high = _low_high_m(land)
    smallest = 0.1 * (range_m or math.inf)
    pending = list(range(nodes.roots))
    while pending:
        node = pending.pop()
        first_column, first_row, last_column, last_row = nodes.rect[node]
        if not (first_column <= post[0] <= last_column and first_row <= post[1] <= last_row):
            continue
        if (last_column - first_column) * land.spacing_m[0] < smallest:
            break
        low_high = (float(nodes.low_high_m[node, 0]), float(nodes.low_high_m[node, 1]))
        pending = [int(child) for child in nodes.children[node] if child >= 0]
    return low_high


def _rise_m(land: Land, target: Floats, turned: Floats, axis: Floats, range_m: float, look: LookAt) -> float:
    """How much higher the target has to be for the reference eye not to be under the ground, metres."""
    eye = target - turned.T @ axis * range_m
    columns, rows = np.array(land.size_posts) - 1
    post = np.array([eye[0] / land.spacing_m[0], eye[2] / land.spacing_m[1]])
    if not (0 <= post[0] <= columns and 0 <= post[1] <= rows):
        return 0.0
    _, high = _around(land, post, range_m)
    return max(0.0, high * look.exaggeration + _CLEARANCE * range_m - float(eye[1]))
