"""The one owner of the GPU memory that pages are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.errors import DeviceLimitError
from limen.gpu.device import Device

__all__ = ["PAGE_SIDE", "PageFormat", "PagePool", "Placed"]

PageFormat: TypeAlias = Literal["rgba8unorm-srgb", "rgba8unorm"]

PAGE_SIDE = 256 + 2 * 4
"""Texels along a page with its gutters. `limen.data.pages` decides this; a test keeps the two equal."""

_PER_SIDE = 8
_PAGE_BYTES = PAGE_SIDE * PAGE_SIDE * 4


class Placed(Protocol):
    """A page and the slot it goes to; `limen.stream.Upload` is one."""

    @property
    def slot(self) -> int: ...

    @property
    def texels(self) -> NDArray[np.uint8]: ...


class PagePool:
    """Pages of RGBA texels in one array texture, 8 x 8 pages a layer.

    WebGPU allows 2,048 layers at most and 256 by default, so a layer holds many pages.

    Parameters
    ----------
    budget_bytes
        How much GPU memory the pool may take; it takes as many whole layers (or, below one layer, whole rows of
        eight pages) as fit.
    format
        ``rgba8unorm-srgb`` for pictures, whose bytes are sRGB codes; ``rgba8unorm`` for bytes that are numbers.

    Raises
    ------
    DeviceLimitError
        If the budget is smaller than eight pages or the adapter refuses the memory.
    """

    def __init__(self, device: Device, budget_bytes: int, *, format: PageFormat = "rgba8unorm-srgb") -> None:
        rows = budget_bytes // (_PER_SIDE * _PAGE_BYTES)
        if rows < 1:
            needed = _PER_SIDE * _PAGE_BYTES / 1e6
            raise DeviceLimitError(
                f"a page pool of {budget_bytes / 1e6:.1f} MB is too small: give at least {needed:.1f} MB"
            )
        self.columns = _PER_SIDE
        self.rows = min(rows, _PER_SIDE)
        self.layers = min(rows // self.rows, device.max_layers)
        if self.layers % 6 == 0:
            self.layers -= 1  # OpenGL takes sixes of layers for cubes
        self.slots = self.columns * self.rows * self.layers
        self.bytes = self.slots * _PAGE_BYTES
        self._queue = device.wgpu.queue
        size = (self.columns * PAGE_SIDE, self.rows * PAGE_SIDE, max(self.layers, 2))
        self._texture = _texture(device, size, format)
        self.texels: Any = self._texture.create_view(dimension="2d-array")

    def write(self, uploads: Sequence[Placed]) -> None:
        """Copy pages into their slots; drawing that was submitted before still sees what was there."""
        for upload in uploads:
            texels = np.ascontiguousarray(upload.texels)
            if texels.shape != (PAGE_SIDE, PAGE_SIDE, 4) or texels.dtype != np.uint8:
                raise ValueError(f"a page has {PAGE_SIDE} x {PAGE_SIDE} RGBA bytes, got {texels.dtype} {texels.shape}")
            self._queue.write_texture(
                {"texture": self._texture, "origin": self._origin(upload.slot)},
                texels,
                {"bytes_per_row": PAGE_SIDE * 4, "rows_per_image": PAGE_SIDE},
                (PAGE_SIDE, PAGE_SIDE, 1),
            )

    def destroy(self) -> None:
        self._texture.destroy()

    def _origin(self, slot: int) -> tuple[int, int, int]:
        if not 0 <= slot < self.slots:
            raise ValueError(f"slot {slot} is not in a pool of {self.slots} pages")
        layer, inside = divmod(slot, self.columns * self.rows)
        row, column = divmod(inside, self.columns)
        return (column * PAGE_SIDE, row * PAGE_SIDE, layer)


def _texture(device: Device, size: tuple[int, int, int], page_format: PageFormat) -> Any:
    usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
    try:
        return device.wgpu.create_texture(label="page pool", size=size, format=page_format, usage=usage)
    except wgpu.GPUError as error:
        gigabytes = size[0] * size[1] * size[2] * 4 / 1e9
        reason = " ".join(str(error).split())
        raise DeviceLimitError(f"the adapter refused {gigabytes:.1f} GB for pages, give it less: {reason}") from None
