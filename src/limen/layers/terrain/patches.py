"""Patches of a terrain on their way to the two buffers that they are drawn from.

A patch's vertices and the indices of its core triangles are ranges of these. The coarsest patch of every root stays, so
there is always something to draw.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch, PatchSource
from limen.errors import InputError
from limen.stream.allocators import Ranges
from limen.stream.chunks import ChunkStream, Index, Resident

__all__ = ["PatchPlaces", "patch_stream"]

Size = TypeVar("Size", int, Index)

_INDICES = 3  # of a triangle


class PatchPlaces(NamedTuple):
    """Where patches lie in the buffers, one row a patch; -1 where a patch is not resident."""

    first_vertex: Index  # (P,)
    first_index: Index  # (P,)
    core_indices: Index  # (P,): indices of core triangles

    @classmethod
    def of(cls, resident: Resident) -> PatchPlaces:
        """As a value, which later frames leave as it is."""
        return cls(*resident.place.T.copy())

    @property
    def resident(self) -> NDArray[np.bool_]:
        return np.asarray(self.first_vertex >= 0)


def patch_stream(
    source: PatchSource,
    *,
    vertex_capacity: int,
    index_capacity: int,
    bytes_per_frame: int = 8 << 20,
    kept: int = 256,
    threads: int = 2,
) -> ChunkStream[Patch]:
    """A stream of a terrain's patches; its places are those of `PatchPlaces`.

    Parameters
    ----------
    source
        Where patches are read, from several threads at once.
    vertex_capacity, index_capacity
        How many vertices and core indices the buffers hold.
    bytes_per_frame
        About how many bytes one update hands over: it stops after the patch that reaches them.
    kept
        How many patches may wait in memory for their upload.
    threads
        Reading threads.

    Raises
    ------
    InputError
        If the roots' coarsest patches alone do not fit.
    """
    patches, table = _Patches(source), source.patches
    # How many of its triangles are rims, and no cores, is known when a patch is read: so many indices at most.
    most = table.vertices.astype(np.int64), _padded(table.triangles.astype(np.int64) * _INDICES)
    vertices, indices = (int(size[patches.pinned].sum()) for size in most)
    if vertices > vertex_capacity or indices > index_capacity:
        raise InputError(
            f"room for {vertex_capacity} vertices and {index_capacity} indices is too small: the coarsest patches "
            f"of this terrain have {vertices} and {indices}"
        )
    allocator = _PatchRanges((vertex_capacity, index_capacity), most, _sizes_of)
    return ChunkStream(
        patches, allocator, width=3, name="patch", per_frame=bytes_per_frame, cost=_bytes_of, kept=kept, threads=threads
    )


class _Patches:
    """Patches as chunks; nothing is asked for in place of one that cannot be read, its node's others are drawn."""

    def __init__(self, source: PatchSource) -> None:
        self.count, self.read = len(source.patches.node), source.read_patch
        self.pinned = source.nodes.first_patch[: source.nodes.roots].astype(np.int64)

    def parents(self, chunks: Index) -> Index:
        return np.full(len(chunks), -1)


class _PatchRanges(Ranges):
    """Ranges, and beside them how many core indices there are, which only a patch that has been read knows."""

    def place(self, chunk: int, item: Any) -> tuple[int, ...] | None:
        begins = super().place(chunk, item)
        return None if begins is None else (*begins, item.core.size)


def _sizes_of(patch: Patch) -> tuple[int, ...]:
    return len(patch.posts), max(_padded(int(patch.core.size)), 2)


def _padded(indices: Size) -> Size:
    """A range of 16-bit indices begins and ends at a multiple of 4 bytes, as WebGPU copies them."""
    return indices + (indices & 1)


def _bytes_of(patch: Patch) -> int:
    """About what is uploaded: 16 bytes a vertex, 2 an index."""
    return 16 * len(patch.posts) + 2 * int(patch.core.size)
