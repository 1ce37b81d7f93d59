"""Contrast in eight bits.

Hierarchies of points and of vertices carry one byte a node: how far the luminance of what a simplification shows may be
from that of what it hides; pyramids of images one a page. `CONTRAST_OF_CODE` says what the bytes mean,
`limen.layers.common.contrast_scale` what an eye makes of them.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, sections 3.1 and 4.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limen.errors import InputError
from limen.geometry import Floats

__all__ = ["CONTRAST_OF_CODE", "FULL_CODE", "code_of_contrast", "code_of_luminances"]

FULL_CODE = 255
"""The largest contrast there is: that of a silhouette, behind which anything may be."""

_FAINTEST = 0.001  # no eye sees less: sensitivities end below 1000

CONTRAST_OF_CODE: Floats = np.concatenate([[0.0], np.geomspace(_FAINTEST, 1.0, FULL_CODE)])
CONTRAST_OF_CODE.setflags(write=False)
"""Michelson contrast of every code, shape (256,): 0, then 0.001 to 1 in steps of 2.8 %."""


def code_of_contrast(contrast: ArrayLike) -> NDArray[np.uint8]:
    """The smallest code that is no less than a Michelson contrast, 0 ... 1; any shape.

    >>> code_of_contrast([0.0, 0.0005, 0.5, 1.0]).tolist()
    [0, 1, 230, 255]

    Raises
    ------
    InputError
        For a contrast that is not from 0 to 1.
    """
    given = np.asarray(contrast, dtype=float)
    if not ((given >= 0) & (given <= 1)).all():
        raise InputError("a Michelson contrast lies from 0 to 1")
    return np.searchsorted(CONTRAST_OF_CODE, given, side="left").astype(np.uint8)


def code_of_luminances(shown_cd_m2: ArrayLike, low_cd_m2: ArrayLike, high_cd_m2: ArrayLike) -> NDArray[np.uint8]:
    """The code of what is shown in place of anything between two luminances: of the larger of the two contrasts."""
    shown, low, high = (np.asarray(each, dtype=float) for each in (shown_cd_m2, low_cd_m2, high_cd_m2))
    return code_of_contrast(np.maximum(_michelson(shown, low), _michelson(shown, high)))


def _michelson(one: Floats, other: Floats) -> Floats:
    total = one + other
    return np.divide(np.abs(one - other), total, out=np.zeros(total.shape), where=total > 0)
