"""Sixteen small pictures, and what is told of each: every kind of content on walls, rooms and turned quilts.

``python tests/golden/scenes.py`` draws them anew, which is a decision: a picture that changes by itself is a fault.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import limen
from clouds import ball
from ground import write_dem
from limen.data import sample_image
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.points.file import Points
from limen.data.samples.mesh import torus_knot
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.layers.common.room_placement import mesh_in_room
from limen.layers.image.renderer import Renderer
from limen.layers.mesh.renderer import SceneRenderer, Simplified
from limen.layers.mesh.select import FoldTree
from limen.layers.points.renderer import PointsRenderer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.renderer import TerrainRenderer
from limen.layers.terrain.resources import Draped
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.lens import Lens
from limen.viewing.placement import LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

HERE = Path(__file__).parent
REPORTS = HERE / "reports.json"
Rgb = NDArray[np.uint8]

WALL = Display.named("rostock").scaled(1 / 24)
_CORNER = [
    f"{side}/{column},{row}"
    for side, columns in (("left", "789"), ("front", "012"))
    for column in columns
    for row in "2345"
]
ROOM = Display.named("reality-deck").select(_CORNER).scaled(1 / 32)


def _turned() -> Display:
    """Four panels that stand upright in two quilts, each turned in another way, with room between them."""
    wall = Display.named("rostock").scaled(1 / 16).select(["wall/2,1", "wall/3,1", "wall/2,2", "wall/3,2"])
    width, height = wall.panels[0].size_px
    first = Quilt((2 * height + 12, width + 8), (0, 2), ((4, 4), (height + 8, 4)), (1, 3), "left")
    second = Quilt((width + 20, 2 * height + 16), (1, 3), ((10, 6), (10, height + 10)), (2, 0), "right")
    return Display("turned", wall.panels, quilts=(first, second))


TURNED = _turned()
VIEWER = Viewer((0.3, 1.5, 0.2), direction=(0, 0, -1), gaze=(-0.4, -0.1, -1.0))


class Scene(NamedTuple):
    """What is drawn: a picture for every panel or quilt, and the reports of how."""

    columns: int
    draw: Callable[[Any, Path], Iterable[tuple[str, Rgb, Any]]]


# ---------------------------------------------------------------------- contents


@cache
def _world(folder: Path) -> Path:
    sample_image(folder / "world.tif", 0.008, aspect=2.0)
    return folder / "world.tif"


@cache
def _hills(folder: Path) -> Path:
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    return folder / "hills.terrain"


@cache
def _knot() -> limen.Mesh:
    return torus_knot(6000)


@cache
def _tree() -> FoldTree:
    return FoldTree(build_vertex_tree(_knot()))


@cache
def _ball() -> Points:
    return ball(40_000)


# ---------------------------------------------------------------------- kinds


def _image(display: Display, placement: Any, policy: str = "acuity", **more: Any) -> Callable[..., Any]:
    def draw(device: Any, folder: Path) -> Iterator[tuple[str, Rgb, Any]]:
        with limen.open(_world(folder)) as image, Renderer(device, display, image, placement) as renderer:  # type: ignore[union-attr]
            yield from renderer.pictures([VIEWER], Policy.parse(policy), **more)

    return draw


def _mesh(display: Display, policy: str = "full", *, quilts: bool = False, **more: Any) -> Callable[..., Any]:
    def draw(device: Any, _folder: Path) -> Iterator[tuple[str, Rgb, Any]]:
        left_out = None if policy == "full" else Simplified(_tree(), Policy.parse(policy))
        with SceneRenderer(
            device, display, _knot(), room_from_mesh=_stands(display), simplified=left_out, **more
        ) as renderer:
            yield from (renderer.quilt_pictures if quilts else renderer.pictures)(VIEWER)

    return draw


def _stands(display: Display) -> Any:
    """Behind a wall, or inside of a room before its front."""
    at_m = (0.3, 1.5, -2.6) if display is not ROOM else (-1.6, 1.4, -1.0)
    return mesh_in_room(_knot().bounds, display, size_m=1.6, at_m=at_m, turn_deg=20)


def _terrain(display: Display, look_at: LookAt, policy: str = "acuity", **more: Any) -> Callable[..., Any]:
    def draw(device: Any, folder: Path) -> Iterator[tuple[str, Rgb, Any]]:
        settings = TerrainSettings(look_at=look_at, camera=more.get("camera", "window"))
        look, land = more.get("look", TerrainLook()), Terrain.open(_hills(folder))
        with limen.open(_world(folder)) as image:  # type: ignore[union-attr]
            scale = [size / posts for size, posts in zip(image.size_px, land.size_posts, strict=True)]
            lies = np.array([[scale[0], 0, 0], [0, scale[1], 0]])
            with TerrainRenderer(
                device, display, land, look=look, settings=settings, reference_m=VIEWER.position_m,
                draped=Draped(image, lies) if look.colours == "drape" else None,
            ) as renderer:  # fmt: skip
                yield from renderer.pictures([VIEWER], Policy.parse(policy), overlay=more.get("overlay"))

    return draw


def _points(
    display: Display, policy: str = "acuity", *, quilts: bool = False, overlay: Any = None, **more: Any
) -> Callable[..., Any]:
    stands = np.diag([1.2, 1.2, 1.2, 1.0])
    stands[:3, 3] = (0.3, 1.5, -3.5) if display is not ROOM else (-3.2, 1.4, -2.0)

    def draw(device: Any, _folder: Path) -> Iterator[tuple[str, Rgb, Any]]:
        with PointsRenderer(device, display, _ball(), room_from_file=stands, **more) as renderer:
            pictures = renderer.quilt_pictures if quilts else renderer.pictures
            yield from pictures([VIEWER], Policy.parse(policy), overlay=overlay)

    return draw


_CLOSE, _FAR = LookAt((0.55, 0.5), 30, 35, 5_000), LookAt((0.5, 0.5), -20, 30, 14_000)
_LENSES = (Lens((2000.0, 1000.0), 600.0, 4.0), Lens((1100.0, 700.0), 500.0, 3.0, 0.2, "linear", "rectangular"))

SCENES: dict[str, Scene] = {
    "image-wall": Scene(6, _image(WALL, OnSurface("cover"))),
    "image-room": Scene(6, _image(ROOM, OnSurface("cover"), "acuity+gaze", overlay="levels")),
    "image-lenses": Scene(6, _image(WALL, OnSurface("cover", lenses=_LENSES))),
    "image-shape": Scene(6, _image(WALL, OnShape("ellipsoid", (0.0, 1.5, 0.0), (6.0, 0.0, -6.0), (0.0, -9.0, 0.0)))),
    "mesh-wall": Scene(6, _mesh(WALL)),
    "mesh-room": Scene(6, _mesh(ROOM, "contrast+gaze")),
    "mesh-turned": Scene(2, _mesh(TURNED, "acuity", quilts=True)),
    "mesh-anaglyph": Scene(6, _mesh(WALL, "budget:2500", stereo="anaglyph", depth="shared")),
    "terrain-wall": Scene(6, _terrain(WALL, _CLOSE, "scheel")),
    "terrain-room": Scene(6, _terrain(ROOM, _CLOSE, look=TerrainLook(contour_interval_m=100.0))),
    "terrain-turned": Scene(2, _terrain(TURNED, _CLOSE, "full", camera="fixed", overlay="patches")),
    "terrain-drape": Scene(6, _terrain(WALL, _FAR, look=TerrainLook("drape", 200.0, 30.0))),
    "points-wall": Scene(6, _points(WALL)),
    "points-room": Scene(6, _points(ROOM, "contrast+gaze", shape="square")),
    "points-turned": Scene(2, _points(TURNED, "full", quilts=True, lit=True)),
    "points-simplified": Scene(6, _points(WALL, "budget:6000", overlay="simplified")),
}


# ---------------------------------------------------------------------- pictures and reports


def drawn(name: str, device: Any, folder: Path) -> tuple[Rgb, list[dict[str, Any]]]:
    """A scene as one picture, and what is told of its quilts: all but times, and what was there before.

    Parameters
    ----------
    folder
        Where contents are made, once.
    """
    scene = SCENES[name]
    pictures: dict[str, Rgb] = {}
    reports: dict[int, dict[str, Any]] = {}
    for part, picture, report in scene.draw(device, folder):
        pictures[part] = picture[..., :3].copy()
        reports.setdefault(id(report), told(report))
    return _montage([pictures[part] for part in sorted(pictures, key=_place)], scene.columns), list(reports.values())


def _place(part: str) -> tuple[str, str]:
    """Where a panel or quilt lies in the picture of all: by rows, from the left."""
    column, _, row = part.rpartition(",")
    return row, column.replace("left", "a")


def told(report: Any) -> dict[str, Any]:
    """A report as plain numbers, without times and uploads."""
    fields = {each.name: getattr(report, each.name) for each in dataclasses.fields(report)}
    numbers = {name: value for name, value in fields.items() if not name.endswith("_ms") and name != "uploads"}
    return {
        name: str(value) if isinstance(value, float) and math.isinf(value) else value for name, value in numbers.items()
    }


def _montage(pictures: list[Rgb], columns: int) -> Rgb:
    """Pictures side by side, each in a field of the largest size, in rows of so many."""
    height, width = (max(picture.shape[axis] for picture in pictures) + 2 for axis in (0, 1))
    rows = -(-len(pictures) // columns)
    whole = np.full((rows * height, columns * width, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = number // columns * height, number % columns * width
        whole[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return whole


def kept(name: str) -> tuple[Rgb, list[dict[str, Any]]]:
    """What was kept of a scene."""
    with Picture.open(HERE / f"{name}.png") as picture:
        return np.asarray(picture.convert("RGB")), json.loads(REPORTS.read_text())[name]


def _keep_all() -> None:
    from limen.gpu.device import open_device

    reports = {}
    with open_device() as device, tempfile.TemporaryDirectory() as folder:
        for name in SCENES:
            picture, reports[name] = drawn(name, device, Path(folder))
            Picture.fromarray(picture).save(HERE / f"{name}.png", optimize=True)
            print(name, *picture.shape[1::-1])
    REPORTS.write_text(json.dumps(reports, indent=1) + "\n")


if __name__ == "__main__":
    _keep_all()
