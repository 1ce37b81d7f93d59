"""Visual acuity: the smallest detail an eye resolves, as an angle.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3 (``Dopt``, the acuity level).
Ashraf, Chapiro, Mantiuk 2025, *Resolution limit of the eye*, Nature Communications (94 samples a degree).
"""

from __future__ import annotations

import math
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limen.errors import InputError
from limen.geometry import Floats
from limen.units import arcmin_to_rad
from limen.vision.resolution import resolution_cpd

__all__ = [
    "GAZE_PER_DEG",
    "HUMAN_ARCMIN",
    "SNELLEN_ARCMIN",
    "acuity_from",
    "acuity_level",
    "eccentricity_scale",
    "hidden_levels",
    "human_arcmin",
    "optimal_distance_m",
]

SNELLEN_ARCMIN = 1.0
"""20/20 vision: one sample an arcminute, the papers' limit."""

HUMAN_ARCMIN = 0.64
"""60 / 94: the median of what 18 observers resolved in the fovea (Ashraf et al. 2025); limen's default."""

GAZE_PER_DEG = 0.10
"""Growth of the smallest visible detail with each degree from the gaze.

What people resolve falls by 0.160 a degree (Ashraf et al. 2025). Omissions that large pass the independent observer
within twice the threshold, but not below it: what is left out of a picture is more than its finest detail. At 0.10 it
stays silent as in the fovea, to 20 degrees and more (docs/explain/observer.md)."""

_NAMED = {"snellen": SNELLEN_ARCMIN, "human": HUMAN_ARCMIN}


def acuity_from(text: str | float) -> float:
    """An acuity in arcminutes from a number or a name (``snellen``, ``human``).

    Raises
    ------
    InputError
        If it is neither a name nor a positive number.
    """
    try:
        value = _NAMED[text] if isinstance(text, str) and text in _NAMED else float(text)
    except ValueError:
        raise InputError(f"acuity '{text}' is neither a number of arcminutes nor one of {', '.join(_NAMED)}") from None
    if not 0 < value <= 600:
        raise InputError(f"an acuity must lie above 0 and at most at 600 arcminutes, got {text}")
    return value


def eccentricity_scale(eccentricity_deg: ArrayLike) -> Floats:
    """How many times larger than in the fovea a detail may be, away from the gaze: `GAZE_PER_DEG` more each degree.

    >>> eccentricity_scale([0.0, 5.0, 20.0]).tolist()
    [1.0, 1.5, 3.0]
    """
    return 1 + GAZE_PER_DEG * np.asarray(eccentricity_deg, dtype=float)


def human_arcmin(luminance_cd_m2: ArrayLike = 100.0) -> Floats:
    """Smallest detail that people resolve in the fovea at some luminance, arcminutes: half a cycle of `resolution_cpd`.

    At 100 cd/m2 it is the fit's 0.629; `HUMAN_ARCMIN` is the measured median there, 1.7 % larger.

    >>> human_arcmin([1, 10, 30, 100, 300]).round(3).tolist()
    [1.907, 0.99, 0.769, 0.629, 0.569]
    """
    return np.asarray(30.0 / resolution_cpd(0.0, luminance_cd_m2))


def optimal_distance_m(pitch_m: float, acuity_arcmin: float = SNELLEN_ARCMIN) -> float:
    """Distance at which one pixel subtends the acuity; farther away, pixels merge.

    ``Dopt = P / tan(acuity)`` (Papadopoulos, Kaufman 2013, section 3.1).

    Parameters
    ----------
    pitch_m
        Distance from one pixel to the next, metres.
    acuity_arcmin
        Smallest resolvable detail, arcminutes.

    >>> round(optimal_distance_m(23.53 / 2560 * 0.0254) / 0.0254, 2)  # inches; the paper's panel
    31.6
    """
    return pitch_m / math.tan(arcmin_to_rad(acuity_arcmin))


def hidden_levels(tolerance_px: Floats) -> NDArray[np.int64]:
    """``floor(max(0, log2 t))``: levels that a tolerance of ``t`` pixels hides; any shape."""
    # frexp gives floor(log2) exactly; log2 itself may round up to the next integer.
    return np.asarray(np.frexp(np.maximum(tolerance_px, 1.0))[1].astype(np.int64) - 1)


@overload
def acuity_level(distance_m: float, pitch_m: float, acuity_arcmin: float = ...) -> int: ...
@overload
def acuity_level(distance_m: Floats, pitch_m: float, acuity_arcmin: float = ...) -> NDArray[np.int64]: ...
def acuity_level(
    distance_m: ArrayLike, pitch_m: float, acuity_arcmin: float = SNELLEN_ARCMIN
) -> int | NDArray[np.int64]:
    """Pyramid levels that distance hides: ``floor(max(0, log2(D / Dopt)))``.

    Papadopoulos, Kaufman 2013, section 3.2; the floor biases toward quality.

    Parameters
    ----------
    distance_m
        Distance from the eye to the pixel, metres; any shape.
    pitch_m, acuity_arcmin
        As in `optimal_distance_m`.

    >>> pitch = 23.53 / 2560 * 0.0254
    >>> acuity_level(198 * 0.0254, pitch), acuity_level(114 * 0.0254, pitch)  # side and front wall of the paper's room
    (2, 1)
    """
    ratio = np.asarray(distance_m, dtype=float) / optimal_distance_m(pitch_m, acuity_arcmin)
    levels = hidden_levels(ratio)
    return int(levels) if levels.ndim == 0 else levels
