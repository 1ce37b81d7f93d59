"""Test charts: what shows a renderer's errors, from the hardest (text, noise) to the easiest (photographs).

References
----------
Lee, Mumford, Huang 2001, "Occlusion models for natural images", Int. J. Computer Vision 41 (dead leaves: discs with
radii distributed like ``r^-3`` that hide one another have the edges and the 1 / f^2 power of photographs).
Field 1987, "Relations between the statistics of natural images and the response properties of cortical cells", J.
Optical Society of America A 4 (natural images' amplitude falls with 1 / f).
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from limen.data.store.resample import linear_of_srgb, srgb_of_linear
from limen.errors import InputError
from limen.study.filters import resampled

__all__ = ["CHARTS", "chart"]

Window = NDArray[np.uint8]

_FONT_SIZES_PX = (9, 11, 14, 18, 24, 36)
_WORDS = """the of and to in a is that for it as was with be by on not he his but at are this have from or had an they
which one you were all her she there would their we him been has when who will no more if out so up said what its about
than into them can only other time new some could these two may first then do any like my now over such our man me even
most made after also did many fly jug quiz box vex gypsum Wall Panel Level Acuity 1984 2013 3.14"""


def chart(name: str, size_px: tuple[int, int], seed: int = 0) -> Window:
    """A chart of `CHARTS` as sRGB (H, W, 3), uint8; ``size_px`` is (width, height). The same seed, the same picture.

    Raises
    ------
    InputError
        If there is no chart of that name, or a side is not positive.
    """
    if name not in CHARTS:
        raise InputError(f"no chart is named '{name}': there are {', '.join(CHARTS)}")
    if min(size_px) < 1:
        raise InputError(f"a chart's sides must be at least 1 px, got {size_px[0]} x {size_px[1]}")
    return CHARTS[name](size_px, seed)


def _text(size_px: tuple[int, int], seed: int) -> Window:
    """A page of words, black on white, in sizes from fine print to headlines."""
    draw_from, words = random.Random(seed), _WORDS.split()
    page = Picture.new("L", size_px, 255)
    pen = ImageDraw.Draw(page)
    top = -draw_from.randrange(max(_FONT_SIZES_PX))
    while top < size_px[1]:
        size = draw_from.choice(_FONT_SIZES_PX)
        # Basic layout: where Pillow finds FriBiDi it sets the same words in another way, and the page would differ.
        font = ImageFont.truetype(str(_font_file()), size, layout_engine=ImageFont.Layout.BASIC)
        left = float(-draw_from.randrange(4 * size))
        while left < size_px[0]:
            word = draw_from.choice(words) + " "
            pen.text((left, top), word, fill=0, font=font)
            left += font.getlength(word)
        top += round(1.25 * size)
    return _grey(np.asarray(page))


def _font_file() -> Path:
    """DejaVu Sans, which comes with Matplotlib."""
    import matplotlib

    return Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"


def _noise(size_px: tuple[int, int], seed: int) -> Window:
    """Black and white by the toss of a coin for every pixel."""
    return _grey(np.random.default_rng(seed).integers(0, 2, (size_px[1], size_px[0]), dtype=np.uint8) * np.uint8(255))


def _grating(size_px: tuple[int, int], seed: int) -> Window:
    """Black and white lines of one pixel, across in the left half and down in the right one."""
    across, down = np.indices((size_px[1], size_px[0]))
    lines = np.where(down < size_px[0] // 2, across, down)
    return _grey(((lines + seed) % 2 * 255).astype(np.uint8))


def _pink(size_px: tuple[int, int], seed: int) -> Window:
    """Grey noise whose amplitude falls with 1 / f."""
    return _grey(np.rint(np.clip(0.5 + 0.18 * _pink_field(size_px, seed), 0, 1) * 255).astype(np.uint8))


def _pink_field(size_px: tuple[int, int], seed: int) -> NDArray[np.float64]:
    """Mean 0, standard deviation 1, shape (H, W)."""
    shape = (size_px[1], size_px[0])
    white = np.fft.rfft2(np.random.default_rng(seed).standard_normal(shape))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :])
    frequency[0, 0] = np.inf
    field = np.fft.irfft2(white / frequency, s=shape)
    return np.asarray((field - field.mean()) / max(float(field.std()), 1e-12))


def _leaves(size_px: tuple[int, int], seed: int) -> Window:
    """Coloured discs of all sizes that hide one another, shaded softly: a photograph's edges and spectrum."""
    finer, least_px, most_px = 3, 1.0, 0.25 * max(size_px)
    width, height = (side * finer for side in size_px)
    rng = np.random.default_rng(seed)
    # Twice as many as would cover the picture by area alone: nothing of the ground is left to see.
    mean_area = math.pi * 2 * least_px**2 * math.log(most_px / least_px) if most_px > least_px else math.pi
    count = max(1, round(12 * size_px[0] * size_px[1] / mean_area))
    radii = finer / np.sqrt(rng.uniform(min(most_px, 1e9) ** -2.0, least_px**-2.0, count))
    centres = rng.uniform((-most_px * finer,) * 2, (width + most_px * finer, height + most_px * finer), (count, 2))
    colours = np.clip(rng.normal(0.42, 0.2, (count, 1)) + rng.normal(0, 0.06, (count, 3)), 0, 1)
    picture = Picture.new("RGB", (width, height))
    pen = ImageDraw.Draw(picture)
    for (x, y), radius, colour in zip(centres.tolist(), radii.tolist(), (colours * 255).astype(int), strict=True):
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=tuple(colour.tolist()))
    light = resampled(linear_of_srgb(np.asarray(picture) / 255.0), float(finer), "mitchell")
    light = light * np.exp(0.25 * _pink_field(size_px, seed))[..., None]
    return np.asarray(np.rint(srgb_of_linear(np.clip(light, 0, 1)) * 255), dtype=np.uint8)


def _grey(plane: NDArray[np.uint8]) -> Window:
    return np.repeat(plane[..., None], 3, axis=2)


CHARTS: dict[str, Callable[[tuple[int, int], int], Window]] = {
    "photograph": _leaves,
    "text": _text,
    "noise": _noise,
    "grating": _grating,
    "pink": _pink,
}
"""Charts by name: dead leaves, a page of text, binary noise, one-pixel lines, 1 / f noise."""
