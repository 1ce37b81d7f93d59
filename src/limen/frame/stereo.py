"""From the quilts of two eyes, side by side, to what glasses take apart again."""

from __future__ import annotations

from typing import Any

import wgpu

from limen.gpu.device import Device
from limen.gpu.shader import load_shader

__all__ = ["Anaglyph"]


class Anaglyph:
    """Red of the left eye, green and blue of the right, for red-cyan glasses."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._module = load_shader(device, "limen.frame", "eyes.wgsl")
        self._layout = device.kept(
            "create_bind_group_layout",
            entries=[
                {
                    "binding": 0,
                    "visibility": wgpu.ShaderStage.FRAGMENT,
                    "texture": {"sample_type": "float", "view_dimension": "2d"},
                }
            ],
        )
        self._pipelines: dict[str, Any] = {}
        self._targets: dict[tuple[tuple[int, int], int], Any] = {}

    def draw(self, both: Any, *, target: Any = None, target_format: str = "rgba8unorm-srgb", slot: int = 0) -> Any:
        """One picture half as wide as ``both``, the texture with both eyes; into ``target`` where one is given.

        Pictures of one size are drawn over each other, unless they are given a ``slot`` each.
        """
        device = self._device.wgpu
        texture = None if target is not None else self._target((both.size[0] // 2, both.size[1]), slot, target_format)
        group = device.create_bind_group(layout=self._layout, entries=[{"binding": 0, "resource": both.create_view()}])
        encoder = device.create_command_encoder(label="anaglyph")
        view = texture.create_view() if texture is not None else target
        render_pass = encoder.begin_render_pass(
            color_attachments=[{"view": view, "load_op": "clear", "store_op": "store", "clear_value": (0, 0, 0, 1)}]
        )
        render_pass.set_pipeline(self._pipeline(target_format))
        render_pass.set_bind_group(0, group)
        render_pass.draw(3)
        render_pass.end()
        device.queue.submit([encoder.finish()])
        return texture

    def destroy(self) -> None:
        for texture in self._targets.values():
            texture.destroy()
        self._targets.clear()
        self._pipelines.clear()

    def _target(self, size_px: tuple[int, int], slot: int, target_format: str) -> Any:
        key = (size_px, slot)
        if key not in self._targets:
            usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC | wgpu.TextureUsage.TEXTURE_BINDING
            self._targets[key] = self._device.wgpu.create_texture(
                label="anaglyph", size=(*size_px, 1), format=target_format, usage=usage
            )
        return self._targets[key]

    def _pipeline(self, target_format: str) -> Any:
        if target_format not in self._pipelines:
            self._pipelines[target_format] = self._device.kept(
                "create_render_pipeline",
                label="anaglyph",
                layout=self._device.kept("create_pipeline_layout", bind_group_layouts=[self._layout]),
                vertex={"module": self._module, "entry_point": "vertex"},
                primitive={"topology": "triangle-list"},
                fragment={
                    "module": self._module, "entry_point": "anaglyph", "targets": [{"format": target_format}],
                },
            )  # fmt: skip
        return self._pipelines[target_format]
