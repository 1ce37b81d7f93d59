"""Pictures of a mesh as one array texture with its halved levels."""

from __future__ import annotations

from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.store.resample import linear_of_srgb, srgb_of_linear
from limen.gpu.device import Device

__all__ = ["halved_levels", "upload_textures"]


def upload_textures(device: Device, textures: NDArray[np.uint8]) -> Any:
    """An array texture of shape (L, H, W, 4) sRGB pictures, mipmapped; of one white texel where there is none."""
    if not len(textures):
        textures = np.full((1, 1, 1, 4), 255, np.uint8)
    levels = halved_levels(textures)
    count, height, width = textures.shape[:3]
    layers = count + 1 if count == 1 or count % 6 == 0 else count
    texture = device.wgpu.create_texture(
        label="mesh pictures",
        size=(width, height, layers),  # OpenGL takes one layer for no array, and sixes for cubes
        mip_level_count=len(levels),
        format="rgba8unorm-srgb",
        usage=wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST,
    )
    for number, level in enumerate(levels):
        device.wgpu.queue.write_texture(
            {"texture": texture, "mip_level": number},
            np.ascontiguousarray(level),
            {"bytes_per_row": level.shape[2] * 4, "rows_per_image": level.shape[1]},
            (level.shape[2], level.shape[1], count),
        )
    return texture


def halved_levels(textures: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """A picture and its halves down to one texel, averaged in linear light: (L, H, W, 4) each."""
    levels = [textures]
    light = np.concatenate([linear_of_srgb(textures[..., :3] / 255.0), textures[..., 3:] / 255.0], axis=-1)
    while max(light.shape[1:3]) > 1:
        if light.shape[1] > 1:
            light = (light[:, :-1:2] + light[:, 1::2]) / 2
        if light.shape[2] > 1:
            light = (light[:, :, :-1:2] + light[:, :, 1::2]) / 2
        codes = np.concatenate([srgb_of_linear(light[..., :3]), light[..., 3:]], axis=-1)
        levels.append(np.rint(codes * 255).astype(np.uint8))
    return levels
