"""The same message and data are the same picture: whatever came first, in any slot, read by any number of threads."""

from __future__ import annotations

import os
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

import limen
from limen.data import sample_image
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.samples.mesh import torus_knot
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.frame.renderer import GPU_BYTES, Renderer
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import FoldTree
from limen.layers.points.layer import PointsLayer
from limen.layers.registry import KINDS
from limen.layers.terrain.layer import Draped, TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.lens import Lens
from limen.viewing.placement import LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import FrameState, decode, encode
from limen.viewing.viewer import Pointer, Viewer
from support.clouds import ball
from support.ground import write_dem
from support.processes import PYTHON, finished

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

WALL = Display.named("rostock").scaled(1 / 12)
EYE = (0.3, 1.5, 0.2)
VIEWER = Viewer(EYE, direction=(0, 0, -1), eye_separation_m=0.0)
ACUITY, ACUITY_AT_GAZE = Policy("acuity"), Policy("acuity", 8.0, gaze=True)
Pictures = dict[str, NDArray[np.uint8]]
"""What every panel shows."""


class Shuffled:
    """A source whose items come late by chance, so that the last is often first."""

    def __init__(self, source: Any, seed: int) -> None:
        self._source, self._chance = source, random.Random(seed)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._source, name)
        if name in ("read_page", "read_patch", "read_chunk"):
            return self._late(found)
        if name in ("relief", "heights"):
            return Shuffled(found, self._chance.randrange(1000))
        return found

    def _late(self, read: Callable[[int], Any]) -> Callable[[int], Any]:
        def late(number: int) -> Any:
            time.sleep(self._chance.choice((0, 0, 0.002, 0.01)))
            return read(number)

        return late


def settled(renderer: Renderer, frame: FrameState | None = None) -> Pictures:
    """Of a frame, or of the one that all stands still in."""
    frame = frame or renderer.state(0.0, viewers=(VIEWER,))
    return {name: picture.copy() for name, picture, _ in renderer.pictures(frame)}


def assert_all_equal(pictures: list[Pictures]) -> None:
    first, *others = pictures
    assert len({picture.tobytes() for picture in first.values()}) > len(first) // 3, "panels show something"
    for other in others:
        for name, picture in first.items():
            np.testing.assert_array_equal(picture, other[name], err_msg=name)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("world") / "world.tif"
    sample_image(path, 0.008, aspect=2.0)
    return path


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terrain")
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    return folder / "hills.terrain"


PLACEMENTS = {
    "on the surface": OnSurface("cover"),
    "through a lens": OnSurface("cover", lenses=(Lens((2000.0, 1000.0), 600.0, 4.0),)),
    "on a shape": OnShape("ellipsoid", (0.0, 1.5, 0.0), (0.0, 0.0, -9.0), (0.0, -9.0, 0.0)),
}


class Conditions(NamedTuple):
    """What no picture may depend on."""

    seed: int
    """Of the order that everything comes in."""
    threads: int
    halvings: int = 0
    """Of the memory for what is read."""


CONDITIONS = Conditions(1, 1), Conditions(2, 4), Conditions(3, 3, 3)


# ---------------------------------------------------------------------- contents


@contextmanager
def an_image(world: Path, placement: Any, under: Conditions, policy: Policy = ACUITY) -> Iterator[ImageLayer]:
    with limen.open(world) as image:  # type: ignore[union-attr]
        shuffled: Any = Shuffled(image, under.seed)
        yield ImageLayer(shuffled, placement, policy)


@contextmanager
def a_terrain(
    world: Path, hills: Path, under: Conditions, policy: Policy = ACUITY, flight: Any = "none"
) -> Iterator[TerrainLayer]:
    """With the picture of the world on it."""
    with limen.open(world) as image:  # type: ignore[union-attr]
        land: Any = Shuffled(Terrain.open(hills), under.seed)
        lies = np.array([[image.size_px[0] / land.size_posts[0], 0, 0], [0, image.size_px[1] / land.size_posts[1], 0]])
        shuffled: Any = Shuffled(image, under.seed + 1)
        settings = TerrainSettings(LookAt((0.55, 0.5), 30, 35, 5_000), flight)
        yield TerrainLayer(land, TerrainLook(), settings, policy, EYE, Draped(shuffled, lies))


def some_points(under: Conditions, stands: RoomPlacement, policy: Policy = ACUITY) -> PointsLayer:
    shuffled: Any = Shuffled(ball(40_000), under.seed)
    return PointsLayer(shuffled, stands, policy)


STANDS = np.array([[1.2, 0, 0, 0.3], [0, 1.2, 0, 1.5], [0, 0, 1.2, -3.5], [0, 0, 0, 1.0]])


def drawn(device: Any, layer: Layer, under: Conditions, frame: FrameState | None = None) -> Pictures:
    halvings = min(under.halvings, 1) if layer.kind == "terrain" else under.halvings
    gpu_bytes = GPU_BYTES >> halvings + (layer.kind == "terrain")
    with Renderer(device, WALL, [layer], threads=under.threads, gpu_bytes=gpu_bytes) as renderer:
        return settled(renderer, frame)


# ---------------------------------------------------------------------- whatever came first, of one frame


