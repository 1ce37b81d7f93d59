"""The pipelines of a terrain's shaders: one for each kind of picture, made when it is first asked for."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import wgpu

from limen.draw import terrain_records as records
from limen.draw.terrain_look import COLOURS, Colours
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT

__all__ = ["BINDINGS", "TerrainOverlay", "TerrainPipelines"]

TerrainOverlay: TypeAlias = Literal["panels", "patches"]

BINDINGS = {
    "terrain": 0, "views": 1, "sources": 2, "table": 3, "relief_pool": 4, "heights_pool": 5, "drape_pool": 6,
    "bilinear": 7,
}  # fmt: skip

_OVERLAYS: dict[TerrainOverlay | None, int] = {None: 0, "panels": 1, "patches": 2}
_VERTICES = {
    "array_stride": records.VERTEX.itemsize,
    "attributes": [
        {"format": "uint32x2", "offset": 0, "shader_location": 0},
        {"format": "float32", "offset": 8, "shader_location": 1},
        {"format": "uint32", "offset": 12, "shader_location": 2},
    ],
}


class TerrainPipelines:
    """``clip``: clip by distances where the adapter can; else fragments outside panels are cut away."""

    def __init__(self, device: Device, *, clip: bool) -> None:
        self._device = device
        self._clips = clip and device.can_clip
        self._fragments = load_shader(device, "limen.draw", "terrain.wgsl")
        self._vertices = load_shader(device, "limen.draw", "terrain_clip.wgsl") if self._clips else self._fragments
        self.layout = self._bind_group_layout()
        self._made: dict[tuple[Any, ...], Any] = {}

    def pipeline(self, target_format: str, colours: Colours, overlay: TerrainOverlay | None, *, contours: bool) -> Any:
        key = (target_format, colours, overlay, contours)
        if key not in self._made:
            self._made[key] = self._device.wgpu.create_render_pipeline(
                label="terrain",
                layout=self._device.wgpu.create_pipeline_layout(bind_group_layouts=[self.layout]),
                vertex={"module": self._vertices, "entry_point": "vertex", "buffers": [_VERTICES]},
                primitive={"topology": "triangle-list"},
                depth_stencil={"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"},
                fragment={
                    "module": self._fragments,
                    "entry_point": "picture" if self._clips else "cut_picture",
                    "constants": {
                        "COLOURS": COLOURS.index(colours),
                        "CONTOURS": int(contours),
                        "OVERLAY": _OVERLAYS[overlay],
                    },
                    "targets": [{"format": target_format}],
                },
            )
        return self._made[key]

    def clear(self) -> None:
        self._made.clear()

    def _bind_group_layout(self) -> Any:
        texture = {"texture": {"sample_type": "float", "view_dimension": "2d-array"}}
        uniform, storage = {"buffer": {"type": "uniform"}}, {"buffer": {"type": "read-only-storage"}}
        kinds: dict[str, dict[str, Any]] = {
            "terrain": uniform, "views": storage, "sources": uniform, "table": storage,
            "relief_pool": texture, "heights_pool": texture, "drape_pool": texture,
            "bilinear": {"sampler": {"type": "filtering"}},
        }  # fmt: skip
        both = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
        return self._device.wgpu.create_bind_group_layout(
            entries=[{"binding": number, "visibility": both, **kinds[name]} for name, number in BINDINGS.items()]
        )
