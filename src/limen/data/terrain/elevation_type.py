"""Whether a file holds heights or a picture, without reading either."""

from __future__ import annotations

import struct
from pathlib import Path

from limen.data.store.file_type import is_tiff

__all__ = ["is_elevation", "is_terrain"]

_SUFFIXES = frozenset(
    ("adf", "asc", "bil", "bt", "dem", "dt0", "dt1", "dt2", "ers", "flt", "grd", "hgt", "img", "rst", "ter", "vrt")
)
"""Of files that hold heights, or nothing that limen could take for an image."""
_GEOGRAPHIC = 33550, 33922, 34264, 34735, 42113
"""Tags of GeoTIFF, and GDAL's for posts without data."""
_UNSIGNED, _SIGNED, _FLOAT = 1, 2, 3
_MICROSCOPY = "ImageJ=", "<?xml", "<OME"


def is_terrain(path: str | Path) -> bool:
    """Whether it is to be opened as a terrain: a folder that was made ready, or a raster of heights."""
    path = Path(path)
    return path.suffix.lower() == ".terrain" or (path.is_file() and is_elevation(path))


def is_elevation(path: Path) -> bool:
    """Whether a file holds heights rather than a picture.

    That is what formats of elevation models hold; and a TIFF with one band of signed whole numbers or floats, or of
    unsigned numbers of more than 8 bits with a georeference. (A microscope's or a camera's 16 bits have none.)
    """
    if path.suffix.lower().removeprefix(".") in _SUFFIXES:
        return True
    if path.stat().st_size == 0 or not is_tiff(path):
        return False
    import tifffile  # a third of a second that a file which is no TIFF need not wait for

    try:
        with tifffile.TiffFile(path) as tiff:
            page = tiff.pages.first
            kind, bits, tags = int(page.sampleformat), int(page.bitspersample), page.tags
            if page.samplesperpixel != 1 or bits <= 8 or page.description.startswith(_MICROSCOPY):
                return False
            return kind in (_SIGNED, _FLOAT) or (kind == _UNSIGNED and any(tag in tags for tag in _GEOGRAPHIC))
    except (tifffile.TiffFileError, ValueError, LookupError, TypeError, OSError, struct.error):
        return False  # whoever opens it as an image says what is wrong
