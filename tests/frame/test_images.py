"""Images: pictures against plain resampling, pages that come late or early, and what happens on bad days."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvips
from numpy.typing import NDArray

import limen
from limen.data.image.file import Image, open_image
from limen.display.quilt import Quilt, pack
from limen.errors import DeviceLimitError, InputError
from limen.frame.renderer import Renderer
from limen.layers.base import Turn
from limen.layers.image.layer import ImageLayer
from limen.stream.chunks import Resident
from limen.stream.pages import page_streaming
from limen.viewing.lens import Lens
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState
from support.frames import FULL, Rgb, drawn, frame_of, psnr, row_of

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]


@pytest.fixture
def image(world: Path) -> Iterator[Image]:
    with open_image(world) as opened:
        yield opened


def plain(path: Path, size_px: tuple[int, int]) -> Rgb:
    """The image resampled by libvips with Lanczos 3 in linear light: uint8 (h, w, 3)."""
    image = pyvips.Image.new_from_file(str(path)).colourspace("scrgb")
    image = image.resize(size_px[0] / image.width, vscale=size_px[1] / image.height, kernel="lanczos3")
    return np.asarray(image.colourspace("srgb").numpy()[..., :3])


@pytest.mark.parametrize("size_px", [(1732, 866), (1200, 600), (640, 320)])
def test_a_panel_under_full_is_a_plain_resampling(world: Path, device: Any, size_px: tuple[int, int]) -> None:
    picture = limen.render(world, limen.Display.window(size_px), policy="full", device=device)["window"]
    assert picture.shape == (size_px[1], size_px[0], 4)
    assert psnr(picture[..., :3], plain(world, size_px)) >= 35


@pytest.mark.data
def test_real_pictures_under_full_are_a_plain_resampling(data_dir: Path, device: Any) -> None:
    """The slide, whose levels were made elsewhere, and a photograph that has none."""
    for name, divisor in (("CMU-1-Small-Region.svs", 2), ("apollo_moon_pano_16810x1708.jpg", 7)):
        path = data_dir / "image" / name
        with open_image(path) as image:
            size_px = (image.size_px[0] // divisor, image.size_px[1] // divisor)
            covered = (size_px[0] * divisor, size_px[1] * divisor)
            centre = (covered[0] / 2 / image.size_px[0], covered[1] / 2 / image.size_px[1])
            placement = OnSurface("one-to-one", zoom=1 / divisor, centre=centre)
            window = limen.Display.window(size_px)
            pictures = limen.render(image, window, policy="full", placement=placement, device=device)
        crop = pyvips.Image.new_from_file(str(path)).crop(0, 0, *covered)
        linear = crop[:3].copy(interpretation="srgb") if crop.bands >= 3 else crop.colourspace("srgb")
        want = linear.colourspace("scrgb").resize(1 / divisor, kernel="lanczos3").colourspace("srgb").numpy()
        inner = (slice(4, -4), slice(4, -4))
        assert psnr(pictures["window"][..., :3][inner], want[..., :3][inner]) >= 35, name


def test_panels_of_a_room_show_their_own_part_and_nothing_else(world: Path, image: Image, device: Any) -> None:
    wall = limen.Display.preset("rostock").scaled(0.1)
    pictures = limen.render(world, wall, policy="full", placement=OnSurface("cover"), device=device)
    assert list(pictures) == [panel.name for panel in wall.panels]
    whole = np.concatenate(
        [np.concatenate([pictures[f"wall/{column},{row}"] for column in range(6)], axis=1) for row in range(4)]
    )
    maps = OnSurface("cover").panel_maps(wall, image.size_px)
    width, height = (round(side / maps.scale[0, 0]) for side in image.size_px)
    source = plain(world, (width, height))
    top = (source.shape[0] - whole.shape[0]) // 2
    left = (source.shape[1] - whole.shape[1]) // 2
    assert psnr(whole[..., :3], source[top : top + whole.shape[0], left : left + whole.shape[1]]) > 30
    some = limen.render(world, wall, policy="full", placement=OnSurface("cover"), panels="wall/?,1", device=device)
    assert len(some) == 6
    np.testing.assert_array_equal(some["wall/2,1"], pictures["wall/2,1"])


def test_a_distant_viewer_gets_less_detail_and_a_near_one_all(world: Path, device: Any) -> None:
    display = limen.Display.window((800, 400))
    near, far = (limen.Viewer((0, 0, -0.6 + distance)) for distance in (0.1, 6.0))
    full = limen.render(world, display, policy="full", device=device)["window"]
    np.testing.assert_array_equal(limen.render(world, display, [near], device=device)["window"], full)
    coarse = limen.render(world, display, [far], device=device)["window"]
    assert psnr(coarse, full) < 40
    sharp = limen.Viewer((0, 0, 5.4), acuity_arcmin=0.05)
    np.testing.assert_array_equal(limen.render(world, display, [far, sharp], device=device)["window"], full)


class Slow:
    """An image of which every page takes long."""

    kind = "image"

    def __init__(self, image: Image) -> None:
        self._image, self.pyramid, self.path = image, image.pyramid, image.path

    def read_page(self, page: int) -> NDArray[np.uint8]:
        time.sleep(0.05)
        return self._image.read_page(page)


def test_a_live_frame_never_waits_and_arrives_in_the_end(
    image: Image, device: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "limen.layers.image.layer.page_streaming", lambda source: replace(page_streaming(source), per_frame=4)
    )
    layer = ImageLayer(Slow(image), policy=FULL)  # type: ignore[arg-type]
    with Renderer(device, limen.Display.window((800, 400)), [layer]) as renderer:
        frame = frame_of(renderer)
        renderer.frame(frame)  # the first one compiles shaders
        row = row_of(renderer.frame(frame))
        assert row.missing > 0
        assert row.uploads <= 4
        deadline = time.monotonic() + 60
        while row.missing and time.monotonic() < deadline:
            row = row_of(renderer.frame(frame))
            assert row.uploads <= 4
            time.sleep(0.01)
        assert row.missing == 0
        assert row.panels_active == 1


def test_pages_are_fetched_ahead_of_a_walking_viewer(image: Image) -> None:
    display = limen.Display.window((1732, 866))
    layer = ImageLayer(image, policy=Policy("acuity", 1.0))
    nothing = np.full((image.pyramid.page_count, 1), -1)
    resident = Resident(nothing, np.full(len(nothing), -np.inf), 0.0, 0, 1000)
    (quilt,) = pack(display)

    def ahead(*walk: limen.Viewer) -> Any:
        """What the last of these frames wants shortly."""
        selector = layer.selector(display, display)
        for viewer in walk:
            frame = FrameState(viewers=(viewer,), layers=(layer.state(viewer.time_s, display),))
            views = [QuiltView.of(QuiltPanels(display, quilt), [viewer.position_m])]
            (soon,) = selector.select(views, frame.layers[0], frame, [resident], live=True).soon
        selector.close()
        return soon

    first, then = (limen.Viewer((0, 0, 2.0 - 0.02 * step), time_s=step / 60) for step in (0, 1))
    assert ahead(first, then) is not None
    assert ahead(first, then, then) is None, "who stands still needs nothing early"
    jump = limen.Viewer((0, 0, 50.0), time_s=1 / 60)
    assert ahead(first, jump) is None, "a jump is not walked on"
    assert ahead(then) is None, "nobody knows where to"
    assert then.extrapolated(first, 0.5).position_m == pytest.approx((0, 0, 1.98 - 0.6))


def test_moving_the_image_keeps_its_pages(image: Image, device: Any) -> None:
    with Renderer(device, limen.Display.window((400, 200)), [ImageLayer(image, policy=FULL)]) as renderer:
        before, first = drawn(renderer, frame_of(renderer))
        zoomed, _ = drawn(renderer, frame_of(renderer, placement=OnSurface(zoom=4.0, centre=(0.3, 0.6))))
        again, last = drawn(renderer, frame_of(renderer, placement=OnSurface()))
    np.testing.assert_array_equal(before["window"], again["window"])
    assert psnr(before["window"], zoomed["window"]) < 30
    assert row_of(first).uploads > row_of(last).uploads == 0


def test_an_image_on_a_shape_is_seen_through_the_panels(world: Path, image: Image, device: Any) -> None:
    cave = limen.Display.preset("cave").scaled(0.1)
    dome = OnShape("ellipsoid", (0, 1.6, 0), (0, 0, -5), (0, -5, 0))
    viewer = limen.Viewer((0, 1.6, 0.2))
    pictures = limen.render(world, cave, [viewer], placement=dome, device=device)
    assert all(picture[..., 3].min() == 255 for picture in pictures.values())
    seen = []
    for background in ((0.0, 0.0, 0.0), (1.0, 0.0, 1.0)):
        with Renderer(device, cave, [ImageLayer(image, dome)], background=background) as renderer:
            seen.append(drawn(renderer, frame_of(renderer, viewer))[0])
    for name, picture in pictures.items():
        for each in seen:
            np.testing.assert_array_equal(each[name], picture[..., :3], "the dome is all around")


def test_what_cannot_be_is_said(world: Path, image: Image, device: Any) -> None:
    display = limen.Display.window((64, 64))
    with pytest.raises(InputError, match="no policy"):
        limen.render(world, display, policy="everything", device=device)
    with pytest.raises(InputError, match="no panel"):
        limen.render(world, display, panels="wall/*", device=device)
    with pytest.raises(InputError, match="eye point"):
        limen.render(world, display, placement=OnShape("plane", (0, 0, -3), (1, 0, 0), (0, -1, 0)), device=device)
    with pytest.raises(DeviceLimitError, match="too small"):
        Renderer(device, display, [ImageLayer(image)], gpu_bytes=1000)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"overlay": "panels"}, "'panels' is not for an image: give 'levels' or 'error'"),
        ({"stereo": "anaglyph"}, "an image lies on the panels, alike for both eyes: leave out the stereo 'anaglyph'"),
        ({"placement": np.eye(4)}, "for meshes, not for images"),
    ],
)
def test_what_is_for_meshes_is_refused_for_images(world: Path, device: Any, options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        limen.render(world, limen.Display.window((64, 64)), device=device, **options)


def test_a_frame_fits_a_small_pool_by_coarser_pages(image: Image, device: Any) -> None:
    quilt = Quilt((1732, 866), (0,), ((0, 0),))
    layer, display = ImageLayer(image, policy=FULL), limen.Display.window((1732, 866))
    with Renderer(device, display, [layer], quilts=[quilt], gpu_bytes=512 * 4096 * 4) as renderer:
        frame = frame_of(renderer)
        (piece,) = renderer.choose(frame).pieces
        assert piece.cut.parts[0].cut.bias > 0
        assert row_of(renderer.frame(frame)).items < 15


def test_lenses_that_move_are_where_they_are_at_a_time_and_dragging_changes_nothing(image: Image) -> None:
    display = limen.Display.window((64, 64))
    standing = Lens((50.0, 50.0), 20.0, 2.0)
    layer = ImageLayer(
        image, OnSurface(lenses=(standing,)), moving=lambda time_s: (replace(standing, centre_px=(time_s, 0.0)),)
    )
    for time_s in (1.0, 3.0):
        state = layer.state(time_s, display)
        assert isinstance(state.placement, OnSurface)
        assert [lens.centre_px for lens in state.placement.lenses] == [(50.0, 50.0), (time_s, 0.0)]
        assert layer.turned(state, Turn(30.0, 10.0, 2.0), display) is state
