"""Pictures and reports into files, each complete or not there."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as Picture

from limen.data.store.atomic import write_bytes
from limen.errors import InputError, StorageError

__all__ = ["JPEG_QUALITY", "check_picture_name", "file_stem", "write_picture"]

JPEG_QUALITY = 90


def file_stem(name: str) -> str:
    """The name of a panel or an output as a file may have it: nothing that is called so leaves its folder."""
    return name.replace("/", "-")


def check_picture_name(path: str | Path) -> None:
    """Refuse a name before the work that fills the picture.

    Raises
    ------
    InputError
        If `write_picture` cannot write a file of this name.
    """
    if Path(path).suffix.lower() not in (".jpg", ".jpeg", ".png"):
        raise InputError(f"{path}: a picture's name must end in .png or .jpg")


def write_picture(path: str | Path, picture: NDArray[np.uint8]) -> Path:
    """Write uint8 (h, w, 3 or 4) sRGB as JPEG or PNG, as the name says; transparency is dropped in a JPEG.

    The folder is made if need be.

    Raises
    ------
    InputError
        If the name ends in anything else.
    StorageError
        If the disk refuses.
    """
    check_picture_name(path)
    path = Path(path)
    picture = np.ascontiguousarray(picture)
    match path.suffix.lower():
        case ".jpg" | ".jpeg":
            space = "RGBA" if picture.shape[2] == 4 else "RGB"
            content = simplejpeg.encode_jpeg(picture, quality=JPEG_QUALITY, colorspace=space, colorsubsampling="444")
        case _:
            file = io.BytesIO()
            Picture.fromarray(picture).save(file, format="PNG", compress_level=3)
            content = file.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{path.parent}: cannot be made: {error.strerror}; choose another folder") from error
    return write_bytes(path, content)


def thumbnail(picture: NDArray[np.uint8], width_px: int = 160) -> NDArray[np.uint8]:
    """Every n-th pixel: enough for a picture of the room. Shape (h, w, ...), about ``width_px`` wide."""
    step = max(1, picture.shape[1] // width_px)
    return picture[::step, ::step].copy()
