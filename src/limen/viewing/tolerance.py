"""The largest error that nobody can see, per place: what every selector asks.

The one currency is the visual angle. On a panel an angle becomes a length on its surface
(``distance x tan(angle)``) and, over the pitch, pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.units import arcmin_to_rad
from limen.viewing.viewer import Viewer
from limen.vision.acuity import HUMAN_ARCMIN, SNELLEN_ARCMIN, acuity_from, eccentricity_scale
from limen.vision.motion import motion_scale

__all__ = [
    "COUNTED",
    "GAZE",
    "HEAD_SLACK_DEG",
    "MOTION",
    "POLICIES",
    "STANDS",
    "Policy",
    "Tolerance",
    "ignores_acuity",
    "scheel_px",
    "tolerance_of",
]

POLICIES = ("full", "acuity", "contrast", "scheel", "budget", "size")
"""``full``: the ordinary mip level, whoever looks. ``acuity``: also what distance hides from the viewers.
``contrast``: also what is too faint to be seen there. ``scheel``: what Scheel and others allowed on the panels of a
wall that shows a terrain, see `scheel_px`; for terrains alone. ``budget``: as many triangles or splats as were asked
for, those first whose absence is seen from farthest away. ``size``: as many, the largest first, whatever they show, as
VDSlib does: to be compared with. The last two are for meshes and points."""

COUNTED = ("budget", "size")
"""Policies that spend a number of triangles or splats; in text, it follows a colon (``budget:30000``), or of ``budget``
a frame's time (``budget:12ms``)."""

GAZE = "+gaze"
"""Appended to a policy's name: also what is too far from where the viewers look."""

MOTION = "+motion"
"""Appended to a policy's name: also what glides over the retina too fast. For meshes and points alone: of what is read
from a disk, the rest would come too late for whoever stops."""

STANDS: Floats = np.zeros((3, 4))
"""The motion of what stands still, see `Tolerance`."""

HEAD_SLACK_DEG = 15.0
"""How far eyes turn from where the head points before the head follows (paper 001)."""


