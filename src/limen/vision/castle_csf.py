"""castleCSF: contrast sensitivity by colour, area, frequency in space and time, luminance and eccentricity.

The formulae and constants are those of the authors' published code (MIT, version 0.2.3), as fitted in the paper.

References
----------
Ashraf, Mantiuk, Chapiro, Wuerger 2024, *castleCSF*, Journal of Vision 24(4):5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from limen.geometry import Floats

__all__ = [
    "FIELDS",
    "FREQUENCY_CPD",
    "LUMINANCE_CD_M2",
    "MECHANISMS",
    "Field",
    "Mechanism",
    "log_bands",
    "log_sensitivity",
    "log_still_sensitivity",
    "mechanism_contrasts",
]

Field: TypeAlias = Literal["nasal", "temporal"]
Mechanism: TypeAlias = Literal["achromatic", "red-green", "yellow-violet"]

FREQUENCY_CPD = (1 / 16, 64.0)
LUMINANCE_CD_M2 = (0.0113, 10_000.0)
"""Where the model was fitted. Below that luminance it gives no number, so luminance is clamped to this range."""

_FALLOFF: dict[str, dict[str, tuple[float, float]]] = {
    "achromatic": {"temporal": (0.0239853, 0.0189038), "nasal": (0.0400662, 0.00813619)},
    "red-green": {"temporal": (0.0591402, 0.0), "nasal": (2.89615e-5, 0.18108)},  # 2e-69 in the fit
    "yellow-violet": {"temporal": (0.00356865, 0.00806631), "nasal": (0.0, 0.0110662)},  # 6e-141 in the fit
}
"""k0, k1 of the loss 10^-((k0 + k1 frequency) eccentricity)."""


@dataclass(frozen=True, slots=True)
class _Channel:
    """Constants of a band of frequencies that is summed over the grating's area."""

    bandwidth: float
    truncation: float
    area_deg2: float
    integration_cpd: float


_SUSTAINED = _Channel(0.000213047, 0.100207, 157.103, 0.702338)
_TRANSIENT = _Channel(2.6761, 0.000241177, 3.81611, 3.01389)
_TRANSIENT_PEAK_CPD = 0.000316696


@dataclass(frozen=True, slots=True)
class _Chromatic:
    """Constants of a mechanism that sees colour alone; it has a sustained channel only."""

    gain: tuple[float, float, float]
    peak_cpd: float
    channel: _Channel
    slowness: tuple[float, float]


_CHROMATIC = {
    "red-green": _Chromatic(
        (681.434, 38.0038, 0.480386), 0.0178364, _Channel(2.42104, 0.0, 2816.44, 0.0711058), (1.15591, 16.4325)
    ),
    "yellow-violet": _Chromatic(
        (166.683, 62.8974, 0.41193), 0.00425753, _Channel(2.68197, 0.0, 2.82789e7, 0.000635093), (0.969123, 7.15012)
    ),
}

MECHANISMS: tuple[Mechanism, ...] = ("achromatic", "red-green", "yellow-violet")
FIELDS: tuple[Field, ...] = ("nasal", "temporal")

_CONES_TO_MECHANISMS = np.array([[1.0, 1.0, 0.0], [1.0, -2.3112, 0.0], [-1.0, -1.0, 50.9875]])


def log_sensitivity(
    frequency_cpd: Floats,
    eccentricity_deg: Floats,
    luminance_cd_m2: Floats,
    temporal_hz: Floats,
    area_deg2: Floats,
    mechanism: Mechanism = "achromatic",
    field: Field = "nasal",
) -> Floats:
    """``log10 S``; the arguments broadcast, frequency is not clamped, and luminance must be in range."""
    k0, k1 = _FALLOFF[mechanism][field]
    foveal = _foveal(mechanism, frequency_cpd, luminance_cd_m2, temporal_hz, area_deg2)
    # Far beyond every cut-off a float64 underflows; 1e-300 is as invisible as 0 and has a logarithm.
    return np.asarray(np.log10(np.maximum(foveal, 1e-300)) - (k0 + k1 * frequency_cpd) * eccentricity_deg)


def log_still_sensitivity(frequency_cpd: Floats, luminance_cd_m2: Floats, mechanism: Mechanism) -> Floats:
    """``log10 S`` of the sustained channel alone, in the fovea, for 1 deg2.

    In ordinary light that is the whole answer to a still grating. In the last half octave above 0.0113 cd/m2 the
    transient channel of the fit jumps in even at 0 Hz, so that a darker room would resolve more; ratios of cut-offs
    leave it out.
    """
    one, still = np.asarray(1.0), np.asarray(0.0)
    if mechanism == "achromatic":
        return np.asarray(np.log10(np.maximum(_sustained(frequency_cpd, luminance_cd_m2, one), 1e-300)))
    return log_sensitivity(frequency_cpd, still, luminance_cd_m2, still, one, mechanism)


