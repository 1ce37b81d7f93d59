"""What a cloud of points is, before or after it was made ready."""

from __future__ import annotations

from pathlib import Path

import msgspec

from limen.data.points.cloud import open_cloud
from limen.data.points.nodes import CHUNK_POINTS, counts_of_levels
from limen.data.store.report import Description, amount, crs_name, spans

__all__ = ["PointsInfo", "cloud_info"]


class PointsInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What ``limen info`` says about a cloud.

    ``size`` is the number of points, ``levels`` that of nodes on each level, from the points to the root. ``bounds``
    are the lowest and the highest x, y, z in the file's unit, ``unit_m`` metres long (None where the file does not
    say). ``colours`` and ``normals`` say where they come from. ``ready`` tells a cloud that was made ready from a file
    of points. ``bytes`` is the size of the files, or of the nodes in memory.
    """

    kind: str = "points"
    path: str
    ready: bool
    size: int
    levels: list[int]
    chunks: int
    format: str
    bounds: tuple[tuple[float, ...], tuple[float, ...]]
    unit_m: float | None
    crs: str
    colours: str
    normals: str
    has_intensity: bool
    bytes: int
    notes: tuple[str, ...] = ()

    def described(self) -> Description:
        unit = f"units of {self.unit_m:g} m" if self.unit_m else "an unknown unit"
        facts = {
            "size": f"{self.size:,} points, {self.chunks:,} chunks, {len(self.levels)} levels",
            **spans(self.bounds, 10, unit),
            "coordinates": crs_name(self.crs),
            "colours": self.colours,
            "normals": self.normals,
            "intensity": "yes" if self.has_intensity else "no",
        }
        if not self.ready:
            facts["not made ready yet"] = "limen ingest makes a .points of it"
        return Description(f"{self.format}, {amount(self.bytes)}", facts, self.notes)


def cloud_info(path: str | Path) -> PointsInfo:
    """What a cloud of points is; it is read to its end only where it does not state its bounds.

    Raises MissingFileError, or FormatError if it is none, or damaged.
    """
    cloud = open_cloud(path)
    found = cloud.found_bounds() if cloud.bounds is None else cloud.bounds
    return PointsInfo(
        path=str(path),
        ready=False,
        size=cloud.count,
        levels=counts_of_levels(cloud.count),
        chunks=-(-cloud.count // CHUNK_POINTS),
        format=cloud.format,
        bounds=(tuple(found[0].tolist()), tuple(found[1].tolist())),
        unit_m=cloud.unit_m,
        crs=cloud.crs,
        colours=cloud.colours,
        normals="given" if cloud.has_normals else "none",
        has_intensity=cloud.has_intensity,
        bytes=cloud.path.stat().st_size,
        notes=cloud.notes,
    )