@dataclass(frozen=True, slots=True)
class Policy:
    """How detail is chosen.

    Parameters
    ----------
    name
        One of `POLICIES`.
    acuity_arcmin
        The acuity of viewers who bring none of their own; ``full`` and ``scheel`` ignore it.
    gaze
        Whether detail may fall off with the angle from the gaze, or from the head's direction less
        ``head_slack_deg`` where no eye tracker tells the gaze.
    distance_factor
        How many times farther away the viewers are taken to be than they are: 1 is the truth, more is for studies
        that look for the place where an omission becomes visible.
    most_items
        How many triangles or splats a policy of `COUNTED` may spend.
    most_ms
        Or how long a frame of the policy ``budget`` may take: renderers find out how many that are.
    motion
        Whether detail may fall off with the velocity at which it passes an eye that follows it.
    """

    name: Literal["full", "acuity", "contrast", "scheel", "budget", "size"] = "acuity"
    acuity_arcmin: float = HUMAN_ARCMIN
    gaze: bool = False
    distance_factor: float = 1.0
    head_slack_deg: float = HEAD_SLACK_DEG
    most_items: int | None = None
    most_ms: float | None = None
    motion: bool = False

    def __post_init__(self) -> None:
        acuity_from(self.acuity_arcmin)
        if not 0 < self.distance_factor < math.inf:
            raise InputError(f"distance_factor must be a positive number, got {self.distance_factor}")
        if not 0 <= self.head_slack_deg <= 180:
            raise InputError(f"head_slack_deg must be from 0 to 180 degrees, got {self.head_slack_deg}")
        self._check_count()

    def _check_count(self) -> None:
        if self.name not in COUNTED:
            if self.most_items is not None or self.most_ms is not None:
                raise InputError(
                    f"the policy {self.name} spends no number of triangles or splats: take budget for that"
                )
        elif self.most_ms is not None:
            if self.name != "budget" or self.most_items is not None:
                raise InputError("only the policy budget spends a time, and then no number: say budget:12ms")
            if not 0 < self.most_ms < math.inf:
                raise InputError(f"a frame must be let take more than 0 ms, got {self.most_ms:g}")
        elif self.most_items is None:
            raise InputError(f"how many triangles or splats may the policy {self.name} spend? Say {self.name}:30000")
        elif self.most_items < 1:
            raise InputError(f"the policy {self.name} must be let spend at least 1, got {self.most_items}")

    @classmethod
    def parse(cls, text: str, acuity_arcmin: str | float = HUMAN_ARCMIN, most_items: int | None = None) -> Policy:
        """A policy by name, with ``+gaze`` appended or not; ``snellen`` is short for ``acuity`` at one arcminute.

        What `COUNTED` policies may spend follows a colon, or is ``most_items``; of ``budget``, also milliseconds.

        >>> Policy.parse("acuity+gaze", "snellen").label
        "acuity+gaze 1'"
        >>> Policy.parse("budget+gaze:30000").most_items
        30000
        >>> Policy.parse("budget:12.5ms").most_ms
        12.5

        Raises
        ------
        InputError
            If there is no policy of that name, the acuity is impossible, or it is not known what may be spent.
        """
        named, colon, count = text.partition(":")
        base, *more = named.split("+")
        gaze, motion = GAZE[1:] in more, MOTION[1:] in more
        most_ms = None
        if colon:
            most_ms = _milliseconds(count)
            if base not in COUNTED or (most_ms is None and not count.isdecimal()):
                raise InputError(
                    f"'{text}' is no policy: a number follows budget or size alone, as in budget:30000 or budget:12ms"
                )
            most_items = int(count) if most_ms is None else None
        match base:
            case _ if len(more) > gaze + motion:
                pass
            case "budget":
                acuity = acuity_from(acuity_arcmin)
                return cls(base, acuity, gaze, most_items=most_items, most_ms=most_ms, motion=motion)
            case "size" if not more:
                return cls(base, most_items=most_items, most_ms=most_ms)
            case "full" | "scheel" if not more:
                return cls(base)
            case "acuity" | "contrast":
                return cls(base, acuity_from(acuity_arcmin), gaze, motion=motion)
            case "snellen":
                return cls("acuity", SNELLEN_ARCMIN, gaze, motion=motion)
        raise InputError(
            f"no policy is named '{text}': there are {', '.join(POLICIES)} and snellen, "
            f"acuity, contrast, budget and snellen also with {GAZE} or {MOTION} appended"
        )

    @property
    def timeless(self) -> Policy:
        """The policy, where each frame is by itself.

        Raises
        ------
        InputError
            If it spends a time: how much fits one is found from frame to frame.
        """
        if self.most_ms is not None:
            raise InputError(f"the policy {self.title} is for what is shown live: give a number here, as budget:30000")
        return self

    @property
    def eyesight(self) -> Policy:
        """The policy that says what viewers see, where this one spends a number of items by it; else itself."""
        return replace(self, name="contrast", most_items=None, most_ms=None) if self.name in COUNTED else self

    @property
    def title(self) -> str:
        """The name as people type it, without the acuity."""
        spent = f":{self.most_items}" if self.most_ms is None else f":{self.most_ms:g}ms"
        return self.name + GAZE * self.gaze + MOTION * self.motion + (spent if self.name in COUNTED else "")

    @property
    def label(self) -> str:
        return self.title if self.name in ("full", "scheel", "size") else f"{self.title} {self.acuity_arcmin:g}'"


def ignores_acuity(text: str) -> bool:
    """Whether a policy, as people type it, goes by no acuity of the viewers, or says its own.

    >>> [ignores_acuity(text) for text in ("full", "snellen+gaze", "size:300", "acuity+gaze", "budget:300")]
    [True, True, True, False, False]
    """
    return text.partition(":")[0].partition("+")[0] in ("full", "scheel", "size", "snellen")


def _milliseconds(text: str) -> float | None:
    try:
        return float(text.removesuffix("ms")) if text.endswith("ms") else None
    except ValueError:
        return None


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
