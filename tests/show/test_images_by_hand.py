"""A live window onto an image: the lens in the hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wgpu
from PIL import Image as Picture

import limen
from limen.layers.image.layer import ImageLayer
from limen.show.canvas import Surface
from limen.stream.pages import FADE_S
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

_SIZE_PX = (320, 200)


@pytest.fixture(scope="module")
def world(tmp_path_factory: Any) -> Path:
    """Squares of random colours, as large as a few pixels of the window."""
    path: Path = tmp_path_factory.mktemp("world") / "squares.png"
    squares = np.random.default_rng(0).integers(0, 256, (60, 96, 3), dtype=np.uint8)
    Picture.fromarray(squares.repeat(16, axis=0).repeat(16, axis=1)).save(path)
    return path


class Screen:
    """A texture instead of a window, and an `App` that draws into it until all pages have come."""

    def __init__(self, device: Any, image: Any, placement: OnSurface, **more: Any) -> None:
        from limen.gpu.buffers import TextureReader
        from limen.show.app import App

        self.live = App(device, limen.Show(ImageLayer(image, placement), **more), None, Viewer((0.0, 0.0, 0.0)))
        self._device, self._reader = device, TextureReader(device)
        self._time_s = 0.0

    def draw(self) -> np.ndarray:
        usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
        texture = self._device.wgpu.create_texture(size=(*_SIZE_PX, 1), format="rgba8unorm-srgb", usage=usage)
        shown = -1
        while shown != 0:
            self._frame(texture, 0.02)
            assert self.live.last is not None
            shown = self.live.last.missing + self.live.last.layers[0].uploads
        self._frame(texture, FADE_S)
        picture = self._reader.read(texture)[..., :3].astype(int)
        texture.destroy()
        return picture

    def _frame(self, texture: Any, later_s: float) -> None:
        self._time_s += later_s
        self.live.draw(0, Surface(texture.create_view(), "rgba8unorm-srgb", _SIZE_PX, self._time_s))

    def key(self, key: str) -> None:
        self.live.handle({"event_type": "key_down", "key": key})

    def point(self, x: float, y: float) -> None:
        self.live.handle({"event_type": "pointer_move", "x": x, "y": y})

    def close(self) -> None:
        self.live.close()
        self._reader.destroy()


def test_a_lens_follows_the_pointer(device: Any, world: Path) -> None:
    with limen.open(world) as image:  # type: ignore[union-attr]
        screen = Screen(device, image, OnSurface("cover"))
        plain = screen.draw()
        screen.point(100.0, 90.0)
        screen.key("l")
        here = screen.draw()
        screen.point(220.0, 110.0)
        there = screen.draw()
        screen.key("+")
        stronger = screen.draw()
        screen.key("[")
        smaller = screen.draw()
        screen.key("l")
        np.testing.assert_allclose(screen.draw(), plain, atol=1)
        screen.close()
    changed = [np.argwhere(np.abs(each - plain).max(axis=-1) > 12) for each in (here, there, stronger, smaller)]
    for places, middle in zip(changed[:2], ((90, 100), (110, 220)), strict=True):
        away = np.linalg.norm(places - middle, axis=1)
        assert len(places) > 300
        assert away.max() < 0.25 * 200 + 2
    assert np.abs(stronger - there).max() > 12
    assert np.linalg.norm(changed[3] - (110, 220), axis=1).max() < 0.2 * 200 + 2


def test_pointers_carry_lenses(device: Any, world: Path) -> None:
    with limen.open(world) as image:  # type: ignore[union-attr]
        width, height = image.size_px
        lens = Lens((0.0, 0.0), height / 4, 3.0)
        ahead, aside = limen.Pointer((0, 0, 0), (0, 0, -1)), limen.Pointer((0, 0, 0), (0, 1, 0))
        pointing: list[limen.Pointer] = [aside]
        screen = Screen(device, image, OnSurface("cover", carried=(lens,)), pointers=lambda _time_s: pointing)
        still = Screen(device, image, OnSurface("cover"))
        there = Screen(device, image, OnSurface("cover", lenses=(Lens((width / 2, height / 2), height / 4, 3.0),)))
        np.testing.assert_allclose(screen.draw(), still.draw(), atol=1)
        pointing[:] = [ahead]
        assert np.abs(screen.draw() - there.draw()).max() <= 3, "but for the last digits of where it points"
        for each in (screen, still, there):
            each.close()
