"""How fine a detail of some contrast can be and still be seen: what decides about every splat and every fold.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, sections 3.1 and 4.1.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from limen.geometry import Floats
from limen.layers.common.page_detail import needed_share
from limen.viewing.policy import Policy
from limen.vision.contrast_codes import CONTRAST_OF_CODE

__all__ = ["acuity_scale", "acuity_scale_of_contrast"]


def acuity_scale_of_contrast(luminance_cd_m2: ArrayLike) -> Floats:
    """The finest detail seen at full contrast over the finest seen at each code's contrast, 0 ... 1: shape (256,).

    A detail of an angle ``a`` and of contrast code ``c`` is invisible where ``a * share[c]`` is below what an eye
    resolves there; 0 means that no size makes it visible. Of several panels' whites the brightest eye decides.

    Parameters
    ----------
    luminance_cd_m2
        Of the panels' white, any shape.
    """
    whites = np.unique(np.asarray(luminance_cd_m2, dtype=float))
    shares = needed_share(CONTRAST_OF_CODE[1:, None], whites).max(axis=1)
    shares[-1] = 1.0  # a silhouette asks for all that acuity sees
    return np.concatenate([[0.0], np.maximum.accumulate(shares)])


def acuity_scale(policy: Policy, whites_cd_m2: Iterable[float]) -> Floats:
    """`acuity_scale_of_contrast` where a policy asks for contrasts, found once for panels of such whites; else ones."""
    return _once(frozenset(whites_cd_m2)) if policy.eyesight.name == "contrast" else np.ones(256)


@cache
def _once(whites_cd_m2: frozenset[float]) -> Floats:
    return acuity_scale_of_contrast(list(whites_cd_m2))
