"""Small contents of every kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from ground import write_dem
from limen.data import sample_image
from limen.data.samples.mesh import sample_mesh
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain


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
