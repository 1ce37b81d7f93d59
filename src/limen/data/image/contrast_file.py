"""The contrast bytes of an image's pages as numbers and as a file beside the image.

``NAME.contrast`` holds one line of JSON (:class:`_Header`: for which file, and a checksum), one byte for each page, and
one bit for each page that says whether its byte is known. Where the image's folder cannot be written to, the file lies
in the user's cache folder. It counts only for the very file it was made from: same length, same time of change.
"""

from __future__ import annotations

import logging
import zlib
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.store.atomic import write_bytes
from limen.errors import InputError, StorageError
from limen.system import place_in_cache
from limen.vision.contrast_codes import CONTRAST_OF_CODE, code_of_contrast

__all__ = [
    "CONTRAST_OF_BYTE",
    "UNKNOWN",
    "PageBytes",
    "byte_of_contrast",
    "faint_shares",
    "read_contrast",
    "sidecar_of",
    "write_contrast",
]

_log = logging.getLogger(__name__)

Bytes = NDArray[np.uint8]

_VERSION = 2
"""To be raised whenever the bytes of the same picture would change: older files are then made anew."""


CONTRAST_OF_BYTE = CONTRAST_OF_CODE
"""(256,) the largest contrast that a byte stands for: three decades up to 1; byte 0 is less than a thousandth."""

UNKNOWN = 255
"""The byte of a page that nobody has looked at yet, or that cannot be read: it may hold anything."""


def byte_of_contrast(contrast: float) -> int:
    """The smallest byte that stands for at least this contrast; contrasts above 1 count as 1.

    >>> byte_of_contrast(0.0), byte_of_contrast(0.00099), byte_of_contrast(0.001), byte_of_contrast(0.01)
    (0, 0, 1, 86)
    """
    return 0 if contrast < CONTRAST_OF_BYTE[1] else int(code_of_contrast(min(contrast, 1.0)))


class PageBytes:
    """``bytes`` (page_count,) uint8, :data:`UNKNOWN` where ``known`` (page_count,) is false; full resolution is 0."""

    def __init__(self, pyramid: Pyramid) -> None:
        finest = pyramid.levels[0].page_count
        self.bytes: Bytes = np.full(pyramid.page_count, UNKNOWN, dtype=np.uint8)
        self.bytes[:finest] = 0  # nothing is finer
        self.known = np.arange(pyramid.page_count) < finest

    @property
    def complete(self) -> bool:
        return bool(self.known.all())


class _Header(msgspec.Struct, frozen=True, kw_only=True):
    """First line of the file."""

    kind: Literal["limen contrast"] = "limen contrast"
    version: int = _VERSION
    size: tuple[int, int]
    pages: int
    source_bytes: int
    source_mtime_ns: int
    crc32: int


def sidecar_of(path: Path) -> Path:
    """Where the bytes of an image belong: beside it."""
    return path.with_name(f"{path.name}.contrast")


def read_contrast(path: Path, pyramid: Pyramid) -> PageBytes | None:
    """The bytes stored for the image file ``path``; None where there are none that fit it. Never raises for a bad file.

    A file that is damaged, foreign or made for another state of the image is passed over, which the log tells.
    """
    for place in (sidecar_of(path), _in_cache(path)):
        try:
            if place.is_file():
                return _decoded(place.read_bytes(), path, pyramid)
        except (OSError, ValueError, msgspec.DecodeError) as error:
            _log.info("%s: is passed over (%s); the contrast of %s is found anew", place, error, path.name)
    return None


def write_contrast(path: Path, pyramid: Pyramid, pages: PageBytes) -> Path | None:
    """Store the bytes of the image file ``path`` and return where; None, and a warning, where no disk takes them."""
    problem = ""
    # An administrator may write everywhere; a folder marked read-only is left alone all the same.
    beside = path.absolute().parent.stat().st_mode & 0o222
    for place in (sidecar_of, _in_cache) if beside else (_in_cache,):
        try:
            return write_bytes(place(path), _encoded(path, pyramid, pages))
        except (OSError, StorageError, InputError) as error:
            problem = str(error)
    _log.warning("%s: the contrast of its pages cannot be kept (%s); it is found anew next time", path, problem)
    return None


def faint_shares(path: Path, pyramid: Pyramid, contrast: float = 0.01) -> list[float] | None:
    """The share of pages, at each level but the finest, whose byte stands for no more than ``contrast``.

    None where the bytes of the image file ``path`` are not stored, or not all.
    """
    pages = read_contrast(path, pyramid)
    if pages is None or not pages.complete:
        return None
    faint = pages.bytes <= int(np.searchsorted(CONTRAST_OF_BYTE, contrast, side="right")) - 1
    spans = [slice(level.first_page, level.first_page + level.page_count) for level in pyramid.levels[1:]]
    return [round(float(faint[span].mean()), 4) for span in spans]


def _in_cache(path: Path) -> Path:
    return place_in_cache(path.name, str(path.resolve()), ".contrast")


def _encoded(path: Path, pyramid: Pyramid, pages: PageBytes) -> bytes:
    payload = pages.bytes.tobytes() + np.packbits(pages.known).tobytes()
    state = path.stat()
    header = _Header(
        size=pyramid.size_px,
        pages=pyramid.page_count,
        source_bytes=state.st_size,
        source_mtime_ns=state.st_mtime_ns,
        crc32=zlib.crc32(payload),
    )
    return msgspec.json.encode(header) + b"\n" + payload


def _decoded(content: bytes, path: Path, pyramid: Pyramid) -> PageBytes:
    line, _, payload = content.partition(b"\n")
    header = msgspec.json.decode(line, type=_Header)
    state = path.stat()
    if header.version != _VERSION:
        raise ValueError(f"version {header.version}, wanted {_VERSION}")
    if (header.source_bytes, header.source_mtime_ns) != (state.st_size, state.st_mtime_ns):
        raise ValueError("the image has changed since")
    if (header.size, header.pages) != (pyramid.size_px, pyramid.page_count):
        raise ValueError("made for an image of another size")
    count = pyramid.page_count
    if len(payload) != count + -(-count // 8) or zlib.crc32(payload) != header.crc32:
        raise ValueError("damaged")
    pages = PageBytes(pyramid)
    known = np.unpackbits(np.frombuffer(payload, dtype=np.uint8, offset=count), count=count).astype(bool)
    pages.known |= known
    pages.bytes[known] = np.frombuffer(payload, dtype=np.uint8, count=count)[known]
    return pages
