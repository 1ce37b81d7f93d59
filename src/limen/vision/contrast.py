"""Contrast sensitivity and the highest visible frequency.

References
----------
Ashraf, Mantiuk, Chapiro, Wuerger 2024, *castleCSF*, Journal of Vision 24(4) (achromatic mechanism; constants from the
authors' published code).
Ashraf, Chapiro, Mantiuk 2025, *Resolution limit of the eye*, Nature Communications (the fit of people's resolution).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from limen.errors import InputError
from limen.geometry import Floats

__all__ = ["resolution_cpd", "sensitivity"]

Field = Literal["nasal", "temporal"]

_FREQUENCY_CPD = (1 / 16, 64.0)
_LUMINANCE_CD_M2 = (0.0113, 10_000.0)
"""Where castleCSF was fitted. Below the range of luminance it gives no number, so both are clamped."""

_FALLOFF = {"temporal": (0.0239853, 0.0189038), "nasal": (0.0400662, 0.00813619)}

# Ashraf, Chapiro, Mantiuk 2025: S = 1 / contrast, c, cF, cR of rho_max = (log10 S - c) / (cF (1 + cR e)).
_HUMAN = (1.0949, 2.13475, -0.043936, 0.160080)
_SNELLEN_CPD = 30.0


@dataclass(frozen=True, slots=True)
class _Channel:
    """Constants of one of castleCSF's achromatic mechanisms."""

    peak_cpd: Floats
    bandwidth: float
    truncation: float
    area_deg2: float
    integration_cpd: float


def _channel(frequency: Floats, gain: Floats, area_deg2: Floats, channel: _Channel) -> Floats:
    relative = np.log10(frequency / channel.peak_cpd)
    pass_band = 10.0 ** (-(relative**2) / 2.0**channel.bandwidth)
    pass_band = np.where(frequency < channel.peak_cpd, np.maximum(pass_band, 1 - channel.truncation), pass_band)
    critical = channel.area_deg2 / (1 + (frequency / channel.integration_cpd) ** 2)
    return np.asarray(gain * pass_band * frequency * np.sqrt(critical / (1 + critical / area_deg2)))


def sensitivity(
    frequency_cpd: ArrayLike,
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    temporal_hz: ArrayLike = 0.0,
    area_deg2: ArrayLike = 1.0,
    field: Field = "nasal",
    model: Literal["castle"] = "castle",
) -> Floats:
    """One over the smallest visible contrast (Michelson) of an achromatic grating.

    castleCSF, achromatic (Ashraf et al. 2024). Arguments broadcast against each other.

    Parameters
    ----------
    frequency_cpd
        Spatial frequency, cycles per degree; clamped to 1/16 ... 64, where the model was fitted.
    eccentricity_deg
        Angle from the gaze, 0 or more.
    luminance_cd_m2
        Of the background; clamped to 0.0113 ... 10,000.
    temporal_hz
        How fast the grating flickers.
    area_deg2
        Size of the grating.
    field
        Side of the visual field; ``nasal`` is the more sensitive one far out, to be used where the side is unknown.

    Raises
    ------
    InputError
        For a model or field that does not exist, or numbers that are negative or not finite.

    >>> float(sensitivity(8).round(2)), float(sensitivity(8, eccentricity_deg=10).round(3))
    (98.56, 8.753)
    """
    if model != "castle":
        raise InputError(f"no model of contrast sensitivity is named '{model}': there is castle")
    if field not in _FALLOFF:
        raise InputError(f"the visual field is nasal or temporal, not '{field}'")
    names = ("frequency_cpd", "eccentricity_deg", "luminance_cd_m2", "temporal_hz", "area_deg2")
    given = (frequency_cpd, eccentricity_deg, luminance_cd_m2, temporal_hz, area_deg2)
    rho, ecc, light, omega, area = (_checked(value, name) for value, name in zip(given, names, strict=True))
    rho, light = np.clip(rho, *_FREQUENCY_CPD), np.clip(light, *_LUMINANCE_CD_M2)
    k0, k1 = _FALLOFF[field]
    return np.asarray(_foveal(rho, light, omega, np.maximum(area, 1e-9)) * 10.0 ** (-(k0 + k1 * rho) * ecc))


