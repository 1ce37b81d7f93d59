"""A cloud's chunks on their way to the slots that they are drawn from.

The nodes of resident chunks lie in memory too, where the selector reads them. A chunk that is not there is drawn as its
top, so there is always something to draw.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.points.file import Points
from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.errors import InputError
from limen.layers.points.select import ResidentNodes
from limen.stream.allocators import Slots
from limen.stream.chunks import ChunkStream, Index, Update

__all__ = ["CHUNK_BYTES", "PointStream"]

CHUNK_BYTES = CHUNK_NODES * NODE.itemsize
Nodes = NDArray[Any]
"""Of one chunk: (4681,) of NODE."""


class PointStream(ChunkStream[Nodes]):
    """Chunks of one cloud on their way to the slots that they are drawn from.

    Parameters
    ----------
    points
        Where chunks are read, from several threads at once.
    slots
        How many chunks are kept; no more are made than there are chunks.
    per_frame
        At most so many are handed over by one `update`.
    threads
        Reading threads.

    Raises
    ------
    InputError
        If there is room for none.
    """

    def __init__(self, points: Points, *, slots: int, per_frame: int = 128, threads: int = 2) -> None:
        if slots < 1:
            raise InputError(f"a cloud of points needs room for at least one chunk of {CHUNK_BYTES} bytes")
        self.slots = min(slots, points.chunks)
        self._nodes = np.zeros((self.slots, CHUNK_NODES), NODE)
        super().__init__(_Chunks(points), Slots(self.slots), per_frame=per_frame, kept=4 * per_frame, threads=threads)

    @property
    def nodes(self) -> ResidentNodes:
        """What is there now; valid until the next `update`."""
        words = self._nodes.view(np.uint32).reshape(self.slots, CHUNK_NODES, 4)
        return ResidentNodes(words, self._places[0].astype(np.int32))

    def update(
        self,
        wanted: Index,
        *,
        soon: Index | None = None,
        in_use: Index | None = None,
        budget: int | None = None,
        now_s: float = math.inf,
    ) -> Update[Nodes]:
        update = super().update(wanted, soon=soon, in_use=in_use, budget=budget, now_s=now_s)
        for arrival in update.arrived:
            self._nodes[arrival.place[0]] = arrival.item
        return update


class _Chunks:
    """Chunks that have nothing else to stand in for them than their tops, which are always there."""

    def __init__(self, points: Points) -> None:
        self.count, self.read = points.chunks, points.read_chunk
        self.pinned = np.zeros(0, np.int64)

    def parents(self, chunks: Index) -> Index:
        return np.full(len(chunks), -1)
