"""What is looked at through lenses, cut into triangles by compute shaders.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.3.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.quilt import Quilt
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.layers.image.lens_cells import LensCells
from limen.viewing.tessellation import LensMode, Tessellation

__all__ = ["CORNER", "LENS_CELL", "LensMesh", "Triangles"]

LENS_CELL = np.dtype([("rect_px", "<f4", 4), ("beside", "<i4", 4), ("names", "<u4", 4)])
CORNER = np.dtype([("pixel", "<f4", 2), ("texel", "<f4", 2), ("panel", "<u4"), ("padding", "<u4")])

_NUMBERS = {
    "frame": 0, "panels": 1, "eyes": 2, "lenses": 10, "cells": 11, "wishes": 12, "corners": 13, "drawn": 14,
    "split": 16,
}  # fmt: skip
_SHARED = ("frame", "panels", "eyes", "lenses")
_READ_WRITE = ("wishes", "corners", "drawn", "split")
_MODES: dict[LensMode, int] = {"exact": 0, "coarse": 0, "uniform": 1, "acuity": 2, "error": 0}
_HALVINGS = 8  # of a cell's side, by `error`: then triangles are smaller than pixels
_ALIGNED = 256  # offsets of uniforms: the largest that WebGPU lets adapters ask for
_LANES, _CELLS_A_ROW, _DRAWN = 64, 32768, 14  # as in the shader

_LEAST_ROOM, _ROOM_A_CELL = 1 << 18, 512
"""Triangles that there is room for where their number is not known before: 19 MB, and 37 kB a cell."""


class Triangles(NamedTuple):
    """As they were drawn; texels count from the panel's first page."""

    panel: NDArray[np.int64]  # (T,), the panel's place in the quilt
    pixel: NDArray[np.float64]  # (T, 3, 2)
    texel: NDArray[np.float64]  # (T, 3, 2)


