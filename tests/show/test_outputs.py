"""Content on the screens of this machine: every window shows its quilt, all of one moment."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wgpu
from numpy.typing import NDArray
from PIL import Image as Picture

import limen
from limen.data.mesh.mesh import Mesh
from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.show.canvas import Surface
from limen.show.show import Show
from limen.viewing.camera import Camera
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

VIEWER = Viewer((0.0, 1.2, 0.8))
LEFT = Panel("left", (120, 80), (-0.3, 1.4, 0.0), (1, 0, 0), (0, -1, 0), (0.0025, 0.0025))
RIGHT = replace(LEFT, name="right", origin_m=(0.0, 1.4, 0.0))
MAPPED = Display(
    "two", (LEFT, RIGHT),
    quilts=(Quilt((130, 90), (0,), ((5, 5),), output="one"), Quilt((80, 120), (1,), ((0, 0),), (1,), output="two")),
)  # fmt: skip


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return torus_knot(3000)


def draw(device: Any, live: Any, number: int, size_px: tuple[int, int], time_s: float = 0.0) -> NDArray[np.uint8]:
    from limen.gpu.buffers import TextureReader

    usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
    window_format = wgpu.TextureFormat.rgba8unorm_srgb
    texture = device.wgpu.create_texture(size=(*size_px, 1), format=window_format, usage=usage)
    live.draw(number, Surface(texture.create_view(), window_format, size_px, time_s))
    reader = TextureReader(device)
    picture = reader.read(texture)
    reader.destroy()
    texture.destroy()
    return picture


def test_every_window_shows_its_quilt(device: Any, mesh: Mesh) -> None:
    from limen.show.app import App

    live = App(device, Show([mesh]), MAPPED, VIEWER, "outputs")
    windows = [draw(device, live, number, quilt.size_px) for number, quilt in enumerate(MAPPED.quilts)]
    live.close()
    with Renderer(device, MAPPED, [MeshLayer(mesh)]) as renderer:
        drawn = renderer.pictures(renderer.state(0.0, viewers=(VIEWER,)), by="quilts")
        quilts = {picture.name: picture.pixels.copy() for picture in drawn}
    assert list(quilts) == ["one", "two"]
    for window, quilt in zip(windows, quilts.values(), strict=True):
        np.testing.assert_array_equal(window, quilt)
        assert (window.max(axis=-1) > 100).sum() > 300, "the knot is on both panels"


def test_windows_share_one_clock_and_keys(device: Any, mesh: Mesh) -> None:
    from limen.show.app import App

    live = App(device, Show([MeshLayer(mesh, RoomPlacement(turning=True))]), MAPPED, VIEWER, "outputs")
    first, second = (quilt.size_px for quilt in MAPPED.quilts)
    still = draw(device, live, 1, second)
    draw(device, live, 0, first, time_s=2.0)
    turned = draw(device, live, 1, second, time_s=7.0)
    assert (turned != still).any(), "the first window's time is everybody's"
    live.handle({"event_type": "key_down", "key": " "})
    draw(device, live, 0, first, time_s=4.0)
    np.testing.assert_array_equal(draw(device, live, 1, second), turned)
    live.handle({"event_type": "key_down", "key": "o"})
    assert (draw(device, live, 1, second) != turned).any()
    assert not live.closed
    live.handle({"event_type": "key_down", "key": "q"})
    assert live.closed
    live.close()


def test_a_screen_of_another_size_is_named(device: Any, mesh: Mesh) -> None:
    from limen.show.app import App

    live = App(device, Show([mesh]), MAPPED, VIEWER, "outputs")
    with pytest.raises(InputError, match="output 'two' has 90 x 120 pixels and its quilt 80 x 120"):
        draw(device, live, 1, (90, 120))
    live.close()


def test_a_display_without_a_mapping_and_two_pictures_at_once_are_refused(device: Any, mesh: Mesh) -> None:
    from limen.show.app import App

    with pytest.raises(InputError, match="add \\[\\[quilt\\]\\]"):
        App(device, Show([mesh]), Display("bare", (LEFT,)), VIEWER, "outputs")
    with pytest.raises(InputError, match="one picture at a time"):
        App(device, Show([mesh], stereo="sequential"), MAPPED, VIEWER, "outputs")


@pytest.mark.parametrize(
    ("output", "names", "screen"),
    [
        ("DP-1", ["DP-1", "DP-2"], 0), ("2", ["DP-1", "DP-2"], 1), ("TV", ["TV", "TV"], None), ("3", ["TV"], None),
        ("", ["TV"], None),
    ],
)  # fmt: skip
def test_which_screen_an_output_means(output: str, names: list[str], screen: int | None) -> None:
    from limen.show.app import _screen_of

    assert _screen_of(output, names) == screen


def test_an_image_fills_every_window_with_its_quilt(device: Any, tmp_path: Path) -> None:
    """Pages come while frames are drawn; all windows of a frame show one choice, with the lens where it is then."""
    from limen.show.app import App

    texels = np.random.default_rng(5).integers(30, 256, (300, 600, 3), dtype=np.uint8)
    Picture.fromarray(texels.repeat(3, axis=0).repeat(3, axis=1)).save(tmp_path / "image.png")
    full, lens = Policy("full"), Lens((900.0, 450.0), 200.0, 3.0)
    with limen.open(tmp_path / "image.png") as image:  # type: ignore[union-attr]
        layer = ImageLayer(image, OnSurface("cover"), full, lambda time_s: (lens,) if time_s >= 1 else ())
        live = App(device, Show([layer]), MAPPED, VIEWER, "outputs")
        for time_s in (0.0, 1.0):
            missing, frames = 1, 0
            while missing or frames < 20:  # pages that came late fade in by the clock
                now_s = time_s + min(0.02 * frames, 0.9)
                windows = [draw(device, live, k, quilt.size_px, now_s) for k, quilt in enumerate(MAPPED.quilts)]
                frames += 1
                assert live.last is not None
                missing = live.last.missing + live.last.layers[0].uploads
                time.sleep(0.02)
            placement = OnSurface("cover", lenses=(lens,) if time_s else ())
            with Renderer(device, MAPPED, [ImageLayer(image, placement, full)]) as renderer:
                frame = renderer.state(0.0, viewers=(VIEWER,))
                quilts = [picture.pixels.copy() for picture in renderer.pictures(frame, by="quilts")]
            for window, quilt in zip(windows, quilts, strict=True):
                assert (np.abs(window.astype(int) - quilt).max(axis=-1) <= 1).mean() > 0.999
        live.close()


def test_all_windows_of_a_frame_show_one_choice(device: Any, mesh: Mesh) -> None:
    """What the first window was drawn for, the others are: whatever has come, or was pressed, meanwhile."""
    from limen.show.app import App

    live = App(device, Show([mesh]), MAPPED, VIEWER, "outputs")
    first, second = (quilt.size_px for quilt in MAPPED.quilts)
    draw(device, live, 0, first)
    chosen = live._view._chosen
    draw(device, live, 1, second)
    assert live._view._chosen is chosen
    draw(device, live, 0, first)
    assert live._view._chosen is not chosen
    live.close()


def test_an_eye_sees_an_image_on_the_lit_wall(device: Any, tmp_path: Path) -> None:
    Picture.new("RGB", (600, 300), (90, 140, 60)).save(tmp_path / "image.png")
    with limen.open(tmp_path / "image.png") as image, Show([image]).renderer(device, MAPPED) as renderer:  # type: ignore[union-attr]
        frame = renderer.state(0.0, viewers=(VIEWER,))
        (seen,) = renderer.seen(frame, [Camera(VIEWER.position_m, (-0.15, 1.3, 0.0), (60, 40), 20.0)])
    assert np.abs(seen[..., :3].astype(int) - (90, 140, 60)).max(axis=-1).min() <= 1, "its colour is seen"
