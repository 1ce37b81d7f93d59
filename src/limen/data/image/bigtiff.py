"""Writing a tiled BigTIFF whose tiles arrive in any order of levels: tiles first, directories last.

Every level is a page of its own in one chain, the reduced ones marked as such: the layout that libvips, tifffile,
GDAL (as overviews), OpenSlide and QuPath all read. Reference: TIFF 6.0 (1992), the BigTIFF extension (2004) and, for
tables shared between JPEG tiles, TIFF Technical Note 2 (1995).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import BinaryIO

import imagecodecs
import numpy as np
import simplejpeg
from numpy.typing import NDArray

__all__ = ["SOFTWARE", "BigTiffWriter", "DeflateTiles", "JpegTiles", "TileCoder"]

SOFTWARE = "limen"
"""The tag Software of our files: their levels need no look at how they were made."""

Texels = NDArray[np.uint8]
Tag = tuple[int, int, Sequence[int] | bytes]

_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL, _UNDEFINED, _LONG8 = 1, 2, 3, 4, 5, 7, 16
_FORMATS = {_SHORT: "H", _LONG: "I", _RATIONAL: "I", _LONG8: "Q"}
_DQT, _DHT, _APP0, _SOS = 0xDB, 0xC4, 0xE0, 0xDA


class JpegTiles:
    """Three bands as JPEG in YCbCr. All tiles have the same tables, which are stored once in the directory."""

    bands = 3

    def __init__(self, quality: int = 90, subsampling: str = "444") -> None:
        self.quality, self.subsampling = quality, subsampling
        blank = np.zeros((16, 16, 3), dtype=np.uint8)
        self._tables, _ = _split_jpeg(self._whole(blank))

    def encode(self, tile: Texels) -> bytes:
        """``tile`` (256, 256, 3), contiguous."""
        return _split_jpeg(self._whole(tile))[1]

    def tags(self) -> list[Tag]:
        across, down = {"444": (1, 1), "422": (2, 1), "420": (2, 2)}[self.subsampling]
        return [
            (258, _SHORT, (8, 8, 8)),
            (259, _SHORT, (7,)),
            (262, _SHORT, (6,)),
            (277, _SHORT, (3,)),
            (347, _UNDEFINED, self._tables),
            (530, _SHORT, (across, down)),
            (532, _RATIONAL, (0, 1, 255, 1, 128, 1, 255, 1, 128, 1, 255, 1)),
        ]

    def _whole(self, tile: Texels) -> bytes:
        data: bytes = simplejpeg.encode_jpeg(tile, self.quality, "RGB", self.subsampling)
        return data


class DeflateTiles:
    """Four bands without loss, for what JPEG cannot hold: opacity."""

    bands = 4

    def encode(self, tile: Texels) -> bytes:
        """``tile`` (256, 256, 4)."""
        steps = tile.copy()
        steps[:, 1:] -= tile[:, :-1]  # the horizontal predictor of TIFF, modulo 256
        return bytes(imagecodecs.deflate_encode(steps.tobytes(), level=6))

    def tags(self) -> list[Tag]:
        return [
            (258, _SHORT, (8, 8, 8, 8)),
            (259, _SHORT, (8,)),
            (262, _SHORT, (2,)),
            (277, _SHORT, (4,)),
            (317, _SHORT, (2,)),
            (338, _SHORT, (2,)),
        ]


TileCoder = JpegTiles | DeflateTiles


def _split_jpeg(data: bytes) -> tuple[bytes, bytes]:
    """(tables only, image without them) of a JPEG, both with start and end markers; the JFIF header is dropped."""
    tables, image = [data[:2]], [data[:2]]
    at = 2
    while True:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        segment = data[at : at + 2 + length]
        if marker in (_DQT, _DHT):
            tables.append(segment)
        elif marker != _APP0:
            image.append(segment)
        at += 2 + length
        if marker == _SOS:
            return b"".join(tables) + b"\xff\xd9", b"".join(image) + data[at:]


class BigTiffWriter:
    """Writes a BigTIFF. Tiles of one level must come row by row; tiles of different levels may interleave."""

    def __init__(self, file: BinaryIO, coder: TileCoder, tile_px: int) -> None:
        self._file = file
        self._coder, self._tile_px = coder, tile_px
        self._offsets: list[list[int]] = []
        self._counts: list[list[int]] = []
        self._at = 16
        self._file.write(struct.pack("<2sHHHQ", b"II", 43, 8, 0, 0))

    @property
    def bytes_written(self) -> int:
        return self._at

    def add(self, level: int, tile: bytes) -> None:
        """Append one encoded tile."""
        while len(self._offsets) <= level:
            self._offsets.append([])
            self._counts.append([])
        self._offsets[level].append(self._at)
        self._counts[level].append(len(tile))
        self._file.write(tile)
        self._at += len(tile)

    def finish(self, sizes_px: Sequence[tuple[int, int]], software: str) -> None:
        """Write the directories of all levels, finest first, and point the header at the first."""
        link = 8  # where the header holds the first directory's position
        for level, size_px in enumerate(sizes_px):
            position = self._at + (-self._at) % 8
            directory = self._directory(level, size_px, software, position)
            self._file.write(b"\0" * (position - self._at) + directory)
            self._at = position + len(directory)
            end = self._file.tell()
            self._file.seek(link)
            self._file.write(struct.pack("<Q", position))
            self._file.seek(end)
            link = position + 8 + 20 * struct.unpack_from("<Q", directory)[0]
        self._file.flush()

    def _directory(self, level: int, size_px: tuple[int, int], software: str, position: int) -> bytes:
        tags: list[Tag] = [
            (254, _LONG, (1 if level else 0,)),
            (256, _LONG, (size_px[0],)),
            (257, _LONG, (size_px[1],)),
            (284, _SHORT, (1,)),
            (305, _ASCII, software.encode() + b"\0"),
            (322, _LONG, (self._tile_px,)),
            (323, _LONG, (self._tile_px,)),
            (324, _LONG8, self._offsets[level]),
            (325, _LONG, self._counts[level]),
            *self._coder.tags(),
        ]
        tags.sort()
        entries, values = [struct.pack("<Q", len(tags))], b""
        behind = position + 8 + 20 * len(tags) + 8  # entries, then the link to the next directory, then long values
        for tag, kind, value in tags:
            packed = value if isinstance(value, bytes) else struct.pack(f"<{len(value)}{_FORMATS[kind]}", *value)
            count = len(value) // 2 if kind == _RATIONAL else len(value)
            if len(packed) <= 8:
                entries.append(struct.pack("<HHQ8s", tag, kind, count, packed))
            else:
                entries.append(struct.pack("<HHQQ", tag, kind, count, behind + len(values)))
                values += packed + b"\0" * (-len(packed) % 8)
        return b"".join(entries) + struct.pack("<Q", 0) + values
