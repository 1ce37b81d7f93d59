"""Images in memory, drawn from start to end as a frame would be."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.display.quilt import Quilt, pack, pieces
from limen.errors import PageError
from limen.gpu.targets import QUILT_FORMAT
from limen.layers.image.cut import PageCut
from limen.layers.image.draw.drawer import EXACT_FORMAT, ImageDrawer
from limen.layers.image.layer import ImageLayer, ImagePart, placed_pages
from limen.layers.image.select import ImageOnDisplay, select, view_of
from limen.stream.chunks import completed
from limen.stream.pages import KeptTable, page_streaming
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.tolerance import Tolerance
from support.drawing import Easel

_TAPS = np.sinc((np.arange(-4, 4) + 0.5) / 2) * np.sinc((np.arange(-4, 4) + 0.5) / 4)
_TAPS /= _TAPS.sum()
_POOL_BYTES = 4096 * 4096 * 4
"""225 pages."""


def _linear(code: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


_LIGHT = _linear(np.arange(256) / 255.0)


def linear(srgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    return _LIGHT[srgb]


def srgb(light: NDArray[Any]) -> NDArray[np.uint8]:
    light = np.clip(light, 0, 1)
    return np.rint(np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055) * 255).astype(
        np.uint8
    )


def _halved(light: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Lanczos (two lobes) at half the size, texel i over texels 2 i and 2 i + 1."""
    light = np.moveaxis(light, axis, 0)
    size = -(-len(light) // 2)
    padded = np.concatenate([light[:1]] * 3 + [light] + [light[-1:]] * (2 * size + 3 - len(light)))
    return np.moveaxis(sum(tap * padded[k : k + 2 * size : 2] for k, tap in enumerate(_TAPS)), 0, axis)


class MemoryImage:
    """A page source that holds its whole pyramid; ``broken`` pages raise `PageError`."""

    path = Path("memory")

    def __init__(self, pixels: NDArray[np.uint8], broken: tuple[int, ...] = ()) -> None:
        self.pyramid = Pyramid.of((pixels.shape[1], pixels.shape[0]))
        self.broken = set(broken)
        self.levels = [pixels]
        light = linear(pixels)
        for _ in self.pyramid.levels[1:]:
            light = _halved(_halved(light, 0), 1)
            self.levels.append(srgb(light))

    @property
    def coarsest(self) -> NDArray[np.int64]:
        """The page that everything falls back on, alone."""
        return np.array([self.pyramid.page_count - 1])

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


_RIM_PX = 0.01
"""Pixels whose centres lie on an outline are their panel's."""


class Exhibit:
    """One image with its drawer and its pages, read one after the other: their slots are the same every time."""

    def __init__(self, device: Any, image: MemoryImage, *, sampling: Any = "sharp", matched: bool = False) -> None:
        self.image = image
        self.drawer = ImageDrawer(device, ImageLayer(image, sampling=sampling), _POOL_BYTES)  # type: ignore[arg-type]
        self.stream = page_streaming(image).stream(self.drawer.allocators[0], 1)
        self.easel = Easel(device, clear=True, matched=matched)
        self._table = KeptTable(image.pyramid)

    def settle(self, pages: Any) -> None:
        """Wait until these pages are there or have failed."""
        for _, update in completed([(self.stream, pages)]):
            self.drawer.upload(0, update)

    def part(self, view: ImageOnDisplay, cut: PageCut, tolerance: Tolerance, eye_m: Any = None) -> ImagePart:
        """What of a cut is drawn by the pages that are there."""
        pages, drawn = placed_pages(view, cut, self.stream.resident, self._table)
        self.stream.touch(drawn)
        return ImagePart(view, cut, tolerance, eye_m, pages)

    def draw(self, quilt: Quilt, part: ImagePart, overlay: str = "") -> NDArray[np.uint8]:
        """A quilt's pixels; alpha is 0 where nothing is drawn."""
        eyes = [] if part.eye_m is None else [part.eye_m]
        seen = QuiltView.of(QuiltPanels(part.view.display, quilt, guard_px=_RIM_PX), eyes)
        form = EXACT_FORMAT if overlay == "exact" else QUILT_FORMAT
        return self.easel.picture(self.drawer, seen, part, overlay, form=form)

    def close(self) -> None:
        self.stream.close()
        self.easel.destroy()
        self.drawer.destroy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Studio:
    """Draws images in memory with everything between a placement and a picture, waiting for all pages."""

    def __init__(self, device: Any) -> None:
        self.device = device

    def exhibit(self, image: MemoryImage, *, sampling: Any = "sharp", matched: bool = False) -> Exhibit:
        return Exhibit(self.device, image, sampling=sampling, matched=matched)

    def draw(
        self,
        image: MemoryImage,
        display: Any,
        placement: Any,
        tolerance: Any,
        *,
        sampling: Any = "sharp",
        overlay: str = "",
        eye_m: Any = None,
        settle: bool = True,
        budget: int | None = None,
        detail: Any = None,
    ) -> dict[str, NDArray[np.uint8]]:
        """The picture of every panel by its name."""
        view = view_of(display, image.pyramid, placement, detail)
        cut = select(view, tolerance, eye_m=eye_m, budget=budget)
        pictures = {}
        with self.exhibit(image, sampling=sampling) as shown:
            shown.settle(cut.pages if settle else image.coarsest)
            part = shown.part(view, cut, tolerance, eye_m)
            for quilt in pack(display):
                pictures.update(pieces(display, quilt, shown.draw(quilt, part, overlay)))
        return pictures
