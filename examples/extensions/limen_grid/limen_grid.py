"""A kind of layers for limen: grid lines on the floor of the room, a metre apart."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import wgpu

from limen.gpu.buffers import GrowingBuffer
from limen.layers.base import Cut, CutCounts
from limen.layers.registry import Kind
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.state import LayerState

KIND = Kind(  # what limen has to know before it has seen a layer
    noun="grid lines", layer="limen_grid:GridLayer", drawer="limen_grid:GridDrawer", placements=(InRoom,),
    overlays=("panels",), policies=("full",), default_policy="full", memory_share=0.0, max_quilt_px=1 << 26,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class GridLayer:
    """What is shown: lines from -``reach_m`` to ``reach_m``, in a colour (linear light, 0 to 1)."""

    kind: ClassVar[str] = "grid"
    reach_m: float = 5.0
    colour: tuple[float, float, float] = (0.1, 0.8, 0.3)
    placement: InRoom | None = None
    policy: Policy | None = None
    overlay: str = ""
    name, alone_because, overlay_word = "grid", "", "panels"

    @classmethod
    def of(cls, content, policy, placement, overlay):
        return cls(content.reach_m, placement=placement, policy=policy, overlay=overlay)

    def state(self, time_s, display):
        at, policy = self.placement or InRoom.of(np.eye(4)), self.policy or Policy("full")
        return LayerState(placement=at, policy=policy, overlay=self.overlay)

    def turned(self, state, turn, display):
        return state  # whatever is dragged, the floor stays

    def selector(self, display, whole):
        return GridSelector(self)


class GridSelector:
    """What decides: all lines, wherever the viewers are. Arrays in, arrays out; no GPU."""

    sources = ()

    def __init__(self, layer):
        at = np.arange(-layer.reach_m, layer.reach_m + 0.5)
        level, far = 0 * at, 0 * at + layer.reach_m
        along_x = np.stack([[-far, level, at], [far, level, at]]).transpose(2, 0, 1)  # (lines, 2 ends, 3)
        self._ends = np.concatenate([along_x, along_x[..., ::-1]]).reshape(-1, 3)  # those along z, too

    def select(self, views, state, frame, resident, *, live):
        matrix, active = state.placement.matrix, sum(int(view.facing.sum()) for view in views)
        ends_m = self._ends @ matrix[:3, :3].T + matrix[:3, 3]
        counts = CutCounts(items=len(ends_m) // 2, panels_active=active)
        return Cut(parts=(ends_m,) * len(views), counts=counts, near_m=(0.02,) * len(views))

    def resolve(self, cut, resident):
        return cut

    def nothing(self, *_): ...

    complete = take = close = nothing


SHADER = """
struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) edges: vec4<f32>,
    @location(1) more_edges: vec4<f32>,
    @location(2) colour: vec3<f32>,
}

@vertex
fn corner(@location(0) at: vec4<f32>, @location(1) edges: vec4<f32>, @location(2) more_edges: vec4<f32>,
          @location(3) colour: vec3<f32>) -> Corner {
    return Corner(at, edges, more_edges, colour);
}

@fragment
fn colour(in: Corner) -> @location(0) vec4<f32> {
    if any(min(in.edges, in.more_edges) < vec4(0.0)) {
        discard;  // beside the panel's outline
    }
    return vec4(in.colour, 1.0);
}
"""
ROW = np.dtype([("position", "<f4", 4), ("edges", "<f4", (2, 4)), ("colour", "<f4", 3)])


class GridDrawer:
    """What draws: the only part that sees the GPU."""

    allocators, upload = (), GridSelector.nothing

    def __init__(self, device, layer, gpu_bytes):
        self._device, self._colour, self._pipelines = device.wgpu, layer.colour, {}
        self._module = device.wgpu.create_shader_module(code=SHADER)
        self._buffer = GrowingBuffer(device, "grid lines", wgpu.BufferUsage.VERTEX)

    def prepare(self, view, part, overlay):
        """Every line on every panel that an eye is before: in clip space, and how far inside the panel's edges."""
        rows = []
        for eye in view.eyes:
            ways = part - eye.eye_m
            for panel in np.flatnonzero(eye.facing):
                row = np.zeros(len(ways), ROW)
                row["position"][:, [0, 1, 3]] = ways @ eye.clip[panel].T
                row["position"][:, 2] = eye.near[panel]
                row["edges"] = (ways @ eye.edges[panel].T).reshape(-1, 2, 4)
                row["colour"] = np.roll(self._colour, panel) if overlay == "panels" else self._colour
                rows.append(row)
        self._rows = np.concatenate([np.zeros(0, ROW), *rows])

    def draw(self, encoder, target, view, part, overlay):
        self._buffer.write(self._rows)
        lines = encoder.begin_render_pass(color_attachments=[target.colour()], depth_stencil_attachment=target.depth())
        lines.set_pipeline(self._pipeline(target.format))
        lines.set_vertex_buffer(0, self._buffer.buffer)
        lines.draw(len(self._rows))
        lines.end()

    def triangles(self, *, wait):
        return 0

    def destroy(self):
        self._buffer.destroy()

    def _pipeline(self, target_format):
        if target_format not in self._pipelines:
            forms = enumerate(("float32x4", "float32x4", "float32x4", "float32x3"))
            parts = [{"format": form, "offset": 16 * place, "shader_location": place} for place, form in forms]
            self._pipelines[target_format] = self._device.create_render_pipeline(
                layout="auto",
                vertex={"module": self._module, "buffers": [{"array_stride": ROW.itemsize, "attributes": parts}]},
                primitive={"topology": "line-list"},
                depth_stencil={"format": "depth32float", "depth_write_enabled": True, "depth_compare": "greater"},
                fragment={"module": self._module, "targets": [{"format": target_format}]},
            )
        return self._pipelines[target_format]
