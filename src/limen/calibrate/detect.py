"""From a photograph to the markers in it, with sub-pixel corners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from limen.calibrate.boards import dictionary
from limen.calibrate.edges import refine
from limen.calibrate.opencv import load
from limen.data.store.resample import LINEAR_OF_SRGB
from limen.errors import FormatError, InputError, MissingFileError
from limen.geometry import Floats

__all__ = ["Sighting", "detect", "look_at", "read_photo"]

_LEAST_PERIMETER = 0.008
"""Of a marker, as a share of the photograph's longer side: 32 px of a photograph of 12 megapixels."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """The markers in one photograph: their ids (M,) and corners (M, 4, 2) in pixels, in the order of the boards'."""

    photo: str
    size_px: tuple[int, int]
    ids: NDArray[np.int64]
    corners_px: Floats


def read_photo(path: Path) -> NDArray[np.uint8]:
    """Grey levels (height, width) as the sensor has them: not turned upright.

    A lens is centred on the sensor, so a photograph in portrait must not be turned as its orientation tag asks.

    Raises
    ------
    MissingFileError, FormatError
        If there is no such file, or it is no picture that OpenCV reads.
    """
    cv2 = load()
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such photograph") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    photo = cv2.imdecode(content, flags) if content.size else None
    if photo is None:
        raise FormatError(f"{path}: is no photograph that can be read; save it as JPEG or PNG")
    return np.asarray(photo, dtype=np.uint8)


def look_at(path: Path) -> Sighting:
    """Read a photograph and find its markers; there may be none.

    Raises
    ------
    MissingFileError, FormatError
        See `read_photo`.
    InputError
        If the photograph is mirrored.
    """
    photo = read_photo(path)
    ids, corners_px = detect(photo)
    if not len(ids) and len(detect(np.ascontiguousarray(photo[:, ::-1]))[0]):
        raise InputError(f"{path}: the photograph is mirrored; switch mirroring off in the camera, or mirror it back")
    return Sighting(str(path), (photo.shape[1], photo.shape[0]), ids, corners_px)


def detect(photo: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Floats]:
    """Ids (M,) and corners (M, 4, 2) of all markers of the family; those seen twice, or unclear, are left out.

    Parameters
    ----------
    photo
        Grey levels in sRGB, (height, width); the centre of the first pixel is (0, 0).
    """
    cv2 = load()
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = _LEAST_PERIMETER
    # Refined by `edges`; what OpenCV offers is up to a pixel off where a marker is seen at an angle.
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    found, numbers, _ = cv2.aruco.ArucoDetector(dictionary(), settings).detectMarkers(photo)
    if numbers is None or not len(numbers):
        return np.empty(0, dtype=np.int64), np.empty((0, 4, 2))
    ids = np.asarray(numbers, dtype=np.int64).ravel()
    corners = np.stack([np.asarray(each, dtype=float).reshape(4, 2) for each in found])
    values, counts = np.unique(ids, return_counts=True)
    once = np.isin(ids, values[counts == 1])  # a marker and its reflection: nobody knows which is which
    ids, corners = ids[once], corners[once]
    # Optics and sensors blur light, not code values: only in linear light an edge's blur is the same to both sides.
    corners = refine(LINEAR_OF_SRGB.astype(float)[photo], corners)
    clear = np.isfinite(corners).all(axis=(1, 2))
    return ids[clear], corners[clear]
