"""The highest frequency that people were found to resolve.

References
----------
Ashraf, Chapiro, Mantiuk 2025, *Resolution limit of the eye - how many pixels can we see?*, Nature Communications.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.vision.castle_csf import LUMINANCE_CD_M2, MECHANISMS, Mechanism, log_still_sensitivity
from limen.vision.inverse import highest_visible_cpd
from limen.vision.models import Model, checked

__all__ = ["ECCENTRICITY_PER_DEG", "STUDY_LUMINANCE_CD_M2", "luminance_scale", "people_cpd", "resolution_cpd"]

STUDY_LUMINANCE_CD_M2 = 100.0

_FITS = {
    "achromatic": (1.0949, 2.13475, -0.043936, 0.160080),
    "red-green": (7.4154, 2.17939, -0.029965, 0.453580),
    "yellow-violet": (2.0517, 1.77669, -0.055037, 0.462995),
}
"""S (one over the contrast shown), c, cF, cR of ``rho = (log10 S - c) / (cF (1 + cR e))``."""

ECCENTRICITY_PER_DEG = _FITS["achromatic"][3]
"""cR: by how much the smallest visible angle grows with each degree from the gaze."""

_CUT_OFF = {"achromatic": 1.0, "red-green": 7.4154, "yellow-violet": 2.0517}
"""The sensitivity at which vision ends: at contrast 1, and for colours at the study's; displays show no more."""

_SNELLEN_CPD = 30.0


def resolution_cpd(
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    model: Literal["human", "snellen"] = "human",
    mechanism: Mechanism = "achromatic",
) -> Floats:
    """The highest spatial frequency that people resolve at a display's highest contrast, cycles per degree.

    ``human``: the fit of Ashraf, Chapiro, Mantiuk 2025 to 18 observers at 100 cd/m2, scaled to other luminances like
    the cut-off of castleCSF (clamped to 0.0113 ... 10,000 cd/m2). ``snellen``: 20/20, 30 cycles a degree, whatever
    the eccentricity, the light and the mechanism.

    Raises
    ------
    InputError
        For a model or mechanism that does not exist, or numbers that are negative or not finite.

    >>> resolution_cpd([0, 5, 10, 20, 30]).round(2).tolist()
    [47.69, 26.49, 18.34, 11.35, 8.22]
    >>> [resolution_cpd([0, 10], mechanism=name).round(2).tolist() for name in ("red-green", "yellow-violet")]
    [[43.69, 7.89], [26.61, 4.73]]
    """
    ecc, light = checked(eccentricity_deg, "eccentricity_deg"), checked(luminance_cd_m2, "luminance_cd_m2")
    if mechanism not in MECHANISMS:
        raise InputError(f"no mechanism is named '{mechanism}': there are {', '.join(MECHANISMS)}")
    if model == "snellen":
        return np.full(np.broadcast_shapes(ecc.shape, light.shape), _SNELLEN_CPD)
    if model != "human":
        raise InputError(f"no model of resolution is named '{model}': there are human and snellen")
    return people_cpd(np.asarray(math.log10(_FITS[mechanism][0])), ecc, light, mechanism)


def people_cpd(log_needed: Floats, eccentricity_deg: Floats, light: Floats, mechanism: Mechanism) -> Floats:
    """The fit for any contrast, ``log_needed = log10(1 / contrast)``: 0 where the contrast is too small to be seen."""
    _, c, c_f, c_r = _FITS[mechanism]
    at_100 = np.maximum((log_needed - c) / (c_f * (1 + c_r * eccentricity_deg)), 0.0)
    return np.asarray(at_100 * luminance_scale(light, mechanism))


def luminance_scale(luminance_cd_m2: ArrayLike, mechanism: Mechanism = "achromatic") -> Floats:
    """How much finer people resolve than at 100 cd/m2: the ratio of castleCSF's cut-offs for a still grating.

    0 where castleCSF sees nothing at any frequency: colour, in the dark.

    >>> luminance_scale([1, 10, 30, 100, 300]).round(4).tolist()
    [0.3298, 0.6352, 0.8185, 1.0, 1.1064]
    """
    log_light, scale = _scales(mechanism)
    light = np.clip(np.asarray(luminance_cd_m2, dtype=float), *LUMINANCE_CD_M2)
    return np.asarray(np.interp(np.log(light), log_light, scale))


@cache
def _scales(mechanism: Mechanism) -> tuple[Floats, Floats]:
    """The ratio at 1024 luminances and at 100 cd/m2; between them it is straight to within 1e-5."""
    light = np.union1d(np.geomspace(*LUMINANCE_CD_M2, 1024), [STUDY_LUMINANCE_CD_M2])
    light[[0, -1]] = LUMINANCE_CD_M2

    def log_sensitivity(rho: Floats, ecc: Floats, lum: Floats, omega: Floats, area: Floats) -> Floats:
        return log_still_sensitivity(rho, lum, mechanism)

    nothing = np.asarray(0.0)
    needed = np.asarray(math.log10(_CUT_OFF[mechanism]))
    cut_off = highest_visible_cpd(Model(log_sensitivity), needed, (nothing, light, nothing, nothing))
    return np.log(light), cut_off / cut_off[light == STUDY_LUMINANCE_CD_M2]
