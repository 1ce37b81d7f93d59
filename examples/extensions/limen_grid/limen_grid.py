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
    "grid lines", "limen_grid:GridLayer", "limen_grid:GridDrawer", placements=(InRoom,), overlays=("panels",),
    policies=("full",), default_policy="full", memory_share=0.0, max_quilt_px=1 << 26,
)  # fmt: skip

SHADER = """
struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) inside: vec4<f32>,
    @location(1) inside_too: vec4<f32>,
    @location(2) colour: vec3<f32>,
}

@vertex
fn corner(
    @location(0) position: vec4<f32>, @location(1) inside: vec4<f32>, @location(2) inside_too: vec4<f32>,
    @location(3) colour: vec3<f32>,
) -> Corner {
    return Corner(position, inside, inside_too, colour);
}

@fragment
fn colour(in: Corner) -> @location(0) vec4<f32> {
    if any(min(in.inside, in.inside_too) < vec4(0.0)) {
        discard;  // beside the panel's outline
    }
    return vec4(in.colour, 1.0);
}
"""
ROW = np.dtype([("position", "<f4", 4), ("inside", "<f4", (2, 4)), ("colour", "<f4", 3)])


@dataclass(frozen=True, eq=False)
class GridLayer:
    """What is shown: lines from -``reach_m`` to ``reach_m``, in a colour of linear light."""

    kind: ClassVar[str] = "grid"
    reach_m: int = 5
    colour: tuple[float, float, float] = (0.1, 0.8, 0.3)
    overlay: str = ""
    name, alone_because, overlay_word = "grid", "", "panels"

    @classmethod
    def of(cls, content, policy, placement, overlay):
        return cls(overlay=overlay)

    def state(self, time_s, display):
        return LayerState(placement=InRoom.of(np.eye(4)), policy=Policy("full"), overlay=self.overlay)

    def turned(self, state, turn, display):
        return state  # whatever is dragged, the floor stays

    def selector(self, display, whole):
        return GridSelector(self)


class GridSelector:
    """What decides: all lines, wherever the viewers are. Arrays in, arrays out; no GPU."""

    sources = ()

    def __init__(self, layer):
        at = np.arange(-layer.reach_m, layer.reach_m + 1.0)
        far = np.full_like(at, layer.reach_m)
        across = np.stack([np.stack([-far, 0 * at, at], 1), np.stack([far, 0 * at, at], 1)], axis=1)
        self._ends = np.concatenate([across, across[..., ::-1]]).reshape(-1, 3)  # of lines along x, and along z

    def select(self, views, state, frame, resident, *, live):
        matrix = state.placement.matrix
        ends_m = self._ends @ matrix[:3, :3].T + matrix[:3, 3]
        counts = CutCounts(len(ends_m) // 2, panels_active=sum(int(view.facing.sum()) for view in views))
        return Cut((ends_m,) * len(views), counts, near_m=(0.02,) * len(views))

    def resolve(self, cut, resident):
        return cut

    def nothing(self, *_): ...

    complete = take = close = nothing  # for kinds that stream chunks


class GridDrawer:
    """What draws: the only part that sees the GPU."""

    allocators = ()

    def __init__(self, device, layer, gpu_bytes):
        self._device, self._colour = device.wgpu, layer.colour
        self._module, self._pipelines = self._device.create_shader_module(code=SHADER), {}
        self._buffer = GrowingBuffer(device, "grid lines", wgpu.BufferUsage.VERTEX)

    def prepare(self, view, part, overlay):
        """Every line on every panel that an eye is before: in the clip space of the quilt, and how far inside."""
        rows = []
        for eye in view.eyes:
            ways = part - eye.eye_m
            for panel in np.flatnonzero(eye.facing):
                row = np.zeros(len(ways), ROW)
                row["position"][:, [0, 1, 3]] = ways @ eye.clip[panel].T
                row["position"][:, 2] = eye.near[panel]
                row["inside"] = (ways @ eye.edges[panel].T).reshape(-1, 2, 4)
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

    upload = GridSelector.nothing

    def _pipeline(self, target_format):
        if target_format not in self._pipelines:
            forms = zip(("float32x4", "float32x4", "float32x4", "float32x3"), (0, 16, 32, 48), range(4), strict=True)
            parts = [{"format": form, "offset": offset, "shader_location": place} for form, offset, place in forms]
            self._pipelines[target_format] = self._device.create_render_pipeline(
                layout="auto",
                vertex={"module": self._module, "buffers": [{"array_stride": ROW.itemsize, "attributes": parts}]},
                primitive={"topology": "line-list"},
                depth_stencil={"format": "depth32float", "depth_write_enabled": True, "depth_compare": "greater"},
                fragment={"module": self._module, "targets": [{"format": target_format}]},
            )
        return self._pipelines[target_format]
