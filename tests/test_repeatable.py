"""The same message and data are the same picture: whatever came first, in any slot, read by any number of threads."""

from __future__ import annotations

import os
import random
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import limen
from clouds import ball
from ground import write_dem
from limen.data import sample_image
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.layers.image.renderer import Renderer
from limen.layers.points.renderer import PointsRenderer
from limen.layers.terrain.renderer import TerrainRenderer
from limen.layers.terrain.resources import Draped
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.lens import Lens
from limen.viewing.placement import LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer
from processes import PYTHON, finished

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

WALL = Display.named("rostock").scaled(1 / 12)
EYE = (0.3, 1.5, 0.2)
VIEWER = Viewer(EYE, direction=(0, 0, -1), eye_separation_m=0.0)
ACUITY = Policy("acuity")
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


def settled(drawn: Iterator[tuple[str, NDArray[np.uint8], Any]]) -> Pictures:
    return {name: picture.copy() for name, picture, _ in drawn}


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


def of_image(device: Any, world: Path, placement: Any, under: Conditions) -> Pictures:
    with limen.open(world) as image:  # type: ignore[union-attr]
        shuffled: Any = Shuffled(image, under.seed)
        with Renderer(
            device, WALL, shuffled, placement, threads=under.threads, gpu_bytes=1 << 29 >> under.halvings
        ) as renderer:
            return settled(renderer.pictures([VIEWER], ACUITY))


def of_terrain(device: Any, world: Path, hills: Path, under: Conditions) -> Pictures:
    """With the picture of the world on it."""
    with limen.open(world) as image:  # type: ignore[union-attr]
        land: Any = Shuffled(Terrain.open(hills), under.seed)
        lies = np.array([[image.size_px[0] / land.size_posts[0], 0, 0], [0, image.size_px[1] / land.size_posts[1], 0]])
        with TerrainRenderer(
            device, WALL, land, settings=TerrainSettings(look_at=LookAt((0.55, 0.5), 30, 35, 5_000)), reference_m=EYE,
            gpu_bytes=1 << 28 >> min(under.halvings, 1), draped=Draped(Shuffled(image, under.seed + 1), lies),
            threads=under.threads,
        ) as renderer:  # fmt: skip
            return settled(renderer.pictures([VIEWER], ACUITY))


def of_points(device: Any, under: Conditions) -> Pictures:
    shuffled: Any = Shuffled(ball(40_000), under.seed)
    stands = np.array([[1.2, 0, 0, 0.3], [0, 1.2, 0, 1.5], [0, 0, 1.2, -3.5], [0, 0, 0, 1.0]])
    with PointsRenderer(
        device, WALL, shuffled, room_from_file=stands, threads=under.threads, gpu_bytes=1 << 27 >> under.halvings
    ) as renderer:
        return settled(renderer.pictures([VIEWER], ACUITY))


@pytest.mark.parametrize("placement", PLACEMENTS.values(), ids=PLACEMENTS.keys())
def test_of_an_image(placement: Any, world: Path, device: Any) -> None:
    assert_all_equal([of_image(device, world, placement, under) for under in CONDITIONS])


def test_of_a_terrain_with_a_picture_on_it(hills: Path, world: Path, device: Any) -> None:
    assert_all_equal([of_terrain(device, world, hills, under) for under in CONDITIONS])


def test_of_a_cloud_of_points(device: Any) -> None:
    assert_all_equal([of_points(device, under) for under in CONDITIONS])


def all_kinds(device: Any, world: Path, hills: Path, under: Conditions) -> Pictures:
    drawn = {
        "image": of_image(device, world, PLACEMENTS["through a lens"], under),
        "terrain": of_terrain(device, world, hills, under),
        "points": of_points(device, under),
    }
    return {f"{kind} {panel}": picture for kind, pictures in drawn.items() for panel, picture in pictures.items()}


def test_in_another_process(world: Path, hills: Path, device: Any, tmp_path: Path) -> None:
    """A message and data are the same picture to whoever draws it, which is what walls of many nodes stand on."""
    script = (
        "import sys, test_repeatable as here; from pathlib import Path; from limen.gpu.device import open_device\n"
        "with open_device() as device:\n"
        "    drawn = here.all_kinds(device, *map(Path, sys.argv[1:3]), here.Conditions(7, 5, 2))\n"
        "here.np.savez(sys.argv[3], **drawn)"
    )
    path = os.pathsep.join(sys.path)
    kept = tmp_path / "drawn.npz"
    ended = finished([*PYTHON, "-c", script, world, hills, kept], 200, env=os.environ | {"PYTHONPATH": path})
    assert ended.returncode == 0, ended.stderr
    with np.load(kept) as other:
        assert_all_equal([all_kinds(device, world, hills, CONDITIONS[0]), dict(other)])
