"""OpenCV is an extra: only calibration needs it, so it is imported when first used."""

from __future__ import annotations

import importlib
import importlib.util
from functools import cache
from typing import Any

from limen.errors import InputError

__all__ = ["INSTALL", "is_installed", "load"]

INSTALL = 'pip install "opencv-python-headless>=4.7"'
"""The command that brings it; before 4.7 the markers are in another package."""


def is_installed() -> bool:
    return importlib.util.find_spec("cv2") is not None


@cache
def load() -> Any:
    """The module ``cv2`` with its markers.

    Raises
    ------
    InputError
        If it is not installed, or too old; the message holds the command that installs it.
    """
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError as error:
        raise InputError(f"calibration needs OpenCV, which is not installed ({error}): {INSTALL}") from None
    if not hasattr(getattr(cv2, "aruco", None), "ArucoDetector"):
        raise InputError(f"calibration needs OpenCV 4.7 or newer, this is {cv2.__version__}: {INSTALL}")
    return cv2
