"""The light that nodes send, and the code of a contrast between two lights."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.nodes import CHUNK_POINTS, LEVEL_BEGIN
from limen.vision.contrast_codes import CONTRAST_OF_CODE

__all__ = ["BRIGHTER", "DARKER", "code_of", "light_of", "luminance_ranges"]

_SAFE = 1.0 + 1e-6
"""Luminances are float32."""

_TABLE_BITS = np.arange(0x3F81, dtype=np.uint32) << 16  # the upper half of float32, from 0 to 1
_LEAST_CODES = np.searchsorted(CONTRAST_OF_CODE, _TABLE_BITS.view(np.float32)).astype(np.uint8)
"""The code of the least contrast whose float32 begins with so many bits."""

with np.errstate(divide="ignore"):
    DARKER = ((1.0 - CONTRAST_OF_CODE) / (1.0 + CONTRAST_OF_CODE) * _SAFE).astype(np.float32)
    BRIGHTER = ((1.0 + CONTRAST_OF_CODE) / (1.0 - CONTRAST_OF_CODE) / _SAFE).astype(np.float32)
"""Times a luminance, what has the contrast of a code to it."""


@compiled(error_model="python")
def light_of(nodes: Any, chunk: int, node: int, channels: Any, dark: float) -> float:
    light: float = (
        np.float32(dark)
        + channels[0, nodes[chunk, node, 12]]
        + channels[1, nodes[chunk, node, 13]]
        + channels[2, nodes[chunk, node, 14]]
    )
    return light


@compiled(error_model="python")
def luminance_ranges(nodes: Any, points: int, channels: Any, dark: float, ranges: Any) -> None:
    """Lowest and highest luminance of the points of chunks: ``ranges`` (C, 2) float32, in cd/m2.

    ``nodes`` (C, 4681, 16) uint8 are consecutive chunks with ``points`` points, ``channels`` (3, 256) float32.
    """
    for chunk in range(nodes.shape[0]):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for i in range(min(CHUNK_POINTS, points - chunk * CHUNK_POINTS)):
            light = light_of(nodes, chunk, LEVEL_BEGIN[0] + i, channels, dark)
            low, high = min(low, light), max(high, light)
        ranges[chunk, 0], ranges[chunk, 1] = low, high


@compiled(error_model="python")
def code_of(shown: float, low: float, high: float) -> int:
    """The smallest code of `limen.vision.contrast_codes` that is no less than the larger contrast of ``shown``."""
    contrast = 0.0
    if shown + low > 0.0:
        contrast = abs(shown - low) / (shown + low)
    if shown + high > 0.0:
        contrast = max(contrast, abs(shown - high) / (shown + high))
    contrast = min(contrast * _SAFE, 1.0)
    code = int(_LEAST_CODES[np.float32(contrast).view(np.int32) >> 16])
    while CONTRAST_OF_CODE[code] < contrast:
        code += 1
    while code > 0 and CONTRAST_OF_CODE[code - 1] >= contrast:  # float32 was rounded up
        code -= 1
    return code
