"""The contrast of a page by the book, in plain NumPy."""

from __future__ import annotations

import math

import numpy as np

from limen.data.image import contrast
from limen.vision.contrast import sensitivity
from support.pictures import codes_of, light_of

__all__ = ["reference"]


def cubic(distance):
    """Keys 1981, a = -1/2, as the shader writes it."""
    x = np.minimum(np.abs(distance), 2.0)
    return np.where(x < 1.0, (1.5 * x - 2.5) * x * x + 1.0, ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0)


def upsampled(page, gutter=4):
    """Linear light (512, 512, 3) of a page with its gutter, composed on black."""
    light = light_of(composed(page))
    place = gutter + (np.arange(512) + 0.5) / 2.0 - 0.5
    matrix = cubic(np.arange(page.shape[0])[None, :] - place[:, None])
    assert np.allclose(matrix.sum(axis=1), 1.0)
    return np.clip(np.stack([matrix @ light[..., band] @ matrix.T for band in range(3)], axis=2), 0.0, 1.0)


def composed(page):
    if (page[..., 3] == 255).all():
        return page[..., :3]
    return codes_of(light_of(page[..., :3]) * (page[..., 3:] / 255.0))


def reference(image, level, column, row):
    """Contrast of one page by the book: cone contrasts, DKL, the three fits, the darkness of each texel, windows."""
    below = upsampled(image.read_page((level, column, row)))
    finer, most = image.pyramid.levels[level - 1], 0.0
    for y in (2 * row, 2 * row + 1):
        for x in (2 * column, 2 * column + 1):
            if x >= finer.columns or y >= finer.rows:
                continue
            w, h = (min(256, size - 256 * at) for size, at in zip(finer.size_px, (x, y), strict=True))
            fine = composed(image.read_page((level - 1, x, y), gutter=0))[:h, :w].astype(float)
            top, left = 256 * (y - 2 * row), 256 * (x - 2 * column)
            found = plain_contrasts(fine, below[top : top + h, left : left + w])
            white, red, violet = map(strongest_window, found, (32, 16, 16))
            with np.errstate(divide="ignore"):
                red = 10 ** (RED_POWER * (2.17939 + np.log10(red)) - 2.13475)
                violet = 10 ** (VIOLET_POWER * (1.77669 + np.log10(violet)) - 2.13475)
            most = max(most, white, red, violet)
    return min(most, 1.0)


RED_POWER, VIOLET_POWER = 0.043936 / 0.029965, 0.043936 / 0.055037


def strongest_window(contrasts, edge):
    """(h, w) to one number: a square, every 8 texels, half of it at least in the quarter, each way."""
    energy, most, half = np.minimum(contrasts, 2.0) ** 2, 0.0, edge // 2
    starts = [range(-half, 8 * -(-size // 8) - half + 1, 8) for size in energy.shape]
    for top in starts[0]:
        for left in starts[1]:
            part = energy[max(top, 0) : top + edge, max(left, 0) : left + edge]
            most = max(most, part.sum() / max(part.size, half * half))
    return math.sqrt(2.0 * most)


def plain_contrasts(fine, below):
    """Of every texel, (h, w) each: achromatic, red-green, yellow-violet."""
    low, high = light_of(np.clip(fine - 1.21, 0, 255)), light_of(np.clip(fine + 1.21, 0, 255))
    seen = ~((low <= below) & (below <= high)).all(axis=2)
    back, step = below, light_of(fine) - below
    luminance = back @ [0.21263901, 0.71516868, 0.07219232]
    frequency = np.geomspace(2.0, 60.0, 32)[:, None]
    roots, which = np.unique(np.ceil(255 * np.sqrt(luminance)) / 255, return_inverse=True)
    light = sensitivity(frequency, luminance_cd_m2=300 * (roots**2 + 0.001))
    dark = np.minimum((light / sensitivity(frequency, luminance_cd_m2=300.0)).max(axis=0), 1.0)[which]
    dark = dark.reshape(luminance.shape)
    achromatic = np.abs(step @ [0.21263901, 0.71516868, 0.07219232]) / (luminance + 0.001)
    lms = np.linalg.inv(contrast._XYZ_OF_LMS) @ contrast._XYZ_OF_RGB
    white, d, b = lms.sum(axis=1), step @ lms.T, back @ lms.T
    # The grey of the background's L + M (and of the display's black), on which the fits were measured.
    grey = ((b[..., 0] + b[..., 1]) / (white[0] + white[1]) + 0.001)[..., None] * white
    ratio = white[0] / white[1]
    along = (d[..., 0] - ratio * d[..., 1]) / (1 + ratio)  # of L, and as much less of M
    red_green = np.hypot(along / grey[..., 0], along / grey[..., 1]) / math.sqrt(3)
    short = d[..., 2] - (d[..., 0] + d[..., 1]) * white[2] / (white[0] + white[1])
    yellow_violet = np.abs(short / grey[..., 2]) / math.sqrt(3)
    # Darkness discounts the equivalent contrasts, which are powers of these.
    powers = (1.0, RED_POWER, VIOLET_POWER)
    found = zip((achromatic, red_green, yellow_violet), powers, strict=True)
    return [np.where(seen, value * dark ** (1.0 / power), 0.0) for value, power in found]
