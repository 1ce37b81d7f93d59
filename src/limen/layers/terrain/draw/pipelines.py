"""The pipelines of a terrain's shaders: one for each kind of picture, made when it is first asked for."""

from __future__ import annotations

from typing import Any

import wgpu

from limen.display.panel import MAX_OUTLINE_CORNERS
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT, SAMPLED_DEPTH
from limen.layers.terrain.draw import uniforms as records
from limen.layers.terrain.look import COLOURS, Colours

__all__ = ["BINDINGS", "OUTLINE_VERTICES", "TerrainPipelines"]

BINDINGS = {
    "terrain": 0, "view": 1, "sources": 2, "table": 3, "relief_pool": 4, "heights_pool": 5, "drape_pool": 6,
    "bilinear": 7,
}  # fmt: skip

OUTLINE_VERTICES = 3 * (MAX_OUTLINE_CORNERS - 2)
"""Of the triangles that a panel is coloured with; where an outline has fewer corners, some have no area."""

_VERTICES = {
    "array_stride": records.VERTEX.itemsize,
    "attributes": [
        {"format": "uint32x2", "offset": 0, "shader_location": 0},
        {"format": "float32", "offset": 8, "shader_location": 1},
        {"format": "uint32", "offset": 12, "shader_location": 2},
    ],
}


class TerrainPipelines:
    """A picture's pipelines: what is nearest, as depth; and then its colours, once a pixel.

    Triangles are few pixels large, and an adapter shades whole blocks of pixels for each: colours from pages would be
    computed several times over if they were drawn with the triangles.

    ``clip``: clip by distances where the adapter can; else fragments outside panels are cut away. ``holes``: there are
    posts without data.
    """

    def __init__(self, device: Device, *, clip: bool, holes: bool) -> None:
        self._device, self._holes = device, holes
        self.attaches_depth = not device.is_opengl
        """Pixels without land fail the test of a depth that is only read: on software adapters, frames take a third
        less than where they are thrown away. OpenGL refuses a texture that is sampled and attached, even so."""
        self._clips = clip and device.can_clip
        self._fragments = load_shader(device, "limen.layers.terrain.draw", "terrain.wgsl")
        self._vertices = (
            load_shader(device, "limen.layers.terrain.draw", "terrain_clip.wgsl") if self._clips else self._fragments
        )
        self.layout = self._bind_group_layout()
        self.depth_layout = device.kept(
            "create_bind_group_layout",
            entries=[{"binding": 0, "visibility": wgpu.ShaderStage.FRAGMENT, "texture": SAMPLED_DEPTH}],
        )
        self._made: dict[tuple[Any, ...], Any] = {}

    def depth(self) -> Any:
        """Draws triangles into depth alone."""
        exact = not self._device.is_opengl
        bare = self._clips and not self._holes and exact
        entry = ("" if self._clips else "cut_") + ("solid" if exact else "deep")
        fragment = None if bare else self._fragment(entry, {}, [])
        return self._kept(("depth",), "bare_vertex" if bare else "vertex", fragment)

    def patches(self, target_format: str, colours: Colours, *, contours: bool) -> Any:
        """Draws triangles, every one flat and every patch in a hue of its own."""
        constants = {"COLOURS": COLOURS.index(colours), "CONTOURS": int(contours)}
        entry = "patches" if self._clips else "cut_patches"
        fragment = self._fragment(entry, constants, [{"format": target_format}])
        return self._kept(("patches", target_format, colours, contours), "vertex", fragment)

    def picture(
        self, target_format: str, colours: Colours, *, contours: bool, panels: bool, fading: bool, deep: bool = False
    ) -> Any:
        """Colours every pixel of a panel from its depth.

        ``panels`` lays the panels' tints over them. ``fading``: some page is not all there. ``deep``: among other
        things, by the depth that all have in common.
        """
        key = ("picture", target_format, colours, contours, panels, fading, deep)
        if key not in self._made:
            constants = {"COLOURS": COLOURS.index(colours), "CONTOURS": int(contours), "PANELS": int(panels)}
            constants["FADING"] = int(fading)
            tested: dict[str, Any] | None = None
            if deep:
                tested = {"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"}
            elif self.attaches_depth:
                tested = {"format": DEPTH_FORMAT, "depth_write_enabled": False, "depth_compare": "less"}
            entry = "picture_deep" if deep else "picture" if self.attaches_depth else "picture_alone"
            self._made[key] = self._device.kept(
                "create_render_pipeline",
                label="terrain",
                layout=self._layout([self.layout, self.depth_layout]),
                vertex={"module": self._fragments, "entry_point": "outline", "buffers": []},
                primitive={"topology": "triangle-list"},
                depth_stencil=tested,
                fragment=self._fragment(entry, constants, [{"format": target_format}]),
            )
        return self._made[key]

    def _kept(self, key: tuple[Any, ...], vertex: str, fragment: dict[str, Any] | None) -> Any:
        if key not in self._made:
            self._made[key] = self._device.kept(
                "create_render_pipeline",
                label="terrain",
                layout=self._layout([self.layout]),
                vertex={"module": self._vertices, "entry_point": vertex, "buffers": [_VERTICES]},
                primitive={"topology": "triangle-list"},
                depth_stencil={"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"},
                fragment=fragment,
            )
        return self._made[key]

    def _fragment(self, entry: str, constants: dict[str, int], targets: list[dict[str, str]]) -> dict[str, Any]:
        constants = constants | {"HOLES": int(self._holes)}
        return {"module": self._fragments, "entry_point": entry, "constants": constants, "targets": targets}

    def _layout(self, groups: list[Any]) -> Any:
        return self._device.kept("create_pipeline_layout", bind_group_layouts=groups)

    def clear(self) -> None:
        self._made.clear()

    def _bind_group_layout(self) -> Any:
        texture = {"texture": {"sample_type": "float", "view_dimension": "2d-array"}}
        uniform, storage = {"buffer": {"type": "uniform"}}, {"buffer": {"type": "read-only-storage"}}
        one_of_many = {"buffer": {"type": "uniform", "has_dynamic_offset": True}}
        kinds: dict[str, dict[str, Any]] = {
            "terrain": uniform, "view": one_of_many, "sources": uniform, "table": storage,
            "relief_pool": texture, "heights_pool": texture, "drape_pool": texture,
            "bilinear": {"sampler": {"type": "filtering"}},
        }  # fmt: skip
        both = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
        return self._device.kept(
            "create_bind_group_layout",
            entries=[{"binding": number, "visibility": both, **kinds[name]} for name, number in BINDINGS.items()],
        )
