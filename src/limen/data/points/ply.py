"""Points from PLY, binary or text, whatever its properties are called.

References
----------
Turk 1994, *The PLY Polygon File Format*.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.cloud import Batch, Cloud, Stretch, stretch_of
from limen.errors import FormatError

__all__ = ["open_ply"]

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLOUR_NAMES = (
    ("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("scalar_red", "scalar_green", "scalar_blue"),
)  # fmt: skip
_NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("scalar_nx", "scalar_ny", "scalar_nz"))
_INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectance", "scalar_reflectance", "quality")
_SAMPLES, _SAMPLE_POINTS = 16, 4096


class _Header(NamedTuple):
    """What the head of a file says of its points."""

    order: str  # of bytes, "=" for text
    begin: int  # of the element's bytes in the file
    lines: int  # of text before the element
    points: int
    dtype: np.dtype[Any]  # names in small letters


class _Look(NamedTuple):
    """Which properties are what, and how they become bytes."""

    colours: tuple[str, ...]  # empty if there are none
    scale: float
    normals: tuple[str, ...]
    intensity: str  # empty if there is none
    stretch: Stretch | None


def open_ply(path: Path) -> Cloud:
    """The element of a PLY whose properties are x, y and z, among others of any names."""
    header = _header(path)
    if header.points == 0:
        raise FormatError(f"{path}: holds no points")
    look = _look(header, _sample(path, header))
    kind = "text" if header.order == "=" else "binary"
    grey = "grey, from intensity" if look.stretch else "none"
    return Cloud(
        path=path,
        format=f"PLY, {kind}",
        count=header.points,
        bounds=None,
        colours=f"{header.dtype[look.colours[0]].name}" if look.colours else grey,
        has_normals=bool(look.normals),
        has_intensity=look.stretch is not None,
        read=lambda size: ((len(rows), _batch(rows, look)) for rows in _rows(path, header, size)),
        notes=("the file does not say what its unit is",),
    )


def _header(path: Path) -> _Header:
    """Raises FormatError where the head is none, or describes nothing that can be read here."""
    with path.open("rb") as file:
        words = [line.decode("latin-1").split() for line in itertools.takewhile(_is_header, file)]
        begin = file.tell()
    order = next((_ORDERS.get(line[1]) for line in words if line[0] == "format" and len(line) > 1), None)
    if order is None:
        raise FormatError(f"{path}: its header names no format of PLY; export it again")
    lines = 0
    for line, properties in _elements(words):
        name, count = line[1], int(line[2]) if len(line) == 3 and line[2].isdecimal() else -1
        if count < 0:
            raise FormatError(f"{path}: its header has an element without a number; export it again")
        names = [each[-1].lower() for each in properties]
        fields = [(n, order + _TYPES.get(each[1], "O")) for n, each in zip(names, properties, strict=True)]
        broken = any("O" in kind for _, kind in fields)
        if {"x", "y", "z"} <= set(names):
            if broken:
                raise FormatError(f"{path}: element '{name}' has properties that are lists; export points alone")
            return _Header(order, begin, lines, count, np.dtype(fields))
        if broken and count:
            raise FormatError(f"{path}: element '{name}' lies before the points and has lists; export points alone")
        begin += count * (0 if broken else np.dtype(fields).itemsize)
        lines += count
    raise FormatError(f"{path}: none of its elements has properties x, y and z; export it again")


def _is_header(line: bytes) -> bool:
    return line.strip() != b"end_header"


def _elements(words: list[list[str]]) -> Iterator[tuple[list[str], list[list[str]]]]:
    """Every line of an element, and those of its properties."""
    body = [line for line in words if line and line[0] in ("element", "property")]
    starts = [i for i, line in enumerate(body) if line[0] == "element"]
    for start, end in itertools.pairwise([*starts, len(body)]):
        yield body[start], body[start + 1 : end]


def _rows(path: Path, header: _Header, size: int) -> Iterator[NDArray[Any]]:
    """Structured arrays of about ``size`` points."""
    return _text(path, header, size) if header.order == "=" else _binary(path, header, size)


def _binary(path: Path, header: _Header, size: int) -> Iterator[NDArray[Any]]:
    with path.open("rb") as file:
        file.seek(header.begin)
        for first in range(0, header.points, size):
            wanted = min(size, header.points - first)
            stored = file.read(wanted * header.dtype.itemsize)
            whole = len(stored) // header.dtype.itemsize
            yield np.frombuffer(stored, header.dtype, whole)
            if whole < wanted:
                return


def _text(path: Path, header: _Header, size: int) -> Iterator[NDArray[Any]]:
    width, first = len(header.dtype.names or ()), 0
    with path.open("rb") as file:
        file.seek(header.begin)
        for _ in range(header.lines):
            file.readline()
        while first < header.points:
            lines = list(itertools.islice(file, min(size, header.points - first)))
            if not lines:
                return
            numbers = np.array(b" ".join(lines).split(), dtype=np.float64)
            if len(numbers) != width * len(lines):
                raise ValueError(f"a line without {width} numbers")
            rows = np.empty(len(lines), header.dtype)
            for k, name in enumerate(header.dtype.names or ()):
                rows[name] = numbers[k::width]
            yield rows
            first += len(lines)


def _sample(path: Path, header: _Header) -> NDArray[Any]:
    """Points from all over the file; of text, from its beginning."""
    if header.order == "=":
        with contextlib.suppress(ValueError):  # whoever reads the points says what is wrong
            return next(_text(path, header, _SAMPLES * _SAMPLE_POINTS), np.empty(0, header.dtype))
        return np.empty(0, header.dtype)
    parts = []
    with path.open("rb") as file:
        each = min(_SAMPLE_POINTS, -(-header.points // _SAMPLES))
        for k in range(_SAMPLES):
            first = k * header.points // _SAMPLES
            file.seek(header.begin + first * header.dtype.itemsize)
            stored = file.read(min(each, header.points - first) * header.dtype.itemsize)
            parts.append(np.frombuffer(stored, header.dtype, len(stored) // header.dtype.itemsize))
    return np.concatenate(parts)


def _look(header: _Header, sample: NDArray[Any]) -> _Look:
    names = set(header.dtype.names or ())
    colours: tuple[str, ...] = next((each for each in _COLOUR_NAMES if set(each) <= names), ())
    normals: tuple[str, ...] = next((each for each in _NORMAL_NAMES if set(each) <= names), ())
    intensity = next((each for each in _INTENSITY_NAMES if each in names), "")
    scale = 1.0
    if colours:
        kind = header.dtype[colours[0]]
        most = max((float(np.max(sample[name], initial=0.0)) for name in colours), default=0.0)
        # Whole numbers of two bytes are 16 bits deep where one is beyond 255; broken ones are shares or bytes.
        scale = (255.0 if most <= 1.0 else 1.0) if kind.kind == "f" else 1.0 / 257.0 if most > 255 else 1.0
    values = np.asarray(sample[intensity], dtype=float) if intensity and len(sample) else np.zeros(0)
    varied = len(values) > 0 and np.nanmin(values) < np.nanmax(values)
    return _Look(colours, scale, normals, intensity, stretch_of(values) if varied else None)


def _batch(rows: NDArray[Any], look: _Look) -> Batch:
    def stacked(names: tuple[str, ...]) -> NDArray[np.float64]:
        return np.stack([np.asarray(rows[name], dtype=float) for name in names], axis=1)

    intensity = look.stretch.apply(rows[look.intensity]) if look.stretch else None
    rgb: NDArray[np.uint8] | None = None
    if look.colours:
        rgb = np.clip(np.rint(np.nan_to_num(stacked(look.colours) * look.scale)), 0, 255).astype(np.uint8)
    elif intensity is not None:
        rgb = np.repeat(intensity[:, None], 3, axis=1)
    return Batch(stacked(("x", "y", "z")), rgb, intensity, stacked(look.normals) if look.normals else None)
