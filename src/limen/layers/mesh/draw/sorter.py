"""What all ways of sorting triangles to panels share: buffers, compute steps, counting, growing, and one draw.

A way of sorting is a shader with some steps. It leaves pairs (triangle, eye * panels + panel) on the GPU and the
arguments of the draw that takes them; `limen.layers.mesh.draw.sort` is limen's own, the others are there to be compared
with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.errors import DeviceLimitError
from limen.geometry import Floats
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.layers.common.panel_uniforms import MAX_EYES
from limen.viewing.projection import PanelProjections, QuiltPanels

__all__ = ["DRAW_OFFSET", "GROUP", "MAX_GROUPS", "Groups", "Parts", "Sorter", "Steps"]

DRAW_OFFSET = 16
"""Where in `Sorter.arguments` the arguments of the indirect draw begin, bytes."""

GROUP = 128
"""Invocations of a workgroup that goes through vertices or triangles."""

MAX_GROUPS = 65_535
"""Workgroups of a dispatch along one dimension."""

Steps: TypeAlias = Mapping[str, tuple[str, ...]]
Parts: TypeAlias = Mapping[str, tuple[str, ...]]
Groups: TypeAlias = tuple[int, int, int] | int
"""Workgroups of a step, or where in `Sorter.arguments` they stand, bytes."""

_FIRST_SHARE = 1.25  # pairs a triangle that room is made for at first
_FIRST_PER_PANEL = 64
_SHARED = ("frame", "views", "positions", "triangles", "ways", "pairs", "counters", "arguments")


class Sorter:
    """Triangles of one mesh, sorted to panels every frame.

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

    package: ClassVar[str] = "limen.layers.mesh.draw"
    shader: ClassVar[str]
    """A file of that package; its bindings are `bindings`, its entry points `steps`."""
    bindings: ClassVar[tuple[str, ...]]
    """Names of the buffers, in the order of their numbers."""
    written: ClassVar[tuple[str, ...]]
    """Those that a step writes."""
    steps: ClassVar[Steps]
    """Entry points in their order, with the buffers of each. Whoever is started by `arguments` must not list them."""
    parts: ClassVar[Parts]
    """Steps by what they are for: what a benchmark tells apart."""
    source: ClassVar[int] = 0
    """Where the vertex stage takes its vertices from: see ``scene.wgsl``."""

    def __init__(
        self,
        device: Device,
        positions: NDArray[np.float32],
        triangles: NDArray[np.uint32],
        *,
        first_pairs: int | None = None,
    ) -> None:
        self.device = device
        self.vertex_count, self.triangle_count = len(positions), len(triangles)
        if max(self.vertex_count, self.triangle_count) > GROUP * MAX_GROUPS:
            raise DeviceLimitError(
                f"a mesh of {self.triangle_count:,} triangles is too large for one draw, which takes "
                f"{GROUP * MAX_GROUPS:,}: simplify it or split it"
            )
        self.buffers = {
            name: GrowingBuffer(device, name, _usage(name)) for name in dict.fromkeys((*_SHARED, *self.bindings))
        }
        self.move(positions)
        self.choose(triangles)
        self.buffers["counters"].reserve(16)
        self.buffers["arguments"].reserve(64)
        self.pair_capacity = first_pairs or 0
        self._readback = device.wgpu.create_buffer(
            label="counters", size=16, usage=wgpu.BufferUsage.MAP_READ | wgpu.BufferUsage.COPY_DST
        )
        module = load_shader(device, self.package, self.shader)
        self._layouts = {step: self._layout(names) for step, names in self.steps.items()}
        self._pipelines = {
            step: device.kept(
                "create_compute_pipeline",
                label=step,
                layout=device.kept("create_pipeline_layout", bind_group_layouts=[layout]),
                compute={"module": module, "entry_point": step},
            )
            for step, layout in self._layouts.items()
        }
        self._groups: dict[str, Any] = {}
        self._bound: tuple[int, ...] = ()
        self._frame: NDArray[np.void] = np.zeros(1, [("pair_capacity", "<u4")])
        self.eyes, self.panels = 1, 0

    def move(self, positions: NDArray[np.float32]) -> None:
        """Other places for the same vertices: shape (V, 3)."""
        self.buffers["positions"].write(positions.astype(np.float32, copy=False))

    def choose(self, triangles: NDArray[np.uint32]) -> None:
        """Other triangles of the same vertices, shape (T, 3): what is sorted from now on."""
        self.triangle_count = len(triangles)
        self.buffers["triangles"].write(triangles)

    def sort(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> None:
        """Submit the sorting of one frame.

        Parameters
        ----------
        views
            The panels as each eye sees them; one eye or two.
        eye_from_mesh
            Affine maps from the mesh's coordinates to the way from each eye, metres: shape (E, 3, 4).
        """
        self.eyes, self.panels = len(views), len(views[0].near)
        if self.eyes > MAX_EYES:
            raise ValueError(f"at most {MAX_EYES} eyes are drawn at once, got {self.eyes}")
        if not self.pair_capacity:
            self.pair_capacity = int(self.triangle_count * self.eyes * _FIRST_SHARE) + self.panels * _FIRST_PER_PANEL
        self.buffers["ways"].reserve(self.vertex_count * self.eyes * 16)
        self._frame = self._prepare(views, eye_from_mesh)
        self.submit()

    def settle(self) -> int:
        """Wait for the count of pairs; where there were more than there was room for, sort once more with room.

        Returns
        -------
        int
            How many pairs there are.
        """
        counts = self._counts()
        if self._make_room(counts):
            self.submit()
            counts = self._counts()
        return counts[0]

    def read_pairs(self) -> NDArray[np.uint32]:
        """The pairs of the last sort, shape (n, 2): triangle, eye * panels + panel. Waits."""
        count = self.settle()
        data = self.device.wgpu.queue.read_buffer(self.buffers["pairs"].buffer, size=max(count, 1) * 8)
        return np.frombuffer(data, np.uint32).reshape(-1, 2)[:count]

    @property
    def arguments(self) -> Any:
        """The buffer with the arguments of the indirect draw, at `DRAW_OFFSET`."""
        return self.buffers["arguments"].buffer

    def record(self, render_pass: Any, _windows: QuiltPanels) -> None:
        """Draw what was sorted, with the pipeline and bindings that are set."""
        render_pass.draw_indirect(self.arguments, DRAW_OFFSET)

    def submit(self, steps: Sequence[str] | None = None) -> None:
        """Run the steps of the last `sort` (again): all of them, or some that follow each other."""
        self._reserve()
        self._frame["pair_capacity"] = self.pair_capacity
        self.buffers["frame"].write(self._frame)
        groups, sizes = self._bind_groups(), self._sizes()
        encoder = self.device.wgpu.create_command_encoder(label="sort")
        if steps is None or steps[0] == next(iter(self.steps)):
            self._clear(encoder)
        compute = encoder.begin_compute_pass()
        for step in self.steps if steps is None else steps:
            compute.set_pipeline(self._pipelines[step])
            compute.set_bind_group(0, groups[step])
            size = sizes.get(step, (1, 1, 1))
            if isinstance(size, int):
                compute.dispatch_workgroups_indirect(self.arguments, size)
            else:
                compute.dispatch_workgroups(*size)
        compute.end()
        encoder.copy_buffer_to_buffer(self.buffers["counters"].buffer, 0, self._readback, 0, 16)
        self.device.wgpu.queue.submit([encoder.finish()])

    def destroy(self) -> None:
        for buffer in self.buffers.values():
            buffer.destroy()
        self._readback.destroy()
        self._groups.clear()
        self._pipelines.clear()

    # ------------------------------------------------------------------ what ways of sorting differ in

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        """Write what the steps read; the one row of ``frame``, but for its ``pair_capacity``."""
        raise NotImplementedError

    def _sizes(self) -> dict[str, Groups]:
        """Workgroups of the steps that have more than one."""
        raise NotImplementedError

    def _reserve(self) -> None:
        """Make room for `pair_capacity` pairs."""
        self.buffers["pairs"].reserve(self.pair_capacity * 8)

    def _clear(self, encoder: Any) -> None:
        """What a sort finds zero."""
        encoder.clear_buffer(self.buffers["counters"].buffer, 0, 16)

    def _make_room(self, counts: Sequence[int]) -> bool:
        """Whether there was too little for these counts: then there is enough now."""
        if counts[0] <= self.pair_capacity:
            return False
        self.pair_capacity = counts[0] + counts[0] // 4
        return True

    # ------------------------------------------------------------------ steps of a sort

    def _counts(self) -> tuple[int, ...]:
        self._readback.map_sync(wgpu.MapMode.READ)
        try:
            return tuple(np.frombuffer(self._readback.read_mapped(copy=False), np.uint32).tolist())
        finally:
            self._readback.unmap()

    def _bind_groups(self) -> dict[str, Any]:
        state = tuple(buffer.generation for buffer in self.buffers.values())
        if state != self._bound:
            self._groups = {
                step: self.device.wgpu.create_bind_group(
                    layout=self._layouts[step],
                    entries=[
                        {"binding": self.bindings.index(name), "resource": {"buffer": self.buffers[name].buffer}}
                        for name in names
                    ],
                )
                for step, names in self.steps.items()
            }
            self._bound = state
        return self._groups

    def _layout(self, names: Sequence[str]) -> Any:
        def kind(name: str) -> str:
            return "uniform" if name == "frame" else "storage" if name in self.written else "read-only-storage"

        return self.device.kept(
            "create_bind_group_layout",
            entries=[
                {
                    "binding": self.bindings.index(name),
                    "visibility": wgpu.ShaderStage.COMPUTE,
                    "buffer": {"type": kind(name)},
                }
                for name in names
            ],
        )


def _usage(name: str) -> int:
    usage = wgpu.BufferUsage
    special: dict[str, int] = {
        "frame": usage.UNIFORM,
        "counters": usage.STORAGE | usage.COPY_SRC,
        "arguments": usage.STORAGE | usage.INDIRECT,
        "pairs": usage.STORAGE | usage.COPY_SRC,
        "triangles": usage.STORAGE | usage.INDEX,
    }
    return special.get(name, int(usage.STORAGE))
