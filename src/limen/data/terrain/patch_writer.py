"""Patches on their way into the chunks of a terrain's folder, and out of them again."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.terrain.model import Nodes, Patch, PatchTable
from limen.data.terrain.store import CHUNK_TRIANGLES, CHUNK_VERTICES, CHUNKS_A_SHARD, create_chunks
from limen.data.terrain.tin_tree import Grown

__all__ = ["TABLES", "PatchRecords", "PatchWriter", "Tables", "decode_patch", "triangles_at"]

Rect = tuple[int, int, int, int]


class PatchRecords(NamedTuple):
    """Where each patch lies, one row a patch; ``chunk`` is -1 for those that are made from the heights."""

    chunk: NDArray[np.int32]
    vertex: NDArray[np.int32]
    triangle: NDArray[np.int32]
    rims: NDArray[np.int32]


class Tables(NamedTuple):
    """All nodes and patches of a terrain."""

    nodes: Nodes
    patches: PatchTable
    places: PatchRecords


TABLES = {"nodes": Nodes._fields[:4], "patches": PatchTable._fields, "places": PatchRecords._fields}
"""Arrays in a terrain's folder, by their groups."""


def decode_patch(posts: Any, heights_m: NDArray[np.float32], core: Any, rims: Any, rect: Rect) -> Patch:
    """The patch of a node from what is stored: (V, 2) posts from the node's first on, and triangles.

    Which border a rim lies on, and what vertices are along each, is seen from the posts.
    """
    left, top, right, bottom = rect
    x, y = posts[:, 0].astype(np.int32), posts[:, 1].astype(np.int32)
    on = y == 0, x == right - left, y == bottom - top, x == 0  # in the order of SIDES
    a, b, c, d = (_along(side, x if number % 2 == 0 else y) for number, side in enumerate(on))
    rim_side = np.zeros(len(rims), np.uint8)
    for number, side in enumerate(on):
        rim_side[side[rims[:, 1]] & side[rims[:, 2]]] = number
    return Patch(np.stack([x + left, y + top], axis=1), heights_m, core, rims, rim_side, (a, b, c, d))


def _along(side: NDArray[np.bool_], position: NDArray[np.int32]) -> NDArray[np.uint16]:
    found = np.flatnonzero(side)
    return found[np.argsort(position[found])].astype(np.uint16)


def _spread(value: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """A gap of one bit between all 16 bits (Morton 1966)."""
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        value = (value | (value << np.uint32(shift))) & np.uint32(mask)
    return value


def _ordered(patch: Patch, rect: Rect) -> tuple[NDArray[np.uint16], NDArray[Any], NDArray[np.uint16]]:
    """Posts from the node's first on, heights, and triangles, neighbours near each other: they compress better so."""
    local = (patch.posts - np.array(rect[:2], np.int32)).astype(np.uint32)
    order = np.argsort(_spread(local[:, 0]) | (_spread(local[:, 1]) << np.uint32(1)))
    number = np.empty(len(order), np.uint16)
    number[order] = np.arange(len(order), dtype=np.uint16)
    core = _begun_at_smallest(number[patch.core])
    parts = [core[np.argsort(core[:, 0], kind="stable")], number[patch.rims]]
    return local[order].astype(np.uint16), patch.heights_m[order], np.concatenate(parts)


def _begun_at_smallest(triangles: NDArray[np.uint16]) -> NDArray[np.uint16]:
    first = triangles.argmin(axis=1)[:, None]
    return np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)


class _Chunk:
    """One chunk while it is filled; its number is known when it is full."""

    def __init__(self, heights_dtype: Any) -> None:
        self.number = -1
        self.vertices = self.triangles = 0
        self.parts = {
            "posts": np.zeros((CHUNK_VERTICES, 2), np.uint16),
            "heights": np.zeros(CHUNK_VERTICES, heights_dtype),
            "triangles": np.zeros((CHUNK_TRIANGLES, 3), np.uint16),
        }

    def has_room(self, patch: Patch) -> bool:
        triangles = len(patch.core) + len(patch.rims)
        return self.vertices + len(patch.posts) <= CHUNK_VERTICES and self.triangles + triangles <= CHUNK_TRIANGLES

    def add(self, patch: Patch, rect: Rect) -> None:
        posts, heights, triangles = _ordered(patch, rect)
        ends = self.vertices + len(posts), self.triangles + len(triangles)
        self.parts["posts"][self.vertices : ends[0]] = posts
        self.parts["heights"][self.vertices : ends[0]] = heights
        self.parts["triangles"][self.triangles : ends[1]] = triangles
        self.vertices, self.triangles = ends


class _Row(NamedTuple):
    """One patch."""

    error_m: float
    vertices: int
    triangles: int
    chunk: _Chunk | None
    vertex: int
    triangle: int
    rims: int


class _Node(NamedTuple):
    rect: Rect
    low_high_m: tuple[float, float]
    children: tuple[int, ...]  # numbers within the block
    rows: list[_Row]


