"""LAS, LAZ and COPC through laspy and lazrs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.cloud import Batch, Cloud, Stretch, stretch_of, unreadable_cloud
from limen.errors import FormatError
from limen.geometry import Floats

__all__ = ["open_las"]

_SAMPLES, _SAMPLED_POINTS = 16, 65_536
_GEOGRAPHIC, _PROJECTED, _UNIT_KEY = 2048, 3072, 3076
"""Keys of GeoTIFF 1.1: the CRS, and its linear unit."""
_USER_DEFINED = 32767
_UNITS_M = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0}  # EPSG: metre, foot, US survey foot
_UNIT = re.compile(r'(?:LENGTH)?UNIT\["[^"]+",\s*([0-9.eE+-]+)')
_COLOURS = ("red", "green", "blue")


class _Look(NamedTuple):
    """How numbers of the file become bytes; found in a sample all over the file."""

    colours: str
    divisor: int  # of colours
    stretch: Stretch | None  # of intensities, None where all are alike


def open_las(path: Path) -> Cloud:
    """Any LAS or LAZ; points marked as withheld are left out.

    References
    ----------
    ASPRS 2019, *LAS Specification 1.4 - R15*, table 17 (withheld: vetted as deleted).
    """
    import laspy

    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:  # the parallel one unpacks whole chunks
            header = reader.header
            count = int(header.point_count)
            if count == 0:
                raise FormatError(f"{path}: holds no points")
            look = _look(reader)
            crs, unit_m = _crs(header)
            bounds = np.array([header.mins, header.maxs], dtype=float)
            version = f"LAS {header.version}, point format {header.point_format.id}"
            packed = bool(header.are_points_compressed)
    except FormatError:
        raise
    except Exception as error:  # laspy and lazrs raise what they like for a damaged file
        raise unreadable_cloud(path, "LAS", error) from error
    return Cloud(
        path=path,
        format=version + (", compressed" if packed else ""),
        count=count,
        bounds=bounds if np.isfinite(bounds).all() and (bounds[1] >= bounds[0]).all() else None,
        colours=look.colours,
        has_normals=False,
        has_intensity=look.stretch is not None,
        read=lambda size: _read(path, look, size),
        crs=crs,
        unit_m=unit_m,
        notes=() if unit_m else ("the file does not say what its unit is",),
    )


def _look(reader: Any) -> _Look:
    """Sixteen places of the file tell whether colours have 8 bits in their 16 (as some writers leave them), or none.

    Places are where compressed chunks begin: to reach another, all that stands before it in its chunk is unpacked.
    """
    header = reader.header
    names = set(header.point_format.dimension_names)
    count = int(header.point_count)
    chunk = _chunk_points(header)
    begins = [0] if chunk is None else sorted({k * count // _SAMPLES // chunk * chunk for k in range(_SAMPLES)})
    records = []
    for begin in begins:
        if begin > 0:
            reader.seek(begin)
        records.append(reader.read_points(min(-(-_SAMPLED_POINTS // len(begins)), count - begin)))
    most = max((int(np.max(record[name])) for record in records for name in _COLOURS if name in names), default=0)
    intensity = np.concatenate([np.asarray(record["intensity"]) for record in records])
    stretch = stretch_of(intensity) if intensity.min() < intensity.max() else None
    if most > 0:
        return _Look("16 bits" if most > 255 else "8 bits in fields of 16", 257 if most > 255 else 1, stretch)
    return _Look("none" if stretch is None else "grey, from intensity", 1, stretch)


def _chunk_points(header: Any) -> int | None:
    """How many points are compressed together; None where chunks vary in size, as in COPC.

    There lazrs 0.8 cannot skip: it would read what is not there.
    """
    import lazrs

    for record in header.vlrs:
        if type(record).__name__ == "LasZipVlr":
            packed = lazrs.LazVlr(record.record_data)
            return None if packed.uses_variable_size_chunks() else int(packed.chunk_size())
    return 1


def _read(path: Path, look: _Look, size: int) -> Iterator[tuple[int, Batch]]:
    import laspy

    with laspy.open(path) as reader:
        for record in reader.chunk_iterator(size):
            yield len(record), _batch(record, reader.header, look)


def _batch(record: Any, header: Any, look: _Look) -> Batch:
    keep = ~np.asarray(record["withheld"], dtype=bool)
    places = np.stack([np.asarray(record[axis]) for axis in "XYZ"], axis=1)[keep]
    positions: Floats = places * np.asarray(header.scales) + np.asarray(header.offsets)
    intensity = look.stretch.apply(np.asarray(record["intensity"])[keep]) if look.stretch else None
    rgb: NDArray[np.uint8] | None = None
    if look.colours.endswith(("bits", "16")):
        wide = np.stack([np.asarray(record[name]) for name in _COLOURS], axis=1)[keep]
        rgb = np.minimum((wide.astype(np.uint32) + look.divisor // 2) // look.divisor, 255).astype(np.uint8)
    elif intensity is not None:
        rgb = np.repeat(intensity[:, None], 3, axis=1)
    return Batch(positions, rgb, intensity, None)


def _crs(header: Any) -> tuple[str, float | None]:
    """WKT of the coordinates, or empty, and metres of their unit, or None."""
    from rasterio.crs import CRS

    records = [*header.vlrs, *(header.evlrs or [])]
    wkt = next((str(r.string).strip("\0 ") for r in records if type(r).__name__ == "WktCoordinateSystemVlr"), "")
    keys = {
        int(key.id): int(key.value_offset)
        for record in records
        if type(record).__name__ == "GeoKeyDirectoryVlr"
        for key in record.geo_keys
        if key.tiff_tag_location == 0
    }
    code = keys.get(_PROJECTED, keys.get(_GEOGRAPHIC, _USER_DEFINED))
    try:
        crs = CRS.from_wkt(wkt) if wkt else CRS.from_epsg(code) if 0 < code < _USER_DEFINED else None
        if crs is None:
            return "", _UNITS_M.get(keys.get(_UNIT_KEY, 0))
        unit_m = None if crs.is_geographic else float(crs.linear_units_factor[1])
        return wkt or str(crs.to_wkt()), unit_m
    except Exception:  # PROJ has an error of its own for each way in which a CRS can be wrong
        units = _UNIT.findall(wkt)  # of angles, if there are any, come before that of lengths
        return wkt, float(units[-1]) if units else _UNITS_M.get(keys.get(_UNIT_KEY, 0))
