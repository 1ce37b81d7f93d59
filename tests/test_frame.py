"""Whole frames: pictures against plain resampling, what a live frame may not do, and what happens on bad days."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import pyvips

import limen
from limen.data import sample_image
from limen.data.samples.mesh import sample_mesh
from limen.display.quilt import Quilt
from limen.errors import DeviceLimitError, InputError
from limen.layers.image.renderer import Renderer, select_ahead
from limen.show.rendering import render
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.policy import Policy

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

FULL = Policy("full")


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """A sample of 6 megapixels."""
    path = tmp_path_factory.mktemp("world") / "world.tif"
    sample_image(path, 0.006, aspect=2.0)
    return path


def plain(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """The image resampled by libvips with Lanczos 3 in linear light: uint8 (h, w, 3)."""
    image = pyvips.Image.new_from_file(str(path)).colourspace("scrgb")
    image = image.resize(size_px[0] / image.width, vscale=size_px[1] / image.height, kernel="lanczos3")
    return image.colourspace("srgb").numpy()[..., :3]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / ((a.astype(float) - b) ** 2).mean()))


@pytest.mark.parametrize("size_px", [(1732, 866), (1200, 600), (640, 320)])
def test_a_panel_under_full_is_a_plain_resampling(world, device, size_px):
    drawn = render(world, limen.Display.window(size_px), policy="full", device=device)["window"]
    assert drawn.shape == (size_px[1], size_px[0], 4)
    assert psnr(drawn[..., :3], plain(world, size_px)) >= 35


@pytest.mark.data
def test_real_pictures_under_full_are_a_plain_resampling(data_dir, device):
    """The slide, whose levels were made elsewhere, and a photograph that has none."""
    for name, divisor in (("CMU-1-Small-Region.svs", 2), ("apollo_moon_pano_16810x1708.jpg", 7)):
        path = data_dir / "image" / name
        with limen.open(path) as image:
            size_px = (image.size_px[0] // divisor, image.size_px[1] // divisor)
            covered = (size_px[0] * divisor, size_px[1] * divisor)
            centre = (covered[0] / 2 / image.size_px[0], covered[1] / 2 / image.size_px[1])
            placement = OnSurface("one-to-one", zoom=1 / divisor, centre=centre)
            drawn = render(image, limen.Display.window(size_px), policy="full", placement=placement, device=device)
        crop = pyvips.Image.new_from_file(str(path)).crop(0, 0, *covered)
        linear = crop[:3].copy(interpretation="srgb") if crop.bands >= 3 else crop.colourspace("srgb")
        want = linear.colourspace("scrgb").resize(1 / divisor, kernel="lanczos3").colourspace("srgb").numpy()
        inner = (slice(4, -4), slice(4, -4))
        assert psnr(drawn["window"][..., :3][inner], want[..., :3][inner]) >= 35, name


def test_panels_of_a_room_show_their_own_part_and_nothing_else(world, device):
    wall = limen.Display.preset("rostock").scaled(0.1)
    pictures = render(world, wall, policy="full", placement=OnSurface("cover"), device=device)
    assert list(pictures) == [panel.name for panel in wall.panels]
    whole = np.concatenate(
        [np.concatenate([pictures[f"wall/{column},{row}"] for column in range(6)], axis=1) for row in range(4)]
    )
    with limen.open(world) as image:
        maps = OnSurface("cover").panel_maps(wall, image.size_px)
        source = plain(world, tuple(round(side / maps.scale[0, 0]) for side in image.size_px))
    top = (source.shape[0] - whole.shape[0]) // 2
    left = (source.shape[1] - whole.shape[1]) // 2
    assert psnr(whole[..., :3], source[top : top + whole.shape[0], left : left + whole.shape[1]]) > 30
    some = render(world, wall, policy="full", placement=OnSurface("cover"), panels="wall/?,1", device=device)
    assert len(some) == 6
    np.testing.assert_array_equal(some["wall/2,1"], pictures["wall/2,1"])


def test_a_distant_viewer_gets_less_detail_and_a_near_one_all(world, device):
    display = limen.Display.window((800, 400))
    near, far = (limen.Viewer((0, 0, -0.6 + distance)) for distance in (0.1, 6.0))
    full = render(world, display, policy="full", device=device)["window"]
    np.testing.assert_array_equal(render(world, display, [near], device=device)["window"], full)
    coarse = render(world, display, [far], device=device)["window"]
    assert psnr(coarse, full) < 40
    sharp = limen.Viewer((0, 0, 5.4), acuity_arcmin=0.05)
    np.testing.assert_array_equal(render(world, display, [far, sharp], device=device)["window"], full)


def test_a_live_frame_never_waits_and_arrives_in_the_end(world, device):
    class Slow:
        """Every page takes long."""

        def __init__(self, image):
            self._image, self.pyramid = image, image.pyramid

        def read_page(self, page):
            time.sleep(0.05)
            return self._image.read_page(page)

    display = limen.Display.window((800, 400))
    with limen.open(world) as image, Renderer(device, display, Slow(image), uploads_per_frame=4) as renderer:
        renderer.frame([], FULL)  # the first one compiles shaders
        report = renderer.frame([], FULL)
        assert report.missing > 0
        assert report.uploads <= 4
        deadline = time.monotonic() + 60
        while report.missing and time.monotonic() < deadline:
            report = renderer.frame([], FULL)
            assert report.uploads <= 4
            time.sleep(0.01)
        assert report.missing == 0
        assert report.panels_active == 1


def test_pages_are_fetched_ahead_of_a_walking_viewer(world):
    from limen.layers.image.select import view_of

    with limen.open(world) as image:
        view = view_of(limen.Display.window((1732, 866)), image.pyramid, OnSurface())
    policy = Policy("acuity", 1.0)
    first, then = (limen.Viewer((0, 0, 2.0 - 0.02 * step), time_s=step / 60) for step in (0, 1))
    assert select_ahead(view, policy, [then], [first], 0.4) is not None
    assert select_ahead(view, policy, [then], [then], 0.4) is None, "who stands still needs nothing early"
    jump = limen.Viewer((0, 0, 50.0), time_s=1 / 60)
    assert select_ahead(view, policy, [jump], [first], 0.4) is None, "a jump is not walked on"
    assert then.extrapolated(first, 0.5).position_m == pytest.approx((0, 0, 1.98 - 0.6))


def test_moving_the_image_keeps_its_pages(world, device):
    display = limen.Display.window((400, 200))
    with limen.open(world) as image, Renderer(device, display, image) as renderer:
        before = next(iter(renderer.pictures([], FULL)))[1].copy()
        renderer.place(OnSurface(zoom=4.0, centre=(0.3, 0.6)))
        zoomed = next(iter(renderer.pictures([], FULL)))[1].copy()
        renderer.place(OnSurface())
        again = next(iter(renderer.pictures([], FULL)))[1].copy()
    np.testing.assert_array_equal(before, again)
    assert psnr(before, zoomed) < 30


def test_an_image_on_a_shape_is_seen_through_the_panels(world, device):
    cave = limen.Display.preset("cave").scaled(0.1)
    dome = OnShape("ellipsoid", (0, 1.6, 0), (0, 0, -5), (0, -5, 0))
    pictures = render(world, cave, [limen.Viewer((0, 1.6, 0.2))], placement=dome, device=device)
    assert all(picture[..., 3].min() == 255 for picture in pictures.values()), "the dome is all around"


def test_what_cannot_be_is_said(world, device):
    display = limen.Display.window((64, 64))
    with pytest.raises(InputError, match="no policy"):
        render(world, display, policy="everything", device=device)
    with pytest.raises(InputError, match="no panel"):
        render(world, display, panels="wall/*", device=device)
    with pytest.raises(InputError, match="eye point"):
        render(world, display, placement=OnShape("plane", (0, 0, -3), (1, 0, 0), (0, -1, 0)), device=device)
    with limen.open(world) as image, pytest.raises(DeviceLimitError, match="too small"):
        Renderer(device, display, image, gpu_bytes=1000)


def test_a_frame_fits_a_small_pool_by_coarser_pages(world, device):
    display = limen.Display.window((1732, 866))
    with limen.open(world) as image, Renderer(device, display, image, gpu_bytes=512 * 4096 * 4) as renderer:
        report = renderer.frame([], FULL, quilt=Quilt((1732, 866), (0,), ((0, 0),)))
        assert report.bias > 0
        assert report.pages < 15


# ---------------------------------------------------------------------------- meshes


@pytest.fixture(scope="module")
def knot(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "knot.ply"
    sample_mesh(path, 2000)
    return path


def test_a_mesh_is_rendered_as_an_image_is(knot, device):
    """From a path or opened, of all panels or of some: a panel shows one picture."""
    wall = limen.Display.preset("rostock")
    viewer = limen.Viewer((0.1, 1.7, 0.0))
    every = render(knot, wall, [viewer], scale=0.05, device=device)
    assert list(every) == [panel.name for panel in wall.panels]
    assert {(picture.shape, picture.dtype) for picture in every.values()} == {((60, 96, 4), np.dtype(np.uint8))}
    assert every["wall/2,1"][..., :3].max() > 100
    some = render(limen.open(knot), wall, [viewer, limen.Viewer((1, 1, 1))], panels="wall/2,*", scale=0.05,
                  device=device)  # fmt: skip
    assert list(some) == [f"wall/2,{row}" for row in range(4)]
    for name, picture in some.items():
        assert (np.abs(picture.astype(int) - every[name]).max(axis=-1) > 8).mean() < 0.004


def test_a_mesh_takes_its_place_and_two_eyes(knot, device):
    display = limen.Display.window((160, 120))
    viewer = limen.Viewer((0, 0, 0))
    behind = np.diag([0.01, 0.01, 0.01, 1.0])
    columns = []
    for x_m in (0.0, 0.005):
        behind[:3, 3] = (x_m, 0, -0.6)
        picture = render(knot, display, [viewer], placement=behind, device=device)["window"]
        columns.append(np.nonzero(picture[..., :3].max(axis=(0, 2)) > 40)[0].mean())
    assert columns[1] - columns[0] == pytest.approx(0.005 / display.pitch_m, abs=1)
    both = render(knot, display, [viewer], stereo="sequential", device=device)
    assert list(both) == ["window@left", "window@right"]
    wide = render(knot, display, [viewer], stereo="side-by-side", device=device)["window"]
    np.testing.assert_array_equal(np.concatenate(list(both.values()), axis=1), wide)
    tinted = render(knot, display, [viewer], placement=behind, overlay="panels", device=device)["window"]
    assert (tinted != picture).any()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"viewers": []}, "give a viewer"),
        ({"overlay": "levels"}, "'levels' is not for a mesh: give 'panels' or 'simplified'"),
        ({"overlay": "simplified"}, "'simplified' shows what a policy leaves out"),
        ({"acuity_arcmin": 1.0}, "acuity_arcmin changes nothing"),
        ({"acuity_arcmin": 1.0, "policy": Policy()}, "a Policy has its own"),
        ({"panels": ["window", "wimdow"]}, "matches wimdow"),
        ({"placement": OnSurface("cover")}, "are for images"),
        ({"policy": "everything"}, "no policy"),
        ({"stereo": "polarised"}, "no stereo is named"),
        ({"placement": np.eye(3)}, r"shape \(4, 4\)"),
        ({"placement": np.full((4, 4), np.nan)}, "finite"),
    ],
)
def test_what_a_mesh_cannot_be_is_said(knot, device, options, says):
    asked = {"viewers": [limen.Viewer((0, 0, 0))]} | options
    with pytest.raises(InputError, match=says):
        render(knot, limen.Display.window((64, 64)), device=device, **asked)


@pytest.mark.parametrize("options", [{"overlay": "panels"}, {"stereo": "anaglyph"}, {"placement": np.eye(4)}])
def test_what_is_for_meshes_is_refused_for_images(world, device, options):
    with pytest.raises(InputError, match="for meshes, not for images"):
        render(world, limen.Display.window((64, 64)), device=device, **options)
