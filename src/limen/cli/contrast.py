"""The survey of an image's contrast with a progress bar, for verbs that need all of it."""

from __future__ import annotations

import numpy as np

from limen.cli.output import Output
from limen.data.contrast import CONTRAST_OF_BYTE, page_contrast
from limen.data.image import Image
from limen.display.display import Display
from limen.select.detail import Detail, contrast_detail

__all__ = ["surveyed"]


def surveyed(out: Output, image: Image, display: Display) -> Detail:
    """What is too faint to be seen on a display; quick where the bytes lie beside the image already."""
    with out.progress("looking for contrast", 1000) as step:
        contrast = page_contrast(image, progress=lambda done: step.to(round(1000 * done)))
    luminance = np.array([panel.luminance_cd_m2 for panel in display.panels])
    return contrast_detail(image.pyramid, CONTRAST_OF_BYTE[contrast], luminance)
