"""What a terrain is drawn from: its patches and pages on their way to the GPU, and the memory that they lie in."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.image.file import Image
from limen.errors import FormatError
from limen.geometry import Floats
from limen.gpu.device import Device
from limen.gpu.pool import PagePool
from limen.layers.terrain.borders import BorderPool
from limen.layers.terrain.draw.drawer import Drape, PageTables, TerrainLayer
from limen.layers.terrain.patches import PatchPlaces, patch_stream
from limen.stream.chunks import ChunkStream, Update, completed
from limen.stream.pages import FADE_S, PageSource, PageStream

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain

__all__ = ["GPU_BYTES", "Draped", "TerrainStock", "Wishes"]

GPU_BYTES = 512 << 20
"""Memory for patches and pages on the GPU, unless told otherwise."""

_VERTEX_BYTES, _INDEX_BYTES = 16, 2


class Draped(NamedTuple):
    """A picture that lies on a terrain.

    ``texel_from_post`` is an affine map of shape (2, 3) from column and row, see
    `limen.data.terrain.drape.texel_from_post`.
    """

    image: Image
    texel_from_post: Floats


class Wishes(NamedTuple):
    """What a frame wants, the most important first."""

    patches: NDArray[np.int64]
    drawn: NDArray[np.int64]
    """Patches that the frame before drew: they stay until others take their place."""
    pages: NDArray[np.int64]
    drape_pages: NDArray[np.int64]


class TerrainStock:
    """Streams, pools and the layer of one terrain.

    An eighth of the memory is for vertices, one for indices, the rest for pages, the same for each kind.

    Raises
    ------
    InputError
        If the terrain's coarsest patches do not fit into ``gpu_bytes``.
    FormatError
        If the terrain's coarsest patches cannot be read.
    DeviceLimitError
        If the adapter cannot hold so much.
    """

    def __init__(
        self,
        device: Device,
        terrain: Terrain,
        draped: Draped | None,
        *,
        background: tuple[float, float, float],
        gpu_bytes: int = GPU_BYTES,
        threads: int | None = None,
    ) -> None:
        sources: list[PageSource] = [terrain.relief, terrain.heights, *([draped.image] if draped else [])]
        threads = threads or max(1, (os.cpu_count() or 2) // 2)
        vertices, indices = gpu_bytes // 8 // _VERTEX_BYTES, gpu_bytes // 8 // _INDEX_BYTES
        self._patches = patch_stream(terrain, vertex_capacity=vertices, index_capacity=indices, threads=threads)
        share = gpu_bytes * 3 // 4 // len(sources)
        self._pools = [
            PagePool(device, share, format="rgba8unorm-srgb" if number == 2 else "rgba8unorm")
            for number in range(len(sources))
        ]
        self._streams = [
            PageStream(source, pool.slots, threads=threads) for source, pool in zip(sources, self._pools, strict=True)
        ]
        self._all: list[ChunkStream[Any]] = [self._patches, *self._streams]
        drape = Drape(draped.image.pyramid, self._pools[2], draped.texel_from_post) if draped else None
        self.layer = TerrainLayer(
            device, terrain, relief=self._pools[0], heights=self._pools[1], drape=drape, vertex_capacity=vertices,
            index_capacity=indices, background=background,
        )  # fmt: skip
        self.rims = BorderPool()
        self._generations: tuple[int, ...] = ()
        self._changed_s = self._tables_s = -np.inf
        self._tables: PageTables | None = None
        self._await_roots(terrain)

    def _await_roots(self, terrain: Terrain) -> None:
        """Wait for the coarsest patches, which every later frame falls back on."""
        nothing = np.zeros(0, np.int64)
        self.fetch(Wishes(nothing, nothing, nothing, nothing))
        if not self.places.resident[terrain.nodes.first_patch[: terrain.nodes.roots]].all():
            self.close()
            raise FormatError(
                f"{terrain.path}: its coarsest patches cannot be read: it is damaged, `limen ingest` it anew"
            )

    @property
    def places(self) -> PatchPlaces:
        """Where patches lie now."""
        return PatchPlaces.of(self._patches.resident)

    def update(self, wishes: Wishes, *, now_s: float = np.inf) -> int:
        """One frame: ask for what is missing, take over what has come. Returns how much is still missing.

        ``now_s`` is the time that pages fade in by; without it they are there at once.
        """
        missing = 0
        for number, wanted in enumerate(self._wanted(wishes)):
            in_use = wishes.drawn if number == 0 else None
            update = self._all[number].update(wanted, in_use=in_use, now_s=now_s)
            self._take(number, update)
            missing += update.statistics.missing
        self._keep_tables(now_s)
        return missing

    def fetch(self, wishes: Wishes) -> int:
        """Wait until all that is wished for is there or has failed; returns how much has failed."""
        missing = [0] * len(self._all)
        for number, update in completed(list(zip(self._all, self._wanted(wishes), strict=True))):
            self._take(number, update)
            missing[number] = update.statistics.missing
        self._keep_tables(np.inf)
        return sum(missing)

    @property
    def tables(self) -> PageTables:
        """What is resident of every kind of page, as of the last `update`."""
        assert self._tables is not None
        return self._tables

    def close(self) -> None:
        """Stop reading and free the GPU memory."""
        for stream in self._all:
            stream.close()
        self.layer.destroy()
        for pool in self._pools:
            pool.destroy()

    def _wanted(self, wishes: Wishes) -> list[NDArray[np.int64]]:
        """What is wanted of each stream."""
        return [wishes.patches, wishes.pages, wishes.pages, wishes.drape_pages][: len(self._all)]

    def _take(self, number: int, update: Update[Any]) -> None:
        """Copy what has come to where it is drawn from."""
        if number:
            self._pools[number - 1].write(update.arrived)
            return
        for gone in update.evicted:
            self.rims.remove(gone)
        for patch, (first_vertex, *_), content in update.arrived:
            self.rims.add(patch, content, first_vertex)
        self.layer.write(update.arrived)

    def _keep_tables(self, now_s: float) -> None:
        """New tables only where something came or is fading in: they are copied to the GPU when they are others."""
        generations = tuple(stream.resident.generation for stream in self._streams)
        if generations != self._generations:
            self._generations, self._changed_s = generations, now_s
        elif self._tables is not None and not self._tables_s - self._changed_s < FADE_S:
            return  # not by the time that has passed: the next frame may come when all would have faded in
        self._tables_s = now_s
        self._tables = PageTables(*(stream.table() for stream in self._streams))
