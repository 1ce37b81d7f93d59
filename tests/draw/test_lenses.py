"""Pictures seen through lenses: every pixel shows what the definition says, on every panel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.frames import frame_of

from limen.data.pages import Pyramid
from limen.display.display import Display
from limen.display.panel import Panel
from limen.frame.renderer import Renderer
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import view_of
from limen.viewing.lens import Lens, source_of
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

_FULL = tolerance_of([], Policy("full"))
_SIZE_PX = (1900, 1300)


def waves(texel: Any) -> Any:
    """A smooth picture whose colours tell the place: codes at texels (..., 2), counted from the image's corner."""
    x, y = texel[..., 0], texel[..., 1]
    waves = [x / 160, y / 140, (x + y) / 230, (x - y) / 310]
    return 128 + 45 * np.stack(
        [np.sin(2 * np.pi * (waves[k] + 0.3)) + np.sin(2 * np.pi * waves[3]) for k in range(3)], -1
    )


def picture() -> Any:
    x, y = np.meshgrid(np.arange(_SIZE_PX[0]) + 0.5, np.arange(_SIZE_PX[1]) + 0.5)
    return np.rint(waves(np.stack([x, y], axis=-1))).astype(np.uint8)


def wall() -> Display:
    """Two panels by two, without bezels."""
    width, height, pitch = 420, 300, 0.0003
    panels = [
        Panel(
            f"{column}{row}", (width, height), (column * width * pitch, 1.0 - row * height * pitch, 0.0), (1, 0, 0),
            (0, -1, 0), (pitch, pitch),
        )
        for row in range(2)
        for column in range(2)
    ]  # fmt: skip
    return Display("wall", tuple(panels))


LENSES = {
    "one": (Lens((900.0, 640.0), 280.0, 6.0),),
    "gaussian": (Lens((1000.0, 700.0), (300.0, 220.0), 3.0, 0.0, "gaussian"),),
    "rectangular": (Lens((930.0, 650.0), (200.0, 260.0), 4.0, 0.5, "quadratic", "rectangular"),),
    "table": (Lens((950.0, 650.0), 250.0, 4.0, heights=np.outer(np.hanning(9), np.hanning(12))),),
    "overlapping": (
        Lens((900.0, 600.0), 220.0, 3.0), Lens((1020.0, 700.0), 200.0, 2.5, 0.3, "linear"),
        Lens((940.0, 780.0), 150.0, 2.0, 0.5, "cosine", "rectangular"),
    ),
}  # fmt: skip


# The shader's numbers for every kind of lens are compared in `test_lens_mesh.py`.
@pytest.mark.parametrize(("name", "zoom"), [("gaussian", 0.6), ("table", 0.6), ("overlapping", 1.0)])
def test_every_pixel_shows_what_is_seen_there(name: str, zoom: float, studio: Any, memory_image: Any) -> None:
    display, placement = wall(), OnSurface("one-to-one", zoom=zoom, lenses=LENSES[name])
    drawn = studio.draw(memory_image(picture()), display, placement, _FULL)
    maps = view_of(display, Pyramid.of(_SIZE_PX), placement).maps
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
