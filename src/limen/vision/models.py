"""Models of contrast sensitivity by name, all in one form.

References
----------
Barten 1999, *Contrast Sensitivity of the Human Eye and Its Effects on Image Quality*, SPIE Press, chapter 3;
constants as in Report ITU-R BT.2246. Mannos, Sakrison 1974, *The effects of a visual fidelity criterion on the
encoding of images*, IEEE Transactions on Information Theory 20(4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from limen.errors import InputError
from limen.geometry import Floats
from limen.vision import castle_csf as castle
from limen.vision.calibration import CalibrationTable

__all__ = [
    "MANNOS_SAKRISON_PEAK",
    "MODELS",
    "Model",
    "ModelChoice",
    "barten_contrast_sensitivity",
    "checked",
    "model_of",
    "pupil_mm",
]

ModelChoice: TypeAlias = Literal["castle", "barten", "mannos-sakrison"] | CalibrationTable
MODELS = ("castle", "barten", "mannos-sakrison")

MANNOS_SAKRISON_PEAK = 134.3
"""The formula of 1974 is relative; its peak is set to castleCSF's, in the fovea at 100 cd/m2 and 1 deg2."""

_EXTRAPOLATED_CPD = 256.0


@dataclass(frozen=True, slots=True)
class Model:
    """``log10 S`` of (frequency, eccentricity, luminance, temporal frequency, area), which broadcast.

    It goes on beyond the highest frequency at which it was fitted, smoothly, up to ``top_cpd``: an inverse needs that.
    """

    log_sensitivity: Callable[[Floats, Floats, Floats, Floats, Floats], Floats]
    top_cpd: float = _EXTRAPOLATED_CPD
    fitted_cpd: tuple[float, float] = castle.FREQUENCY_CPD


def model_of(model: ModelChoice, mechanism: castle.Mechanism = "achromatic", field: castle.Field = "nasal") -> Model:
    """A model by its name, or a person's own table.

    Raises
    ------
    InputError
        For a model, mechanism or field that does not exist, or colour asked of a model that has none.
    """
    if mechanism not in castle.MECHANISMS:
        raise InputError(f"no mechanism is named '{mechanism}': there are {', '.join(castle.MECHANISMS)}")
    if field not in castle.FIELDS:
        raise InputError(f"the visual field is nasal or temporal, not '{field}'")
    if model == "castle":
        return Model(partial(castle.log_sensitivity, mechanism=mechanism, field=field))
    if mechanism != "achromatic":
        raise InputError(f"only castle models the {mechanism} mechanism; leave model= out")
    if isinstance(model, CalibrationTable):
        return Model(model.log_sensitivity, model.frequency_cpd[-1], (model.frequency_cpd[0], model.frequency_cpd[-1]))
    if model == "barten":
        return Model(_barten)
    if model == "mannos-sakrison":
        return Model(_mannos_sakrison)
    raise InputError(f"no model of contrast sensitivity is named '{model}': there are {', '.join(MODELS)}")


def checked(value: ArrayLike, name: str) -> Floats:
    """``value`` as float64.

    Raises
    ------
    InputError
        If a number is negative or not finite; ``name`` names the argument.
    """
    array = np.asarray(value, dtype=float)
    if not np.isfinite(array).all() or (array < 0).any():
        raise InputError(f"{name} must be finite and not negative")
    return array


def _barten(frequency: Floats, eccentricity: Floats, light: Floats, temporal_hz: Floats, area_deg2: Floats) -> Floats:
    """The fovea's answer to a still grating, whatever the eccentricity and the flicker."""
    side_deg = np.sqrt(area_deg2)
    pupil = pupil_mm(light, area_deg2)
    light_td = np.pi / 4 * pupil**2 * light * (1 - (pupil / 9.7) ** 2 + (pupil / 12.4) ** 4)  # Stiles-Crawford
    spread_deg = np.hypot(0.5 / 60, 0.08 / 60 * pupil)
    seen = barten_contrast_sensitivity(frequency, spread_deg, side_deg, light_td)
    return np.asarray(np.log10(np.maximum(seen, 1e-300)) + 0 * (eccentricity + temporal_hz))


def pupil_mm(luminance_cd_m2: ArrayLike, area_deg2: ArrayLike) -> Floats:
    """Diameter of the pupil (Barten 1999; the logarithm has base 10, see Watson, Yellott 2012).

    >>> float(pupil_mm(100, 60**2).round(7))
    2.7931307
    """
    return np.asarray(5 - 3 * np.tanh(0.4 * np.log10(np.asarray(luminance_cd_m2) * np.asarray(area_deg2) / 40**2)))


def barten_contrast_sensitivity(
    frequency_cpd: ArrayLike, spread_deg: ArrayLike, side_deg: ArrayLike, illuminance_td: ArrayLike
) -> Floats:
    """Barten 1999, for both eyes: the ratio of signal to photon and neural noise.

    Parameters
    ----------
    frequency_cpd
        Above 0.
    spread_deg
        Standard deviation of the eye's line spread function, degrees.
    side_deg
        Width and height of the grating, degrees.
    illuminance_td
        Of the retina, troland.

    >>> import numpy as np
    >>> retina = np.pi / 4 * 2.1**2 * 20 * (1 - (2.1 / 9.7) ** 2 + (2.1 / 12.4) ** 4)
    >>> spread = np.hypot(0.5, 0.08 * 2.1) / 60  # the number of colour-science's documentation:
    >>> float(barten_contrast_sensitivity(4, spread, 60, retina).round(7))
    360.8691122
    """
    u = np.asarray(frequency_cpd, dtype=float)
    optics = np.exp(-2 * (np.pi * np.asarray(spread_deg) * u) ** 2)
    noise_area = 1 / np.asarray(side_deg, dtype=float) ** 2 + 1 / 12**2 + u**2 / 15**2  # 1/deg2: grating, eye, cycles
    photons = 1 / (0.03 * 1.2274e6 * np.asarray(illuminance_td))  # quantum efficiency x photons per troland
    neurons = 3e-8 / -np.expm1(-((u / 7) ** 2))  # lateral inhibition ends at 7 cycles a degree
    integration_s = 0.1
    return np.asarray(optics / 3.0 / np.sqrt(2 / integration_s * noise_area * (photons + neurons)))


def _mannos_sakrison(
    frequency: Floats, eccentricity: Floats, light: Floats, temporal_hz: Floats, area_deg2: Floats
) -> Floats:
    """``2.6 (0.0192 + 0.114 f) exp(-(0.114 f)^1.1)`` over its largest value, times the peak; frequency alone counts."""
    relative = 2.6 * (0.0192 + 0.114 * frequency) * np.exp(-((0.114 * frequency) ** 1.1)) / _MANNOS_SAKRISON_LARGEST
    ignored = 0 * (eccentricity + light + temporal_hz + area_deg2)
    return np.asarray(np.log10(np.maximum(MANNOS_SAKRISON_PEAK * relative, 1e-300)) + ignored)


_MANNOS_SAKRISON_LARGEST = 0.980878  # at 7.89 cycles a degree
