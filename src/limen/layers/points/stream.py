"""From wanted to resident for a cloud's chunks: read in the background, kept in slots, and no frame waits.

`PointStream` decides which chunk lies in which slot; it never sees the GPU. The nodes of resident chunks lie in memory
too, where the selector reads them. A chunk that is not there is drawn as its top, so there is always something to draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.file import Points
from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.errors import InputError
from limen.layers.points.select import Resident
from limen.stream.fetch import Fetcher

__all__ = ["CHUNK_BYTES", "ChunkUpdate", "ChunkUpload", "PointStream"]

CHUNK_BYTES = CHUNK_NODES * NODE.itemsize

Index = NDArray[np.int64]


class ChunkUpload(NamedTuple):
    chunk: int
    slot: int
    nodes: NDArray[Any]  # (4681,) of NODE


@dataclass(frozen=True, slots=True)
class ChunkUpdate:
    """One frame of a stream of chunks."""

    uploads: list[ChunkUpload]
    wanted: int
    missing: int  # wanted, and not resident after this frame's uploads
    denied: int  # wanted, and there are too few slots for them
    queued: int
    failed: int


class PointStream:
    """Chunks of one cloud on their way to the slots that they are drawn from.

    Parameters
    ----------
    points
        Where chunks are read, from several threads at once.
    slots
        How many chunks are kept; no more are made than there are chunks.
    chunks_per_frame
        At most so many are handed over by one `update`.
    threads
        Reading threads.

    Raises
    ------
    InputError
        If there is room for none.
    """

    def __init__(self, points: Points, *, slots: int, chunks_per_frame: int = 128, threads: int = 2) -> None:
        if slots < 1:
            raise InputError(f"a cloud of points needs room for at least one chunk of {CHUNK_BYTES} bytes")
        self.slots = min(slots, points.chunks)
        self._nodes = np.zeros((self.slots, CHUNK_NODES), NODE)
        self._slot_of = np.full(points.chunks, -1, np.int32)
        self._chunk_in = np.full(self.slots, -1, np.int64)
        self._last_used = np.full(self.slots, -1, np.int64)
        self._frame, self._per_frame = 0, chunks_per_frame
        self.generation = 0
        """Grows whenever other chunks are resident than before."""
        self._fetcher = Fetcher(
            points.read_chunk, kept=4 * chunks_per_frame, threads=threads, name="chunk", cost=lambda _: 1
        )

    @property
    def resident(self) -> Resident:
        """What is there now; valid until the next `update`."""
        words = self._nodes.view(np.uint32).reshape(self.slots, CHUNK_NODES, 4)
        return Resident(words, self._slot_of)

    def update(self, wanted: Index, *, most: int | None = None) -> ChunkUpdate:
        """One frame: queue what is missing, hand over what has been read. Never waits.

        Parameters
        ----------
        wanted
            Distinct chunks, the most important first. Where they do not all fit, the last are denied.
        most
            Another number of chunks to be handed over.
        """
        self._frame += 1
        served = wanted[: self.slots]
        held = self._slot_of[served]
        self._last_used[held[held >= 0]] = self._frame
        absent = served[held < 0]
        ready, pending = self._fetcher.exchange(absent.tolist(), self._per_frame if most is None else most)
        free = np.argsort(self._last_used, kind="stable")  # empty slots first, then those unused for the longest
        uploads = []
        for (chunk, nodes), slot in zip(ready, free.tolist(), strict=False):
            self._place(chunk, slot, nodes)
            uploads.append(ChunkUpload(chunk, slot, nodes))
        self.generation += bool(uploads)
        missing = int((self._slot_of[wanted] < 0).sum())
        return ChunkUpdate(uploads, len(wanted), missing, len(wanted) - len(served), pending.queued, pending.failed)

    @property
    def settled(self) -> bool:
        """Nothing is queued, being read, or waiting to be handed over."""
        return self._fetcher.settled

    def wait(self, timeout_s: float = 1.0) -> None:
        """Sleep until a chunk has been read (for offscreen pictures; a live frame never calls this)."""
        self._fetcher.wait(timeout_s)

    def close(self) -> None:
        """Stop the workers; chunks being read are finished first."""
        self._fetcher.close()

    def __enter__(self) -> PointStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _place(self, chunk: int, slot: int, nodes: NDArray[Any]) -> None:
        """The slot's last chunk goes: `update` names slots that this frame uses last, and there are enough others."""
        former = self._chunk_in[slot]
        if former >= 0:
            self._slot_of[former] = -1
        self._nodes[slot] = nodes
        self._chunk_in[slot], self._slot_of[chunk], self._last_used[slot] = chunk, slot, self._frame
