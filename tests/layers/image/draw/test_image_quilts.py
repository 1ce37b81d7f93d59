"""Images in the quilts that a display's owner wrote: turned panels, room around them, facets, several outputs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Picture

import limen
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt
from limen.errors import DeviceLimitError
from limen.frame.renderer import Renderer
from limen.layers.image.layer import ImageLayer
from limen.viewing.lens import Lens
from limen.viewing.placement import OnShape, OnSurface, Placement
from limen.viewing.projection import GUARD_PX
from limen.viewing.tessellation import Tessellation
from limen.viewing.viewer import Viewer
from support.frames import FULL, MEMORY, frame_of, row_of

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

EXAMPLE = Path(__file__).parents[4] / "examples/portrait_wall.toml"
WALL = Display.load(EXAMPLE)
SMALL = replace(
    WALL.scaled(0.5),
    quilts=tuple(
        replace(
            quilt,
            size_px=tuple(side // 2 for side in quilt.size_px),
            offsets_px=tuple((x // 2, y // 2) for x, y in quilt.offsets_px),
        )
        for quilt in WALL.quilts
    ),
)
"""The same with half as many pixels along each side."""
VIEWER = Viewer((0.2, 1.5, 0.3))
LENSES = (Lens((300.0, 260.0), 160.0, 3.0), Lens((700.0, 500.0), 150.0, 2.5))
PLACEMENTS: dict[str, Placement] = {
    "surface": OnSurface("cover"),
    "lenses": OnSurface("cover", lenses=LENSES),
    "lenses in triangles": OnSurface("cover", lenses=LENSES, tessellation=Tessellation("uniform")),
    "plane": OnShape("plane", (-1.5, 2.2, -2.0), (3.0, 0, 0), (0, -1.6, 0)),
    "ellipsoid": OnShape("ellipsoid", (0, 1.4, 0), (0, 0, -4.0), (0, -2.0, 0)),
}
Rgb = NDArray[np.uint8]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Smooth hills with squares on them: what is mirrored, turned or a pixel off differs everywhere."""
    y, x = np.mgrid[:640, :960]
    rgb = np.stack([120 + 90 * np.sin(x / 37), 120 + 90 * np.sin(y / 23), 60 + x * 0.18], axis=-1)
    rgb[(x // 48 + y // 64) % 5 == 0] += 25
    path = tmp_path_factory.mktemp("world") / "world.png"
    Picture.fromarray(rgb.clip(20, 255).astype(np.uint8)).save(path)
    return path


def drawn(device: Any, world: Path, display: Display, placement: Any, *, quilts: bool = False) -> dict[str, Rgb]:
    with (
        limen.open(world) as image,
        Renderer(device, display, [ImageLayer(image, placement, FULL)], gpu_bytes=MEMORY) as renderer,
    ):  # type: ignore[union-attr]
        pictures = renderer.pictures(frame_of(renderer, VIEWER), by="quilts" if quilts else "panels")
        return {name: picture[..., :3].copy() for name, picture, _ in pictures}


@pytest.mark.parametrize("name", PLACEMENTS)
def test_turned_panels_show_what_upright_ones_show(name: str, device: Any, world: Path) -> None:
    turned = drawn(device, world, SMALL, PLACEMENTS[name])
    upright = drawn(device, world, replace(SMALL, quilts=()), PLACEMENTS[name])
    assert set(turned) == set(upright)
    codes = 8 if name == "lenses in triangles" else 1  # whose corners are interpolated along the quilt's rows
    for panel, picture in turned.items():
        assert picture.std() > 20
        apart = np.abs(picture.astype(int) - upright[panel]).max(axis=-1)
        assert (apart > codes).mean() < 0.01


def test_each_output_has_its_panels_where_its_owner_wants_them(device: Any, world: Path) -> None:
    quilts = drawn(device, world, WALL, OnSurface("cover"), quilts=True)
    panels = drawn(device, world, WALL, OnSurface("cover"))
    assert {name: picture.shape for name, picture in quilts.items()} == {"1": (360, 1920, 3), "2": (360, 1920, 3)}
    for column in range(3):
        left = quilts["1"][:, 640 * column : 640 * (column + 1)]
        np.testing.assert_array_equal(np.rot90(left), panels[f"wall/{column},0"], err_msg="clockwise, so back again")
        right = quilts["2"][:, 640 * (2 - column) : 640 * (3 - column)]
        np.testing.assert_array_equal(np.rot90(right, 3), panels[f"wall/{column},1"])


@pytest.mark.parametrize("turns", [(0, 0), (1, 3), (2, 1)])
def test_where_there_is_room_the_image_goes_on_beyond_the_outline(turns: Any, device: Any, world: Path) -> None:
    """Whoever samples the quilt between pixels finds no seam; without room, panels end at their outlines."""
    panels = tuple(replace(panel, size_px=(90, 90)) for panel in WALL.panels[:2])
    apart = Display("apart", panels, quilts=(Quilt((220, 110), (0, 1), ((10, 10), (120, 10)), turns),))
    close = Display("close", panels, quilts=(Quilt((180, 90), (0, 1), ((0, 0), (90, 0)), turns),))
    image = drawn(device, world, apart, OnSurface("cover"), quilts=True)["quilt-0"]
    lit = image.max(axis=-1) > 0
    for left in (10, 120):
        whole = np.zeros_like(lit)
        whole[9:101, left - 1 : left + 91] = True  # the pixels whose middles are nearer than that
        near = slice(max(0, left - 10), left + 100)
        np.testing.assert_array_equal(lit[:, near], whole[:, near], err_msg=f"{GUARD_PX} pixels around")
        beside = np.abs(image[10:100, left - 1].astype(int) - image[10:100, left]).max()
        assert beside < 60, "of the image"
    dim = replace(apart, panels=tuple(replace(panel, gain=0.5) for panel in panels))
    dimmed = drawn(device, world, dim, OnSurface("cover"), quilts=True)["quilt-0"]
    assert (dimmed[9:101, 9:101].astype(int) < 0.85 * image[9:101, 9:101]).all(), "with the panel, to the last pixel"
    touching = drawn(device, world, close, OnSurface("cover"), quilts=True)["quilt-0"]
    np.testing.assert_array_equal(touching, np.concatenate([image[10:100, 10:100], image[10:100, 120:210]], axis=1))


def test_facets_in_a_packing_show_what_they_show_alone(device: Any, world: Path) -> None:
    """Triangles, some of them upside down, as `limen display NAME --quilt --to-toml` keeps them."""
    display = Display.preset("icosahedron").scaled(0.125)
    around = OnShape("ellipsoid", (0, 0, 0), (0, 0, -3.0), (0, -3.0, 0), eye_m=(0.0, 0.0, 0.0))
    packed = replace(display, quilts=tuple(pack_outlines(display, max_size_px=4096)))
    assert any(turn for quilt in packed.quilts for turn in quilt.quarter_turns)
    together, alone = drawn(device, world, packed, around), drawn(device, world, display, around)
    for name, picture in alone.items():
        seen = picture.max(axis=-1) > 0
        assert seen.any()
        apart = np.abs(together[name].astype(int) - picture).max(axis=-1)
        assert (apart[seen] > 1).mean() < 0.01
        assert (together[name].max(axis=-1) > 0)[seen].all()


def test_a_part_of_a_wall_is_drawn_and_panels_match_in_its_quilts(device: Any, world: Path) -> None:
    dim = tuple(replace(panel, gain=0.5) if panel.name == "wall/1,0" else panel for panel in SMALL.panels)
    pictures = drawn(device, world, replace(SMALL, panels=dim).select("wall/*,0"), OnSurface("cover"))
    bright = drawn(device, world, SMALL.select("wall/*,0"), OnSurface("cover"))
    assert set(pictures) == {f"wall/{column},0" for column in range(3)}
    np.testing.assert_array_equal(pictures["wall/0,0"], bright["wall/0,0"])
    assert pictures["wall/1,0"].mean() < 0.85 * bright["wall/1,0"].mean()


def test_a_quilt_that_the_adapter_cannot_hold_is_named(device: Any, world: Path) -> None:
    with limen.open(world) as image, pytest.raises(DeviceLimitError, match=r"quilt '1'.* several quilts"):  # type: ignore[union-attr]
        Renderer(replace(device, max_texture_px=1024), WALL, [ImageLayer(image)])


def test_through_lenses_panels_end_at_their_outlines(device: Any, world: Path) -> None:
    """What lies beside them without lenses would be something else."""
    panels = tuple(replace(panel, size_px=(90, 90)) for panel in WALL.panels[:2])
    apart = Display("apart", panels, quilts=(Quilt((220, 110), (0, 1), ((10, 10), (120, 10))),))
    lit = drawn(device, world, apart, PLACEMENTS["lenses"], quilts=True)["quilt-0"].max(axis=-1) > 0
    whole = np.zeros_like(lit)
    whole[10:100, 10:100] = whole[10:100, 120:210] = True
    np.testing.assert_array_equal(lit, whole)


def test_every_quilt_tells_its_own_panels(device: Any, world: Path) -> None:
    for placement in PLACEMENTS.values():
        with (
            limen.open(world) as image,
            Renderer(device, SMALL, [ImageLayer(image, placement, FULL)], gpu_bytes=MEMORY) as renderer,
        ):  # type: ignore[union-attr]
            reports = [report for *_, report in renderer.pictures(frame_of(renderer, VIEWER), by="quilts")]
        assert [row_of(report).panels_active for report in reports] == [3, 3]
