"""A wall, a picture whose colours tell their place, and lenses over it."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.display.display import Display
from limen.display.panel import Panel
from limen.viewing.lens import Lens

__all__ = ["LENSES", "SIZE_PX", "picture", "wall", "waves"]

SIZE_PX = (1900, 1300)
"""Of the picture."""


def waves(texel: Any) -> Any:
    """A smooth picture whose colours tell the place: codes at texels (..., 2), counted from the image's corner."""
    x, y = texel[..., 0], texel[..., 1]
    waves = [x / 160, y / 140, (x + y) / 230, (x - y) / 310]
    return 128 + 45 * np.stack(
        [np.sin(2 * np.pi * (waves[k] + 0.3)) + np.sin(2 * np.pi * waves[3]) for k in range(3)], -1
    )


def picture() -> Any:
    x, y = np.meshgrid(np.arange(SIZE_PX[0]) + 0.5, np.arange(SIZE_PX[1]) + 0.5)
    return np.rint(waves(np.stack([x, y], axis=-1))).astype(np.uint8)


def wall() -> Display:
    """Two panels by two, without bezels."""
    width, height, pitch = 210, 150, 0.0003
    panels = [
        Panel(
            f"{column}{row}", (width, height), (column * width * pitch, 1.0 - row * height * pitch, 0.0), (1, 0, 0),
            (0, -1, 0), (pitch, pitch),
        )
        for row in range(2)
        for column in range(2)
    ]  # fmt: skip
    return Display("wall", tuple(panels))


LENSES = {
    "one": (Lens((900.0, 640.0), 280.0, 6.0),),
    "gaussian": (Lens((1000.0, 700.0), (300.0, 220.0), 3.0, 0.0, "gaussian"),),
    "rectangular": (Lens((930.0, 650.0), (200.0, 260.0), 4.0, 0.5, "quadratic", "rectangular"),),
    "table": (Lens((950.0, 650.0), 250.0, 4.0, heights=np.outer(np.hanning(9), np.hanning(12))),),
    "overlapping": (
        Lens((900.0, 600.0), 220.0, 3.0), Lens((1020.0, 700.0), 200.0, 2.5, 0.3, "linear"),
        Lens((940.0, 780.0), 150.0, 2.0, 0.5, "cosine", "rectangular"),
    ),
}  # fmt: skip