class LensMesh:
    """Makes the triangles of one frame after another; the layer's buffers say where lenses are and who looks."""

    def __init__(self, device: Device, shader: Any, tessellation: Tessellation) -> None:
        self._device, self._shader, self.tessellation = device, shader, tessellation
        storage, copied = wgpu.BufferUsage.STORAGE, wgpu.BufferUsage.COPY_SRC
        own = {"cells": storage, "corners": storage | copied, "drawn": storage | copied | wgpu.BufferUsage.INDIRECT}
        own |= {"wishes": storage} | ({"split": storage} if tessellation.mode == "error" else {})
        self._buffers = {name: GrowingBuffer(device, f"lens {name}", usage) for name, usage in own.items()}
        self._names = (*_SHARED, *own)
        self._layouts: list[Any] = []
        self._steps: Any = None
        self._halvings = _HALVINGS
        self._pipelines: dict[str, Any] = {}

    @property
    def corners(self) -> GrowingBuffer:
        """Of all triangles, as `CORNER`."""
        return self._buffers["corners"]

    @property
    def drawn(self) -> GrowingBuffer:
        """What an indirect draw call reads."""
        return self._buffers["drawn"]

    def write(self, cells: LensCells, quilt: Quilt) -> dict[str, int]:
        """Hand over the cells on a quilt's panels; returns what a frame's row says of them."""
        panel, rect_px, beside = cells.of_panels(quilt.panels)
        rows = np.zeros(len(panel), LENS_CELL)
        rows["rect_px"], rows["beside"], rows["names"][:, 0] = rect_px, beside, panel
        room = _room(self.tessellation, len(rows), self._device.max_binding_bytes // (3 * CORNER.itemsize))
        self._buffers["cells"].write(rows)
        if self._split is not None:
            self._fit(max(len(rows), 1))
            self._split.reserve(self._split_bytes(max(len(rows), 1)))
        self._buffers["wishes"].reserve(16 * len(rows))
        self.corners.reserve(3 * CORNER.itemsize * room)
        self.drawn.write(np.array([0, 1] + _DRAWN * [0], np.uint32))
        return {"cells": len(rows), "max_triangles": room}

    def encode(self, encoder: Any, count: int, buffers: dict[str, GrowingBuffer]) -> None:
        """Cut ``count`` cells, by the layer's frame, panels, eyes and lenses."""
        if not self._pipelines:
            self._make_pipelines()
        if self._split is not None:
            encoder.clear_buffer(self._split.buffer, 0, self._split_bytes(count))
        each = (min(count, _CELLS_A_ROW), -(-count // _CELLS_A_ROW))
        compute = encoder.begin_compute_pass()
        compute.set_bind_group(0, self._group(buffers))
        for entry, pipeline in self._pipelines.items():
            compute.set_pipeline(pipeline)
            if entry != "lens_split":
                compute.dispatch_workgroups(*((-(-count // _LANES), 1) if entry == "lens_counts" else each))
                continue
            for number in range(2 * self._halvings):
                compute.set_bind_group(1, self._steps, [number * _ALIGNED])
                compute.dispatch_workgroups(*each)
        compute.end()

    @property
    def count(self) -> int:
        """Triangles made last; waits for the GPU."""
        return int(np.frombuffer(self._device.wgpu.queue.read_buffer(self.drawn.buffer, 0, 4), np.uint32)[0]) // 3

    def read(self) -> Triangles:
        """The triangles made last; waits for the GPU."""
        count = 3 * self.count
        size = max(CORNER.itemsize * count, 4)  # WebGPU reads no empty range
        read = self._device.wgpu.queue.read_buffer(self.corners.buffer, 0, size)
        corners = np.frombuffer(read, CORNER, count=count).reshape(-1, 3)
        return Triangles(
            corners["panel"][:, 0].astype(np.int64), corners["pixel"].astype(float), corners["texel"].astype(float)
        )

    def destroy(self) -> None:
        for buffer in self._buffers.values():
            buffer.destroy()
        self._pipelines.clear()
        self._layouts, self._steps = [], None

    @property
    def _split(self) -> GrowingBuffer | None:
        return self._buffers.get("split")

    def _fit(self, count: int) -> None:
        """Halve as often as there is room to note."""
        before, self._halvings = self._halvings, _HALVINGS
        while self._split_bytes(count) > self._device.max_binding_bytes and self._halvings > 1:
            self._halvings -= 1
        if self._halvings != before:
            self._pipelines.clear()

    def _split_bytes(self, count: int) -> int:
        """A bit for every place of every cell."""
        return 4 * count * -(-(((1 << self._halvings) + 1) ** 2) // 32)

    def _group(self, buffers: dict[str, GrowingBuffer]) -> Any:
        buffers = {**buffers, **self._buffers}
        entries = [{"binding": _NUMBERS[name], "resource": {"buffer": buffers[name].buffer}} for name in self._names]
        return self._device.wgpu.create_bind_group(layout=self._layouts[0], entries=entries)

    def _make_pipelines(self) -> None:
        kept, compute = self._device.kept, wgpu.ShaderStage.COMPUTE
        kinds = {"frame": "uniform"} | dict.fromkeys(_READ_WRITE, "storage")
        entries: list[dict[str, Any]] = [
            {"binding": _NUMBERS[name], "visibility": compute, "buffer": {"type": kinds.get(name, "read-only-storage")}}
            for name in self._names
        ]
        self._layouts = [kept("create_bind_group_layout", entries=entries)]
        names = ["lens_wishes", "lens_counts", "lens_triangles"]
        if self._split is not None:
            uniform = {"type": "uniform", "has_dynamic_offset": True}
            self._layouts.append(
                kept("create_bind_group_layout", entries=[{"binding": 0, "visibility": compute, "buffer": uniform}])
            )
            self._steps = self._step_group()
            names = ["lens_survey", "lens_split", "lens_split_counts", "lens_split_triangles"]
        constants = _constants(self.tessellation) | {"FINEST": self._halvings}
        for name in names:
            layouts = self._layouts if name == "lens_split" else self._layouts[:1]
            self._pipelines[name] = kept(
                "create_compute_pipeline",
                label=name,
                layout=kept("create_pipeline_layout", bind_group_layouts=layouts),
                compute={"module": self._shader, "entry_point": name, "constants": constants},
            )

    def _step_group(self) -> Any:
        """What tells every pass of `lens_split` its step: from the finest, first sides, then centres."""
        rows = np.zeros((2 * self._halvings, _ALIGNED // 4), np.uint32)
        rows[:, 0], rows[:, 1] = np.divmod(np.arange(len(rows)), 2)
        steps = self._buffers.setdefault("steps", GrowingBuffer(self._device, "lens steps", wgpu.BufferUsage.UNIFORM))
        steps.write(rows)
        entry = {"binding": 0, "resource": {"buffer": steps.buffer, "offset": 0, "size": 16}}
        return self._device.wgpu.create_bind_group(layout=self._layouts[1], entries=[entry])


def _constants(tessellation: Tessellation) -> dict[str, float]:
    """What the shader is specialised by."""
    return {
        "MODE": _MODES[tessellation.mode],
        "SEGMENTS": tessellation.segments,
        "MOST": tessellation.most,
        "SUB_EDGE_PX": tessellation.sub_edge_px,
        "ERROR_PX": tessellation.error_px,
    }


def _room(tessellation: Tessellation, cells: int, most: int) -> int:
    """Triangles that there must be room for, ``most`` at most; if more are wanted, all sides are cut less."""
    if tessellation.mode in ("exact", "coarse"):
        return min(16 * cells, most)
    if tessellation.mode == "uniform":
        return min((2 * tessellation.segments**2 + 8) * cells, most)
    return min(max(_LEAST_ROOM, _ROOM_A_CELL * cells), most)
