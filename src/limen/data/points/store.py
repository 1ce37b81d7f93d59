"""What lies in a folder ``NAME.points``: a Zarr v3 group that other programs can read, too.

===============  =================================================================================================
``chunks``       (chunk, 4681, 16) uint8: the nodes of `limen.data.points.nodes.NODE`, zeros beyond the last point
``tops/L``       (node, 24) uint8: nodes of level L, 4 and above, of `limen.data.points.nodes.TOP`
``frames/*``     what the numbers of each chunk are measured in: `limen.data.points.nodes.ChunkFrame`
===============  =================================================================================================

The group's attribute ``limen`` is a `PointsHeader`. ``files.json`` lists all other files with their sizes: a copy that
is not complete is found out when opened. Every chunk ends with a checksum (CRC-32C).
"""

from __future__ import annotations

from typing import Any

import msgspec
import zarr

from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.data.store.zarr_group import MadeOf, create_array

__all__ = ["CHUNKS_A_SHARD", "VERSION", "CloudSource", "PointsHeader", "create_chunks"]

VERSION = 1
CHUNKS_A_SHARD = 64


class CloudSource(MadeOf, frozen=True, kw_only=True):
    """The file that the points were read from."""

    format: str
    notes: tuple[str, ...] = ()


class PointsHeader(msgspec.Struct, frozen=True, kw_only=True):
    """What is said of the whole cloud.

    ``bounds`` are the lowest and highest coordinates of points in the file's coordinates and unit; the nodes' are
    relative to ``origin`` (metres are ``unit_m`` times these; None where the file does not say). ``two_sided``: normals
    were estimated, so that either side of the surface may be its front. ``crs`` is WKT, empty where unknown.
    ``white_cd_m2`` and ``black_cd_m2`` are of the display that contrasts were measured for.
    """

    version: int = VERSION
    points: int
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    origin: tuple[float, float, float]
    two_sided: bool
    colours: str
    normals: str
    has_intensity: bool
    crs: str = ""
    unit_m: float | None = None
    white_cd_m2: float = 100.0
    black_cd_m2: float = 0.0
    source: CloudSource | None = None


def create_chunks(group: zarr.Group, chunks: int) -> Any:
    """The array of all chunks' nodes, to be filled by shards of `CHUNKS_A_SHARD`."""
    shape = (CHUNK_NODES, NODE.itemsize)
    shard = min(CHUNKS_A_SHARD, chunks)
    return create_array(group, "chunks", (chunks, *shape), "uint8", (1, *shape), (shard, *shape), NODE.itemsize)
