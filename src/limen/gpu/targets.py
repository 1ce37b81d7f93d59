"""Textures that quilts are drawn into, kept from frame to frame."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.gpu.shader import load_shader

__all__ = ["DEPTH_FORMAT", "QUILT_FORMAT", "SAMPLED_DEPTH", "Rgb", "Target", "Targets"]

Rgb: TypeAlias = tuple[float, float, float]
"""Linear light: red, green, blue."""

QUILT_FORMAT = "rgba8unorm-srgb"
DEPTH_FORMAT = "depth32float"
SAMPLED_DEPTH = {"sample_type": "unfilterable-float", "view_dimension": "2d"}
"""How a shader sees it: as ``texture_2d<f32>``, because on OpenGL wgpu loads no texels of a ``texture_depth_2d``."""
_BITS_FORMAT = "r32uint"


class Target:
    """The picture and the depth that all layers of a view are drawn into; the first to draw into either clears it.

    Parameters
    ----------
    view
        A texture view of the picture.
    background
        Linear light (red, green, blue) where nothing is drawn.
    alone
        Nothing else is drawn into it: whoever does may use a cheaper pass of its own.
    """

    def __init__(
        self, targets: Targets, view: Any, format: str, size_px: tuple[int, int], background: Rgb, *, alone: bool = True
    ) -> None:
        self.view, self.format, self.size_px, self.alone, self.background = view, format, size_px, alone, background
        self._targets, self._cleared, self._deep = targets, False, False

    def colour(self) -> dict[str, Any]:
        """The attachment of a pass that draws into the picture."""
        load = "load" if self._cleared else "clear"
        self._cleared = True
        return {"view": self.view, "clear_value": (*self.background, 1.0), "load_op": load, "store_op": "store"}

    @property
    def is_deep(self) -> bool:
        """Whether somebody has drawn into the depth."""
        return self._deep

    def depth(self) -> dict[str, Any]:
        """The attachment of a pass that draws into the depth: reversed, 1 is near, 0 nothing."""
        load = "load" if self._deep else "clear"
        self._deep = True
        texture = self._targets.texture(self.size_px, DEPTH_FORMAT)
        return {
            "view": texture.create_view(), "depth_clear_value": 0.0, "depth_load_op": load, "depth_store_op": "store",
        }  # fmt: skip

    def finish(self, encoder: Any) -> None:
        """Clear the picture if nobody drew into it."""
        if not self._cleared:
            encoder.begin_render_pass(color_attachments=[self.colour()]).end()


class Targets:
    """One texture for every size, format and slot that is asked for."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._textures: dict[tuple[tuple[int, int], str, int], Any] = {}
        self._reader = TextureReader(device)

    def target(
        self,
        size_px: tuple[int, int],
        target_format: str = QUILT_FORMAT,
        *,
        slot: int = 0,
        background: Rgb = (0.0, 0.0, 0.0),
        alone: bool = True,
    ) -> tuple[Any, Target]:
        """A texture of its own to draw a view into, see `texture`, and the target that it is."""
        texture = self.texture(size_px, target_format, slot)
        return texture, Target(self, texture.create_view(), target_format, size_px, background, alone=alone)

    def texture(self, size_px: tuple[int, int], target_format: str, slot: int = 0) -> Any:
        """Quilts of one size are drawn over each other, unless they are given slots of their own."""
        key = (size_px, target_format, slot)
        if key not in self._textures:
            usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC | wgpu.TextureUsage.TEXTURE_BINDING
            if target_format != DEPTH_FORMAT:
                usage |= wgpu.TextureUsage.COPY_DST
            self._textures[key] = self._device.wgpu.create_texture(
                label="quilt", size=(*size_px, 1), format=target_format, usage=usage
            )
        return self._textures[key]

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A texture's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._reader.read(texture)

    def read_depth(self, size_px: tuple[int, int]) -> NDArray[np.float32]:
        """The depth of the last draw of this size, shape (H, W): 1 is near, 0 nothing; waits.

        Its bits are drawn into a texture of whole numbers: OpenGL copies no depth, and draws no r32float.
        """
        device = self._device.wgpu
        depth, bits = self.texture(size_px, DEPTH_FORMAT), self.texture(size_px, _BITS_FORMAT)
        layout = self._device.kept(
            "create_bind_group_layout",
            entries=[{"binding": 0, "visibility": wgpu.ShaderStage.FRAGMENT, "texture": SAMPLED_DEPTH}],
        )
        group = device.create_bind_group(layout=layout, entries=[{"binding": 0, "resource": depth.create_view()}])
        encoder = device.create_command_encoder(label="read depth")
        render_pass = encoder.begin_render_pass(
            color_attachments=[{"view": bits.create_view(), "load_op": "clear", "store_op": "store"}]
        )
        render_pass.set_pipeline(self._bits_pipeline(layout))
        render_pass.set_bind_group(0, group)
        render_pass.draw(3)
        render_pass.end()
        device.queue.submit([encoder.finish()])
        return self._reader.read(bits).view(np.float32)[..., 0]

    def _bits_pipeline(self, layout: Any) -> Any:
        module = load_shader(self._device, "limen.gpu", "depth.wgsl")
        return self._device.kept(
            "create_render_pipeline",
            label="read depth",
            layout=self._device.kept("create_pipeline_layout", bind_group_layouts=[layout]),
            vertex={"module": module, "entry_point": "whole"},
            primitive={"topology": "triangle-list"},
            fragment={"module": module, "entry_point": "bits", "targets": [{"format": _BITS_FORMAT}]},
        )

    def destroy(self) -> None:
        for texture in self._textures.values():
            texture.destroy()
        self._textures.clear()
        self._reader.destroy()
