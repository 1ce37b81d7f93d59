"""Motion: what glides over the retina is seen less sharply than what the eye follows.

References
----------
Kelly 1979, *Motion and vision. II. Stabilized spatio-temporal threshold surface*, J. Opt. Soc. Am. 69(10).
Daly 1998, *Engineering observations from spatiovelocity and spatiotemporal visual models*, Proc. SPIE 3299.
Virsu, Rovamo, Laurinen, Näsänen 1982, *Temporal contrast sensitivity and cortical magnification*, Vision Research 22.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from limen.geometry import Floats

__all__ = [
    "DRIFT_DEG_S",
    "FASTEST_DEG_S",
    "KELLY_DEG_S",
    "MOST_DEG_S",
    "PURSUIT_GAIN",
    "motion_scale",
    "retinal_velocity_deg_s",
]

PURSUIT_GAIN = 0.82
"""Share of its velocity at which eyes follow what moves (Daly 1998)."""

DRIFT_DEG_S = 0.15
"""How fast eyes drift that rest on something (Daly 1998): the velocity of what stands still."""

FASTEST_DEG_S = 80.0
"""How fast eyes can follow (Daly 1998)."""

KELLY_DEG_S = 2.0
"""Velocity at which the highest visible frequency is half of what it would be on a stabilized retina (Kelly 1979)."""

MOST_DEG_S = 5.0
"""On the retina; what glides faster is treated alike, for what is striped along its motion is seen all the same."""


def retinal_velocity_deg_s(velocity_deg_s: ArrayLike) -> Floats:
    """What is left on the retina of a velocity, where the eye follows as well as it can: any shape.

    ``v - min(0.82 v + 0.15, 80)``, and not less than the drift (Daly 1998).

    >>> retinal_velocity_deg_s([0.0, 1.0, 10.0, 100.0]).round(2).tolist()
    [0.15, 0.15, 1.65, 20.0]
    """
    velocity = np.asarray(velocity_deg_s, dtype=float)
    eye = np.minimum(PURSUIT_GAIN * velocity + DRIFT_DEG_S, FASTEST_DEG_S)
    return np.asarray(np.maximum(velocity - eye, DRIFT_DEG_S))


def motion_scale(velocity_deg_s: ArrayLike, eccentricity_scale: ArrayLike = 1.0) -> Floats:
    """How many times larger than of what stands still a detail may be, at a velocity that the eye follows.

    Sensitivity falls with ``exp(-4 pi frequency (velocity + 2) / 45.9)`` (Kelly 1979): along the motion, what is seen
    moves to lower frequencies as a whole, and a detail of any contrast may grow by ``(velocity + 2) / (0.15 + 2)``.
    But what is striped along the motion stays as sharp as if it stood still, so this is the square root, up to
    `MOST_DEG_S`: a detail's area may grow by as much. Where its width grew by it, or without end, the independent
    observer saw what was left out (docs/explain/observer.md). castleCSF, asked at ``frequency x velocity`` Hz, loses
    more than the root of it at every contrast.

    Off the gaze, where details are seen that are ``eccentricity_scale`` times larger, velocities count for as much less
    (Virsu, Rovamo, Laurinen, Näsänen 1982).

    >>> motion_scale([0.0, 10.0, 30.0]).round(2).tolist()
    [1.0, 1.3, 1.8]
    """
    retinal = np.minimum(retinal_velocity_deg_s(velocity_deg_s), MOST_DEG_S)
    retinal = np.maximum(retinal / np.asarray(eccentricity_scale, dtype=float), DRIFT_DEG_S)
    return np.asarray(np.sqrt((retinal + KELLY_DEG_S) / (DRIFT_DEG_S + KELLY_DEG_S)))
