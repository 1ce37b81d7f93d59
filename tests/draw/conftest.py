"""Images in memory, drawn from start to end as a frame would be."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.errors import PageError

_TAPS = np.sinc((np.arange(-4, 4) + 0.5) / 2) * np.sinc((np.arange(-4, 4) + 0.5) / 4)
_TAPS /= _TAPS.sum()


def linear(srgb: NDArray[Any]) -> NDArray[np.float64]:
    code = np.asarray(srgb) / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def srgb(light: NDArray[Any]) -> NDArray[np.uint8]:
    light = np.clip(light, 0, 1)
    return np.rint(np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055) * 255).astype(
        np.uint8
    )


def _halved(light: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Lanczos (two lobes) at half the size, texel i over texels 2 i and 2 i + 1."""
    size = -(-light.shape[axis] // 2)
    before = np.arange(2 * size)[::2][:, None] + np.arange(-3, 5)
    taken = np.take(light, np.clip(before, 0, light.shape[axis] - 1), axis=axis)
    return np.tensordot(taken, _TAPS, axes=([axis + 1], [0]))


class MemoryImage:
    """A page source that holds its whole pyramid; ``broken`` pages raise `PageError`."""

    def __init__(self, pixels: NDArray[np.uint8], broken: tuple[int, ...] = ()) -> None:
        self.pyramid = Pyramid.of((pixels.shape[1], pixels.shape[0]))
        self.broken = set(broken)
        self.levels = [pixels]
        light = linear(pixels)
        for _ in self.pyramid.levels[1:]:
            light = _halved(_halved(light, 0), 1)
            self.levels.append(srgb(light))

    def read_page(self, page: int) -> NDArray[np.uint8]:
        if page in self.broken:
            raise PageError(f"page {page} is broken")
        level, column, row = (int(value) for value in self.pyramid.page_of(np.array(page)))
        texels = self.levels[level]
        x = np.clip(np.arange(-GUTTER, PAGE + GUTTER) + column * PAGE, 0, texels.shape[1] - 1)
        y = np.clip(np.arange(-GUTTER, PAGE + GUTTER) + row * PAGE, 0, texels.shape[0] - 1)
        side = PAGE + 2 * GUTTER
        rgba = np.full((side, side, 4), 255, np.uint8)
        rgba[..., :3] = texels[y][:, x]
        return rgba


class Studio:
    """Draws images in memory with everything between a placement and a picture, waiting for all pages."""

    def __init__(self, device: Any) -> None:
        from limen.gpu.pool import PagePool

        self.device = device
        self.pool = PagePool(device, 64 * 8 * 264 * 264 * 4)

    def destroy(self) -> None:
        self.pool.destroy()

    def stream(self, image: MemoryImage) -> Any:
        from limen.stream.pages import PageStream

        return PageStream(image, self.pool.slots)

    def settle(self, stream: Any, cut: Any) -> None:
        from limen.stream.chunks import completed

        for _, update in completed([(stream, cut.pages)]):
            self.pool.write(update.arrived)

    def draw(
        self,
        image: MemoryImage,
        display: Any,
        placement: Any,
        tolerance: Any,
        *,
        sampling: Any = "sharp",
        overlay: Any = None,
        eye_m: Any = None,
        settle: bool = True,
        budget: int | None = None,
        detail: Any = None,
    ) -> dict[str, NDArray[np.uint8]]:
        """The picture of every panel by its name."""
        from limen.display.quilt import pack, pieces
        from limen.layers.image.draw.drawer import ImageLayer, drawable_of
        from limen.layers.image.select import select, view_of

        view = view_of(display, image.pyramid, placement, detail)
        cut = select(view, tolerance, eye_m=eye_m, budget=budget)
        layer = ImageLayer(self.device, view, self.pool, sampling=sampling)
        pictures = {}
        with self.stream(image) as stream:
            pinned = np.array([image.pyramid.page_count - 1])
            self.settle(stream, cut) if settle else self.settle(stream, _Only(pinned))
            drawable = drawable_of(stream, view, cut)
            for quilt in pack(display):
                texture = layer.draw(cut, drawable, tolerance, quilt, overlay=overlay, eye_m=eye_m)
                pictures.update(pieces(display, quilt, layer.read(texture)))
        layer.destroy()
        return pictures


class _Only:
    def __init__(self, pages: NDArray[np.int64]) -> None:
        self.pages = pages


@pytest.fixture(scope="session")
def memory_image() -> Callable[..., MemoryImage]:
    return MemoryImage


@pytest.fixture(scope="session")
def studio(device: Any) -> Iterator[Studio]:
    made = Studio(device)
    yield made
    made.destroy()
