"""The one owner of the GPU memory that pages are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.pages import GUTTER, PAGE
from limen.errors import DeviceLimitError
from limen.gpu.device import Device

__all__ = ["PAGE_SIDE", "PageFormat", "PagePool", "Placed"]

PageFormat: TypeAlias = Literal["rgba8unorm-srgb", "rgba8unorm"]

PAGE_SIDE = PAGE + 2 * GUTTER
"""Texels along a page with its gutters."""

_COLUMNS = 15
_LAYER_PX = 4096
_HEIGHTS_PX = (512, 1024, 2048, _LAYER_PX)
"""Powers of two, so that a place in a layer is divided by its size exactly: see `PagePool`."""


class Placed(Protocol):
    """A page and the slot it goes to; a `limen.stream.chunks.Arrival` is one."""

    @property
    def place(self) -> tuple[int, ...]: ...

    @property
    def item(self) -> NDArray[np.uint8]: ...


class PagePool:
    """Pages of RGBA texels in one array texture, 15 x 15 pages a layer of 4096 x 4096.

    A picture must not depend on the slots that its pages happen to have. Samplers take places as shares of the texture:
    those are exact only where its sides are powers of two (and shaders count places in 2048ths of a texel), which
    leaves a fifteenth of the memory unused. WebGPU allows 2,048 layers at most and 256 by default, so a layer holds
    many pages.

    Parameters
    ----------
    budget_bytes
        How much GPU memory the pool may take; it takes as many whole layers as fit, or one of fewer rows.
    pages
        How many there are to be held: it takes no layer more. All of its memory is cleared before it is drawn from.
    format
        ``rgba8unorm-srgb`` for pictures, whose bytes are sRGB codes; ``rgba8unorm`` for bytes that are numbers.

    Raises
    ------
    DeviceLimitError
        If the budget is smaller than a row of pages or the adapter refuses the memory.
    """

    def __init__(
        self, device: Device, budget_bytes: int, pages: int, *, format: PageFormat = "rgba8unorm-srgb"
    ) -> None:
        fitting = [height for height in _HEIGHTS_PX if height * _LAYER_PX * 4 <= budget_bytes]
        if not fitting:
            needed = _HEIGHTS_PX[0] * _LAYER_PX * 4 / 1e6
            raise DeviceLimitError(
                f"a page pool of {budget_bytes / 1e6:.1f} MB is too small: give at least {needed:.1f} MB"
            )
        height = next((each for each in fitting if _held(each) >= pages), fitting[-1])
        self.layer_px = (_LAYER_PX, height)
        layer_bytes, layers = _LAYER_PX * height * 4, 1
        if height == _LAYER_PX:
            layers = min(budget_bytes // layer_bytes, device.max_layers, _unlike_cubes(-(-pages // _held(height)), 1))
        layers = _unlike_cubes(layers, -1)
        self.slots = _held(height) * layers
        self.bytes = layers * layer_bytes
        self._queue = device.wgpu.queue
        self._texture = _texture(device, (*self.layer_px, max(layers, 2)), format)
        self.texels: Any = self._texture.create_view(dimension="2d-array")

    def write(self, uploads: Sequence[Placed]) -> None:
        """Copy pages into their slots; drawing that was submitted before still sees what was there."""
        for upload in uploads:
            texels = np.ascontiguousarray(upload.item)
            if texels.shape != (PAGE_SIDE, PAGE_SIDE, 4) or texels.dtype != np.uint8:
                raise ValueError(f"a page has {PAGE_SIDE} x {PAGE_SIDE} RGBA bytes, got {texels.dtype} {texels.shape}")
            self._queue.write_texture(
                {"texture": self._texture, "origin": self._origin(upload.place[0])},
                texels,
                {"bytes_per_row": PAGE_SIDE * 4, "rows_per_image": PAGE_SIDE},
                (PAGE_SIDE, PAGE_SIDE, 1),
            )

    def destroy(self) -> None:
        self._texture.destroy()

    def _origin(self, slot: int) -> tuple[int, int, int]:
        if not 0 <= slot < self.slots:
            raise ValueError(f"slot {slot} is not in a pool of {self.slots} pages")
        layer, inside = divmod(slot, _COLUMNS * _COLUMNS)
        row, column = divmod(inside, _COLUMNS)
        return (column * PAGE_SIDE, row * PAGE_SIDE, layer)


def _held(height_px: int) -> int:
    """Pages in a layer."""
    return _COLUMNS * (height_px // PAGE_SIDE)


def _unlike_cubes(layers: int, step: int) -> int:
    """OpenGL takes sixes of layers for cubes."""
    return layers if layers % 6 else layers + step


def _texture(device: Device, size: tuple[int, int, int], page_format: PageFormat) -> Any:
    usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
    try:
        return device.wgpu.create_texture(label="page pool", size=size, format=page_format, usage=usage)
    except wgpu.GPUError as error:
        gigabytes = size[0] * size[1] * size[2] * 4 / 1e9
        reason = " ".join(str(error).split())
        raise DeviceLimitError(f"the adapter refused {gigabytes:.1f} GB for pages, give it less: {reason}") from None
