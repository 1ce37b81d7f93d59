"""Small contents of every kind, each as a layer: fixtures for the tests of frames and of shows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from limen.data import sample_image
from limen.data.image.file import open_image
from limen.data.samples.mesh import sample_mesh, torus_knot
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.points.layer import PointsLayer
from limen.layers.registry import KINDS
from limen.layers.terrain.layer import TerrainLayer
from limen.layers.terrain.selector import TerrainSettings
from support.clouds import ball
from support.frames import CLOSE, EYE, FULL, STANDS
from support.ground import write_dem


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample of 6 megapixels."""
    path = tmp_path_factory.mktemp("world") / "world.tif"
    sample_image(path, 0.006, aspect=2.0)
    return path


@pytest.fixture(scope="session")
def knot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "knot.ply"
    sample_mesh(path, 2000)
    return path


@pytest.fixture(scope="session")
def terrain(tmp_path_factory: pytest.TempPathFactory) -> Terrain:
    folder = tmp_path_factory.mktemp("terrain")
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    return Terrain.open(folder / "hills.terrain")


@pytest.fixture(scope="session")
def layers(world: Path, terrain: Terrain) -> Iterator[dict[str, Layer]]:
    """One of every kind, of which all detail is drawn."""
    with open_image(world) as image:
        yield {
            "image": ImageLayer(image, policy=FULL),
            "mesh": MeshLayer(torus_knot(3000), RoomPlacement()),
            "terrain": TerrainLayer(terrain, settings=TerrainSettings(CLOSE), policy=FULL, reference_m=EYE),
            "points": PointsLayer(ball(20_000), RoomPlacement(matrix=STANDS), FULL),
        }


@pytest.fixture(params=list(KINDS))
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def layer(kind: str, layers: dict[str, Layer]) -> Layer:
    return layers[kind]