@pytest.mark.parametrize("placement", PLACEMENTS.values(), ids=PLACEMENTS.keys())
def test_of_an_image(placement: Any, world: Path, device: Any) -> None:
    pictures = []
    for under in CONDITIONS:
        with an_image(world, placement, under) as layer:
            pictures.append(drawn(device, layer, under))
    assert_all_equal(pictures)


def test_of_a_terrain_with_a_picture_on_it(hills: Path, world: Path, device: Any) -> None:
    pictures = []
    for under in CONDITIONS:
        with a_terrain(world, hills, under) as layer:
            pictures.append(drawn(device, layer, under))
    assert_all_equal(pictures)


def test_of_a_cloud_of_points(device: Any) -> None:
    stands = RoomPlacement(matrix=STANDS)
    assert_all_equal([drawn(device, some_points(under, stands), under) for under in CONDITIONS])


# ---------------------------------------------------------------------- from the message of a frame

LENS = Lens((2000.0, 1000.0), 600.0, 4.0)
_HILL = np.minimum(np.arange(9), np.arange(9)[::-1]) / 8
TABLE = Lens((0.0, 0.0), (400.0, 300.0), 2.0, heights=np.add.outer(_HILL, _HILL))
TURNING = RoomPlacement(size_m=2.4, at_m=(0.3, 1.5, -2.8), turn_deg=20, turning=True)
PEOPLE = (
    Viewer(EYE, direction=(0.1, -0.2, -3.0), gaze=(-0.4, -0.1, -1.0), time_s=7.7, name="one", velocity_m_s=(0.3, 0, 0)),
    Viewer((-1.1, 1.7, 0.6), direction=(0.3, 0.0, -0.7), acuity_arcmin=5.0, eye_separation_m=0.0),
)
POINTERS = (Pointer((0.5, 1.3, 0.1), (-0.3, 0.1, -2.0), name="hand"),)


@contextmanager
def in_motion(kind: str, world: Path, hills: Path, under: Conditions) -> Iterator[Layer]:
    """Content of every kind, that makes use of all that a message says."""
    unhurried = Policy.parse("contrast+gaze+motion", 12.0)
    if kind == "image":
        with an_image(world, OnSurface("cover", lenses=(LENS,), carried=(TABLE,)), under, ACUITY_AT_GAZE) as image:
            yield image
    elif kind == "terrain":
        with a_terrain(world, hills, under, ACUITY_AT_GAZE, "orbit") as terrain:
            yield terrain
    elif kind == "points":
        yield some_points(under, TURNING, unhurried)
    else:
        yield MeshLayer(knot(), TURNING, unhurried, FoldTree(build_vertex_tree(knot())))


@cache
def knot() -> limen.Mesh:
    return torus_knot(6000)


def frame_of(layer: Layer) -> FrameState:
    state = layer.state(1.3, WALL)
    if state.motion is not None:  # as if it turned faster: then it is drawn with less detail than if it stood still
        state = msgspec.structs.replace(state, motion=tuple(30 * number for number in state.motion))
    return FrameState(number=39, time_s=1.3, viewers=PEOPLE, pointers=POINTERS, layers=(state,))


@pytest.mark.parametrize("kind", KINDS)
def test_of_a_message_that_was_sent(kind: str, world: Path, hills: Path, device: Any) -> None:
    pictures = []
    for under, sent in zip(CONDITIONS[:2], (False, True), strict=True):
        with in_motion(kind, world, hills, under) as layer:
            frame = frame_of(layer)
            pictures.append(drawn(device, layer, under, decode(encode(frame)) if sent else frame))
    assert_all_equal(pictures)


def all_kinds(device: Any, world: Path, hills: Path, under: Conditions, messages: dict[str, bytes]) -> Pictures:
    """What is drawn from messages, one for each kind."""
    pictures = {}
    for kind, message in messages.items():
        with in_motion(kind, world, hills, under) as layer:
            assert encode(frame_of(layer)) == message, "this process would have sent the same"
            for panel, picture in drawn(device, layer, under, decode(message)).items():
                pictures[f"{kind} {panel}"] = picture
    return pictures


def test_in_another_process(world: Path, hills: Path, device: Any, tmp_path: Path) -> None:
    """A message and data are the same picture to whoever draws it, which is what walls of many nodes stand on."""
    script = (
        "import sys, test_repeatable as here; from pathlib import Path; from limen.gpu.device import open_device\n"
        "world, hills, sent, kept = map(Path, sys.argv[1:])\n"
        "messages = {path.name: path.read_bytes() for path in sent.iterdir()}\n"
        "with open_device() as device:\n"
        "    drawn = here.all_kinds(device, world, hills, here.Conditions(7, 5, 2), messages)\n"
        "here.np.savez(kept, **drawn)"
    )
    sent, kept = tmp_path / "sent", tmp_path / "drawn.npz"
    sent.mkdir()
    messages = {}
    for kind in KINDS:
        with in_motion(kind, world, hills, CONDITIONS[0]) as layer:
            messages[kind] = encode(frame_of(layer))
            (sent / kind).write_bytes(messages[kind])
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    ended = finished([*PYTHON, "-c", script, world, hills, sent, kept], 200, env=os.environ | {"PYTHONPATH": path})
    assert ended.returncode == 0, ended.stderr
    with np.load(kept) as other:
        assert_all_equal([all_kinds(device, world, hills, CONDITIONS[0], messages), dict(other)])
