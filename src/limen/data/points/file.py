"""A cloud of points that was made ready: tops in memory, chunks read as they are wanted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.points.info import PointsInfo
from limen.data.points.nodes import CHUNK_LEVEL, CHUNK_NODES, CHUNK_POINTS, NODE, TOP, ChunkFrame, counts_of_levels
from limen.data.points.store import VERSION, PointsHeader
from limen.data.store.zarr_group import checked_header, list_files, opening, reading, table_of
from limen.errors import InputError
from limen.geometry import Floats

__all__ = ["Points"]


_FLAT, _FLAT_TILT_DEG = 0.2, 40.0
"""How high over its largest extent what is flat is at most, and how far it is tilted then."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """A hierarchy of splats, see `limen.data.points.nodes`. Any number of threads may read at once.

    ``tops[k]`` are the nodes of level 4 + k, dtype `TOP`, the last of them the root alone; chunk ``i`` hangs from
    ``tops[0][i]``. Places and radii are in the file's unit, from ``origin`` (3,), in the file's coordinates.
    """

    path: Path | None
    header: PointsHeader
    tops: tuple[NDArray[Any], ...]
    frames: ChunkFrame
    _chunks: Any  # indexed by chunk: (4681, 16) uint8

    @classmethod
    def open(cls, path: str | Path) -> Points:
        """Open a folder that `limen.data.ingest_points` wrote.

        Raises MissingFileError, or FormatError if it is none, damaged, or copied in part.
        """
        path = Path(path)
        header = checked_header(path, PointsHeader, VERSION, "cloud of points", "limen ingest CLOUD.laz NAME.points")
        with opening(path):
            group = zarr.open_group(path, mode="r", zarr_format=3)
            counts = counts_of_levels(header.points)[CHUNK_LEVEL:]
            tops = tuple(
                table_of(group, f"tops/{CHUNK_LEVEL + k}").view(TOP).reshape(count) for k, count in enumerate(counts)
            )
            frames = ChunkFrame._make(table_of(group, f"frames/{field}") for field in ChunkFrame._fields)
            chunks = group["chunks"]
        return cls(path, header, tops, frames, chunks)

    kind: ClassVar[str] = "points"

    @property
    def name(self) -> str:
        return self.path.stem if self.path else "points"

    @property
    def size(self) -> int:
        """How many points there are."""
        return self.header.points

    @property
    def chunks(self) -> int:
        return len(self.tops[0])

    @property
    def levels(self) -> list[int]:
        """Nodes of each level, from the points to the root."""
        return counts_of_levels(self.size)

    @property
    def bounds(self) -> Floats:
        """Lowest and highest coordinates of points, (2, 3), in the file's coordinates."""
        return np.array(self.header.bounds)

    @property
    def up(self) -> Literal["y", "z"]:
        """Which of its axes points up: z of surveys, y of points that were made elsewhere."""
        return "y" if self.header.source is None else "z"

    @property
    def tilt_deg(self) -> float:
        """How far it leans toward viewers unless told: from the side nothing would be seen of a flat survey."""
        extent = np.ptp(self.bounds, axis=0)
        return _FLAT_TILT_DEG if extent["xyz".index(self.up)] < _FLAT * extent.max() else 0.0

    @property
    def origin(self) -> Floats:
        """What nodes' places are relative to, (3,), in the file's coordinates."""
        return np.array(self.header.origin)

    @property
    def unit_m(self) -> float | None:
        """Metres of the file's unit; None where it does not say."""
        return self.header.unit_m

    @property
    def crs(self) -> str:
        return self.header.crs

    @property
    def two_sided(self) -> bool:
        """Whether normals were estimated: either side may be the front, nothing may be culled for facing away."""
        return self.header.two_sided

    def points_of_chunk(self, chunk: int) -> int:
        """How many points a chunk holds: 4096, the last one the rest."""
        return int(min(CHUNK_POINTS, self.size - chunk * CHUNK_POINTS))

    def read_chunk(self, chunk: int) -> NDArray[Any]:
        """All nodes of a chunk, (4681,) of dtype `NODE`, the caller's own; zeros where the last chunk has no nodes.

        Raises InputError for a number that does not exist, PageError where it cannot be read.
        """
        if not 0 <= chunk < self.chunks:
            raise InputError(f"chunk {chunk}: these points have chunks 0 to {self.chunks - 1}")
        with reading(self.path or Path(self.name), f"chunk {chunk}"):
            stored = np.array(self._chunks[chunk], dtype=np.uint8)
        return stored.reshape(CHUNK_NODES * NODE.itemsize).view(NODE)

    def info(self) -> PointsInfo:
        """What the cloud is."""
        header, source = self.header, self.header.source
        files = list_files(self.path) if self.path else None
        return PointsInfo(
            path=str(self.path or ""),
            ready=True,
            size=self.size,
            levels=self.levels,
            chunks=self.chunks,
            format=f"made of {source.name} ({source.format})" if source else "made in memory",
            bounds=header.bounds,
            unit_m=header.unit_m,
            crs=header.crs,
            colours=header.colours,
            normals=header.normals,
            has_intensity=header.has_intensity,
            bytes=sum(files.values()) if files else self.chunks * CHUNK_NODES * NODE.itemsize,
            notes=source.notes if source else (),
        )
