"""Draws splats of a cloud of points into a quilt: every panel a window onto the same scene.

References
----------
Schütz, Kerbl, Wimmer 2021, *Rendering Point Clouds with Compute Shaders and Vertex Order Optimization*, Computer
Graphics Forum 40(4) (the nearest point of a pixel by 64-bit atomics).
Rusinkiewicz, Levoy 2000, *QSplat*, SIGGRAPH (splats of the nodes' own size, round or square).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.errors import DeviceLimitError, InputError
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT, Rgb, Target, Targets
from limen.layers.common.panel_uniforms import view_rows
from limen.layers.points.draw.uniforms import (
    CHUNK_ROW,
    CLOUD,
    CLOUD_STRIDE,
    PLACED,
    chunk_row,
    cloud_rows,
    ray_rows,
    stride_of,
)
from limen.layers.points.layer import PointsPart
from limen.stream.allocators import Slots
from limen.stream.chunks import Update
from limen.viewing.projection import QuiltView

if TYPE_CHECKING:
    from limen.layers.points.layer import PointsLayer

__all__ = ["CHUNK_BYTES", "METHODS", "SHAPES", "PointsDrawer", "Shape", "SplatMethod"]

CHUNK_BYTES = CHUNK_NODES * NODE.itemsize

SplatMethod: TypeAlias = Literal["wide", "narrow", "quads"]
METHODS: tuple[SplatMethod, ...] = get_args(SplatMethod)
"""How the nearest splat of a pixel is found: 64-bit atomics, 32-bit atomics in two passes, quads and the depth test.

