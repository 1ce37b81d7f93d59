"""From wanted to resident for a terrain's patches: read in the background, placed in two arenas, and no frame waits.

A patch's vertices and the indices of its core triangles are ranges of two big buffers. `PatchStream` decides which
patch lies where; it never sees the GPU. The coarsest patch of every root stays, so there is always something to draw,
and what a frame draws, or wants and has room for, is not evicted by it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch, PatchSource
from limen.errors import InputError
from limen.stream.fetch import Fetcher
from limen.stream.ranges import Arena

__all__ = ["PatchPlaces", "PatchStatistics", "PatchStream", "PatchUpdate", "PatchUpload"]

Index = NDArray[np.int64]
Size = TypeVar("Size", int, Index)

_INDICES = 3  # of a triangle


class PatchUpload(NamedTuple):
    patch: int
    content: Patch
    first_vertex: int
    first_index: int


class PatchPlaces(NamedTuple):
    """Where patches lie in the buffers, one row a patch; -1 where a patch is not resident."""

    first_vertex: Index  # (P,)
    first_index: Index  # (P,)
    core_indices: Index  # (P,): indices of core triangles; 0 where a patch is not resident

    @property
    def resident(self) -> NDArray[np.bool_]:
        return np.asarray(self.first_vertex >= 0)


@dataclass(frozen=True, slots=True)
class PatchStatistics:
    """One frame of a stream of patches."""

    wanted: int
    missing: int  # wanted, and not resident after this frame's uploads
    uploads: int
    upload_bytes: int
    decoded_waiting: int
    queued: int
    failed: int
    denied: int  # wanted, and there is no room for them
    resident: int
    update_ms: float


@dataclass(frozen=True, slots=True)
class PatchUpdate:
    uploads: list[PatchUpload]
    evicted: list[int]
    statistics: PatchStatistics


class PatchStream:
    """Patches of one terrain on their way to the buffers that they are drawn from.

    Parameters
    ----------
    source
        Where patches are read, from several threads at once.
    vertex_capacity, index_capacity
        How many vertices and core indices the buffers hold.
    bytes_per_frame
        About how many bytes one `update` hands over: it stops after the patch that reaches them.
    cpu_patches
        How many decoded patches may wait in memory for their upload.
    threads
        Reading threads.

    Raises
    ------
    InputError
        If the roots' coarsest patches alone do not fit.
    """

    def __init__(
        self,
        source: PatchSource,
        *,
        vertex_capacity: int,
        index_capacity: int,
        bytes_per_frame: int = 8 << 20,
        cpu_patches: int = 256,
        threads: int = 2,
    ) -> None:
        nodes, table = source.nodes, source.patches
        self._pinned = nodes.first_patch[: nodes.roots].astype(np.int64)
        # How many of its triangles are rims, and no cores, is known when a patch is read: so many indices at most.
        self._sizes = table.vertices.astype(np.int64), _padded(table.triangles.astype(np.int64) * _INDICES)
        vertices, indices = (int(size[self._pinned].sum()) for size in self._sizes)
        if vertices > vertex_capacity or indices > index_capacity:
            raise InputError(
                f"room for {vertex_capacity} vertices and {index_capacity} indices is too small: the coarsest patches "
                f"of this terrain have {vertices} and {indices}"
            )
        self._vertices, self._indices = Arena(vertex_capacity), Arena(index_capacity)
        count = len(table.node)
        self._bytes_per_frame = bytes_per_frame
        self._frame = 0
        self._last_used = np.full(count, -1, dtype=np.int64)
        self._first_vertex = np.full(count, -1, dtype=np.int64)
        self._first_index = np.full(count, -1, dtype=np.int64)
        self._core_indices = np.zeros(count, dtype=np.int64)
        self._denied: set[int] = set()
        self._denied_while: Index = np.empty(0, dtype=np.int64)
        self._fetcher = Fetcher(source.read_patch, kept=cpu_patches, threads=threads, name="patch", cost=_bytes_of)

    @property
    def places(self) -> PatchPlaces:
        """Where all patches lie now, as a value."""
        return PatchPlaces(self._first_vertex.copy(), self._first_index.copy(), self._core_indices.copy())

    def update(self, wanted: Index, *, drawn: Index | None = None, bytes_budget: int | None = None) -> PatchUpdate:
        """One frame: queue what is missing, hand over what has been read. Never waits for a patch.

        Parameters
        ----------
        wanted
            Distinct patches, the most important first. Where they do not all fit, the last are denied.
        drawn
            Patches that are drawn in the place of missing ones: they stay, but are not asked for.
        bytes_budget
            Another upload budget for this frame.
        """
        begin = time.perf_counter()
        self._frame += 1
        wanted = np.asarray(wanted, dtype=np.int64)
        ordered = np.concatenate([self._pinned, wanted[~np.isin(wanted, self._pinned)]])
        served = ordered[self._that_fit(ordered)]
        for used in (served, np.empty(0, np.int64) if drawn is None else drawn):
            self._last_used[used] = self._frame
        missing = self._missing(served)
        budget = self._bytes_per_frame if bytes_budget is None else bytes_budget
        ready, pending = self._fetcher.exchange(missing, budget)
        uploads, evicted = self._place(ready)
        resident = self._first_vertex >= 0
        statistics = PatchStatistics(
            wanted=len(wanted),
            missing=int((~resident[wanted]).sum()),
            uploads=len(uploads),
            upload_bytes=sum(_bytes_of(upload.content) for upload in uploads),
            decoded_waiting=pending.decoded,
            queued=pending.queued,
            failed=pending.failed,
            denied=len(ordered) - len(served) + len(self._denied),
            resident=int(resident.sum()),
            update_ms=(time.perf_counter() - begin) * 1e3,
        )
        return PatchUpdate(uploads, evicted, statistics)

    @property
    def settled(self) -> bool:
        """Nothing is queued, being read, or waiting for its upload."""
        return self._fetcher.settled

    def wait(self, timeout_s: float = 1.0) -> None:
        """Sleep until a patch has been read (for offscreen pictures; a live frame never calls this)."""
        self._fetcher.wait(timeout_s)

    def close(self) -> None:
        """Stop the workers; patches being read are finished first."""
        self._fetcher.close()

    def __enter__(self) -> PatchStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of an update

    def _that_fit(self, ordered: Index) -> NDArray[np.bool_]:
        """Which of these patches fit together, the first ones first."""
        vertices, indices = (np.cumsum(size[ordered]) for size in self._sizes)
        return np.asarray((vertices <= self._vertices.capacity) & (indices <= self._indices.capacity))

    def _missing(self, served: Index) -> list[int]:
        """Of these patches those to be read, in their order."""
        if not np.array_equal(served, self._denied_while):
            self._denied.clear()  # other wishes leave other patches to be evicted
            self._denied_while = served
        absent = served[self._first_vertex[served] < 0].tolist()
        return [patch for patch in absent if patch not in self._denied]

    def _place(self, ready: list[tuple[int, Patch]]) -> tuple[list[PatchUpload], list[int]]:
        """Give each patch its ranges; where there is none, the least recently used go, never what this frame uses."""
        if not ready:
            return [], []
        old = np.flatnonzero((self._first_vertex >= 0) & (self._last_used < self._frame))
        old = old[np.argsort(-self._last_used[old], kind="stable")]
        evictable = old[~np.isin(old, self._pinned)].tolist()  # the next to go is the last
        uploads: list[PatchUpload] = []
        evicted: list[int] = []
        for patch, content in ready:
            place = self._allocate(content)
            while place is None and evictable:
                evicted.append(evictable.pop())
                self._evict(evicted[-1])
                place = self._allocate(content)
            if place is None:
                self._denied.add(patch)
                continue
            self._first_vertex[patch], self._first_index[patch] = place
            self._core_indices[patch] = content.core.size
            uploads.append(PatchUpload(patch, content, *place))
        return uploads, evicted

    def _allocate(self, content: Patch) -> tuple[int, int] | None:
        vertex = self._vertices.take(len(content.posts))
        if vertex is None:
            return None
        index = self._indices.take(max(_padded(content.core.size), 2))
        if index is None:
            self._vertices.give_back(vertex)
            return None
        return vertex, index

    def _evict(self, patch: int) -> None:
        self._vertices.give_back(int(self._first_vertex[patch]))
        self._indices.give_back(int(self._first_index[patch]))
        self._first_vertex[patch] = self._first_index[patch] = -1
        self._core_indices[patch] = 0


def _padded(indices: Size) -> Size:
    """A range of 16-bit indices begins and ends at a multiple of 4 bytes, as WebGPU copies them."""
    return indices + (indices & 1)


def _bytes_of(patch: Patch) -> int:
    """About what is uploaded: 16 bytes a vertex, 2 an index."""
    return 16 * len(patch.posts) + 2 * int(patch.core.size)
