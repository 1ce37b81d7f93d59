"""Reading and making data: images as pages of a pyramid.

What is slow to import (Numba for ``ingest`` and ``sample_image``, the image codecs for ``open``) is imported when it
is first asked for, so that ``import limen.data`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data.build import IngestReport, ingest
    from limen.data.contrast import CONTRAST_OF_BYTE, ContrastSurvey, page_contrast
    from limen.data.image import Image, ImageInfo
    from limen.data.image import open_image as open
    from limen.data.pages import GUTTER, PAGE, Level, Pyramid
    from limen.data.sample import SampleReport, sample_image

__all__ = [
    "CONTRAST_OF_BYTE",
    "GUTTER",
    "PAGE",
    "ContrastSurvey",
    "Image",
    "ImageInfo",
    "IngestReport",
    "Level",
    "Pyramid",
    "SampleReport",
    "ingest",
    "open",
    "page_contrast",
    "sample_image",
]

_HOMES = {
    "CONTRAST_OF_BYTE": ("contrast_file", "CONTRAST_OF_BYTE"),
    "ContrastSurvey": ("contrast", "ContrastSurvey"),
    "GUTTER": ("pages", "GUTTER"),
    "PAGE": ("pages", "PAGE"),
    "Image": ("image", "Image"),
    "ImageInfo": ("image", "ImageInfo"),
    "IngestReport": ("build", "IngestReport"),
    "Level": ("pages", "Level"),
    "Pyramid": ("pages", "Pyramid"),
    "SampleReport": ("sample", "SampleReport"),
    "ingest": ("build", "ingest"),
    "open": ("image", "open_image"),
    "page_contrast": ("contrast", "page_contrast"),
    "sample_image": ("sample", "sample_image"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    value = getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