class PatchWriter:
    """Takes the nodes of all roots, root by root, and writes their patches into chunks of about one error each.

    A chunk that is full goes to the disk with 15 others; so about a chunk for every step of the ladder, and these, are
    in memory.
    """

    def __init__(self, group: zarr.Group, heights_dtype: np.dtype[Any]) -> None:
        self._group = group
        self._arrays: dict[str, Any] = {}
        self._dtype = heights_dtype
        self._open: dict[int, _Chunk] = {}
        self._full: list[_Chunk] = []
        self._written = 0
        self._blocks: list[list[_Node]] = []

    def add_root(self, nodes: Iterable[Grown]) -> Iterator[Rect]:
        """Write the patches of one root's nodes as they come; yields the rectangle of each node done."""
        block: list[_Node] = []
        self._blocks.append(block)
        known = 1
        for node in nodes:
            children = []
            for exists in node.children:
                children.append(known if exists else -1)
                known += exists
            rows = [
                self._add(patch, error_m, node.rect) for patch, error_m in zip(node.patches, node.errors_m, strict=True)
            ]
            if not any(node.children):
                width, height = node.rect[2] - node.rect[0], node.rect[3] - node.rect[1]
                rows.append(_Row(0.0, (width + 1) * (height + 1), 2 * width * height, None, 0, 0, 0))
            block.append(_Node(node.rect, node.low_high_m, tuple(children), rows))
            yield node.rect

    def _add(self, patch: Patch, error_m: float, rect: Rect) -> _Row:
        step = round(2.0 * math.log2(error_m)) if error_m > 0.0 else -1000
        chunk = self._open.get(step)
        if chunk is None or not chunk.has_room(patch):
            if chunk is not None:
                self._close(chunk)
            chunk = self._open[step] = _Chunk(self._dtype)
        row = _Row(
            error_m,
            len(patch.posts),
            len(patch.core) + len(patch.rims),
            chunk,
            chunk.vertices,
            chunk.triangles,
            len(patch.rims),
        )
        chunk.add(patch, rect)
        return row

    def _close(self, chunk: _Chunk) -> None:
        chunk.number = self._written + len(self._full)
        self._full.append(chunk)
        if len(self._full) == CHUNKS_A_SHARD:
            self._flush()

    def _flush(self) -> None:
        end = self._written + len(self._full)
        if not self._arrays:  # a small terrain has fewer chunks than a shard: none is padded
            self._arrays = create_chunks(self._group, self._dtype, len(self._full))
        for name, array in self._arrays.items():
            array.resize((end, *array.shape[1:]))
            array[self._written : end] = np.stack([chunk.parts[name] for chunk in self._full])
        for chunk in self._full:
            chunk.parts = {}
        self._full, self._written = [], end

    def finish(self) -> Tables:
        """Write what is left; the tables of all nodes, roots first."""
        for step in sorted(self._open, reverse=True):
            self._close(self._open[step])
        self._open = {}
        if self._full:
            self._flush()
        return _tables(self._blocks)


def _tables(blocks: list[list[_Node]]) -> Tables:
    """Number the nodes of all blocks: roots first, then what is below the first root, below the second, and so on."""
    offset, below = [], len(blocks)
    for block in blocks:
        offset.append(below - 1)
        below += len(block) - 1
    nodes = [block[0] for block in blocks] + [node for block in blocks for node in block[1:]]
    offsets = offset + [start for start, block in zip(offset, blocks, strict=True) for _ in block[1:]]
    children = np.array([node.children for node in nodes], np.int32)
    children += np.where(children >= 0, np.array(offsets, np.int32)[:, None], 0)
    counts = np.array([len(node.rows) for node in nodes])
    rows = [row for node in nodes for row in node.rows]
    error_m = np.array([row.error_m for row in rows])

    def column(values: Iterable[int]) -> NDArray[np.int32]:
        return np.fromiter(values, np.int32, len(rows))

    return Tables(
        Nodes(
            np.array([node.rect for node in nodes], np.int32),
            np.array([node.low_high_m for node in nodes], np.float32),
            children,
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            len(blocks),
        ),
        PatchTable(
            np.repeat(np.arange(len(nodes), dtype=np.int32), counts),
            _rounded_up(error_m),
            column(row.vertices for row in rows),
            column(row.triangles for row in rows),
        ),
        PatchRecords(
            column(row.chunk.number if row.chunk else -1 for row in rows),
            column(row.vertex for row in rows),
            column(row.triangle for row in rows),
            column(row.rims for row in rows),
        ),
    )


def _rounded_up(values: NDArray[np.float64]) -> NDArray[np.float32]:
    nearest = values.astype(np.float32)
    return np.where(nearest < values, np.nextafter(nearest, np.float32(np.inf)), nearest).astype(np.float32)


def triangles_at(nodes: Nodes, patches: PatchTable, error_m: float) -> int:
    """Triangles of the coarsest cut of the whole terrain with no error above ``error_m``, before borders are joined."""
    first = nodes.first_patch[:-1]
    too_coarse = np.add.reduceat(patches.error_m > error_m, first)
    reaches = too_coarse < np.diff(nodes.first_patch)
    inherited = np.zeros(len(reaches), np.bool_)  # whether a node further up already reaches it
    for node in np.flatnonzero((nodes.children >= 0).any(axis=1)):
        kids = nodes.children[node]
        inherited[kids[kids >= 0]] = inherited[node] or reaches[node]
    chosen = reaches & ~inherited
    return int(patches.triangles[(first + too_coarse)[chosen]].sum(dtype=np.int64))
