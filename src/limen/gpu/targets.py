"""Textures that quilts are drawn into, kept from frame to frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.errors import DeviceLimitError
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device

__all__ = ["DEPTH_FORMAT", "QUILT_FORMAT", "Targets"]

QUILT_FORMAT = "rgba8unorm-srgb"
DEPTH_FORMAT = "depth32float"


class Targets:
    """One texture for every size, format and slot that is asked for."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._textures: dict[tuple[tuple[int, int], str, int], Any] = {}
        self._reader = TextureReader(device)

    def texture(self, size_px: tuple[int, int], target_format: str, slot: int = 0) -> Any:
        """Quilts of one size are drawn over each other, unless they are given slots of their own."""
        key = (size_px, target_format, slot)
        if key not in self._textures:
            usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC | wgpu.TextureUsage.TEXTURE_BINDING
            self._textures[key] = self._device.wgpu.create_texture(
                label="quilt", size=(*size_px, 1), format=target_format, usage=usage
            )
        return self._textures[key]

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A texture's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._reader.read(texture)

    def read_depth(self, size_px: tuple[int, int]) -> NDArray[np.float32]:
        """The depth of the last draw of this size, shape (H, W): 1 is near, 0 nothing; waits.

        Raises
        ------
        DeviceLimitError
            On OpenGL, which does not give depth away.
        """
        try:
            return self._reader.read(self.texture(size_px, DEPTH_FORMAT)).view(np.float32)[..., 0]
        except wgpu.GPUValidationError:
            raise DeviceLimitError(f"{self._device.adapter_name} cannot read depth back: use a Vulkan driver") from None

    def destroy(self) -> None:
        for texture in self._textures.values():
            texture.destroy()
        self._textures.clear()
        self._reader.destroy()