def log_bands(frequency_cpd: Floats, luminance_cd_m2: Floats) -> tuple[Floats, Floats]:
    """``log10`` of gain times log-parabola of the two achromatic channels, the sustained one not truncated.

    What is left of the model is short enough for a shader: truncation, area, time and eccentricity.
    """
    gain, peak = _sustained_peak(luminance_cd_m2)
    sustained = np.log10(gain) - np.log10(frequency_cpd / peak) ** 2 / 2.0**_SUSTAINED.bandwidth
    above = np.log10(frequency_cpd / _TRANSIENT_PEAK_CPD) ** 2 / 2.0**_TRANSIENT.bandwidth
    return sustained, np.log10(_transient_gain(luminance_cd_m2)) - above


def _foveal(mechanism: Mechanism, frequency: Floats, light: Floats, temporal_hz: Floats, area_deg2: Floats) -> Floats:
    if mechanism == "achromatic":
        slow = np.exp(-(temporal_hz**1.3314) / 10.5795)
        best_hz = 2.41482 * np.log10(light) + 4.7036  # not negative where the luminance is in range
        fast = np.exp(-((temporal_hz**0.1898 - best_hz**0.1898) ** 2) / 0.0844836)
        return np.asarray(
            slow * _sustained(frequency, light, area_deg2) + fast * _transient(frequency, light, area_deg2)
        )
    own = _CHROMATIC[mechanism]
    power, spread = own.slowness
    gain = np.exp(-(temporal_hz**power) / spread) * _hyperbola(light, *own.gain)
    return _summed(frequency, gain * _pass_band(frequency, own.peak_cpd, own.channel), area_deg2, own.channel)


def _sustained(frequency: Floats, light: Floats, area_deg2: Floats) -> Floats:
    gain, peak = _sustained_peak(light)
    return _summed(frequency, gain * _pass_band(frequency, peak, _SUSTAINED), area_deg2, _SUSTAINED)


def _sustained_peak(light: Floats) -> tuple[Floats, Floats]:
    """Gain of the achromatic sustained channel, and the frequency of its log-parabola's peak."""
    # (1 + s / L)^-n with n near 1e10, by its logarithm: the power itself would lose six digits.
    dim = -np.expm1(-9.66862e9 * np.log1p(5.58341e-7 / light))
    return _hyperbola(light, 56.4947, 7.54726, 0.144532) * dim, _hyperbola(light, 1.78119, 91.5718, 0.256682)


def _transient(frequency: Floats, light: Floats, area_deg2: Floats) -> Floats:
    band = _transient_gain(light) * _pass_band(frequency, _TRANSIENT_PEAK_CPD, _TRANSIENT)
    return _summed(frequency, band, area_deg2, _TRANSIENT)


def _transient_gain(light: Floats) -> Floats:
    return np.asarray(2748.09 * light**0.193434)


def _hyperbola(light: Floats, most: float, half: float, power: float) -> Floats:
    return np.asarray(most * (1 + half / light) ** -power)


def _pass_band(frequency: Floats, peak_cpd: Floats | float, channel: _Channel) -> Floats:
    """A log-parabola that falls no lower than ``1 - truncation`` below its peak."""
    band = 10.0 ** (-(np.log10(frequency / peak_cpd) ** 2) / 2.0**channel.bandwidth)
    return np.asarray(np.where(frequency < peak_cpd, np.maximum(band, 1 - channel.truncation), band))


def _summed(frequency: Floats, band: Floats, area_deg2: Floats, channel: _Channel) -> Floats:
    """Rovamo, Luntinen, Näsänen 1993: more cycles are seen better, up to a critical area."""
    critical = channel.area_deg2 / (1 + (frequency / channel.integration_cpd) ** 2)
    return np.asarray(band * frequency * np.sqrt(critical / (1 + critical / area_deg2)))


def mechanism_contrasts(cone_contrast: ArrayLike, background_lms: ArrayLike) -> Floats:
    """Contrast that each mechanism sees: (..., 3) cone contrasts to (..., 3), in the order of `MECHANISMS`.

    ``|A (contrast x background)| / (L + M)``, with the cones of CIE 2006 and the authors' matrix ``A``.
    """
    background = np.asarray(background_lms, dtype=float)
    change = np.asarray(cone_contrast, dtype=float) * background
    return np.asarray(np.abs(change @ _CONES_TO_MECHANISMS.T) / (background[..., :1] + background[..., 1:2]))
