"""What tests of options share: small files of every kind, opened once, and a desk."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from limen.data import sample_image, sample_mesh
from limen.data.opening import open_content
from support.clouds import ball
from support.desk import NAMES, POINTS, SESSION, WALL, Desk
from support.ground import write_dem


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], files: Path) -> Iterator[Desk]:
    here = Path.cwd()
    os.chdir(files)
    before = {path: path.stat().st_mtime_ns for path in files.rglob("*")}
    yield Desk(monkeypatch, capsys)
    assert {path: path.stat().st_mtime_ns for path in files.rglob("*")} == before, "something was written"
    os.chdir(here)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small file of every kind, a wall with a [[quilt]], and a session."""
    folder = tmp_path_factory.mktemp("options")
    sample_image(folder / "image.tif", 0.0001)
    sample_mesh(folder / "mesh.ply", 200)
    write_dem(folder / "terrain.tif")
    away = np.hypot(*(np.mgrid[:33, :33] / 16 - 1))
    Picture.fromarray(np.uint8(255 * np.clip(1 - away, 0, 1))).save(folder / "heights.png")
    (folder / "points.ply").write_text(POINTS)
    (folder / "wall.toml").write_text(WALL.to_toml())
    nodes = dataclasses.replace(
        WALL, panels=tuple(dataclasses.replace(panel, node=panel.name) for panel in WALL.panels)
    )
    (folder / "nodes.toml").write_text(nodes.to_toml())
    (folder / "walk.csv").write_text(SESSION)
    (folder / "other.csv").write_text(SESSION.replace("0.1,0.2,0.5", "0.2,0.2,0.5"))
    (folder / "panels.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


@pytest.fixture(scope="module")
def contents(files: Path) -> Iterator[dict[str, Any]]:
    """What the files hold, opened once."""
    land = SimpleNamespace(kind="terrain", name="terrain", transform=None, crs="", size_posts=(321, 257))
    image = open_content(files / NAMES["image"])
    yield {
        NAMES["image"]: image,
        NAMES["mesh"]: open_content(files / NAMES["mesh"]),
        NAMES["points"]: ball(300),
        NAMES["terrain"]: land,
    }
    image.close()
