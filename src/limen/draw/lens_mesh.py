"""What is looked at through lenses, cut into triangles by compute shaders.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.select.lens_cells import LensCells

__all__ = ["CORNER", "LENS_CELL", "LENS_MODES", "LensMesh", "LensMode", "Tessellation", "Triangles"]

LensMode: TypeAlias = Literal["exact", "coarse", "uniform", "acuity", "error"]
LENS_MODES: tuple[LensMode, ...] = get_args(LensMode)

LENS_CELL = np.dtype([("rect_px", "<f4", 4), ("beside", "<i4", 4), ("names", "<u4", 4)])
CORNER = np.dtype([("pixel", "<f4", 2), ("texel", "<f4", 2), ("panel", "<u4"), ("padding", "<u4")])

_NUMBERS = {
    "frame": 0, "panels": 1, "eyes": 2, "lenses": 10, "cells": 11, "wishes": 12, "corners": 13, "drawn": 14, "split": 16,
}  # fmt: skip
_SHARED = ("frame", "panels", "eyes", "lenses")
_READ_WRITE = ("wishes", "corners", "drawn", "split")
_MODES: dict[LensMode, int] = {"exact": 0, "coarse": 0, "uniform": 1, "acuity": 2, "error": 0}
_ALIGNED = 256  # offsets of uniforms: the largest that WebGPU lets adapters ask for
_LANES, _CELLS_A_ROW = 64, 32768  # as in the shader

_LEAST_ROOM, _ROOM_A_CELL = 1 << 16, 256
"""Triangles that there is room for where their number is not known before: 5 MB, and 18 kB a cell."""


@dataclass(frozen=True, slots=True)
class Tessellation:
    """How what is seen through lenses is drawn.

    Parameters
    ----------
    mode
        ``exact``: every pixel looks up what it shows. Else in triangles between whose corners places are interpolated:
        ``coarse``, two a cell (the paper's NGV); ``uniform``, every side of a cell in ``segments`` (PRE); ``acuity``,
        the more the more a lens bends and the nearer the viewers are, up to ``most`` (ADGV); ``error``, as many as it
        takes to be nowhere off by more than allowed.
    segments, most
        Parts of a cell's side; ``error`` takes powers of two.
    sub_edge_px
        Length of the sides of triangles that ``acuity`` makes at the sharpest bend, for viewers who see single pixels.
    error_px
        How far ``error`` lets a place be drawn from where it belongs, in pixels or, for viewers who do not see single
        pixels, in the smallest lengths that they see.

    Raises
    ------
    InputError
        If that cannot be.
    """

    mode: LensMode = "exact"
    segments: int = 16
    most: int = 64
    sub_edge_px: float = 4.0
    error_px: float = 0.5

    def __post_init__(self) -> None:
        if self.mode not in LENS_MODES:
            raise InputError(f"no lens mode is named '{self.mode}': there are {', '.join(LENS_MODES)}")
        if not (1 <= self.segments <= self.most <= 1024):
            raise InputError(
                f"segments and most must lie from 1 to 1024, segments first, got {self.segments} and {self.most}"
            )
        if not (self.sub_edge_px > 0 and self.error_px > 0):
            raise InputError(
                f"sub_edge_px and error_px must be above 0, got {self.sub_edge_px:g} and {self.error_px:g}"
            )

    @property
    def halvings(self) -> int:
        """How often ``error`` may halve a cell's side."""
        return self.most.bit_length() - 1

    @property
    def constants(self) -> dict[str, float]:
        """The shader's."""
        return {
            "MODE": _MODES[self.mode],
            "FINEST": self.halvings,
            "SEGMENTS": self.segments,
            "MOST": self.most,
            "SUB_EDGE_PX": self.sub_edge_px,
            "ERROR_PX": self.error_px,
        }

    def room(self, cells: int, most: int) -> int:
        """Triangles that there must be room for, ``most`` at most; if more are wanted, all sides are cut less."""
        if self.mode in ("exact", "coarse"):
            return min(16 * cells, most)
        if self.mode == "uniform":
            return min((2 * self.segments**2 + 8) * cells, most)
        return min(max(_LEAST_ROOM, _ROOM_A_CELL * cells), most)


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
        room = self.tessellation.room(len(rows), self._device.max_binding_bytes // (3 * CORNER.itemsize))
        self._buffers["cells"].write(rows)
        if self._split is not None:
            self._split.reserve(self._split_bytes(max(len(rows), 1)))
        self._buffers["wishes"].reserve(16 * len(rows))
        self.corners.reserve(3 * CORNER.itemsize * room)
        self.drawn.write(np.array([0, 1] + 14 * [0], np.uint32))
        return {"cells": len(rows), "most_triangles": room}

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
            for number in range(2 * self.tessellation.halvings):
                compute.set_bind_group(1, self._steps, [number * _ALIGNED])
                compute.dispatch_workgroups(*each)
        compute.end()

    def read(self) -> Triangles:
        """The triangles made last; waits for the GPU."""
        queue = self._device.wgpu.queue
        count = int(np.frombuffer(queue.read_buffer(self.drawn.buffer, 0, 4), np.uint32)[0]) // 3
        size = 3 * CORNER.itemsize * count
        corners = np.frombuffer(queue.read_buffer(self.corners.buffer, 0, size), CORNER) if count else np.empty(
            0, CORNER
        )  # fmt: skip
        corners = corners.reshape(-1, 3)
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

    def _split_bytes(self, count: int) -> int:
        """A number for every place of every cell."""
        return 4 * count * ((1 << self.tessellation.halvings) + 1) ** 2

    def _group(self, buffers: dict[str, GrowingBuffer]) -> Any:
        buffers = {**buffers, **self._buffers}
        entries = [{"binding": _NUMBERS[name], "resource": {"buffer": buffers[name].buffer}} for name in self._names]
        return self._device.wgpu.create_bind_group(layout=self._layouts[0], entries=entries)

    def _make_pipelines(self) -> None:
        gpu, compute = self._device.wgpu, wgpu.ShaderStage.COMPUTE
        kinds = {"frame": "uniform"} | dict.fromkeys(_READ_WRITE, "storage")
        entries: list[dict[str, Any]] = [
            {"binding": _NUMBERS[name], "visibility": compute, "buffer": {"type": kinds.get(name, "read-only-storage")}}
            for name in self._names
        ]
        self._layouts = [gpu.create_bind_group_layout(entries=entries)]
        names = ["lens_wishes", "lens_counts", "lens_triangles"]
        if self._split is not None:
            uniform = {"type": "uniform", "has_dynamic_offset": True}
            self._layouts.append(
                gpu.create_bind_group_layout(entries=[{"binding": 0, "visibility": compute, "buffer": uniform}])
            )
            self._steps = self._step_group()
            names = ["lens_survey", "lens_split", "lens_split_counts", "lens_split_triangles"]
        constants = self.tessellation.constants
        for name in names:
            layouts = self._layouts if name == "lens_split" else self._layouts[:1]
            self._pipelines[name] = gpu.create_compute_pipeline(
                label=name,
                layout=gpu.create_pipeline_layout(bind_group_layouts=layouts),
                compute={"module": self._shader, "entry_point": name, "constants": constants},
            )

    def _step_group(self) -> Any:
        """What tells every pass of `lens_split` its step: from the finest, first sides, then centres."""
        rows = np.zeros((2 * self.tessellation.halvings, _ALIGNED // 4), np.uint32)
        rows[:, 0], rows[:, 1] = np.divmod(np.arange(len(rows)), 2)
        steps = self._buffers["steps"] = GrowingBuffer(self._device, "lens steps", wgpu.BufferUsage.UNIFORM)
        steps.write(rows)
        entry = {"binding": 0, "resource": {"buffer": steps.buffer, "offset": 0, "size": 16}}
        return self._device.wgpu.create_bind_group(layout=self._layouts[1], entries=[entry])
