"""How viewers decide about detail: policies, by the names that people type."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from limen.errors import InputError
from limen.vision.acuity import HUMAN_ARCMIN, SNELLEN_ARCMIN, acuity_from

__all__ = ["COUNTED", "GAZE", "HEAD_SLACK_DEG", "MOTION", "POLICIES", "Policy", "ignores_acuity"]

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
    max_items
        How many triangles or splats a policy of `COUNTED` may spend.
    max_ms
        Or how long a frame of the policy ``budget`` may take: renderers find out how many that are.
    motion
        Whether detail may fall off with the velocity at which it passes an eye that follows it.
    """

    name: Literal["full", "acuity", "contrast", "scheel", "budget", "size"] = "acuity"
    acuity_arcmin: float = HUMAN_ARCMIN
    gaze: bool = False
    distance_factor: float = 1.0
    head_slack_deg: float = HEAD_SLACK_DEG
    max_items: int | None = None
    max_ms: float | None = None
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
            if self.max_items is not None or self.max_ms is not None:
                raise InputError(
                    f"the policy {self.name} spends no number of triangles or splats: take budget for that"
                )
        elif self.max_ms is not None:
            if self.name != "budget" or self.max_items is not None:
                raise InputError("only the policy budget spends a time, and then no number: say budget:12ms")
            if not 0 < self.max_ms < math.inf:
                raise InputError(f"a frame must be let take more than 0 ms, got {self.max_ms:g}")
        elif self.max_items is None:
            raise InputError(f"how many triangles or splats may the policy {self.name} spend? Say {self.name}:30000")
        elif self.max_items < 1:
            raise InputError(f"the policy {self.name} must be let spend at least 1, got {self.max_items}")

    @classmethod
    def parse(cls, text: str, acuity_arcmin: str | float = HUMAN_ARCMIN, max_items: int | None = None) -> Policy:
        """A policy by name, with ``+gaze`` appended or not; ``snellen`` is short for ``acuity`` at one arcminute.

        What `COUNTED` policies may spend follows a colon, or is ``max_items``; of ``budget``, also milliseconds.

        >>> Policy.parse("acuity+gaze", "snellen").label
        "acuity+gaze 1'"
        >>> Policy.parse("budget+gaze:30000").max_items
        30000
        >>> Policy.parse("budget:12.5ms").max_ms
        12.5

        Raises
        ------
        InputError
            If there is no policy of that name, the acuity is impossible, or it is not known what may be spent.
        """
        named, colon, count = text.partition(":")
        base, *more = named.split("+")
        gaze, motion = GAZE[1:] in more, MOTION[1:] in more
        max_ms = None
        if colon:
            max_ms = _milliseconds(count)
            if base not in COUNTED or (max_ms is None and not count.isdecimal()):
                raise InputError(
                    f"'{text}' is no policy: a number follows budget or size alone, as in budget:30000 or budget:12ms"
                )
            max_items = int(count) if max_ms is None else None
        match base:
            case _ if len(more) > gaze + motion:
                pass
            case "budget":
                acuity = acuity_from(acuity_arcmin)
                return cls(base, acuity, gaze, max_items=max_items, max_ms=max_ms, motion=motion)
            case "size" if not more:
                return cls(base, max_items=max_items, max_ms=max_ms)
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
        if self.max_ms is not None:
            raise InputError(f"the policy {self.title} is for what is shown live: give a number here, as budget:30000")
        return self

    @property
    def eyesight(self) -> Policy:
        """The policy that says what viewers see, where this one spends a number of items by it; else itself."""
        return replace(self, name="contrast", max_items=None, max_ms=None) if self.name in COUNTED else self

    @property
    def title(self) -> str:
        """The name as people type it, without the acuity."""
        spent = f":{self.max_items}" if self.max_ms is None else f":{self.max_ms:g}ms"
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