def _foveal(rho: Floats, light: Floats, omega: Floats, area: Floats) -> Floats:
    slow = np.exp(-(omega**1.3314) / 10.5795)
    best_hz = 2.41482 * np.log10(light) + 4.7036  # not negative where the luminance is in range
    fast = np.exp(-(np.abs(omega**0.1898 - best_hz**0.1898) ** 2) / 0.0844836)
    return np.asarray(slow * _sustained(rho, light, area) + fast * _transient(rho, light, area))


def _sustained(rho: Floats, light: Floats, area: Floats) -> Floats:
    dim = 1 - (1 + 5.58341e-7 / light) ** -9.66862e9
    gain = 56.4947 * (1 + 7.54726 / light) ** -0.144532 * dim
    peak = 1.78119 * (1 + 91.5718 / light) ** -0.256682
    return _channel(rho, gain, area, _Channel(peak, 0.000213047, 0.100207, 157.103, 0.702338))


def _transient(rho: Floats, light: Floats, area: Floats) -> Floats:
    gain = 2748.09 * light**0.193434
    return _channel(rho, gain, area, _Channel(np.asarray(0.000316696), 2.6761, 0.000241177, 3.81611, 3.01389))


def resolution_cpd(
    eccentricity_deg: ArrayLike = 0.0,
    luminance_cd_m2: ArrayLike = 100.0,
    model: Literal["human", "snellen"] = "human",
) -> Floats:
    """The highest spatial frequency that people resolve at full contrast, cycles per degree.

    ``human``: the fit of Ashraf, Chapiro, Mantiuk 2025 to 18 observers at 100 cd/m2, scaled to other luminances like
    the cut-off of castleCSF. ``snellen``: 20/20, 30 cycles a degree, whatever the eccentricity and the light.

    Raises
    ------
    InputError
        For a model that does not exist, or numbers that are negative or not finite.

    >>> resolution_cpd([0, 5, 10, 20, 30]).round(1).tolist()
    [47.7, 26.5, 18.3, 11.4, 8.2]
    """
    ecc, light = _checked(eccentricity_deg, "eccentricity_deg"), _checked(luminance_cd_m2, "luminance_cd_m2")
    if model == "snellen":
        return np.full(np.broadcast_shapes(ecc.shape, light.shape), _SNELLEN_CPD)
    if model != "human":
        raise InputError(f"no model of resolution is named '{model}': there are human and snellen")
    s, c, c_f, c_r = _HUMAN
    at_100 = (math.log10(s) - c) / (c_f * (1 + c_r * ecc))
    scale = np.vectorize(_cut_off, otypes=[float])(light) / _cut_off(100.0)
    return np.asarray(at_100 * scale)


@lru_cache(maxsize=4096)
def _cut_off(luminance_cd_m2: float) -> float:
    """Where castleCSF falls to one in the fovea: no contrast is visible beyond."""
    light, still, one = np.clip(np.asarray(luminance_cd_m2), *_LUMINANCE_CD_M2), np.asarray(0.0), np.asarray(1.0)

    def excess(log_rho: float) -> float:
        # Beyond 64 cycles a degree the model is extrapolated, which only a ratio of cut-offs is allowed to do.
        return float(np.log10(_foveal(np.asarray(math.exp(log_rho)), light, still, one)))

    return math.exp(brentq(excess, math.log(2.0), math.log(400.0)))


def _checked(value: ArrayLike, name: str) -> Floats:
    array = np.asarray(value, dtype=float)
    if not np.isfinite(array).all() or (array < 0).any():
        raise InputError(f"{name} must be finite and not negative")
    return array
