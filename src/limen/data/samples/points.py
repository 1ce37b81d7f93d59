"""A cloud of points of any size: an imaginary hall, scanned from four places by a laser that sees what a laser sees.

Points lie dense near the scanners and sparse far off, columns throw shadows, and ranges are a little noisy. Every block
of points is a pure function of its number and the seed.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.samples.seeds import check_seed
from limen.data.store.atomic import partial_file
from limen.data.store.ingest import Progress
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport, one_line
from limen.data.store.resample import srgb_of_linear
from limen.errors import InputError, StorageError
from limen.geometry import Floats

__all__ = ["HALL_POINTS", "sample_points", "scanned_hall"]

HALL_POINTS = 1_000_000

_MOST_POINTS = 10_000_000_000
_BLOCK = 1 << 16
_SIZE_M = np.array([30.0, 18.0, 8.0])
_STATIONS_M = np.array([[6.0, 5.0, 1.7], [24.0, 5.5, 1.7], [15.0, 13.0, 1.7], [15.0, 4.0, 1.7]])
_COLUMNS_M = np.array([(4.0 + 4.4 * i, y) for i in range(6) for y in (3.0, 15.0)])
_COLUMN_RADIUS_M = 0.45
_SPHERES = 5
_RANGE_NOISE_M = 0.002
_LAMP_M = np.array([15.0, 9.0, 7.5])
_GOLDEN_TURN = np.pi * (3.0 - 5.0**0.5)
_SCALE_M = 1e-4
"""Of coordinates in LAS: a tenth of a millimetre."""

_LOCAL_METRES = 'LOCAL_CS["limen sample hall",UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["X",EAST],AXIS["Y",NORTH]]'


class Scanned(NamedTuple):
    """A block of points of the hall, in metres, z up."""

    positions: Floats  # (N, 3)
    rgb: NDArray[np.uint8]  # (N, 3)
    normals: Floats  # (N, 3), towards the scanner's side
    intensity: NDArray[np.uint8]  # (N,): what came back of the laser's light


def sample_points(
    path: str | Path, size: int = HALL_POINTS, seed: int = 0, progress: Progress | None = None
) -> IngestReport:
    """Scan the hall number ``seed`` into a LAS, a LAZ or a PLY (which also keeps normals), as the name says.

    The same bytes on every run; memory does not grow with ``size``, the number of points.

    Raises
    ------
    InputError
        If the name ends in none of these, or the size or the seed cannot be meant.
    StorageError
        If the disk refuses.
    """
    path = Path(path)
    writers = {".las": _write_las, ".laz": _write_las, ".ply": _write_ply}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: the sample is a LAS, LAZ or PLY; give it a name that ends in .las, .laz or .ply")
    _check(size, seed)
    tell = progress or (lambda _: None)
    with Footprint() as used, partial_file(path) as file:
        writers[path.suffix.lower()](file, size, _told(scanned_hall(size, seed), size, tell), path)
    return IngestReport.of("points", path, used, size=size, seed=seed)


def scanned_hall(points: int, seed: int = 0) -> Iterator[Scanned]:
    """The points of the hall, a quarter of them from each station, in blocks.

    Raises InputError if the size or the seed cannot be meant.
    """
    _check(points, seed)
    spheres = _spheres(seed)
    for begin in range(0, points, _BLOCK):
        number = np.arange(begin, min(begin + _BLOCK, points))
        station = number * len(_STATIONS_M) // points
        first = -(-station * points // len(_STATIONS_M))
        each = -(-(station + 1) * points // len(_STATIONS_M)) - first
        # A spiral of even steps around the sphere, turned a little for each station.
        z = 1.0 - (2.0 * (number - first) + 1.0) / each
        turn = _GOLDEN_TURN * (number - first) + station
        across = np.sqrt(1.0 - z * z)
        direction = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
        chance = np.random.default_rng([seed, begin, 0x68616C6C])
        yield _scan(_STATIONS_M[station], direction, spheres, chance)


def _check(points: int, seed: int) -> None:
    if not 1 <= points <= _MOST_POINTS:
        raise InputError(f"a sample cloud has 1 to {_MOST_POINTS:,} points, not {points}")
    check_seed(seed)


def _spheres(seed: int) -> Floats:
    """Centres and radii (5, 4) of balls on the floor, other ones for each seed, clear of columns and scanners."""
    chance = np.random.default_rng([seed, 0x62616C6C])
    taken = np.concatenate([_COLUMNS_M, _STATIONS_M[:, :2]])
    found: list[NDArray[Any]] = []
    while len(found) < _SPHERES:
        radius = chance.uniform(0.4, 1.1)
        place = chance.uniform([1.5, 1.5], _SIZE_M[:2] - 1.5)
        others = np.concatenate([taken, *(each[None, :2] for each in found)])
        if np.linalg.norm(others - place, axis=1).min() > radius + 1.2:
            found.append(np.array([*place, radius, radius]))
    return np.array(found)


def _scan(origin: Floats, direction: Floats, spheres: Floats, chance: np.random.Generator) -> Scanned:
    distance, normal, kind = _walls(origin, direction)
    for x, y in _COLUMNS_M:
        offset = (origin - np.array([x, y, 0.0]))[:, :2]
        hit = _entry(offset, direction[:, :2], _COLUMN_RADIUS_M)
        nearer = hit < distance
        side = (offset[nearer] + hit[nearer, None] * direction[nearer, :2]) / _COLUMN_RADIUS_M
        normal[nearer] = np.pad(side, ((0, 0), (0, 1)))
        distance[nearer], kind[nearer] = hit[nearer], 3
    for number, (x, y, z, radius) in enumerate(spheres):
        offset = origin - np.array([x, y, z])
        hit = _entry(offset, direction, radius)
        nearer = hit < distance
        normal[nearer] = (offset[nearer] + hit[nearer, None] * direction[nearer]) / radius
        distance[nearer], kind[nearer] = hit[nearer], 4 + number
    facing = np.abs((normal * direction).sum(axis=1))
    place = origin + direction * distance[:, None]
    rgb = _coloured(place, normal, kind)
    echo = np.clip(255.0 * facing / (1.0 + (distance / 12.0) ** 2), 0, 255).astype(np.uint8)
    noisy = place + direction * chance.normal(0.0, _RANGE_NOISE_M, len(place))[:, None]
    return Scanned(noisy, rgb, normal, echo)


def _walls(origin: Floats, direction: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Distances to the box from inside, normals inward, and kinds: 0 floor, 1 ceiling, 2 wall."""
    with np.errstate(divide="ignore"):
        exits = np.where(direction > 0, _SIZE_M - origin, -origin) / direction
    exits = np.where(direction == 0, np.inf, exits)
    axis = exits.argmin(axis=1)
    every = np.arange(len(axis))
    sign = -np.sign(direction[every, axis])
    normal = np.zeros_like(direction)
    normal[every, axis] = sign
    kind = np.where(axis == 2, np.where(sign > 0, 0, 1), 2)
    return exits[every, axis], normal, kind


