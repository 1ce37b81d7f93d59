"""How fine a detail of some contrast can be, and how far away, and still be seen: the inverses of sensitivity."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.vision.castle_csf import LUMINANCE_CD_M2, Field, Mechanism
from limen.vision.inverse import highest_visible_cpd
from limen.vision.models import ModelChoice, checked, model_of
from limen.vision.resolution import people_cpd

__all__ = ["visible_cpd", "visible_distance_m"]


def visible_cpd(
    contrast: ArrayLike,
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    temporal_hz: ArrayLike = 0.0,
    area_deg2: ArrayLike = 1.0,
    field: Field = "nasal",
    model: ModelChoice = "castle",
    mechanism: Mechanism = "achromatic",
    floor: Literal["human", "none"] = "human",
) -> Floats:
    """The highest spatial frequency at which a contrast is visible, cycles per degree; 0 where it never is.

    The larger of two numbers:

    * the highest frequency at which the model's sensitivity is at least ``1 / contrast``. All lower ones count as
      visible
      too (sensitivity is clamped below its peak). Beyond 64 cycles a degree, where castleCSF was not measured, its
      formula is followed on, so that a bright, stark pattern is not called invisible for want of data;
    * ``floor="human"``: what people saw, ``(log10(1 / contrast) - c) / (cF (1 + cR e))`` of Ashraf, Chapiro, Mantiuk
      2025,
      scaled to other luminances as in `limen.resolution_cpd`. castleCSF alone is too bold away from the gaze.

    Arguments broadcast against each other; the answer is within 1e-6 of itself, except that a contrast within 1 % of
    the smallest visible one may count as invisible to the model.

    Parameters
    ----------
    contrast
        Michelson, 0 or more.
    eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2, field, model, mechanism
        As in `limen.sensitivity`; a `CalibrationTable` sees nothing beyond its last frequency.
    floor
        ``none`` asks the model alone.

    Raises
    ------
    InputError
        For names that do not exist, or numbers that are negative or not finite.

    >>> visible_cpd([1, 0.1, 0.01, 0.001]).round(2).tolist()
    [65.76, 29.65, 7.87, 0.0]
    >>> visible_cpd(0.1, [0, 5, 10, 20, 40]).round(2).tolist()
    [29.65, 14.35, 9.93, 6.15, 3.49]
    """
    needed = checked(contrast, "contrast")
    ecc, light = checked(eccentricity_deg, "eccentricity_deg"), checked(luminance_cd_m2, "luminance_cd_m2")
    omega, area = checked(temporal_hz, "temporal_hz"), checked(area_deg2, "area_deg2")
    if floor not in ("human", "none"):
        raise InputError(f"the floor is human or none, not '{floor}'")
    chosen = model_of(model, mechanism, field)
    light, area = np.clip(light, *LUMINANCE_CD_M2), np.maximum(area, 1e-9)
    log_needed = -np.log10(np.maximum(needed, 1e-30))  # no model sees a contrast of 1e-30
    found = highest_visible_cpd(chosen, log_needed, (ecc, light, omega, area))
    return found if floor == "none" else np.maximum(found, people_cpd(log_needed, ecc, light, mechanism))


def visible_distance_m(
    contrast: ArrayLike,
    period_m: ArrayLike,
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    temporal_hz: ArrayLike = 0.0,
    area_deg2: ArrayLike = 1.0,
    field: Field = "nasal",
    model: ModelChoice = "castle",
    mechanism: Mechanism = "achromatic",
    floor: Literal["human", "none"] = "human",
) -> Floats:
    """The viewing distance at which a periodic change becomes visible to someone who walks up to it, metres.

    ``D = period / tan(1 / rho)`` with `visible_cpd`'s ``rho``: there one period subtends one cycle of the highest
    visible frequency, seen square on. Nearer it is visible, farther not; 0 where it never is.

    Parameters
    ----------
    period_m
        Length of one cycle, above 0: from one dark line to the next. Two pixels for a pattern of single pixels, so
        twice the size of a lone detail.
    contrast, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2, field, model, mechanism, floor
        As in `visible_cpd`. Eccentricity and area are those at the distance that is found.

    Raises
    ------
    InputError
        As `visible_cpd`, and for a period of 0.

    >>> pitch_m = 0.000_23347  # of the Reality Deck; pixels 2 % apart, and black on white
    >>> visible_distance_m([0.01, 1], 2 * pitch_m).round(3).tolist()
    [0.211, 1.759]
    """
    period = checked(period_m, "period_m")
    if not period.all():
        raise InputError("period_m must be above 0: the length of one cycle")
    rho = visible_cpd(
        contrast, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2, field, model, mechanism, floor
    )
    # A cycle of 90 degrees or more is no pattern on a flat panel any more.
    cycle_deg = np.minimum(1 / np.maximum(rho, 1 / 90), 90.0)
    return np.asarray(np.where(cycle_deg < 90, period / np.tan(np.radians(cycle_deg)), 0.0))
