"""What lies in a folder ``NAME.terrain``: a Zarr v3 group that other programs can read, too.

============================  ====================================================================================
``posts/heights``             (rows, columns) int16 or float32: every height in metres, voids filled
``posts/void``                (rows, columns) bool; only if there are voids
``relief/L``, ``heights/L``   (rows, columns of pages, 264, 264, 4) uint8: pages of level L with their gutters
``nodes/*``, ``patches/*``    the tables of `limen.data.terrain.model`
``places/*``                  where each patch lies in the chunks
``chunks/posts``              (chunk, vertex, 2) uint16: column and row from the node's first post
``chunks/heights``            (chunk, vertex): their heights, as ``posts/heights`` has them
``chunks/triangles``          (chunk, triangle, 3) uint16: vertices of the patch; cores, then rims
============================  ====================================================================================

A patch lies in one chunk; a chunk holds patches of about one error, in Morton order, so what is wanted together is
read together. Patches of error 0 hold every post of their node and are not stored. The group's attribute ``limen`` is
a `Header`. ``files.json`` lists all other files with their sizes: a copy that is not complete is found out when opened.
Every chunk ends with a checksum (CRC-32C).
"""

from __future__ import annotations

from typing import Any

import msgspec
import zarr

from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.data.store.zarr_group import MadeOf, create_array

__all__ = [
    "BLOCK",
    "CHUNKS_A_SHARD",
    "CHUNK_TRIANGLES",
    "CHUNK_VERTICES",
    "EDGE",
    "KINDS",
    "POSTS_A_CHUNK",
    "VERSION",
    "Header",
    "Source",
    "create_chunks",
    "create_pages",
    "create_posts",
]

VERSION = 1

BLOCK = 4096
"""Posts along the edge of a block: a root of the quadtree, a shard of pages, and a shard of heights."""

EDGE = PAGE + 2 * GUTTER
KINDS = ("relief", "heights")

CHUNK_VERTICES = 1 << 16
CHUNK_TRIANGLES = 2 * CHUNK_VERTICES
"""A triangulation has fewer than two triangles a vertex."""

_PAGES_A_SHARD = BLOCK // PAGE
POSTS_A_CHUNK = 512
CHUNKS_A_SHARD = 16


class Source(MadeOf, frozen=True, kw_only=True):
    """The file that a terrain was made from, and how it was read."""

    format: str
    band: int
    exact: bool
    notes: tuple[str, ...]


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """What is said of the whole terrain; lengths in metres.

    ``low_m`` and ``high_m`` are what the lowest and the highest code of heights' pages stand for, and hold all posts
    between them; ``height_range_m`` is the lowest and highest post. ``errors_m`` is the ladder. ``transform`` maps
    column and row of pixels' corners to coordinates in ``crs`` (WKT).
    """

    version: int = VERSION
    size_posts: tuple[int, int]
    spacing_m: tuple[float, float]
    crs: str
    transform: tuple[float, ...] | None
    low_m: float
    high_m: float
    height_range_m: tuple[float, float]
    void_share: float
    errors_m: tuple[float, ...]
    roots: int
    source: Source


def create_posts(group: zarr.Group, size_posts: tuple[int, int], dtype: Any, name: str = "posts/heights") -> Any:
    shard = tuple(min(BLOCK, -(-size // POSTS_A_CHUNK) * POSTS_A_CHUNK) for size in size_posts[::-1])
    return create_array(group, name, size_posts[::-1], dtype, (POSTS_A_CHUNK,) * 2, shard, dtype.itemsize)


def create_pages(group: zarr.Group, kind: str, pyramid: Pyramid) -> list[Any]:
    """One array a level."""
    page, arrays = (EDGE, EDGE, 4), []
    for number, level in enumerate(pyramid.levels):
        pages = level.rows, level.columns
        shard = tuple(min(_PAGES_A_SHARD, count) for count in pages)
        arrays.append(
            create_array(group, f"{kind}/{number}", (*pages, *page), "uint8", (1, 1, *page), (*shard, *page), 4)
        )
    return arrays


def create_chunks(group: zarr.Group, heights_dtype: Any, chunks_a_shard: int) -> dict[str, Any]:
    """Arrays without any chunk yet, to be resized."""
    tails: dict[str, tuple[tuple[int, ...], Any, int]] = {
        "posts": ((CHUNK_VERTICES, 2), "uint16", 4),
        "heights": ((CHUNK_VERTICES,), heights_dtype, heights_dtype.itemsize),
        "triangles": ((CHUNK_TRIANGLES, 3), "uint16", 2),
    }
    return {
        name: create_array(group, f"chunks/{name}", (0, *tail), dtype, (1, *tail), (chunks_a_shard, *tail), item_bytes)
        for name, (tail, dtype, item_bytes) in tails.items()
    }
