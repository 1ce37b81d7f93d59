"""Which filters pages should be halved and drawn with: levels of charts and photographs, judged by the observer.

Content lies texel on pixel on a panel; a level of its pyramid is drawn in its stead, and both are judged as seen from
where a texel of that level subtends a given angle. Levels are rounded to 8 bits as stored pages are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data.store.resample import srgb_of_linear
from limen.errors import InputError
from limen.geometry import Floats
from limen.study.filters import magnified, resampled
from limen.study.observer import SAMPLES_PER_DEGREE, WINDOW_PX, Observer, Verdict, light_of

__all__ = ["KernelRow", "angle_that_passes", "drawn_level", "judged", "kernel_rows", "pixels_per_degree", "window_px"]

Window = NDArray[np.uint8]


class KernelRow(msgspec.Struct, frozen=True):
    """The worst window of a content: lowest JOD and largest drop, which may be of two windows."""

    halving: str
    drawing: str
    content: str
    level: int
    texel_arcmin: float
    eccentricity_deg: float
    jod: float
    drop_p99: float
    strict: bool
    practical: bool


def pixels_per_degree(texel_arcmin: float, level: int) -> float:
    """Panel pixels a degree where a texel of a level, ``2^level`` pixels, subtends an angle."""
    return 2.0**level * math.tan(math.radians(1.0)) / math.tan(math.radians(texel_arcmin / 60.0))


def window_px(texel_arcmin: float, level: int) -> int:
    """Panel pixels that make the observer's window, a multiple of the level's texel."""
    side = WINDOW_PX * max(1.0, pixels_per_degree(texel_arcmin, level) / SAMPLES_PER_DEGREE)
    texel_px: int = 2**level
    return math.floor(side / texel_px) * texel_px


def drawn_level(content: Window, level: int, halving: str, drawing: str) -> Window:
    """What a panel shows of content (H, W, 3), sides multiples of ``2^level``, at a level of its pyramid."""
    if any(side % 2**level for side in content.shape[:2]):
        raise InputError(f"sides must be multiples of {2**level} for level {level}, got {content.shape[:2]}")
    pixels = content
    for _ in range(level):
        pixels = _coded(resampled(light_of(pixels), 2.0, halving))
    return pixels if level == 0 else _coded(magnified(light_of(pixels), (content.shape[0], content.shape[1]), drawing))


def kernel_rows(
    observer: Observer,
    contents: dict[str, list[Window]],
    filters: Iterable[tuple[str, str]],
    level: int,
    texel_arcmin: float,
    eccentricity_deg: float = 0.0,
) -> Iterator[KernelRow]:
    """Judge (halving, drawing) filters on contents, of which the middle that the observer takes is judged."""
    for halving, drawing in filters:
        for content, windows in contents.items():
            pairs = [(drawn_level(window, level, halving, drawing), window) for window in windows]
            verdicts = [judged(observer, pair, level, texel_arcmin, eccentricity_deg) for pair in pairs]
            worst = Verdict(min(v.jod for v in verdicts), max(v.drop_p99 for v in verdicts))
            yield KernelRow(halving, drawing, content, level, texel_arcmin, eccentricity_deg,
                            worst.jod, worst.drop_p99, worst.strict, worst.practical)  # fmt: skip


def angle_that_passes(
    observer: Observer,
    pairs: list[tuple[Window, Window]],
    level: int,
    passes: Callable[[Verdict], bool],
    eccentricity_deg: float = 0.0,
    between_arcmin: tuple[float, float] = (0.4, 2.0),
    steps: int = 6,
) -> float:
    """The largest texel, arcminutes, at which every (drawn, content) passes; an end of the range means none or all."""
    low, high = (math.log(angle) for angle in between_arcmin)
    for _ in range(steps):
        middle = 0.5 * (low + high)
        if all(passes(judged(observer, pair, level, math.exp(middle), eccentricity_deg)) for pair in pairs):
            low = middle
        else:
            high = middle
    return math.exp(low)


def judged(
    observer: Observer, pair: tuple[Window, Window], level: int, texel_arcmin: float, eccentricity_deg: float
) -> Verdict:
    """The verdict on the middle of (drawn, content) seen from where a texel of the level subtends an angle."""
    side = window_px(texel_arcmin, level)
    shape = pair[0].shape[:2]
    if min(shape) < side:
        raise InputError(f"{side} x {side} px are judged at {texel_arcmin:g}', here are {shape[1]} x {shape[0]}")
    # Drawn before it is cut: what is judged never touches an edge where there is more to take.
    top, left = ((length - side) // 2 // 2**level * 2**level for length in shape)
    drawn, content = (window[top : top + side, left : left + side] for window in pair)
    return observer.judge(drawn, content, pixels_per_degree(texel_arcmin, level), eccentricity_deg)


def _coded(light: Floats) -> Window:
    return np.asarray(np.rint(srgb_of_linear(np.clip(light, 0.0, 1.0)) * 255), dtype=np.uint8)
