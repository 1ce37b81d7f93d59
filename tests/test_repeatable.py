"""The same message and data are the same picture: whatever came first, in any slot, read by any number of threads."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import limen
from clouds import ball
from ground import write_dem
from limen.data import sample_image
from limen.data.terrain_build import ingest_terrain
from limen.data.terrain_file import Terrain
from limen.display.display import Display
from limen.frame import Renderer
from limen.lens import Lens
from limen.look_at import LookAt
from limen.placement import OnShape, OnSurface
from limen.points import PointsRenderer
from limen.terrain import TerrainRenderer
from limen.terrain_choice import TerrainSettings
from limen.terrain_stock import Draped
from limen.tolerance import Policy
from limen.viewer import Viewer

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


@pytest.mark.parametrize("placement", PLACEMENTS.values(), ids=PLACEMENTS.keys())
def test_of_an_image(placement: Any, world: Path, device: Any) -> None:
    def picture(threads: int, gpu_bytes: int, seed: int) -> Pictures:
        with limen.open(world) as image:
            shuffled: Any = Shuffled(image, seed)
            made = Renderer(device, WALL, shuffled, placement, threads=threads, gpu_bytes=gpu_bytes)
            with made as renderer:
                return settled(renderer.pictures([VIEWER], ACUITY))

    assert_all_equal([picture(1, 1 << 29, 1), picture(4, 1 << 29, 2), picture(3, 1 << 26, 3)])


def test_of_a_terrain_with_a_picture_on_it(hills: Path, world: Path, device: Any) -> None:
    look_at = LookAt((0.55, 0.5), 30, 35, 5_000)

    def picture(threads: int, gpu_bytes: int, seed: int) -> Pictures:
        with limen.open(world) as image:
            land: Any = Shuffled(Terrain.open(hills), seed)
            lies = np.array(
                [[image.size_px[0] / land.size_posts[0], 0, 0], [0, image.size_px[1] / land.size_posts[1], 0]]
            )
            made = TerrainRenderer(
                device, WALL, land, settings=TerrainSettings(look_at=look_at), reference_m=EYE, gpu_bytes=gpu_bytes,
                draped=Draped(Shuffled(image, seed + 1), lies), threads=threads,
            )  # fmt: skip
            with made as renderer:
                return settled(renderer.pictures([VIEWER], ACUITY))

    assert_all_equal([picture(1, 1 << 28, 1), picture(4, 1 << 28, 2), picture(2, 1 << 27, 3)])


def test_of_a_cloud_of_points(device: Any) -> None:
    cloud = ball(40_000)
    stands = np.array([[1.2, 0, 0, 0.3], [0, 1.2, 0, 1.5], [0, 0, 1.2, -3.5], [0, 0, 0, 1.0]])

    def picture(threads: int, gpu_bytes: int, seed: int) -> Pictures:
        shuffled: Any = Shuffled(cloud, seed)
        made = PointsRenderer(device, WALL, shuffled, room_from_file=stands, threads=threads, gpu_bytes=gpu_bytes)
        with made as renderer:
            return settled(renderer.pictures([VIEWER], ACUITY))

    assert_all_equal([picture(1, 1 << 27, 1), picture(4, 1 << 27, 2), picture(3, 1 << 24, 3)])
