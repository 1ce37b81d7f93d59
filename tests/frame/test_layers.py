"""Several layers in one picture: every pixel is that of the nearest one, whatever the display, the order, the eyes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

import limen
from golden.scenes import ROOM, TURNED, WALL
from limen.data import sample_image
from limen.data.mesh.mesh import NO_TEXTURE, Mesh
from limen.data.points.file import Points
from limen.data.samples.mesh import torus_knot
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement, mesh_in_room
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.points.layer import PointsLayer
from limen.layers.terrain.layer import TerrainLayer
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.placement import InRoom, LookAt, OnShape, OnSurface
from limen.viewing.viewer import Viewer
from support.clouds import ball
from support.ground import write_dem

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

VIEWER = Viewer((0.3, 1.5, 0.2), direction=(0, 0, -1))
BACKGROUND = (0.02, 0.0, 0.02)
_BYTES = 48 << 20
Rgb = NDArray[np.int64]


@cache
def a_knot() -> Mesh:
    return torus_knot(3000)


@cache
def a_ball() -> Points:
    return ball(12_000)


class Contents(NamedTuple):
    """What stands where, for all displays here: the terrain farther back than the others, which are in one another."""

    image: limen.Image
    terrain: Terrain

    def layer(self, kind: str, away_m: float = 3.0, *, aside: bool = False) -> Layer:
        """``aside``: to the left, where the corner of the room is."""
        middle = np.array(VIEWER.position_m) + away_m * np.array([-0.85, -0.05, -0.53] if aside else [0.0, 0.0, -1.0])
        if kind == "image":
            return ImageLayer(self.image, OnSurface("cover"))
        if kind == "terrain":
            look_at = TerrainSettings(LookAt((0.55, 0.5), 30, 35, 5_000))
            return TerrainLayer(self.terrain, settings=look_at, reference_m=VIEWER.position_m)
        if kind == "mesh":
            stands = mesh_in_room(a_knot().bounds, WALL, size_m=1.6, at_m=tuple(middle), turn_deg=20)
            return MeshLayer(a_knot(), RoomPlacement(matrix=stands))
        stands = np.diag([0.6, 0.6, 0.6, 1.0])
        stands[:3, 3] = middle + np.array([0.2, -0.1, 0.0])
        return PointsLayer(a_ball(), RoomPlacement(matrix=stands))


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder: Path = tmp_path_factory.mktemp("layers")
    sample_image(folder / "world.tif", 0.008, aspect=2.0)
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    with limen.open(folder / "world.tif") as image:  # type: ignore[union-attr]
        yield Contents(image, Terrain.open(folder / "hills.terrain"))


def drawn(device: Any, display: Display, layers: list[Layer], **more: Any) -> Rgb:
    """All panels' pictures, or all quilts', one pixel after the other."""
    by, hidden = more.pop("by", "panels"), more.pop("hidden", ())
    with Renderer(device, display, layers, background=BACKGROUND, gpu_bytes=_BYTES, **more) as renderer:
        frame = renderer.state(0.0, viewers=(VIEWER,))
        states = tuple(
            msgspec.structs.replace(state, visible=number not in hidden) for number, state in enumerate(frame.layers)
        )
        pictures = {
            each.name: each.pixels[..., :3].reshape(-1, 3).astype(int)
            for each in renderer.pictures(msgspec.structs.replace(frame, layers=states), by=by)
        }
    return np.concatenate([pictures[name] for name in sorted(pictures)])


def alike(one: Rgb, other: Rgb) -> NDArray[np.bool_]:
    return np.asarray(np.abs(one - other).max(axis=-1) <= 1)


DISPLAYS = {"a wall": WALL, "a room": ROOM, "turned panels": TURNED}
BY = {"a wall": "panels", "a room": "panels", "turned panels": "quilts"}
Alone = Callable[..., tuple[Layer, Rgb]]


@pytest.fixture(scope="module")
def alone(device: Any, contents: Contents) -> Alone:
    """A layer so far away on one of the displays, and its picture without any other (hidden: the background)."""

    @cache
    def made(where: str, kind: str, away_m: float, hidden: tuple[int, ...] = ()) -> tuple[Layer, Rgb]:
        layer, by = contents.layer(kind, away_m, aside=where == "a room"), BY[where]
        return layer, drawn(device, DISPLAYS[where], [layer], by=by, hidden=hidden)

    return made


@pytest.mark.parametrize("where", DISPLAYS)
@pytest.mark.parametrize(
    ("front", "behind"),
    [pair for pair in permutations(("image", "mesh", "points", "terrain"), 2) if pair[0] != "image"],
)
def test_what_is_in_front_hides_what_is_behind(where: str, front: str, behind: str, device: Any, alone: Alone) -> None:
    """Each pixel is that of one of them alone; what is nearer everywhere is all there, an image always behind."""
    display, by = DISPLAYS[where], BY[where]
    (near, one), (far, other) = alone(where, front, 1.6), alone(where, behind, 4.0)
    both = drawn(device, display, [far, near], by=by)
    assert (alike(both, one) | alike(both, other)).all()
    shown = ~alike(one, alone(where, front, 1.6, hidden=(0,))[1])
    assert shown.mean() > 0.01, "something of it is seen"
    if front != "terrain":  # which begins nearer than what is behind it here, and ends farther away
        assert alike(both, one)[shown].all()
        assert alike(both, other)[~shown].all()
    np.testing.assert_array_equal(drawn(device, display, [near, far], by=by), both, err_msg="in whatever order")


@pytest.mark.parametrize("kinds", [("mesh", "points"), ("mesh", "terrain"), ("points", "terrain")])
def test_what_stands_in_one_another_is_cut_where_it_meets(
    kinds: tuple[str, str], device: Any, contents: Contents
) -> None:
    layers = [contents.layer(kind, 3.0) for kind in kinds]
    one, other = (drawn(device, WALL, [layer]) for layer in layers)
    both = drawn(device, WALL, layers)
    first, second = alike(both, one), alike(both, other)
    assert (first | second).all()
    assert (first & ~second).mean() > 0.005
    assert (second & ~first).mean() > 0.005


def test_a_mesh_and_its_own_vertices_meet_where_they_are(device: Any, contents: Contents) -> None:
    """The depths of both kinds mean the same: a plane of points a hand's breadth before or behind a plane mesh."""
    from limen.data.points.build import build_points

    side = np.linspace(-1, 1, 41)
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    cloud = build_points(np.column_stack([places, np.zeros(len(places))]), np.full((len(places), 3), 250, np.uint8))
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    plane = Mesh(
        None, corners, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), np.tile(np.float32([0, 0, 1]), (4, 1)),
        np.full((4, 4), 120, np.uint8) | np.uint8([0, 0, 0, 255]), np.zeros((4, 2), np.float32),
        np.full(4, NO_TEXTURE, np.uint32), np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip
    for apart_m, seen in ((0.05, True), (-0.05, False)):
        stands = np.eye(4)
        stands[:3, 3] = (0.3, 1.5, -2.0)
        nearer = stands.copy()
        nearer[2, 3] += apart_m
        layers: list[Layer] = [
            MeshLayer(plane, RoomPlacement(matrix=stands)),
            PointsLayer(cloud, RoomPlacement(matrix=nearer)),
        ]
        both, mesh = drawn(device, WALL, layers), drawn(device, WALL, layers[:1])
        inside = ~alike(mesh, drawn(device, WALL, layers[:1], hidden=(0,)))
        assert (~alike(both, mesh)[inside]).mean() > 0.2 if seen else alike(both, mesh)[inside].mean() > 0.99


