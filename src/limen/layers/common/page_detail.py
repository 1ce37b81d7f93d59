"""When a page's finer detail is seen: the one number a page that every policy comes down to.

A pixel's tolerance, counted in texels of full resolution, is ``T``. Page ``Q`` is replaced by the four finer pages
below it where ``T`` is less than ``tau(Q)``. If all that counts is how small a texel is, ``tau`` is ``2**level`` over
`KEPT`; where what the next finer level adds is faint, ``tau`` is less. The coarser page does not take over at once but
gradually, from ``tau / 2**BLEND_LEVELS`` to ``tau``, so that no pixel's level changes from one frame to the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from limen.data.pages import Pyramid
from limen.geometry import Floats
from limen.vision.contrast import sensitivity
from limen.vision.resolution import people_cpd, resolution_cpd
from limen.vision.visible import visible_cpd

__all__ = [
    "BLEND_LEVELS",
    "KEPT",
    "Detail",
    "contrast_detail",
    "level_shares",
    "needed_share",
    "plain_detail",
    "reduced_detail",
]

KEPT = 0.90
"""What is left of a texel's fineness when a page was halved, rounded to 8 bits and drawn.

Where texels subtend just the acuity, the independent observer passes text within twice the threshold, but below it only
where they are a tenth smaller (docs/explain/observer.md)."""

BLEND_LEVELS = 0.125
"""Width of the blend between two levels, in octaves of tolerance.

