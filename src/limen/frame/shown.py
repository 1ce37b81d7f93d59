"""A layer at work: what decides, what draws, and one stream for each of its sources."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from limen.display.display import Display
from limen.errors import FormatError
from limen.frame.report import LayerReport
from limen.gpu.device import Device
from limen.layers.base import Cut, Drawer, Layer, Selector
from limen.layers.common.frame_time import FrameTimeBudget
from limen.layers.registry import Kind, drawer_of, kind_of
from limen.stream.chunks import ChunkStream, Index, Resident, Update, completed
from limen.viewing.state import LayerState

__all__ = ["Piece", "Shown"]


@dataclass(slots=True, eq=False)
class Shown:
    """A layer on a display.

    Parameters
    ----------
    throttle
        How many triangles or splats fit a frame's time, for policies that spend one.
    drawn
        What the last frame drew of each source that has to keep that.
    """

    layer: Layer
    kind: Kind
    selector: Selector[Any]
    drawer: Drawer[Any]
    streams: tuple[ChunkStream[Any], ...]
    throttle: FrameTimeBudget
    drawn: list[Index | None] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        device: Device,
        layer: Layer,
        display: Display,
        whole: Display,
        *,
        gpu_bytes: int,
        threads: int | None,
        quilts: int,
    ) -> Shown:
        """Begin to show a layer; waits for what nothing can be drawn without.

        Raises
        ------
        FormatError
            If that cannot be read.
        InputError, DeviceLimitError
            If it does not fit into ``gpu_bytes``, or the adapter.
        """
        drawer = drawer_of(device, layer, gpu_bytes)
        selector = layer.selector(display, whole)
        threads = threads or max(2, os.cpu_count() or 2)
        sources = zip(selector.sources, drawer.allocators, strict=True)
        streams = tuple(source.stream(allocator, threads) for source, allocator in sources)
        throttle = FrameTimeBudget(quilts)
        shown = cls(layer, kind_of(layer), selector, drawer, streams, throttle, [None] * len(streams))
        if any(source.required for source in selector.sources):
            shown.complete([np.zeros(0, np.int64)] * len(streams))
        for source, stream in zip(selector.sources, streams, strict=True):
            if source.required and not stream.resident.mask[source.source.pinned].all():
                shown.close()
                raise FormatError(
                    f"{layer.name}: its coarsest {source.name}es cannot be read: it is damaged, `limen ingest` it anew"
                )
        return shown

    @property
    def resident(self) -> list[Resident]:
        """What is there of each source."""
        return [stream.resident for stream in self.streams]

    def ask(self, cut: Cut[Any], now_s: float) -> tuple[int, int]:
        """Ask for what a live frame wants, take what has come: (missing, uploads)."""
        missing = uploads = 0
        for source, stream in enumerate(self.streams):
            soon = cut.soon[source] if cut.soon else None
            update = stream.update(cut.wanted[source], soon=soon, in_use=self.drawn[source], now_s=now_s)
            self._take(source, update)
            missing, uploads = missing + update.statistics.missing, uploads + len(update.arrived)
        return missing, uploads

    def complete(self, wanted: Sequence[Index]) -> tuple[int, int]:
        """Wait until all of this is there or has failed: (failed, uploads)."""
        missing, uploads = [0] * len(self.streams), 0
        for source, update in completed(list(zip(self.streams, wanted, strict=True))):
            self._take(source, update)
            missing[source], uploads = update.statistics.missing, uploads + len(update.arrived)
        return sum(missing), uploads

    def resolve(self, cut: Cut[Any]) -> Cut[Any]:
        """What of a cut can be drawn now; what is drawn in place of missing chunks stays as long as it has to."""
        resolved = self.selector.resolve(cut, self.resident)
        for source, chunks in enumerate(resolved.drawn):
            if self.selector.sources[source].keeps_drawn:
                self.drawn[source] = chunks
            else:
                self.streams[source].touch(chunks)
        return resolved

    def close(self) -> None:
        """Stop reading and free the GPU memory."""
        self.selector.close()
        for stream in self.streams:
            stream.close()
        self.drawer.destroy()

    def _take(self, source: int, update: Update[Any]) -> None:
        """Hand over what has come."""
        self.selector.take(source, update)
        self.drawer.upload(source, update)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """What one layer shows in a frame, and what choosing it took."""

    shown: Shown
    state: LayerState
    cut: Cut[Any]
    missing: int
    uploads: int
    select_ms: float
    stream_ms: float

    def report(self, draw_ms: float, triangles: int, eyes: int) -> LayerReport:
        """What is told of it, drawn like this; ``eyes``: how many views of each quilt it was selected for."""
        counts, layer = self.cut.counts, self.shown.layer
        return LayerReport(
            kind=layer.kind, name=layer.name, policy=self.state.policy.label,
            panels_active=counts.panels_active // eyes, items=counts.items, drawn=counts.drawn + triangles,
            chunks=sum(len(wanted) for wanted in self.cut.wanted), missing=self.missing, uploads=self.uploads,
            error_px=counts.error_px, allowed_px=counts.allowed_px, distance_factor=counts.distance_factor,
            select_ms=self.select_ms, stream_ms=self.stream_ms, draw_ms=draw_ms,
        )  # fmt: skip
