"""A tracked person: where the eyes are, where the head points, how sharp the eyes see. And a pointer in the hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from limen.errors import InputError
from limen.geometry import Floats, Vec3, as_vec3, cross, length, normalised

__all__ = ["FASTEST_M_S", "Pointer", "Viewer", "nobody_points"]

FASTEST_M_S = 5.0
"""Whoever is said to move faster jumped: the tracker changed its mind."""

_UP: Vec3 = (0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Viewer:
    """One viewer at one instant, in the room frame.

    Parameters
    ----------
    position_m
        Midpoint between the eyes.
    direction
        Where the head points; any length, stored as a unit vector.
    gaze
        Where the eyes look, if an eye tracker tells; ``None`` if only the head is known.
    acuity_arcmin
        The viewer's own smallest resolvable detail; ``None`` leaves it to the policy.
    time_s
        Time stamp on the session's clock.
    eye_separation_m
        Distance between the eyes; 0 is a single eye at ``position_m``.
    name
        Tells several viewers of one session apart.
    velocity_m_s
        How the viewer moves: what policies with ``+motion`` ask for. Zeros also where that is not known.

    Raises
    ------
    InputError
        For coordinates that are not finite, a zero direction, or an acuity that is not positive.
    """

    position_m: Vec3
    direction: Vec3 = (0.0, 0.0, -1.0)
    gaze: Vec3 | None = None
    acuity_arcmin: float | None = None
    time_s: float = 0.0
    eye_separation_m: float = 0.063
    name: str = ""
    velocity_m_s: Vec3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "position_m", as_vec3(self.position_m, "viewer.position_m"))
            object.__setattr__(self, "velocity_m_s", as_vec3(self.velocity_m_s, "viewer.velocity_m_s"))
            object.__setattr__(self, "direction", _unit(self.direction, "viewer.direction"))
            if self.gaze is not None:
                object.__setattr__(self, "gaze", _unit(self.gaze, "viewer.gaze"))
        except ValueError as error:
            raise InputError(str(error)) from None
        if self.acuity_arcmin is not None and not 0 < self.acuity_arcmin < math.inf:
            raise InputError(f"viewer.acuity_arcmin must be a positive number, got {self.acuity_arcmin}")
        if not 0 <= self.eye_separation_m < 1:
            raise InputError(f"viewer.eye_separation_m must be from 0 to 1 m, got {self.eye_separation_m}")
        if not math.isfinite(self.time_s):
            raise InputError(f"viewer.time_s must be finite, got {self.time_s}")

    @property
    def eyes_m(self) -> Floats:
        """Both eyes, left first: shape (2, 3); (1, 3) if the separation is 0."""
        centre = np.array(self.position_m)
        if self.eye_separation_m == 0:
            return centre[None]
        half = np.array(self._rightward()) * (self.eye_separation_m / 2)
        return np.stack([centre - half, centre + half])

    @property
    def at_rest(self) -> Viewer:
        """The viewer, standing still."""
        return replace(self, velocity_m_s=(0.0, 0.0, 0.0))

    def extrapolated(self, earlier: Viewer, seconds: float) -> Viewer:
        """Where the viewer will be, walking on as since ``earlier``; unmoved where that tells nothing.

        Jumps (more than `FASTEST_M_S`) and pauses of over a second are not walked on.
        """
        elapsed = self.time_s - earlier.time_s
        if not 0 < elapsed <= 1:
            return self
        step = [(here - there) / elapsed for here, there in zip(self.position_m, earlier.position_m, strict=True)]
        if math.hypot(*step) > FASTEST_M_S:
            return self
        x, y, z = (here + speed * seconds for here, speed in zip(self.position_m, step, strict=True))
        return replace(self, position_m=(x, y, z))

    def _rightward(self) -> Vec3:
        across = cross(self.direction, _UP)
        if length(across) < 1e-6:  # looking straight up or down: the head's yaw is unknown
            return (1.0, 0.0, 0.0)
        return normalised(across, "viewer.direction")


@dataclass(frozen=True, slots=True)
class Pointer:
    """A tracked hand-held pointer at one instant, in the room frame: what it points at is wanted in full detail.

    Parameters
    ----------
    position_m
        Where it is held.
    direction
        Where it points; any length, stored as a unit vector.
    time_s
        Time stamp on the session's clock.
    name
        Tells several pointers of one session apart.

    Raises
    ------
    InputError
        For coordinates that are not finite, or a zero direction.
    """

    position_m: Vec3
    direction: Vec3
    time_s: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "position_m", as_vec3(self.position_m, "pointer.position_m"))
            object.__setattr__(self, "direction", _unit(self.direction, "pointer.direction"))
        except ValueError as error:
            raise InputError(str(error)) from None
        if not math.isfinite(self.time_s):
            raise InputError(f"pointer.time_s must be finite, got {self.time_s}")


def _unit(direction: Vec3, what: str) -> Vec3:
    vector = as_vec3(direction, what)
    if not length(vector) < math.inf:
        raise ValueError(f"{what} must not be too long to be measured, got {vector}")
    return normalised(vector, what)


def nobody_points(_time_s: float) -> tuple[Pointer, ...]:
    """No pointer at any time."""
    return ()