For someone who walks at 1.25 m/s toward a wall 2.5 m away, where levels change, a change lasts 0.17 s: at that pace
(3 Hz) eyes are no more sensitive to it than to a picture that stands still. Up to 0.29 the blend hides what a hard
change at its end would hide: the contrast that is lost grows with its share, and the eye's sensitivity falls faster
over the same octaves (10 ** (0.0439 rho), Ashraf et al. 2025)."""


_WELL_MEASURED_CPD = 32.0
_FULL_CONTRAST = 1 / 1.0949  # of the study that the fit of people's resolution comes from


class Detail(NamedTuple):
    """For every page of a pyramid: below which tolerance its finer detail is seen.

    ``tau`` is in texels of full resolution, shape (pages,); 0 where nothing finer exists or is to be seen. A page's is
    never less than any of its four finer pages'. ``least`` is the smallest of each level.
    """

    tau: Floats
    least: Floats


def plain_detail(pyramid: Pyramid) -> Detail:
    """What is finer than the tolerance is not seen, whatever it shows; soft levels count as one level coarser."""
    soft = len(pyramid.levels) if pyramid.soft_from is None else pyramid.soft_from
    sizes = [2.0 ** (number + (number >= soft)) / KEPT for number in range(len(pyramid.levels))]
    tau = np.repeat(sizes, [level.page_count for level in pyramid.levels])
    return _nested(pyramid, tau)


def reduced_detail(pyramid: Pyramid, share: Floats) -> Detail:
    """Faint detail is not seen either.

    Parameters
    ----------
    share
        For every page the highest frequency at which what the next finer level adds to it is visible, over the highest
        frequency visible at full contrast: 0 ... 1, shape (pages,).
    """
    return _nested(pyramid, plain_detail(pyramid).tau * np.clip(share, 0.0, 1.0))


def contrast_detail(pyramid: Pyramid, contrast: Floats, luminance_cd_m2: Floats) -> Detail:
    """What is too faint to be seen at any of some panels' luminances is not seen.

    The falloff with eccentricity is the tolerance's, for every contrast: castleCSF's and that of people's resolution
    are steeper, so faint detail is not dropped too early anywhere.

    Parameters
    ----------
    contrast
        Of what the next finer level adds to each page, where it adds most over an area that the eye sums (see
        :mod:`limen.data.image.contrast`), 0 ... 1, shape (pages,).
    luminance_cd_m2
        Of the panels' white, any shape.
    """
    grades, grade_of = np.unique(contrast, return_inverse=True)
    shares = needed_share(grades[:, None], np.unique(luminance_cd_m2))
    return reduced_detail(pyramid, shares.max(axis=1)[grade_of])


def needed_share(contrast: Floats, luminance_cd_m2: Floats) -> Floats:
    """The highest frequency at which a contrast is visible in the fovea, over that of the highest contrast; 0 ... 1.

    The larger of what castleCSF and the fit to people's resolution say, with one exception. Where castleCSF goes beyond
    32 cycles a degree it was hardly measured, and at full contrast it claims 66 where people resolved 48 (Ashraf et al.
    2025): from the contrast that it sees at 32 up to full contrast, the frequency rises in proportion to the logarithm
    of the contrast, to what people resolved. Arguments broadcast.
    """
    finest = resolution_cpd(0.0, luminance_cd_m2)
    castle = visible_cpd(contrast, 0.0, luminance_cd_m2, floor="none")
    people = people_cpd(-np.log10(np.maximum(contrast, 1e-30)), np.zeros(()), luminance_cd_m2, "achromatic")
    seen_at_32 = 1 / sensitivity(_WELL_MEASURED_CPD, 0.0, luminance_cd_m2)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.log(contrast / seen_at_32) / np.log(_FULL_CONTRAST / seen_at_32)
        above = _WELL_MEASURED_CPD + np.clip(along, 0.0, 1.0) * np.maximum(finest - _WELL_MEASURED_CPD, 0.0)
    castle = np.where(castle > _WELL_MEASURED_CPD, np.minimum(castle, above), castle)
    return np.asarray(np.clip(np.maximum(castle, people) / finest, 0.0, 1.0))


def _nested(pyramid: Pyramid, tau: Floats) -> Detail:
    """A page under which finer pages are needed is itself needed as their parent."""
    tau = tau.copy()
    base = pyramid.levels[0]
    tau[: base.page_count] = 0.0
    for fine, coarse in zip(pyramid.levels[1:], pyramid.levels[2:], strict=False):
        below = np.zeros((2 * coarse.rows, 2 * coarse.columns))
        below[: fine.rows, : fine.columns] = _grid(tau, fine.first_page, fine.rows, fine.columns)
        finest = below.reshape(coarse.rows, 2, coarse.columns, 2).max(axis=(1, 3))
        own = _grid(tau, coarse.first_page, coarse.rows, coarse.columns)
        np.maximum(own, finest, out=own)
    least = np.array([tau[level.first_page : level.first_page + level.page_count].min() for level in pyramid.levels])
    return Detail(tau, least)


def _grid(values: Floats, first: int, rows: int, columns: int) -> Floats:
    return values[first : first + rows * columns].reshape(rows, columns)


def level_shares(pyramid: Pyramid, detail: Detail, texel: Floats, tolerance: Floats) -> Floats:
    """How much of each level is drawn at places of an image: the definition, in plain NumPy.

    Parameters
    ----------
    texel
        Places in texels of full resolution, shape (..., 2), all inside the image.
    tolerance
        In texels of full resolution, shape (...).

    Returns
    -------
    Shares of shape (levels, ...), which sum to 1. The finest level is drawn without regard to the pixels' size: the
    caller moves the share of levels finer than the pixels to the finest that pixels can show.
    """
    with np.errstate(divide="ignore"):  # log2(0): full detail, or none at all
        x = np.log2(np.asarray(tolerance, dtype=float))
        ramps = [np.zeros(np.shape(x))]
        for number, level in enumerate(pyramid.levels[1:], start=1):
            column, row = (
                np.minimum(texel[..., axis] // (256 * 2.0**number), most - 1).astype(np.int64)
                for axis, most in ((0, level.columns), (1, level.rows))
            )
            edge = np.log2(detail.tau[level.first_page + row * level.columns + column])
            with np.errstate(invalid="ignore"):
                ramp = np.clip((edge - x) / BLEND_LEVELS, 0.0, 1.0)
            ramps.append(np.where(np.isneginf(edge), 0.0, ramp))
    ramps.append(np.ones(np.shape(x)))
    return np.diff(np.array(ramps), axis=0)