def _entry(offset: Floats, direction: Floats, radius: float) -> Floats:
    """How far to a circle (2 axes) or a sphere (3) at the origin; infinite where it is missed."""
    a = (direction * direction).sum(axis=1)
    half_b = (offset * direction).sum(axis=1)
    inside = half_b * half_b - a * ((offset * offset).sum(axis=1) - radius * radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        hit = (-half_b - np.sqrt(inside)) / a
    return np.where((inside > 0) & (hit > 0), hit, np.inf)


def _coloured(place: Floats, normal: Floats, kind: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Colours of what is there, times the light of one lamp: sRGB (N, 3)."""
    x, y, z = place.T
    slab = (np.floor(x / 1.5) + np.floor(y / 1.5)) % 2
    vein = 0.5 + 0.5 * np.sin(7.0 * x + 3.0 * np.sin(5.0 * y) + 2.0 * np.sin(11.0 * x * y / 9.0))
    floor = np.stack([0.25 + 0.4 * slab + 0.1 * vein] * 3, axis=1) * [1.0, 0.95, 0.85]
    along = np.where(np.abs(normal[:, 0]) > 0.5, y, x)
    fresco = 0.5 + 0.5 * np.sin(along[:, None] * [0.9, 1.3, 1.9] + z[:, None] * [1.7, 0.8, 1.1])
    joint = ((z % 0.6 < 0.02) | ((along + 0.45 * np.floor(z / 0.6)) % 0.9 < 0.02))[:, None]
    wall = np.where((z > 2.4)[:, None], 0.15 + 0.6 * fresco, np.where(joint, 0.2, [0.55, 0.45, 0.36]))
    ribs = (np.abs(x % 4.4 - 2.2) < 0.15)[:, None]
    ceiling = np.where(ribs, [0.45, 0.3, 0.18], [0.75, 0.74, 0.7])
    flute = (0.55 + 0.15 * np.sin(24.0 * np.arctan2(normal[:, 1], normal[:, 0])))[:, None]
    column = flute * np.array([1.0, 0.97, 0.9])
    hue = 2.0 * np.pi * (kind[:, None] / _SPHERES + np.array([0.0, 1 / 3, 2 / 3]))
    sphere = 0.45 + 0.35 * np.sin(hue)
    albedo = np.select(
        [(kind == k)[:, None] for k in range(4)], [floor, ceiling, wall, column], np.asarray(sphere, dtype=float)
    )
    to_lamp = _LAMP_M - place
    lit = np.abs((to_lamp * normal).sum(axis=1)) / np.linalg.norm(to_lamp, axis=1)
    light = albedo * (0.35 + 0.65 * lit)[:, None]
    return np.rint(255.0 * srgb_of_linear(np.clip(light, 0.0, 1.0))).astype(np.uint8)


def _told(blocks: Iterator[Scanned], points: int, tell: Progress) -> Iterator[Scanned]:
    done = 0
    for block in blocks:
        yield block
        done += len(block.rgb)
        tell(done / points)


def _write_ply(file: BinaryIO, points: int, blocks: Iterator[Scanned], _path: Path) -> None:
    names = [*(f"float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")), "uchar red", "uchar green", "uchar blue"]
    header = [
        "ply", "format binary_little_endian 1.0", "comment limen sample points", f"element vertex {points}",
        *(f"property {name}" for name in (*names, "uchar intensity")), "end_header\n",
    ]  # fmt: skip
    file.write("\n".join(header).encode())
    row = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3), ("intensity", "u1")])
    for block in blocks:
        rows = np.empty(len(block.rgb), row)
        rows["place"], rows["normal"] = block.positions, block.normals
        rows["rgb"], rows["intensity"] = block.rgb, block.intensity
        file.write(rows.tobytes())


def _write_las(file: BinaryIO, _points: int, blocks: Iterator[Scanned], path: Path) -> None:
    """LAS 1.4, point format 7, with the metre as unit; dated the same whenever it was made."""
    import laspy
    import lazrs

    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, _SCALE_M), np.zeros(3)
    header.creation_date = datetime.date(2020, 1, 1)
    header.generating_software = "limen"
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(_LOCAL_METRES))
    header.global_encoding.wkt = True
    packed = path.suffix.lower() == ".laz"
    try:
        with laspy.open(file, mode="w", header=header, do_compress=packed, closefd=False) as writer:
            for block in blocks:
                record = laspy.ScaleAwarePointRecord.zeros(len(block.rgb), header=header)
                record.x, record.y, record.z = block.positions.T
                for name, values in zip(("red", "green", "blue"), block.rgb.T, strict=True):
                    record[name] = values.astype(np.uint16) * 257
                record["intensity"] = block.intensity.astype(np.uint16) * 257
                for name in ("return_number", "number_of_returns"):
                    record[name] = np.ones(len(block.rgb), np.uint8)
                writer.write_points(record)
    except lazrs.LazrsError as error:  # what it hides is an OSError of the file
        raise StorageError(f"{path}: cannot be written ({one_line(error)}); free some space") from error
