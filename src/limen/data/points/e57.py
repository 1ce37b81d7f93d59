"""E57 through pye57, an extra: all scans of a file in one frame.

References
----------
ASTM E2807-11 (2019), *Standard Specification for 3D Imaging Data Exchange*.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.cloud import Batch, Cloud, Stretch, stretch_of, unreadable_cloud
from limen.errors import FormatError

__all__ = ["open_e57"]

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
_SAMPLE_POINTS = 65_536


class _Look(NamedTuple):
    has_colours: bool
    stretch: Stretch | None


def open_e57(path: Path) -> Cloud:
    """Points of all scans, each moved to where its pose says; invalid ones are left out.

    Raises FormatError where the file is damaged or has no points, or pye57 is not installed.
    """
    try:
        import pye57
    except ImportError as error:
        raise FormatError(f"{path}: E57 needs a package; install it with: pip install 'limen[e57]'") from error
    try:
        with pye57.E57(str(path)) as file:
            headers = [file.get_header(scan) for scan in range(file.scan_count)]
            count = sum(int(header.point_count) for header in headers)
            fields = [set(header.point_fields) for header in headers if header.point_count]
            if count == 0:
                raise FormatError(f"{path}: holds no points")
            has_colours = all(set(_COLOURS) <= each for each in fields)
            stretch = _stretch(file) if all("intensity" in each for each in fields) else None
    except FormatError:
        raise
    except Exception as error:  # libE57 and its XML raise what they like
        raise unreadable_cloud(path, "E57", error) from error
    grey = "grey, from intensity" if stretch else "none"
    return Cloud(
        path=path,
        format=f"E57, {len(headers)} scans",
        count=count,
        bounds=None,
        colours="given" if has_colours else grey,
        has_normals=False,
        has_intensity=stretch is not None,
        read=lambda size: _read(path, _Look(has_colours, stretch), size),
        unit_m=1.0,  # as the standard asks for
    )


def _stretch(file: Any) -> Stretch | None:
    values = np.concatenate(
        [next(_scan(file, scan, ("intensity",), _SAMPLE_POINTS))["intensity"] for scan in range(file.scan_count)]
    )
    return stretch_of(values) if values.min() < values.max() else None


def _scan(file: Any, scan: int, wanted: tuple[str, ...], size: int) -> Iterator[dict[str, NDArray[np.float64]]]:
    """The wanted fields of one scan, as far as it has them, ``size`` points at a time; the caller's own."""
    from pye57 import libe57

    header = file.get_header(scan)
    size = min(size, int(header.point_count))
    names = [name for name in wanted if name in header.point_fields]
    arrays = {name: np.empty(size, np.float64) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name in names:
        buffers.append(libe57.SourceDestBuffer(file.image_file, name, arrays[name], size, True, True))
    reader = header.points.reader(buffers)
    while got := int(reader.read()):
        yield {name: array[:got].copy() for name, array in arrays.items()}


def _read(path: Path, look: _Look, size: int) -> Iterator[tuple[int, Batch]]:
    import pye57

    with pye57.E57(str(path)) as file:
        for scan in range(file.scan_count):
            header = file.get_header(scan)
            if header.point_count:
                for fields in _scan(file, scan, (*_CARTESIAN, *_SPHERICAL, *_COLOURS, *_INVALID, "intensity"), size):
                    yield len(next(iter(fields.values()))), _batch(header, fields, look)


def _batch(header: Any, fields: dict[str, NDArray[np.float64]], look: _Look) -> Batch:
    valid = np.ones(len(next(iter(fields.values()))), bool)
    for name in _INVALID:
        if name in fields:
            valid &= fields[name] == 0
    positions = _positions(fields)
    if header.has_pose():
        positions = positions @ np.asarray(header.rotation_matrix).T + np.asarray(header.translation)
    intensity = look.stretch.apply(fields["intensity"])[valid] if look.stretch else None
    rgb: NDArray[np.uint8] | None = None
    if look.has_colours:
        wide = np.stack([fields[name] for name in _COLOURS], axis=1) * (255.0 / _most_colour(header))
        rgb = np.clip(np.rint(wide), 0, 255).astype(np.uint8)[valid]
    elif intensity is not None:
        rgb = np.repeat(intensity[:, None], 3, axis=1)
    return Batch(positions[valid], rgb, intensity, None)


def _positions(fields: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    if _CARTESIAN[0] in fields:
        return np.stack([fields[name] for name in _CARTESIAN], axis=1)
    distance, azimuth, elevation = (fields[name] for name in _SPHERICAL)
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


def _most_colour(header: Any) -> float:
    """What the scan says is its brightest; 255 if it does not."""
    try:
        most = float(header["colorLimits"]["colorRedMaximum"].value())
    except Exception:  # libE57 raises its own error for what is not there
        return 255.0
    return most if most > 0 else 255.0
