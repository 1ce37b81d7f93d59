"""What ``sensitivity.wgsl`` reads: castleCSF's achromatic mechanism as two tables of 32 x 32 numbers.

Gain and log-parabola of the sustained and the transient channel are smooth in log frequency and log luminance, so a
cubic through four neighbours is all but exact; truncation, area, time and eccentricity are formulae in the shader. A
table over all of them at once would be megabytes, and 8 % off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from limen.vision.castle_csf import FREQUENCY_CPD, LUMINANCE_CD_M2, log_bands
from limen.vision.resolution import luminance_scale

__all__ = ["SIDE", "SensitivityTables", "sensitivity_tables"]

SIDE = 32
"""Rows and columns; the same number is in the shader."""


@dataclass(frozen=True, slots=True)
class SensitivityTables:
    """The tables, float32.

    Parameters
    ----------
    sustained, transient
        ``log10`` of gain times log-parabola, shape (32, 32): a row a luminance, a column a frequency, both evenly in
        their logarithm over the model's range.
    scale
        ``log10`` of how much finer people resolve than at 100 cd/m2, shape (32,), at the same luminances.
    """

    sustained: NDArray[np.float32]
    transient: NDArray[np.float32]
    scale: NDArray[np.float32]

    @property
    def buffer(self) -> NDArray[np.float32]:
        """All numbers in the order in which the shader's storage buffer holds them."""
        return np.concatenate([self.sustained.ravel(), self.transient.ravel(), self.scale])


def sensitivity_tables() -> SensitivityTables:
    """The tables for ``sensitivity.wgsl``; the same numbers every time.

    With them the shader's ``sensitivity`` (frequency, eccentricity, luminance, flicker, area) stays within 0.06 % of
    `limen.sensitivity`, and its ``resolution_cpd`` within 0.02 % of `limen.resolution_cpd`, over the whole range of the
    models; measured with Mesa's llvmpipe.
    """
    frequency = np.geomspace(*FREQUENCY_CPD, SIDE)
    light = np.geomspace(*LUMINANCE_CD_M2, SIDE)
    sustained, transient = log_bands(frequency, light[:, None])
    scale = np.log10(luminance_scale(light))
    return SensitivityTables(sustained.astype(np.float32), transient.astype(np.float32), scale.astype(np.float32))
