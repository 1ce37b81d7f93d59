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
from limen.stream.chunks import Allocator, Index, Resident, Streaming

__all__ = ["PatchPlaces", "patch_ranges", "patch_streaming"]

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


def patch_streaming(source: PatchSource, *, bytes_per_frame: int = 8 << 20, kept: int = 256) -> Streaming:
    """A terrain's patches on their way; the coarsest of every root are pinned, and nothing can be drawn without them.

    Parameters
    ----------
    source
        Where patches are read, from several threads at once.
    bytes_per_frame
        About how many bytes one update hands over: it stops after the patch that reaches them.
    kept
        How many patches may wait in memory for their upload.
    """
    return Streaming(
        _Patches(source), "patch", width=3, per_frame=bytes_per_frame, cost=_bytes_of, kept=kept, keeps_drawn=True,
        required=True,
    )  # fmt: skip


def patch_ranges(source: PatchSource, vertex_capacity: int, index_capacity: int) -> Allocator:
    """Where patches lie in buffers of so many vertices and core indices; places are those of `PatchPlaces`.

    Raises
    ------
    InputError
        If the roots' coarsest patches alone do not fit.
    """
    pinned, table = _Patches(source).pinned, source.patches
    # How many of its triangles are rims, and no cores, is known when a patch is read: so many indices at most.
    most = table.vertices.astype(np.int64), _padded(table.triangles.astype(np.int64) * _INDICES)
    vertices, indices = (int(size[pinned].sum()) for size in most)
    if vertices > vertex_capacity or indices > index_capacity:
        raise InputError(
            f"room for {vertex_capacity} vertices and {index_capacity} indices is too small: the coarsest patches "
            f"of this terrain have {vertices} and {indices}"
        )
    return _PatchRanges((vertex_capacity, index_capacity), most, _sizes_of)


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
