"""Buffers that grow with what is written to them, and reading pictures back."""

from __future__ import annotations

from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.errors import DeviceLimitError
from limen.gpu.device import Device

__all__ = ["GrowingBuffer", "TextureReader"]

_ROW_ALIGNMENT = 256  # WebGPU: bytes_per_row of a copy


class GrowingBuffer:
    """A GPU buffer for rows whose number changes from frame to frame.

    ``generation`` grows when the buffer had to be replaced; bind groups made before are stale then.
    """

    def __init__(self, device: Device, label: str, usage: int) -> None:
        self._device, self._label = device, label
        self._usage = usage | wgpu.BufferUsage.COPY_DST
        self.generation = 0
        self.buffer: Any = None

    def write(self, rows: NDArray[Any]) -> None:
        data = np.ascontiguousarray(rows) if rows.size else np.zeros(1, rows.dtype)  # WebGPU binds no empty buffer
        self.reserve(data.nbytes)
        self._device.wgpu.queue.write_buffer(self.buffer, 0, data)

    def reserve(self, size: int) -> None:
        """Make it at least ``size`` bytes large; what it held is lost where it has to grow.

        Raises
        ------
        DeviceLimitError
            If that is more than a shader can see at once.
        """
        if size > self._device.max_binding_bytes:
            raise DeviceLimitError(f"{self._label}: {size} bytes exceed the adapter's {self._device.max_binding_bytes}")
        if self.buffer is None or self.buffer.size < size:
            self.destroy()
            grown = min(1 << (max(size, 256) - 1).bit_length(), self._device.max_binding_bytes)
            self.buffer = self._device.wgpu.create_buffer(label=self._label, size=grown, usage=self._usage)
            self.generation += 1

    def destroy(self) -> None:
        if self.buffer is not None:
            self.buffer.destroy()
            self.buffer = None


class TextureReader:
    """Reads textures of four bytes a pixel through one kept buffer."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._buffer: Any = None

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """The texture's texels, shape (H, W, 4); waits for the GPU."""
        width, height, _ = texture.size
        row_bytes = -(-width * 4 // _ROW_ALIGNMENT) * _ROW_ALIGNMENT
        buffer = self._sized(row_bytes * height)
        encoder = self._device.wgpu.create_command_encoder(label="read a texture")
        encoder.copy_texture_to_buffer(
            {"texture": texture},
            {"buffer": buffer, "bytes_per_row": row_bytes, "rows_per_image": height},
            (width, height, 1),
        )
        self._device.wgpu.queue.submit([encoder.finish()])
        buffer.map_sync(wgpu.MapMode.READ, 0, row_bytes * height)
        try:
            mapped = np.frombuffer(buffer.read_mapped(0, row_bytes * height, copy=False), np.uint8)
            return mapped.reshape(height, row_bytes)[:, : width * 4].reshape(height, width, 4).copy()
        finally:
            buffer.unmap()

    def destroy(self) -> None:
        if self._buffer is not None:
            self._buffer.destroy()
            self._buffer = None

    def _sized(self, size: int) -> Any:
        if self._buffer is None or self._buffer.size < size:
            self.destroy()
            usage = wgpu.BufferUsage.MAP_READ | wgpu.BufferUsage.COPY_DST
            self._buffer = self._device.wgpu.create_buffer(label="readback", size=size, usage=usage)
        return self._buffer
