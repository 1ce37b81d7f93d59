"""Sorts the triangles of a mesh to the panels that they touch, on the GPU, every frame.

The pairs are exact up to the guard band: every panel whose outline a triangle covers is there, and none that the
triangle, seen from the eye, does not come near. Their order is of no matter, since one draw takes them all.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.2.1, sorts in two passes over
all panels; this does the same with a grid of directions, and asks the second pass for few panels instead of all.
Ericson 2005, *Real-Time Collision Detection*, section 5.2.1 (separating axes).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.draw.views import MOST_EYES, SORT_FRAME, grid_words, sort_frame, view_rows
from limen.errors import DeviceLimitError
from limen.geometry import Floats
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.select.directions import direction_grid
from limen.view import PanelViews

__all__ = ["DRAW_OFFSET", "TriangleSorter"]

DRAW_OFFSET = 16
"""Where in `TriangleSorter.arguments` the arguments of the indirect draw begin, bytes."""

_GROUP = 128  # the shader's workgroup_size of `locate` and `assign`
_MOST_GROUPS = 65_535
_WRITTEN = ("ways", "waiting", "pairs", "counters", "arguments")
_NUMBERS = {
    "frame": 0, "views": 1, "positions": 2, "triangles": 3, "ways": 4,
    "grid": 5, "waiting": 6, "pairs": 7, "counters": 8, "arguments": 9,
}  # fmt: skip
_STEPS: dict[str, tuple[str, ...]] = {
    "locate": ("frame", "views", "positions", "ways", "grid"),
    "assign": ("frame", "triangles", "ways", "waiting", "pairs", "counters"),
    "plan": ("counters", "arguments"),
    # Whoever is started by `arguments` must not be able to write them.
    "search": ("frame", "views", "triangles", "ways", "grid", "waiting", "pairs", "counters"),
    "finish": ("frame", "counters", "arguments"),
}
_FIRST_SHARE = 1.25  # pairs a triangle that room is made for at first
_FIRST_PER_PANEL = 64


class TriangleSorter:
    """The sorter of one mesh.

    Parameters
    ----------
    positions, triangles
        Shape (V, 3), any unit; shape (T, 3), indices into it.
    first_pairs
        How many pairs there is room for at first; more is made when needed.

    Raises
    ------
    DeviceLimitError
        If the mesh is larger than a shader of this adapter can see.
    """

    def __init__(
        self,
        device: Device,
        positions: NDArray[np.float32],
        triangles: NDArray[np.uint32],
        *,
        first_pairs: int | None = None,
    ) -> None:
        self._device = device
        self.vertex_count, self.triangle_count = len(positions), len(triangles)
        if max(self.vertex_count, self.triangle_count) > _GROUP * _MOST_GROUPS:
            raise DeviceLimitError(
                f"a mesh of {self.triangle_count:,} triangles is too large for one draw, which takes "
                f"{_GROUP * _MOST_GROUPS:,}: simplify it or split it"
            )
        usages = {"frame": wgpu.BufferUsage.UNIFORM, "counters": wgpu.BufferUsage.COPY_SRC, "arguments": 0}
        usages["arguments"] = wgpu.BufferUsage.INDIRECT
        usages["pairs"] = wgpu.BufferUsage.COPY_SRC
        self.buffers = {
            name: GrowingBuffer(
                device, name, usages.get(name, 0) | (wgpu.BufferUsage.STORAGE if name != "frame" else 0)
            )
            for name in _NUMBERS
        }
        self.move(positions)
        self.buffers["triangles"].write(triangles)
        self.buffers["counters"].reserve(8)
        self.buffers["arguments"].reserve(32)
        self.pair_capacity = first_pairs or 0
        self._readback = device.wgpu.create_buffer(
            label="counters", size=8, usage=wgpu.BufferUsage.MAP_READ | wgpu.BufferUsage.COPY_DST
        )
        module = load_shader(device, "limen.draw", "sort.wgsl")
        self._layouts = {step: self._layout(names) for step, names in _STEPS.items()}
        self._pipelines = {
            step: device.wgpu.create_compute_pipeline(
                label=step,
                layout=device.wgpu.create_pipeline_layout(bind_group_layouts=[layout]),
                compute={"module": module, "entry_point": step},
            )
            for step, layout in self._layouts.items()
        }
        self._groups: dict[str, Any] = {}
        self._bound: tuple[int, ...] = ()
        self._frame = np.zeros(1, SORT_FRAME)
        self._eyes = 1

    def move(self, positions: NDArray[np.float32]) -> None:
        """Other places for the same vertices: shape (V, 3)."""
        self.buffers["positions"].write(positions.astype(np.float32, copy=False))

    def sort(self, views: Sequence[PanelViews], eye_from_mesh: Floats, light: tuple[Floats, Floats]) -> None:
        """Submit the sorting of one frame.

        Parameters
        ----------
        views
            The panels as each eye sees them; one eye or two.
        eye_from_mesh
            Affine maps from the mesh's coordinates to the way from each eye, metres: shape (E, 3, 4).
        light
            See `limen.draw.views.view_rows`: gain and falloff of every panel.
        """
        grids = [direction_grid(view) for view in views]
        words, begins = grid_words(grids)
        eyes, panels = len(views), len(views[0].near)
        if eyes > MOST_EYES:
            raise ValueError(f"at most {MOST_EYES} eyes are drawn at once, got {eyes}")
        if not self.pair_capacity:
            self.pair_capacity = int(self.triangle_count * eyes * _FIRST_SHARE) + panels * _FIRST_PER_PANEL
        self.buffers["views"].write(view_rows(views, grids, *light))
        self.buffers["grid"].write(words)
        self.buffers["ways"].reserve(self.vertex_count * eyes * 16)
        self.buffers["waiting"].reserve(self.triangle_count * eyes * 4)
        self._eyes = eyes
        self._frame = sort_frame(
            grids, begins, eye_from_mesh, vertices=self.vertex_count, triangles=self.triangle_count, panels=panels
        )
        self._submit()

    def settle(self) -> int:
        """Wait for the count of pairs; where there were more than there was room for, sort once more with room.

        Returns
        -------
        int
            How many pairs there are.
        """
        pairs = self._count()
        if pairs > self.pair_capacity:
            self.pair_capacity = pairs + pairs // 4
            self._submit()
            pairs = self._count()
        return pairs

    def read_pairs(self) -> NDArray[np.uint32]:
        """The pairs of the last sort, shape (n, 2): triangle, eye * panels + panel. Waits."""
        count = self.settle()
        data = self._device.wgpu.queue.read_buffer(self.buffers["pairs"].buffer, size=max(count, 1) * 8)
        return np.frombuffer(data, np.uint32).reshape(-1, 2)[:count]

    @property
    def arguments(self) -> Any:
        """The buffer with the arguments of the indirect draw, at `DRAW_OFFSET`."""
        return self.buffers["arguments"].buffer

    def destroy(self) -> None:
        for buffer in self.buffers.values():
            buffer.destroy()
        self._readback.destroy()
        self._groups.clear()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a sort

    def _submit(self) -> None:
        self.buffers["pairs"].reserve(self.pair_capacity * 8)
        self._frame["pair_capacity"] = self.pair_capacity
        self.buffers["frame"].write(self._frame)
        groups = self._bind_groups()
        encoder = self._device.wgpu.create_command_encoder(label="sort")
        encoder.clear_buffer(self.buffers["counters"].buffer, 0, 8)
        compute = encoder.begin_compute_pass()
        sizes = {
            "locate": (-(-self.vertex_count // _GROUP), self._eyes, 1),
            "assign": (-(-self.triangle_count // _GROUP), self._eyes, 1),
        }
        for step in _STEPS:
            compute.set_pipeline(self._pipelines[step])
            compute.set_bind_group(0, groups[step])
            if step == "search":
                compute.dispatch_workgroups_indirect(self.arguments, 0)
            else:
                compute.dispatch_workgroups(*sizes.get(step, (1, 1, 1)))
        compute.end()
        encoder.copy_buffer_to_buffer(self.buffers["counters"].buffer, 0, self._readback, 0, 8)
        self._device.wgpu.queue.submit([encoder.finish()])

    def _count(self) -> int:
        self._readback.map_sync(wgpu.MapMode.READ)
        try:
            return int(np.frombuffer(self._readback.read_mapped(copy=False), np.uint32)[0])
        finally:
            self._readback.unmap()

    def _bind_groups(self) -> dict[str, Any]:
        state = tuple(buffer.generation for buffer in self.buffers.values())
        if state != self._bound:
            self._groups = {
                step: self._device.wgpu.create_bind_group(
                    layout=self._layouts[step],
                    entries=[
                        {"binding": _NUMBERS[name], "resource": {"buffer": self.buffers[name].buffer}} for name in names
                    ],
                )
                for step, names in _STEPS.items()
            }
            self._bound = state
        return self._groups

    def _layout(self, names: Sequence[str]) -> Any:
        def kind(name: str) -> str:
            return "uniform" if name == "frame" else "storage" if name in _WRITTEN else "read-only-storage"

        return self._device.wgpu.create_bind_group_layout(
            entries=[
                {"binding": _NUMBERS[name], "visibility": wgpu.ShaderStage.COMPUTE, "buffer": {"type": kind(name)}}
                for name in names
            ]
        )
