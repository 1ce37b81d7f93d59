"""Content that costs nothing to read, so that only our own work is timed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import GUTTER, PAGE, Pyramid

__all__ = ["Blank"]


@dataclass(frozen=True)
class Blank:
    """Pages of a virtual image."""

    pyramid: Pyramid
    path = Path("blank")
    page = np.zeros((PAGE + 2 * GUTTER, PAGE + 2 * GUTTER, 4), dtype=np.uint8)

    def read_page(self, _page: int) -> NDArray[np.uint8]:
        return self.page
