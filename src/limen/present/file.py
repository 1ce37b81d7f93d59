"""Pictures and reports into files, each complete or not there."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as Picture

from limen.data.partial import PartialFile, is_disk_full
from limen.errors import InputError, LimenError, StorageError

__all__ = ["JPEG_QUALITY", "write_bytes", "write_picture"]

JPEG_QUALITY = 90


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file in a folder that is made if need be; returns the path.

    Raises
    ------
    StorageError
        If the disk refuses; the message names the file and what to do. Nothing is left behind.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with PartialFile(path) as file:
            file.write(content)
    except LimenError:
        raise
    except OSError as error:
        cure = "free some space" if is_disk_full(error) else "choose another place"
        raise StorageError(f"{path}: cannot be written: {error.strerror or error}; {cure}") from error
    return path


def write_picture(path: str | Path, picture: NDArray[np.uint8]) -> Path:
    """Write uint8 (h, w, 3 or 4) sRGB as JPEG or PNG, as the name says; transparency is dropped in a JPEG.

    Raises
    ------
    InputError
        If the name ends in anything else.
    StorageError
        As in `write_bytes`.
    """
    path = Path(path)
    picture = np.ascontiguousarray(picture)
    match path.suffix.lower():
        case ".jpg" | ".jpeg":
            space = "RGBA" if picture.shape[2] == 4 else "RGB"
            content = simplejpeg.encode_jpeg(picture, quality=JPEG_QUALITY, colorspace=space, colorsubsampling="444")
        case ".png":
            file = io.BytesIO()
            Picture.fromarray(picture).save(file, format="PNG", compress_level=3)
            content = file.getvalue()
        case _:
            raise InputError(f"{path}: a picture's name must end in .png or .jpg")
    return write_bytes(path, content)
