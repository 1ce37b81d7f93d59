"""What is known of an image's contrast while it is still being looked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from limen.data.image.contrast import CONTRAST_OF_BYTE, ContrastSurvey
from limen.data.image.file import Image
from limen.display.display import Display
from limen.layers.common.page_detail import Detail, contrast_detail

__all__ = ["KnownContrast"]


class KnownContrast:
    """What is known of the contrast of an image's pages, and what that hides.

    The first frame that asks starts a survey in the background, unless the bytes lie beside the image; pages not
    surveyed yet count as full of contrast, so that nothing visible is ever missing.
    """

    def __init__(self, image: Image) -> None:
        self._image = image
        self._survey: ContrastSurvey | None = None
        self._known: NDArray[np.uint8] | None = None
        self._detail: Detail | None = None

    def detail(self, display: Display) -> Detail:
        """Below which tolerance each page's finer detail is seen on a display."""
        contrast = self._started().bytes
        if self._detail is None or self._known is None or not np.array_equal(contrast, self._known):
            self._known = contrast.copy()
            luminance = np.array([panel.luminance_cd_m2 for panel in display.panels])
            self._detail = contrast_detail(self._image.pyramid, CONTRAST_OF_BYTE[self._known], luminance)
        return self._detail

    def complete(self) -> None:
        """Wait until every page is surveyed."""
        self._started().run()

    def close(self) -> None:
        if self._survey is not None:
            self._survey.close()

    def _started(self) -> ContrastSurvey:
        if self._survey is None:
            self._survey = ContrastSurvey(self._image)
            self._survey.start()
        return self._survey
