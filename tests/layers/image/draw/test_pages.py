"""Pages that are missing, broken or evicted; overlays; and what is left behind."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from limen.display.display import Display
from limen.display.quilt import pack, pieces
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.gpu.buffers import TextureReader
from limen.layers.image.draw.feedback import Feedback
from limen.layers.image.draw.uniforms import level_colours
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import select, view_of
from limen.viewing.placement import OnShape, OnSurface, Placement
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of
from support.frames import frame_of

pytestmark = pytest.mark.gpu

_FULL = tolerance_of([], Policy("full"))
_EYE = (0.0, 0.0, 0.0)
PLACEMENTS: dict[str, Placement] = {
    "surface": OnSurface("one-to-one"),
    "ellipsoid": OnShape("ellipsoid", (0, 0, 0), (0, 0, -5.0), (0, -4.0, 0)),
    "plane": OnShape("plane", (-0.3, 0.3, -0.9), (0.6, 0, 0), (0, -0.6, 0)),
}


@pytest.fixture(scope="module")
def texels() -> Any:
    """Nowhere black."""
    return np.random.default_rng(3).integers(60, 256, (1100, 1500, 3), dtype=np.uint8)


@pytest.mark.parametrize("kind", PLACEMENTS)
def test_with_only_the_coarsest_page_nothing_is_black(kind: str, studio: Any, memory_image: Any, texels: Any) -> None:
    image, display = memory_image(texels), Display.window((600, 400))
    full = studio.draw(image, display, PLACEMENTS[kind], _FULL, eye_m=_EYE)["window"]
    coarse = studio.draw(image, display, PLACEMENTS[kind], _FULL, eye_m=_EYE, settle=False)["window"]
    exact = studio.draw(image, display, PLACEMENTS[kind], _FULL, eye_m=_EYE, settle=False, overlay="exact")["window"]
    shown = full[..., 3] > 0
    assert ((coarse[..., 3] > 0) == shown).all()
    assert (coarse[shown][:, :3].max(axis=1) > 40).all()
    top = len(image.pyramid.levels) - 1
    assert (exact[shown][:, 0] + exact[shown][:, 1] == top).all()
    # Coarse, but of the same places: block means agree.
    light = [(picture[..., :3] / 255.0) ** 2.2 for picture in (full, coarse)]
    blocks = [each.reshape(4, 100, 6, 100, 3).mean((1, 3)) for each in light]
    assert np.abs(blocks[0] - blocks[1]).max() < 0.06


@pytest.mark.parametrize("kind", PLACEMENTS)
def test_a_broken_page_is_shown_by_its_coarser_level(
    kind: str, studio: Any, memory_image: Any, texels: Any, caplog: pytest.LogCaptureFixture
) -> None:
    display = Display.window((600, 400))
    whole = memory_image(texels)
    view = view_of(display, whole.pyramid, PLACEMENTS[kind])
    worst = int(select(view, _FULL, eye_m=_EYE).pages[0])
    exact = studio.draw(memory_image(texels, (worst,)), display, PLACEMENTS[kind], _FULL, eye_m=_EYE, overlay="exact")
    coarser = exact["window"][..., 1]
    # Its parent is fetched in its stead.
    assert np.unique(coarser).tolist() == [0, 1]
    assert "is broken" in caplog.text
    good = studio.draw(whole, display, PLACEMENTS[kind], _FULL, eye_m=_EYE)["window"]
    seen = studio.draw(memory_image(texels, (worst,)), display, PLACEMENTS[kind], _FULL, eye_m=_EYE)["window"]
    # Where a page lies in the pool decides the last bit of a bilinear sample's place.
    assert np.abs(good[coarser == 0].astype(int) - seen[coarser == 0]).max() <= 1


def test_before_any_page_has_come_the_quilt_is_black(studio: Any, memory_image: Any, texels: Any) -> None:
    image, display = memory_image(texels), Display.window((300, 200))
    for placement in PLACEMENTS.values():
        view = view_of(display, image.pyramid, placement)
        cut = select(view, _FULL, eye_m=_EYE)
        with studio.exhibit(image) as shown:
            assert (shown.draw(pack(display)[0], shown.part(view, cut, _FULL, _EYE)) == 0).all()


def test_the_overlay_tints_by_level(studio: Any, memory_image: Any) -> None:
    grey = memory_image(np.full((1050, 1650, 3), 128, np.uint8))
    hues = level_colours(12)
    assert hues[0, 0] > hues[0, 1] == hues[0, 2]  # red
    assert (hues[8:] == hues[8]).all()
    for size_px, level in (((1500, 1000), 0), ((800, 500), 1), ((350, 250), 2)):
        tinted = studio.draw(grey, Display.window(size_px), OnSurface(), _FULL, overlay="levels")["window"]
        colour = tinted[size_px[1] // 2, size_px[0] // 2, :3].astype(float)
        assert np.argsort(colour).tolist()[-1] == np.argsort(hues[level]).tolist()[-1]
        assert colour.max() > colour.min() + 40


def test_another_placement_of_the_same_image(studio: Any, memory_image: Any, texels: Any) -> None:
    """Panned, zoomed, laid on a shape and back on the surface, while its pages stay."""
    image, display = memory_image(texels), Display.window((300, 200))
    zoomed = [OnSurface("one-to-one", zoom=zoom) for zoom in (1.0, 2.0)]
    first, second, plane = (view_of(display, image.pyramid, each) for each in (*zoomed, PLACEMENTS["plane"]))
    quilt = pack(display)[0]
    pictures = []
    with studio.exhibit(image) as shown:
        for view in (first, second, first, plane, first):
            cut = select(view, _FULL, eye_m=_EYE)
            shown.settle(cut.pages)
            pictures.append(shown.draw(quilt, shown.part(view, cut, _FULL, _EYE)))
    assert (pictures[0] == pictures[2]).all()
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[0] == pictures[4]).all()
    alone = studio.draw(image, display, PLACEMENTS["plane"], _FULL, eye_m=_EYE)["window"].astype(int)
    off = np.abs(alone - pieces(display, quilt, pictures[3])["window"]).max(axis=-1) > 1
    assert off.mean() < 1e-4, "pages lie elsewhere in the pool"


@pytest.mark.parametrize("texture_format", ["rgba8unorm-srgb", "bgra8unorm-srgb"])
def test_drawing_to_a_windows_texture_is_drawing_to_the_quilts(
    texture_format: str, studio: Any, memory_image: Any, texels: Any
) -> None:
    import wgpu

    image, display = memory_image(texels), Display.window((256, 200))
    expected = studio.draw(image, display, OnSurface(), _FULL)["window"]
    usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
    texture = studio.device.wgpu.create_texture(size=(256, 200, 1), format=texture_format, usage=usage)
    layer = ImageLayer(image, policy=Policy("full"))
    with Renderer(studio.device, display, [layer], gpu_bytes=1 << 26) as renderer:
        frame = frame_of(renderer)
        for _ in renderer.pictures(frame):  # until its pages are there
            pass
        chosen = renderer.choose(frame, now_s=1.0)
        target = texture.create_view()
        assert renderer.draw(chosen, 0, target=target, target_format=texture_format).texture is None
        (quilt,) = renderer.quilts
    reader = TextureReader(studio.device)
    drawn = reader.read(texture)
    order = [2, 1, 0, 3] if texture_format.startswith("bgra") else [0, 1, 2, 3]
    shown = pieces(display, quilt, drawn)["window"][..., order].astype(int)
    inside = expected[..., 3] > 0
    assert np.abs(shown - expected)[inside].max() <= 1
    assert (shown[~inside] == [0, 0, 0, 255]).all(), "black beside the image"
    reader.destroy()
    texture.destroy()


def test_an_image_on_a_shape_needs_an_eye(studio: Any, memory_image: Any, texels: Any) -> None:
    image, display = memory_image(texels), Display.window((64, 64))
    view = view_of(display, image.pyramid, PLACEMENTS["plane"])
    cut = select(view, _FULL, eye_m=_EYE)
    with studio.exhibit(image) as shown, pytest.raises(InputError, match="needs an eye point"):
        shown.draw(pack(display)[0], shown.part(view, cut, _FULL))


def _objects() -> dict[str, int]:
    import wgpu

    gc.collect()
    return {name: row["count"] for name, row in wgpu.diagnostics.object_counts.get_dict().items()}


@pytest.mark.parametrize("kind", PLACEMENTS)
def test_nothing_is_left_on_the_gpu(kind: str, studio: Any, memory_image: Any, texels: Any) -> None:
    image, display = memory_image(texels), Display.window((300, 200))

    def use() -> None:
        for overlay in ("", "exact", "levels"):
            studio.draw(image, display, PLACEMENTS[kind], _FULL, eye_m=_EYE, overlay=overlay)
        feedback = Feedback(studio.device, view_of(display, image.pyramid, PLACEMENTS[kind]))
        feedback.run(_FULL, eye_m=_EYE)
        feedback.destroy()

    use()
    before = _objects()
    use()
    assert _objects() == before
