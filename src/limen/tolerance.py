"""The largest error that nobody can see, per place: what every selector asks.

The one currency is the visual angle. On a panel an angle becomes a length on its surface
(``distance x tan(angle)``) and, over the pitch, pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from limen.errors import InputError
from limen.geometry import Floats
from limen.units import arcmin_to_rad
from limen.viewer import Viewer
from limen.vision.acuity import HUMAN_ARCMIN, SNELLEN_ARCMIN, acuity_from

__all__ = ["POLICIES", "Policy", "Tolerance", "tolerance_of"]

POLICIES = ("full", "acuity")
"""``full``: the ordinary mip level, whoever looks. ``acuity``: also what distance hides from the viewers."""


@dataclass(frozen=True, slots=True)
class Policy:
    """How detail is chosen.

    ``acuity_arcmin`` is the acuity of viewers who bring none of their own; ``full`` ignores it.
    """

    name: Literal["full", "acuity"] = "acuity"
    acuity_arcmin: float = HUMAN_ARCMIN

    def __post_init__(self) -> None:
        acuity_from(self.acuity_arcmin)

    @classmethod
    def parse(cls, text: str, acuity_arcmin: str | float = HUMAN_ARCMIN) -> Policy:
        """A policy by name; ``snellen`` is short for ``acuity`` at one arcminute.

        Raises
        ------
        InputError
            If there is no policy of that name or the acuity is impossible.
        """
        match text:
            case "full":
                return cls("full")
            case "acuity":
                return cls("acuity", acuity_from(acuity_arcmin))
            case "snellen":
                return cls("acuity", SNELLEN_ARCMIN)
        raise InputError(f"no policy is named '{text}': there are {', '.join(POLICIES)} and snellen")

    @property
    def label(self) -> str:
        return self.name if self.name == "full" else f"{self.name} {self.acuity_arcmin:g}'"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The largest invisible error at every place of a room, for all viewers together.

    Parameters
    ----------
    eyes_m
        Eye positions, shape (E, 3). Without any eye nothing is tolerated (policy ``full``).
    tan_angle
        Tangent of the angle that stays invisible to each eye, shape (E,).
    """

    eyes_m: Floats
    tan_angle: Floats

    def __post_init__(self) -> None:
        if self.eyes_m.ndim != 2 or self.eyes_m.shape != (len(self.tan_angle), 3):
            raise InputError(f"eyes_m must have shape ({len(self.tan_angle)}, 3), got {self.eyes_m.shape}")
        if not (np.isfinite(self.eyes_m).all() and (self.tan_angle > 0).all()):
            raise InputError("eyes must be finite and their angles positive")

    def allowed_m(self, position_m: Floats) -> Floats:
        """The largest invisible length at places of the room: (..., 3) metres to (...) metres.

        The most demanding eye decides. Oblique viewing is not made use of: a length is taken to be
        seen square on, as Papadopoulos, Kaufman 2013 do, which errs toward detail.
        """
        position_m = np.asarray(position_m, dtype=float)
        if not len(self.tan_angle):
            return np.zeros(position_m.shape[:-1])
        distance = np.linalg.norm(position_m[..., None, :] - self.eyes_m, axis=-1)
        return np.asarray((distance * self.tan_angle).min(axis=-1))

    def allowed_px(self, position_m: Floats, pitch_m: float) -> Floats:
        """The largest invisible error in pixels of a panel: (..., 3) metres to (...) pixels."""
        return self.allowed_m(position_m) / pitch_m


def tolerance_of(viewers: Iterable[Viewer], policy: Policy) -> Tolerance:
    """What the viewers cannot see under a policy; the finest demand wins, place by place."""
    eyes: list[Floats] = []
    tangents: list[float] = []
    if policy.name != "full":
        for viewer in viewers:
            acuity = policy.acuity_arcmin if viewer.acuity_arcmin is None else viewer.acuity_arcmin
            eyes.extend(viewer.eyes_m)
            tangents += [math.tan(arcmin_to_rad(acuity))] * (len(eyes) - len(tangents))
    return Tolerance(np.array(eyes, dtype=float).reshape(-1, 3), np.array(tangents, dtype=float))
