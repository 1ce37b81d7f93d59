"""Pictures seen through lenses: every pixel shows what the definition says, on every panel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from limen.data.pages import Pyramid
from limen.frame.renderer import Renderer
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import view_of
from limen.viewing.lens import Lens, source_of
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer
from support.frames import frame_of
from support.lenses import LENSES, SIZE_PX, picture, wall, waves

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

_FULL = tolerance_of([], Policy("full"))


# The shader's numbers for every kind of lens are compared in `test_lens_mesh.py`.
@pytest.mark.parametrize(("name", "zoom"), [("gaussian", 0.6), ("table", 0.6), ("overlapping", 1.0)])
def test_every_pixel_shows_what_is_seen_there(name: str, zoom: float, studio: Any, memory_image: Any) -> None:
    display, placement = wall(), OnSurface("one-to-one", zoom=zoom, lenses=LENSES[name])
    drawn = studio.draw(memory_image(picture()), display, placement, _FULL)
    maps = view_of(display, Pyramid.of(SIZE_PX), placement).maps
    assert maps is not None
    for number, panel in enumerate(display.panels):
        x, y = np.meshgrid(np.arange(panel.size_px[0]) + 0.5, np.arange(panel.size_px[1]) + 0.5)
        shown = np.stack([x, y], axis=-1) * maps.scale[number] + maps.offset[number]
        seen = source_of(placement.lenses, shown)
        away = np.abs(drawn[panel.name][..., :3] - waves(seen))
        assert away.max() < 3, panel.name
        assert np.abs(drawn[panel.name][..., :3] - waves(shown)).max() > 30, "the test can tell"


def test_lenses_come_and_go_while_pages_stay(device: Any, memory_image: Any) -> None:
    display, image = wall(), memory_image(picture())
    layer = ImageLayer(image, OnSurface("contain"), Policy("acuity"))

    def shown(renderer: Renderer, *lenses: Lens) -> np.ndarray:
        frame = frame_of(renderer, Viewer((0.1, 0.9, 0.7)), placement=OnSurface("contain", lenses=lenses))
        return np.stack([picture[..., :3].copy() for _, picture, _ in renderer.pictures(frame)])

    with Renderer(device, display, [layer], gpu_bytes=1 << 26) as renderer:
        before = shown(renderer)
        through = shown(renderer, *LENSES["one"])
        assert (np.abs(through.astype(int) - before).max(axis=-1) > 10).mean() > 0.01
        plain = shown(renderer, Lens((900.0, 640.0), 280.0, 1.0))
        assert np.abs(plain.astype(int) - before).max() <= 2, (
            "plain glass: levels are mixed in one step, not painted over"
        )
        np.testing.assert_array_equal(shown(renderer), before)
