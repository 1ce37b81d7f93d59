"""Pictures and reports into files: written beside, then renamed, so that nothing is ever half there."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as Picture

from limen.errors import InputError, StorageError

__all__ = ["JPEG_QUALITY", "write_atomically", "write_picture"]

JPEG_QUALITY = 90


def write_atomically(path: str | Path, write: Callable[[IO[bytes]], object]) -> Path:
    """Call ``write`` with a file beside ``path``, then put it in its place.

    Raises
    ------
    StorageError
        If the disk refuses; the message names the file and what to do. Nothing is left behind.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            write(file)
        partial.replace(path)
    except OSError as error:
        cure = "free some space" if error.errno == errno.ENOSPC else "choose another place"
        raise StorageError(f"{path}: cannot be written: {error.strerror or error}; {cure}") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_picture(path: str | Path, picture: NDArray[np.uint8]) -> Path:
    """Write uint8 (h, w, 3 or 4) sRGB as JPEG or PNG, as the name says; transparency is dropped in a JPEG.

    Raises
    ------
    InputError
        If the name ends in anything else.
    StorageError
        As in `write_atomically`.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in (".jpg", ".jpeg"):
        space = "RGBA" if picture.shape[2] == 4 else "RGB"
        data = simplejpeg.encode_jpeg(
            np.ascontiguousarray(picture), quality=JPEG_QUALITY, colorspace=space, colorsubsampling="444"
        )
        return write_atomically(path, lambda file: file.write(data))
    if suffix == ".png":
        return write_atomically(
            path, lambda file: Picture.fromarray(picture).save(file, format="PNG", compress_level=3)
        )
    raise InputError(f"{path}: a picture's name must end in .png or .jpg")
