"""The largest error that nobody can see, per place: what every selector asks.

The one currency is the visual angle. On a panel an angle becomes a length on its surface
(``distance x tan(angle)``) and, over the pitch, pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.units import arcmin_to_rad
from limen.viewing.policy import COUNTED, MOTION, Policy
from limen.viewing.viewer import Viewer
from limen.vision.acuity import eccentricity_scale
from limen.vision.motion import motion_scale

__all__ = ["STANDS", "Tolerance", "scheel_px", "tolerance_of"]


STANDS: Floats = np.zeros((3, 4))
"""The motion of what stands still, see `Tolerance`."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The largest invisible error at every place of a room, for all viewers together.

    Whether an eye is in front of a panel or behind it is not asked: from behind, the same is allowed as from the
    same distance in front, which errs toward detail.

    Parameters
    ----------
    eyes_m
        Eye positions, shape (E, 3). Without any eye nothing is tolerated (policy ``full``).
    tan_angle
        Tangent of the angle that stays invisible to each eye where it looks, shape (E,).
    gaze
        Unit vectors along which the eyes look, shape (E, 3); zeros where that is unknown, or not to be made use of.
    slack_deg
        How far from ``gaze`` the eye may really look, shape (E,).
    motion
        How places move past each eye, shape (E, 3, 4): a place (x, y, z, 1) of the room by so many m/s; zeros where
        that is unknown, or not to be made use of.
    """

    eyes_m: Floats
    tan_angle: Floats
    gaze: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    slack_deg: Floats = field(default_factory=lambda: np.zeros(0))
    motion: Floats = field(default_factory=lambda: np.zeros((0, 3, 4)))

    def __post_init__(self) -> None:
        eyes = len(self.tan_angle)
        if not len(self.gaze):
            object.__setattr__(self, "gaze", np.zeros((eyes, 3)))
        if not len(self.slack_deg):
            object.__setattr__(self, "slack_deg", np.zeros(eyes))
        if not len(self.motion):
            object.__setattr__(self, "motion", np.zeros((eyes, 3, 4)))
        if self.motion.shape != (eyes, 3, 4) or not np.isfinite(self.motion).all():
            raise InputError(f"motion must be finite numbers of the shape ({eyes}, 3, 4) for {eyes} eyes")
        if self.eyes_m.shape != (eyes, 3) or self.gaze.shape != (eyes, 3) or self.slack_deg.shape != (eyes,):
            raise InputError(f"eyes_m and gaze must have shape ({eyes}, 3) and slack_deg ({eyes},) for {eyes} eyes")
        if not (np.isfinite(self.eyes_m).all() and np.isfinite(self.gaze).all() and (self.tan_angle > 0).all()):
            raise InputError("eyes and gazes must be finite and their angles positive")

    def allowed_m(self, position_m: Floats, along: Floats | None = None) -> Floats:
        """The largest invisible length at places of the room: (..., 3) metres to (...) metres.

        The most demanding eye decides. A length is taken to be seen square on, as Papadopoulos, Kaufman 2013 do,
        unless ``along`` tells how it lies: unit vectors of shape (..., 3). Seen obliquely it may be longer, by one over
        the sine of the angle between it and the line of sight. Images, whose texels are as wide as they are high, can
        make no use of that: across the slant they are seen square on from everywhere.
        """
        position_m = np.asarray(position_m, dtype=float)
        if not len(self.tan_angle):
            return np.zeros(position_m.shape[:-1])
        sight = position_m[..., None, :] - self.eyes_m
        distance = np.linalg.norm(sight, axis=-1)
        farther = np.ones(distance.shape)
        allowed = distance * self.tan_angle
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.gaze.any():
                ahead = np.clip((sight * self.gaze).sum(axis=-1) / distance, -1, 1)
                beside = np.degrees(np.arccos(ahead)) - self.slack_deg
                known = self.gaze.any(axis=-1) & (distance > 0)
                farther = np.where(known, eccentricity_scale(np.maximum(beside, 0)), 1.0)
                allowed = allowed * farther
            if self.motion.any():
                speed = np.where(distance > 0, self._speed_deg_s(position_m, sight), 0.0)
                allowed = allowed * motion_scale(speed, farther)
            if along is not None:
                cosine = (sight * np.asarray(along, dtype=float)[..., None, :]).sum(axis=-1) / distance
                sine = np.sqrt(np.maximum(1 - np.square(cosine), 0))
                allowed = np.where(distance > 0, allowed / sine, 0.0)
        return np.asarray(allowed.min(axis=-1))

    def _speed_deg_s(self, position_m: Floats, sight: Floats) -> Floats:
        """How fast places pass each eye, across the line of sight: (..., 3) and (..., E, 3) to (..., E)."""
        moves = np.einsum("eik,...k->...ei", self.motion[..., :3], position_m) + self.motion[..., 3]
        across = np.cross(sight, moves)
        return np.asarray(np.degrees(np.linalg.norm(across, axis=-1) / np.square(sight).sum(axis=-1)))

    def allowed_px(self, position_m: Floats, pitch_m: float) -> Floats:
        """The largest invisible error in pixels of a panel: (..., 3) metres to (...) pixels."""
        return self.allowed_m(position_m) / pitch_m


def tolerance_of(viewers: Iterable[Viewer], policy: Policy, moves: Floats | None = None) -> Tolerance:
    """What the viewers cannot see under a policy; the finest demand wins, place by place.

    Parameters
    ----------
    moves
        How places of the room move with what is shown, (3, 4), see `Tolerance`; `STANDS` if they do not.

    Raises
    ------
    InputError
        For the policy ``scheel``, which knows panels and no places: see `limen.viewing.panel_demands.panel_demands`;
        for those of `COUNTED`, of which whoever can spend items asks for the `Policy.eyesight`; and for those with
        `MOTION` where it is not told what ``moves``.
    """
    if policy.name == "scheel":
        raise InputError("the policy scheel gives panels of a terrain one error each: take acuity for anything else")
    if policy.name in COUNTED:
        raise InputError(
            f"the policy {policy.name} spends triangles of a mesh or splats of a cloud: images and terrains take full, "
            "acuity or contrast"
        )
    if policy.motion and moves is None:
        raise InputError(
            f"the policy {policy.title} is for meshes and points: pages of images and terrains would come too late for "
            f"whoever stops; leave out {MOTION}"
        )
    rows: list[Floats] = []
    if policy.name != "full":
        for viewer in viewers:
            acuity = policy.acuity_arcmin if viewer.acuity_arcmin is None else viewer.acuity_arcmin
            tangent = math.tan(arcmin_to_rad(acuity)) * policy.distance_factor
            look = np.zeros(3) if not policy.gaze else np.array(viewer.gaze or viewer.direction)
            slack = policy.head_slack_deg if viewer.gaze is None else 0.0
            motion = np.zeros((3, 4))
            if policy.motion and moves is not None:
                motion = moves.copy()
                motion[:, 3] -= viewer.velocity_m_s
            rows += [np.concatenate([eye, [tangent], look, [slack], motion.ravel()]) for eye in viewer.eyes_m]
    table = np.array(rows, dtype=float).reshape(-1, 20)
    parts = (table[:, :3], table[:, 3], table[:, 4:7], table[:, 7], table[:, 8:].reshape(-1, 3, 4))
    return Tolerance(*(part.copy() for part in parts))


def scheel_px(distance_m: ArrayLike, angle_deg: ArrayLike, pixel_height_m: ArrayLike) -> Floats:
    """The error in pixels that Scheel and others allow a panel: 1 arcmin where it is looked at, 11 at 60 degrees.

    ``theta = (1 + 20 (1 - cos alpha)) / 60`` degrees and ``rho = 2 d tan(theta / 2) / h``. The arrays are broadcast.

    Parameters
    ----------
    distance_m
        From the eye to the panel.
    angle_deg
        Between the line of sight and the way to the panel.
    pixel_height_m
        Of the panel.

    References
    ----------
    Scheel, Löffler, Lehmann, Schumann, Staadt 2014, *Dynamic Level of Detail for Tiled Large High-Resolution
    Displays*, equations 3 and 4.

    >>> scheel_px(3.0, [0.0, 60.0], 0.000303).round(2).tolist()
    [2.88, 31.68]
    """
    angle = np.radians(np.asarray(angle_deg, dtype=float))
    theta = np.radians((1 + (1 - np.cos(angle)) * 20) / 60)
    return np.asarray(2 * np.asarray(distance_m, dtype=float) * np.tan(theta / 2) / pixel_height_m)
