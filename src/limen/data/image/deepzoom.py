"""Deep Zoom images in place: a small XML file and a folder of tiles beside it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvips
import simplejpeg
from numpy.typing import NDArray

from limen.data.pages import PAGE
from limen.data.store.report import one_line
from limen.errors import FormatError

__all__ = ["DeepZoomLevel", "open_deepzoom"]

Texels = NDArray[np.uint8]

_LARGEST_XML_BYTES = 1 << 16
_SAMPLED_TILES = 256


@dataclass(frozen=True, slots=True)
class DeepZoomLevel:
    """One folder of tiles; neighbouring tiles share ``overlap_px`` texels, which are cut off when decoding."""

    folder: Path
    suffix: str
    size_px: tuple[int, int]
    scale: tuple[float, float]
    tile_px: tuple[int, int]
    overlap_px: int

    def decode(self, column: int, row: int) -> Texels:
        data = (self.folder / f"{column}_{row}{self.suffix}").read_bytes()
        rgba = _decode(data)
        x, y = (self.overlap_px if column else 0), (self.overlap_px if row else 0)
        w = min(self.tile_px[0], self.size_px[0] - column * self.tile_px[0])
        h = min(self.tile_px[1], self.size_px[1] - row * self.tile_px[1])
        part = rgba[y : y + h, x : x + w]
        if part.shape[:2] != (h, w):
            raise ValueError(f"it holds {rgba.shape[1]} x {rgba.shape[0]} texels, {x + w} x {y + h} are wanted")
        return part

    def mean_page_bytes(self) -> float:
        """Mean stored bytes of a page's area, from at most 256 tiles evenly spread."""
        columns, rows = (-(-size // tile) for size, tile in zip(self.size_px, self.tile_px, strict=True))
        step = max(1, columns * rows // _SAMPLED_TILES)
        sizes = [
            path.stat().st_size
            for index in range(0, columns * rows, step)
            if (path := self.folder / f"{index % columns}_{index // columns}{self.suffix}").exists()
        ]
        return (sum(sizes) / max(1, len(sizes))) * PAGE * PAGE / (self.tile_px[0] * self.tile_px[1])


def _decode(data: bytes) -> Texels:
    if data[:2] == b"\xff\xd8":
        rgba: Texels = simplejpeg.decode_jpeg(data, colorspace="RGBA")
        return rgba
    try:
        image = pyvips.Image.new_from_buffer(data, "", fail_on="error").colourspace("srgb").cast("uchar")
        if image.bands == 3:
            image = image.bandjoin(255)
        return np.ndarray(shape=(image.height, image.width, 4), dtype=np.uint8, buffer=image.write_to_memory())
    except (pyvips.Error, TypeError) as error:
        raise ValueError(one_line(error)) from error


def open_deepzoom(path: Path) -> list[DeepZoomLevel]:
    """Levels of a ``.dzi`` file, finest first; FormatError says which part of it is wrong."""
    width, height, tile, overlap, suffix = _parse(path)
    files = path.with_name(path.stem + "_files")
    if not files.is_dir():
        raise FormatError(f"{path}: its folder of tiles {files.name} is missing; copy it beside the file")
    levels: list[DeepZoomLevel] = []
    top = (max(width, height) - 1).bit_length()  # level 0 of the folder is one texel
    for power in range(top + 1):
        size = (-(-width // 2**power), -(-height // 2**power))
        folder = files / str(top - power)
        if folder.is_dir():
            levels.append(DeepZoomLevel(folder, suffix, size, (2.0**power, 2.0**power), (tile, tile), overlap))
        if max(size) <= PAGE:
            break
    if not levels or levels[0].size_px != (width, height):
        raise FormatError(f"{path}: the folder {files.name}/{top} of its finest level is missing; copy it again")
    return levels


def _parse(path: Path) -> tuple[int, int, int, int, str]:
    text = path.read_bytes()[: _LARGEST_XML_BYTES + 1]
    if len(text) > _LARGEST_XML_BYTES or b"<!" in text.replace(b"<!--", b""):
        # Document type declarations can make a parser read other files or grow without bound; Deep Zoom has none.
        raise FormatError(f"{path}: is not a Deep Zoom description (a short XML file without declarations)")
    try:
        root = ElementTree.fromstring(text)
        size = next(child for child in root if child.tag.rpartition("}")[2] == "Size")
        numbers = (int(size.attrib["Width"]), int(size.attrib["Height"]), int(root.attrib["TileSize"]))
        overlap, suffix = int(root.attrib["Overlap"]), root.attrib["Format"]
    except (ElementTree.ParseError, KeyError, ValueError, StopIteration) as error:
        reason = str(error) or "no Size"
        raise FormatError(f"{path}: cannot be read as Deep Zoom: {reason}; export it again") from error
    if min(numbers) < 1 or overlap < 0 or not re.fullmatch(r"[A-Za-z0-9]{1,8}", suffix):
        raise FormatError(f"{path}: its sizes or its tile format {suffix!r} cannot be meant; export it again")
    return (*numbers, overlap, "." + suffix)