def test_every_kind_is_drawn_for_each_eye(device: Any, contents: Contents) -> None:
    """Both halves of a stereo picture are those of one eye alone."""
    layers = [contents.layer(kind) for kind in ("image", "terrain", "mesh", "points")]
    with Renderer(device, WALL, layers, stereo="sequential") as renderer:
        frame = renderer.state(0.0, viewers=(VIEWER,))
        both = {each.name: each.pixels.copy() for each in renderer.pictures(frame)}
    apart = 0
    for side, eye_m in zip(("left", "right"), VIEWER.eyes_m, strict=True):
        with Renderer(device, WALL, layers, eye_m=tuple(eye_m)) as renderer:
            alone = {each.name: each.pixels.copy() for each in renderer.pictures(frame)}
        for name, picture in alone.items():
            np.testing.assert_array_equal(both[f"{name}@{side}"], picture)
            apart += int((both[f"{name}@left"] != both[f"{name}@right"]).any())
    assert apart > 10, "the eyes see the scene from two places"


def test_each_layer_has_a_row_of_its_own(device: Any, contents: Contents) -> None:
    layers = [contents.layer(kind) for kind in ("points", "image", "mesh", "terrain")]
    with Renderer(device, WALL, layers) as renderer:
        frame = renderer.state(0.0, viewers=(VIEWER,))
        report = [each.report for each in renderer.pictures(frame)][-1]
        live = renderer.frame(frame)
        alone = msgspec.structs.replace(
            frame, layers=tuple(msgspec.structs.replace(state, visible=n == 2) for n, state in enumerate(frame.layers))
        )
        only = renderer.frame(alone)
    assert [row.kind for row in report.layers] == ["points", "image", "mesh", "terrain"]
    assert [row.missing for row in report.layers] == [0, 0, 0, 0]
    assert [row.items for row in live.layers] == [row.items for row in report.layers]
    assert all(row.draw_ms > 0 for row in live.layers)
    assert [row.kind for row in only.layers] == ["mesh"]


def test_the_memory_is_shared(device: Any, contents: Contents) -> None:
    """Of one budget for all: an image and a terrain take half of it each."""
    with Renderer(device, WALL, [contents.layer("image")], gpu_bytes=1 << 26) as renderer:
        alone = renderer.layers and renderer._shown[0].resident[0].capacity
    with Renderer(device, WALL, [contents.layer("image"), contents.layer("terrain")], gpu_bytes=1 << 26) as renderer:
        shared = renderer._shown[0].resident[0].capacity
    assert 0.3 < shared / alone <= 0.5


def test_what_cannot_be_shown_together_is_refused(device: Any, contents: Contents) -> None:
    mesh = contents.layer("mesh")
    shape = ImageLayer(contents.image, OnShape("ellipsoid", (0.0, 1.5, 0.0), (6.0, 0.0, -6.0), (0.0, -9.0, 0.0)))
    with pytest.raises(InputError, match="an image beside other layers lies on the surface"):
        Renderer(device, WALL, [shape, mesh])
    with pytest.raises(InputError, match="a mesh beside other layers has the depth of each panel"):
        Renderer(device, WALL, [MeshLayer(a_knot(), depth="shared"), mesh])
    with pytest.raises(InputError, match="alike for both eyes"):
        Renderer(device, WALL, [contents.layer("image")], stereo="anaglyph")
    with Renderer(device, WALL, [mesh, contents.layer("image")]) as renderer:
        frame = renderer.state(0.0, viewers=(VIEWER,))
        wrong = msgspec.structs.replace(
            frame, layers=(frame.layers[0], msgspec.structs.replace(frame.layers[1], placement=InRoom.of(np.eye(4))))
        )
        with pytest.raises(InputError, match="an image"):
            renderer.frame(wrong)
