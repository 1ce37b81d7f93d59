"""What an observer must say of pairs whose answer is known, before anything else that it says counts."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.study.charts import CHARTS, chart
from limen.study.filters import magnified, resampled
from limen.study.kernels import drawn_level, judged, pixels_per_degree, window_px
from limen.study.observer import FAILED_JOD, Observer, light_of

__all__ = ["Control", "run_controls"]

Window = NDArray[np.uint8]

FINE_SAMPLES_PER_DEGREE = 94.0
"""What the median of people resolve (Ashraf et al. 2025): a level that keeps it must pass."""

COARSE_ARCMIN = 2.0
"""A texel twice as wide as 20/20 vision resolves: level 1 from the papers' ``Dopt``. It must fail."""

FINE_JOD = 9.99
_FINE_RANGE = (0.2, 0.8)
"""Light between which the fine level's charts lie: at black and white filters ring beyond what a display can show."""

_SIDE_PX = 544


class Control(msgspec.Struct, frozen=True):
    """A pair with a known answer: its JOD must lie from ``least`` to ``most``."""

    control: str
    content: str
    jod: float
    least: float
    most: float

    @property
    def holds(self) -> bool:
        """Whether the observer said what it must."""
        return self.least <= self.jod <= self.most


def run_controls(observer: Observer) -> list[Control]:
    """On every chart: a picture against itself, a level too fine to be told, and one too coarse to be missed."""
    rows = []
    for content in CHARTS:
        page = chart(content, (_SIDE_PX, _SIDE_PX))
        coarse = drawn_level(page, 1, "box", "bilinear")
        rows += [
            Control("identity", content, judged(observer, (page, page), 1, COARSE_ARCMIN, 0.0).jod, 10.0, 10.0),
            Control("fine", content, _fine_jod(observer, page), FINE_JOD, 10.0),
            Control("coarse", content, judged(observer, (coarse, page), 1, COARSE_ARCMIN, 0.0).jod, 0.0, FAILED_JOD),
        ]
    return rows


def _fine_jod(observer: Observer, page: Window) -> float:
    """Of level 1, halved and drawn well and not rounded to 8 bits, with the samples a degree that people resolve."""
    texel_arcmin = 60 / FINE_SAMPLES_PER_DEGREE
    low, high = _FINE_RANGE
    light = low + (high - low) * light_of(page)
    drawn = magnified(resampled(light, 2.0, "lanczos-3"), (_SIDE_PX, _SIDE_PX), "catmull-rom")
    side = window_px(texel_arcmin, 1)
    first = (_SIDE_PX - side) // 4 * 2
    middle = np.s_[first : first + side, first : first + side]
    return observer.judge_light(drawn[middle], light[middle], pixels_per_degree(texel_arcmin, 1)).jod
