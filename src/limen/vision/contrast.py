"""Contrast sensitivity: one over the smallest contrast that can be seen.

References
----------
Ashraf, Mantiuk, Chapiro, Wuerger 2024, *castleCSF*, Journal of Vision 24(4):5; other models in `limen.vision.models`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.vision.castle_csf import LUMINANCE_CD_M2, MECHANISMS, Field, Mechanism, mechanism_contrasts
from limen.vision.models import ModelChoice, checked, model_of

__all__ = ["D65_LMS", "cone_sensitivity", "sensitivity"]

D65_LMS = (0.6991, 0.3009, 0.0198)
"""Cone responses (CIE 2006) to a grey of daylight colour, per cd/m2."""


def sensitivity(
    frequency_cpd: ArrayLike,
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    temporal_hz: ArrayLike = 0.0,
    area_deg2: ArrayLike = 1.0,
    field: Field = "nasal",
    model: ModelChoice = "castle",
    mechanism: Mechanism = "achromatic",
) -> Floats:
    """One over the smallest visible contrast (Michelson) of a grating.

    Arguments broadcast against each other.

    Parameters
    ----------
    frequency_cpd
        Spatial frequency, cycles per degree; clamped to 1/16 ... 64, where castleCSF was fitted.
    eccentricity_deg
        Angle from the gaze, 0 or more.
    luminance_cd_m2
        Of the background; clamped to 0.0113 ... 10,000.
    temporal_hz
        How fast the grating flickers.
    area_deg2
        Size of the grating.
    field
        Side of the visual field. ``nasal`` is the more sensitive one beyond 1.5 cycles a degree, to be used where the
        side is unknown. (For red-green the fit says the opposite.)
    model
        ``castle`` (castleCSF, Ashraf et al. 2024); ``barten`` (1999) knows frequency, luminance and area and
        ``mannos-sakrison`` (1974) frequency alone, both ignore the rest; or a person's own `CalibrationTable`.
    mechanism
        ``achromatic``, or one of castleCSF's two that see colour. Their contrast is the change that the mechanism
        sees over the background's luminance (see `cone_sensitivity`).

    Raises
    ------
    InputError
        For a model, field or mechanism that does not exist, or numbers that are negative or not finite.

    >>> float(sensitivity(8).round(2)), float(sensitivity(8, eccentricity_deg=10).round(3))
    (98.56, 8.753)
    >>> [float(sensitivity(4, mechanism=name).round(2)) for name in ("red-green", "yellow-violet")]
    [148.89, 14.76]
    >>> [float(sensitivity(4, model=name).round(2)) for name in ("barten", "mannos-sakrison")]
    [197.3, 110.98]
    """
    chosen = model_of(model, mechanism, field)
    names = ("frequency_cpd", "eccentricity_deg", "luminance_cd_m2", "temporal_hz", "area_deg2")
    given = (frequency_cpd, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2)
    rho, ecc, light, omega, area = (checked(value, name) for value, name in zip(given, names, strict=True))
    rho, light = np.clip(rho, *chosen.fitted_cpd), np.clip(light, *LUMINANCE_CD_M2)
    return np.asarray(10.0 ** chosen.log_sensitivity(rho, ecc, light, omega, np.maximum(area, 1e-9)))


def cone_sensitivity(
    cone_contrast: ArrayLike,
    frequency_cpd: ArrayLike,
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    temporal_hz: ArrayLike = 0.0,
    area_deg2: ArrayLike = 1.0,
    field: Field = "nasal",
    background_lms: ArrayLike = D65_LMS,
) -> Floats:
    """Sensitivity to a change of colour in any direction, as one over cone contrast.

    castleCSF (Ashraf et al. 2024): each mechanism's contrast times its sensitivity, summed as squares, is 1 at the
    threshold. Cone contrast is the root mean square of the three cones' contrasts.

    Parameters
    ----------
    cone_contrast
        Direction of the change: contrasts of the L, M and S cones (change over background), shape (..., 3), any
        length; it broadcasts with the arguments that follow.
    background_lms
        Colour of the background, cone responses of CIE 2006 up to a factor, shape (3,).
    frequency_cpd, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2, field
        As in `sensitivity`.

    Raises
    ------
    InputError
        As `sensitivity`, and for a direction that is no direction.

    >>> grey = cone_sensitivity([1, 1, 1], 4)  # light and dark: nearly the achromatic mechanism alone
    >>> float(grey.round(2)), float((grey / sensitivity(4)).round(3))
    (134.28, 1.0)
    """
    direction = np.asarray(cone_contrast, dtype=float)
    background = checked(background_lms, "background_lms")
    if direction.shape[-1:] != (3,) or background.shape != (3,) or not background[:2].all():
        raise InputError("cone_contrast must have shape (..., 3) and background_lms three numbers, L and M above 0")
    size = np.sqrt((direction**2).mean(axis=-1))
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise InputError("cone_contrast must be finite and not all zero: it is a direction of colour")
    seen = mechanism_contrasts(direction, background)
    own = [
        sensitivity(
            frequency_cpd, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2, field, mechanism=mechanism
        )
        for mechanism in MECHANISMS
    ]
    return np.asarray(np.sqrt(sum((seen[..., n] * each) ** 2 for n, each in enumerate(own))) / size)
