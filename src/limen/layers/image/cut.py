"""What a selector chose for one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from limen.layers.common.page_detail import Detail

__all__ = ["PageCut"]


@dataclass(frozen=True, slots=True)
class PageCut:
    """The pages of an image that one frame needs.

    Parameters
    ----------
    pages
        Distinct page numbers, the most important first, shape (N,).
    importance
        Screen pixels that each page serves, shape (N,).
    pair_panel, pair_page
        Which page is drawn on which panel, shape (M,) each; empty where pixels look pages up for themselves.
    error_px
        The error reached: the largest texel drawn, in panel pixels, less where what it lacks is too faint to be seen as
        soon; 0 where the source has nothing finer.
    detail
        What the pages were chosen by.
    bias
        Levels that were given up everywhere to stay within the budget.
    denied
        Pages that were wanted and did not fit into the budget.
    """

    pages: NDArray[np.int64]
    importance: NDArray[np.float64]
    pair_panel: NDArray[np.int64]
    pair_page: NDArray[np.int64]
    error_px: float
    detail: Detail
    bias: int = 0
    denied: int = 0

    def __len__(self) -> int:
        return len(self.pages)
