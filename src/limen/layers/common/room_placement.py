"""Where content of the room stands unless its user says, and how it moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats, Vec3, as_vec3
from limen.viewing.arrangement import arrangement_of, facing_of_wall, middle_of_wall
from limen.viewing.placement import InRoom, LookAt, OnShape, OnSurface

__all__ = ["RoomPlacement", "about_middle", "mesh_in_room", "mesh_stand", "motion_of"]

_TURN_DEG_PER_S = 20.0

_STEP_S = 1e-3

_FILLS = 0.8
"""Share of the display that a mesh fills unless told otherwise."""


def mesh_stand(display: Display, size_m: float | None = None) -> tuple[Vec3, float]:
    """Where a mesh stands unless its user says: the place of its middle, and its largest extent, metres.

    Inside an object; just behind a wall, as far as it reaches; in a room, behind the panels that the room opens
    toward (-z, where all look alike). It fills most of the second largest extent of an object or a wall, and of the
    height of a room.

    Parameters
    ----------
    size_m
        Its largest extent, where the user says; a larger one stands farther behind the panels.
    """
    low, high = display.bounds_m
    middle, extents = (low + high) / 2, high - low
    arrangement = arrangement_of(display)
    fitted = float(extents[:2].min()) if arrangement == "room" else float(np.sort(extents)[1])
    size = _FILLS * fitted if size_m is None else size_m
    if arrangement == "wall":
        middle = middle_of_wall(display) - facing_of_wall(display) * size / 2
    elif arrangement == "room":
        middle = middle - np.array([0, 0, extents[2] / 2 + size / 2])
    return as_vec3(middle, "middle"), size


def mesh_in_room(
    bounds: NDArray[np.floating[Any]],
    display: Display,
    *,
    size_m: float | None = None,
    at_m: Vec3 | None = None,
    up: Literal["y", "z"] = "y",
    turn_deg: float = 0.0,
    tilt_deg: float = 0.0,
) -> Floats:
    """Affine map from a mesh's coordinates to the room, metres, shape (4, 4).

    Parameters
    ----------
    bounds
        Smallest and largest coordinates of the mesh, shape (2, 3).
    display
        The whole installation: what a part of it shows must not depend on which part it is.
    size_m
        Its largest extent in the room; by default that of `mesh_stand`.
    at_m
        Place of the middle of its bounds; by default that of `mesh_stand`.
    up
        Which of the mesh's axes points up.
    turn_deg
        Turned about the vertical, counter-clockwise from above.
    tilt_deg
        Then tilted toward who stands before it: at 90 degrees it is seen from above.

    Raises
    ------
    InputError
        If the mesh has no extent, or ``size_m`` is not positive.
    """
    low, high = np.asarray(bounds, dtype=float)
    extent = float((high - low).max())
    if not extent > 0:
        raise InputError("the mesh is a single point: it has no size to be shown at")
    if size_m is not None and not 0 < size_m < math.inf:
        raise InputError(f"a mesh's size must be a positive number of metres, got {size_m}")
    middle, size = mesh_stand(display, size_m)
    frame = np.eye(3) if up == "y" else np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    turn = math.radians(turn_deg)
    about = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    tilt = math.radians(tilt_deg)
    leaning = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
    matrix = np.eye(4)
    matrix[:3, :3] = leaning @ about @ frame * (size / extent)
    matrix[:3, 3] = np.array(middle if at_m is None else at_m) - matrix[:3, :3] @ ((low + high) / 2)
    return matrix


@dataclass(frozen=True, slots=True)
class RoomPlacement:
    """Where content stands in the room, and how it turns there; see `mesh_in_room`.

    Parameters
    ----------
    turning
        Whether it turns about the vertical as time passes, 20 degrees a second.
    matrix
        Where it stands, in place of all else: shape (4, 4).
    """

    size_m: float | None = None
    at_m: Vec3 | None = None
    up: Literal["y", "z"] = "y"
    turn_deg: float = 0.0
    tilt_deg: float = 0.0
    turning: bool = False
    matrix: Floats | None = None

    @classmethod
    def by(cls, placement: Any, noun: str) -> RoomPlacement | None:
        """Content that stands by a (4, 4) matrix, an `InRoom` or another of these; None where nobody says.

        Raises
        ------
        InputError
            If the placement is for other kinds; ``noun`` is what is placed.
        """
        if isinstance(placement, cls | None):
            return placement
        if isinstance(placement, OnSurface | OnShape | LookAt):
            others = "terrains" if isinstance(placement, LookAt) else "images"
            raise InputError(
                f"placements of the kind {type(placement).__name__} are for {others}: {noun} takes a (4, 4) matrix"
            )
        return cls(matrix=(placement if isinstance(placement, InRoom) else InRoom.of(placement)).matrix)

    def at(self, bounds: NDArray[np.floating[Any]], display: Display, time_s: float = 0.0) -> Floats:
        """The map from coordinates within these bounds, (2, 3), to the room at a time: shape (4, 4)."""
        if self.matrix is not None:
            return np.asarray(self.matrix, dtype=float)
        turned = self.turn_deg + (_TURN_DEG_PER_S * time_s if self.turning else 0.0)
        return mesh_in_room(
            bounds, display, size_m=self.size_m, at_m=self.at_m, up=self.up, turn_deg=turned, tilt_deg=self.tilt_deg
        )

    def state(self, bounds: NDArray[np.floating[Any]], display: Display, time_s: float) -> RoomState:
        """Where it stands at a time, and how it moves there."""
        motion = None
        if self.turning and self.matrix is None:
            moving = motion_of(lambda moment_s: self.at(bounds, display, moment_s), time_s)
            motion = tuple(moving.ravel().tolist())
        return RoomState(InRoom.of(self.at(bounds, display, time_s)), motion)


class RoomState(NamedTuple):
    """Where content stands in one frame, and its motion, as a `limen.viewing.state.LayerState` has them."""

    placement: InRoom
    motion: tuple[float, ...] | None


def about_middle(
    room_from_content: Floats, bounds: NDArray[Any], *, yaw_deg: float, pitch_deg: float, nearer: float
) -> Floats:
    """The same place for the middle of what has these bounds, (2, 3), turned and scaled about it: shape (4, 4)."""
    yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
    about_y = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
    middle = np.append(bounds.mean(axis=0), 1.0)
    stood = room_from_content @ middle
    matrix = np.array(room_from_content)
    matrix[:3, :3] = about_x @ about_y @ matrix[:3, :3] / nearer
    matrix[:3, 3] = stood[:3] - matrix[:3, :3] @ middle[:3]
    return matrix


def motion_of(room_from_content: Callable[[float], Floats], time_s: float) -> Floats:
    """How places of the room move, at a time, with what stands by a map (4, 4) of time: (3, 4), see `Tolerance`."""
    here = np.linalg.inv(room_from_content(time_s))
    later, earlier = (room_from_content(time_s + step_s) for step_s in (_STEP_S, -_STEP_S))
    return np.asarray(((later - earlier) @ here / (2 * _STEP_S))[:3])