On OpenGL ``quads`` is drawn as ``narrow`` where the adapter cannot hold all that is placed at once."""

Shape: TypeAlias = Literal["round", "square"]
SHAPES: tuple[Shape, ...] = get_args(Shape)

_OVERLAYS = {"": 0, "panels": 1, "simplified": 2}
_GROUP, _ROW = 128, 65_535 * 128
_ID_FORMAT = "r32uint"
_NUMBERS = {
    "cloud": 0, "views": 1, "rays": 2, "pairs": 3, "nodes": 4, "tops": 5, "chunks": 6, "placing": 7, "placed": 8,
    "depths": 9, "firsts": 10, "ids": 11,
}  # fmt: skip
_SEEN = ("cloud", "views", "rays", "placed")
_DECODED = ("cloud", "views", "rays", "pairs", "nodes", "tops", "chunks")
_BINDINGS: dict[str, tuple[str, ...]] = {
    "place": (*_DECODED, "placing"),
    "nearest": (*_SEEN, "depths"),
    "first_of_nearest": (*_SEEN, "depths", "firsts"),
    "nearest_wide": (*_SEEN, "depths"),
    "quad": _SEEN,
    "colour": (*_DECODED, "ids"),
}
_WRITTEN = ("placing", "depths", "firsts")


class PointsDrawer:
    """Draws splats of one cloud.

    Parameters
    ----------
    layer
        Its ``shape`` is ``round``: discs that face the eye; or ``square``: the squares around the spheres' pictures.
        Its ``method`` is one of `METHODS`, which all draw the same picture; by default the best that the adapter has.
    gpu_bytes
        Memory for chunks; no more is taken than there are.

    Raises
    ------
    InputError
        If not one chunk fits into ``gpu_bytes``.
    DeviceLimitError
        If the adapter cannot hold so many chunks, or does not have the method.
    """

    def __init__(self, device: Device, layer: PointsLayer, gpu_bytes: int) -> None:
        points = layer.points
        slots = min(min(gpu_bytes, device.max_binding_bytes) // CHUNK_BYTES, points.chunks)
        if slots < 1:
            raise InputError(f"a cloud of points needs room for at least one chunk of {CHUNK_BYTES} bytes")
        if layer.shape not in SHAPES:
            raise InputError(f"no shape of splats is named '{layer.shape}': there are {', '.join(SHAPES)}")
        self.method: SplatMethod = layer.method or ("wide" if device.has_wide_atomics else "narrow")
        if self.method == "wide" and not device.has_wide_atomics:
            raise DeviceLimitError(f"{device.adapter_name} has no 64-bit atomics: leave out the method, or take narrow")
        self._device, self._frames, self._round = device, points.frames, int(layer.shape == "round")
        self.allocators = (Slots(slots),)
        self.most_placed = device.max_binding_bytes // PLACED.itemsize
        usage = wgpu.BufferUsage
        self._buffers = {
            name: GrowingBuffer(device, f"points {name}", usage.UNIFORM if name == "cloud" else usage.STORAGE)
            for name in ("cloud", "views", "rays", "pairs", "nodes", "tops", "chunks", "placed", "depths", "ids")
        }
        self._buffers["tops"].write(np.ascontiguousarray(np.concatenate(points.tops)).view(np.uint32))
        self._buffers["nodes"].reserve(slots * CHUNK_BYTES)
        self._buffers["chunks"].reserve(slots * CHUNK_ROW.itemsize)
        self._shader = load_shader(device, "limen.layers.points.draw", "points.wgsl")
        self._layouts = {step: self._layout(names) for step, names in _BINDINGS.items()}
        self._pipelines: dict[tuple[Any, ...], Any] = {}
        self._targets = Targets(device)

    def upload(self, source: int, update: Update[NDArray[np.void]]) -> None:
        queue, frames = self._device.wgpu.queue, self._frames
        for chunk, (slot,), nodes in update.arrived:
            words = np.ascontiguousarray(nodes).view(np.uint32)
            row = chunk_row(frames.origin[chunk], float(frames.step[chunk]), float(frames.radius[chunk]))
            queue.write_buffer(self._buffers["nodes"].buffer, slot * CHUNK_BYTES, words)
            queue.write_buffer(self._buffers["chunks"].buffer, slot * CHUNK_ROW.itemsize, row.view(np.uint8))

    def prepare(self, view: QuiltView, part: PointsPart, overlay: str) -> None:
        """Nothing has to be known before."""

    def draw(self, encoder: Any, target: Target, view: QuiltView, part: PointsPart, overlay: str) -> None:
        size, pairs = view.quilt.size_px, part.cut.pairs
        ends = [*range(self.most_placed, len(pairs), self.most_placed), len(pairs)]
        self._write(view, part, ends, target.background)
        words = 2 if self.method == "wide" else 1
        ids = self._buffers["ids"]
        ids.reserve(stride_of(size[0]) * size[1] * 4 * words)
        self._find(encoder, size, ends)
        render_pass = encoder.begin_render_pass(
            color_attachments=[target.colour()], depth_stencil_attachment=None if target.alone else target.depth()
        )
        render_pass.set_pipeline(self._colour_pipeline(target.format, overlay, words, deep=not target.alone))
        render_pass.set_bind_group(0, self._group("colour"))
        render_pass.draw(3)
        render_pass.end()

    def triangles(self, *, wait: bool) -> int:
        return 0

    def destroy(self) -> None:
        self._targets.destroy()
        for buffer in self._buffers.values():
            buffer.destroy()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a draw

    def _write(self, view: QuiltView, part: PointsPart, ends: Sequence[int], background: Rgb) -> None:
        windows, (eye,), request = view.panels, view.eyes, part.request
        way = request.way_from_cloud
        unit_m = float(np.sqrt(np.square(way[:, :3]).sum() / 3))
        buffers = self._buffers
        buffers["cloud"].write(cloud_rows(windows, way, unit_m, ends=ends, lit=request.lit, background=background))
        buffers["views"].write(view_rows([eye], [np.array(0.0)]))
        buffers["rays"].write(ray_rows(windows, eye))
        buffers["pairs"].write(part.cut.pairs)
        buffers["placed"].reserve(max(ends[0], 1) * PLACED.itemsize)

    def _find(self, encoder: Any, size: tuple[int, int], ends: Sequence[int]) -> None:
        """Leave the nearest pair of every pixel in ``ids``, in batches of what the adapter can hold of placed pairs."""
        ids = self._buffers["ids"]
        encoder.clear_buffer(ids.buffer)
        if not ends[-1]:
            return
        counts = np.diff([0, *ends]).tolist()
        # On OpenGL a later shader's writing does not wait for a draw that reads, and `placed` is written once a batch.
        narrow = len(counts) > 1 and self._device.is_opengl
        if self.method == "quads" and not narrow:
            self._draw_quads(encoder, size, counts)
        elif self.method == "wide":
            for batch, count in enumerate(counts):
                self._compute(encoder, batch, count, ["place", "nearest_wide"])
        else:
            depths = self._buffers["depths"]
            depths.reserve(stride_of(size[0]) * size[1] * 4)
            encoder.clear_buffer(depths.buffer)
            for batch, count in enumerate(counts):
                self._compute(encoder, batch, count, ["place", "nearest"])
            for batch, count in enumerate(counts):  # what one batch has placed is still there
                again = ["place"] if len(counts) > 1 else []
                self._compute(encoder, batch, count, [*again, "first_of_nearest"])

    def _compute(self, encoder: Any, batch: int, count: int, steps: Sequence[str]) -> None:
        compute = encoder.begin_compute_pass()
        for step in steps:
            compute.set_pipeline(self._compute_pipeline(step))
            compute.set_bind_group(0, self._group(step, batch))
            compute.dispatch_workgroups(-(-min(count, _ROW) // _GROUP), -(-count // _ROW), 1)
        compute.end()

    def _draw_quads(self, encoder: Any, size: tuple[int, int], counts: Sequence[int]) -> None:
        found, depth = self._targets.texture(size, _ID_FORMAT), self._targets.texture(size, DEPTH_FORMAT)
        for batch, count in enumerate(counts):
            self._compute(encoder, batch, count, ["place"])
            load = "clear" if batch == 0 else "load"
            render_pass = encoder.begin_render_pass(
                color_attachments=[
                    {"view": found.create_view(), "clear_value": (0, 0, 0, 0), "load_op": load, "store_op": "store"}
                ],
                depth_stencil_attachment={
                    "view": depth.create_view(), "depth_clear_value": 0.0, "depth_load_op": load,
                    "depth_store_op": "store",
                },
            )  # fmt: skip
            render_pass.set_pipeline(self._quad_pipeline())
            render_pass.set_bind_group(0, self._group("quad", batch))
            render_pass.draw(6, count)
            render_pass.end()
        encoder.copy_texture_to_buffer(
            {"texture": found},
            {"buffer": self._buffers["ids"].buffer, "bytes_per_row": stride_of(size[0]) * 4, "rows_per_image": size[1]},
            (*size, 1),
        )

    # ------------------------------------------------------------------ pipelines and bindings

    def _group(self, step: str, batch: int = 0) -> Any:
        spans = {"cloud": {"offset": batch * CLOUD_STRIDE, "size": CLOUD.itemsize}}
        names = {"placing": "placed", "firsts": "ids"}
        if step == "nearest_wide":
            names["depths"] = "ids"
        return self._device.wgpu.create_bind_group(
            layout=self._layouts[step],
            entries=[
                {
                    "binding": _NUMBERS[name],
                    "resource": {"buffer": self._buffers[names.get(name, name)].buffer, **spans.get(name, {})},
                }
                for name in _BINDINGS[step]
            ],
        )

    def _layout(self, names: Sequence[str]) -> Any:
        stage = wgpu.ShaderStage
        drawn = not set(names) & set(_WRITTEN)
        seen = stage.VERTEX | stage.FRAGMENT if drawn else stage.COMPUTE
        kinds = {"cloud": "uniform", **dict.fromkeys(_WRITTEN, "storage")}
        return self._device.kept(
            "create_bind_group_layout",
            entries=[
                {
                    "binding": _NUMBERS[name],
                    "visibility": seen,
                    "buffer": {"type": kinds.get(name, "read-only-storage")},
                }
                for name in names
            ],
        )

    def _pipeline_layout(self, step: str) -> Any:
        return self._device.kept("create_pipeline_layout", bind_group_layouts=[self._layouts[step]])

    def _compute_pipeline(self, step: str) -> Any:
        if (step,) not in self._pipelines:
            wide = step == "nearest_wide"
            module = load_shader(self._device, "limen.layers.points.draw", "points_wide.wgsl") if wide else self._shader
            constants = {} if step == "place" else {"ROUND": self._round}
            self._pipelines[step,] = self._device.kept(
                "create_compute_pipeline",
                label=step,
                layout=self._pipeline_layout(step),
                compute={"module": module, "entry_point": step, "constants": constants},
            )
        return self._pipelines[step,]

    def _quad_pipeline(self) -> Any:
        if ("quad",) not in self._pipelines:
            self._pipelines["quad",] = self._device.kept(
                "create_render_pipeline",
                label="points quads",
                layout=self._pipeline_layout("quad"),
                vertex={"module": self._shader, "entry_point": "quad"},
                primitive={"topology": "triangle-list"},
                depth_stencil={"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"},
                fragment={
                    "module": self._shader,
                    "entry_point": "found",
                    "constants": {"ROUND": self._round},
                    "targets": [{"format": _ID_FORMAT}],
                },
            )
        return self._pipelines["quad",]

    def _colour_pipeline(self, target_format: str, overlay: str, words: int, *, deep: bool) -> Any:
        """``deep``: among other things, by the depth that all have in common."""
        key = ("colour", target_format, overlay, deep)
        if key not in self._pipelines:
            tested = {"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"}
            self._pipelines[key] = self._device.kept(
                "create_render_pipeline",
                label="points colour",
                layout=self._pipeline_layout("colour"),
                vertex={"module": self._shader, "entry_point": "whole"},
                primitive={"topology": "triangle-list"},
                depth_stencil=tested if deep else None,
                fragment={
                    "module": self._shader,
                    "entry_point": "colour_deep" if deep else "colour",
                    "constants": {"OVERLAY": _OVERLAYS[overlay], "WORDS": words},
                    "targets": [{"format": target_format}],
                },
            )
        return self._pipelines[key]
