"""Windows that glide over the retina, as if they stood still: with what is lost and won of them by flickering.

References
----------
Ashraf, Mantiuk, Chapiro, Wuerger 2024, *castleCSF*, Journal of Vision 24(4):5 (sensitivity by temporal frequency).
"""

from __future__ import annotations

import numpy as np

from limen.geometry import Floats
from limen.vision.castle_csf import FREQUENCY_CPD, LUMINANCE_CD_M2, MECHANISMS, log_sensitivity

__all__ = ["gliding"]


def gliding(
    test: Floats,
    reference: Floats,
    samples_per_degree: float,
    velocity_deg_s: tuple[float, float],
    mean_cd_m2: float,
    opponent_of_rgb: Floats,
) -> tuple[Floats, Floats]:
    """Both windows, (H, W, 3) in linear light, for an observer of still pictures.

    A frequency that moves along itself flickers, and is seen as castleCSF says; one that moves along its stripes does
    not change at all. What flicker makes more visible is added to the difference alone: the reference only masks it,
    and would leave the range of the display.

    Parameters
    ----------
    velocity_deg_s
        On the retina, to the right and down.
    mean_cd_m2
        What eyes are adapted to.
    opponent_of_rgb
        (3, 3): to the channels of `limen.vision.castle_csf.MECHANISMS`.
    """
    height, width = reference.shape[:2]
    down_cpd = samples_per_degree * np.fft.fftfreq(height)[:, None]
    across_cpd = samples_per_degree * np.fft.rfftfreq(width)[None]
    frequency_cpd = np.maximum(np.hypot(down_cpd, across_cpd), FREQUENCY_CPD[0])
    temporal_hz = np.abs(down_cpd * velocity_deg_s[1] + across_cpd * velocity_deg_s[0])
    light = np.clip(mean_cd_m2, *LUMINANCE_CD_M2)
    kept = []
    for mechanism in MECHANISMS:
        still, moving = (
            log_sensitivity(frequency_cpd, np.zeros(1), light, hertz, np.ones(1), mechanism)
            for hertz in (np.zeros(1), temporal_hz)
        )
        share = 10.0 ** (moving - still)
        share[0, 0] = 1.0
        kept.append(share)
    glided, difference = (
        _filtered(window, [np.minimum(share, most) for share in kept], opponent_of_rgb)
        for window, most in ((reference, 1.0), (test - reference, np.inf))
    )
    return glided + difference, glided


def _filtered(window: Floats, shares: list[Floats], opponent_of_rgb: Floats) -> Floats:
    opponent = window @ opponent_of_rgb.T
    for channel, share in enumerate(shares):
        spectrum = np.fft.rfft2(opponent[..., channel]) * share
        opponent[..., channel] = np.fft.irfft2(spectrum, s=window.shape[:2])
    return np.asarray(opponent @ np.linalg.inv(opponent_of_rgb).T)
