"""Sixteen small pictures, and what is told of each: every kind of content on walls, rooms and turned quilts.

``python tests/golden/scenes.py`` draws them anew, which is a decision: a picture that changes by itself is a fault.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import limen
from limen.data import sample_image
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.points.file import Points
from limen.data.samples.mesh import torus_knot
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport, Picture
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import FoldTree
from limen.layers.points.layer import PointsLayer
from limen.layers.terrain.layer import Draped, TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.lens import Lens
from limen.viewing.placement import LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer
from support.clouds import ball
from support.ground import write_dem

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
    """What is drawn: a picture for every panel or quilt."""

    columns: int
    draw: Callable[[Any, Path], Iterable[Picture]]


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


def _pictures(
    device: Any, display: Display, layer: Layer, by: Literal["panels", "quilts"] = "panels", **more: Any
) -> Iterator[Picture]:
    with Renderer(device, display, [layer], **more) as renderer:
        yield from renderer.pictures(renderer.state(0.0, viewers=(VIEWER,)), by=by)


def _image(display: Display, placement: Any, policy: str = "acuity", overlay: str = "") -> Callable[..., Any]:
    def draw(device: Any, folder: Path) -> Iterator[Picture]:
        with limen.open(_world(folder)) as image:  # type: ignore[union-attr]
            layer = ImageLayer(image, placement, Policy.parse(policy), overlay=overlay)
            yield from _pictures(device, display, layer)

    return draw


def _mesh(display: Display, policy: str = "full", depth: Any = "panel", **more: Any) -> Callable[..., Any]:
    """Behind a wall, or inside of a room before its front."""
    at_m = (0.3, 1.5, -2.6) if display is not ROOM else (-1.6, 1.4, -1.0)
    stands = RoomPlacement(size_m=1.6, at_m=at_m, turn_deg=20)

    def draw(device: Any, _folder: Path) -> Iterator[Picture]:
        tree = None if policy == "full" else _tree()
        layer = MeshLayer(_knot(), stands, Policy.parse(policy), tree, depth=depth)
        yield from _pictures(device, display, layer, **more)

    return draw


def _terrain(
    display: Display, look_at: LookAt, policy: str = "acuity", look: TerrainLook | None = None, overlay: str = "",
    **more: Any,
) -> Callable[..., Any]:  # fmt: skip
    def draw(device: Any, folder: Path) -> Iterator[Picture]:
        looks, land = look or TerrainLook(), Terrain.open(_hills(folder))
        with limen.open(_world(folder)) as image:  # type: ignore[union-attr]
            scale = [size / posts for size, posts in zip(image.size_px, land.size_posts, strict=True)]
            draped = Draped(image, np.array([[scale[0], 0, 0], [0, scale[1], 0]]))
            layer = TerrainLayer(
                land, looks, TerrainSettings(look_at), Policy.parse(policy), VIEWER.position_m,
                draped if looks.colours == "drape" else None, overlay,
            )  # fmt: skip
            yield from _pictures(device, display, layer, **more)

    return draw


def _points(display: Display, policy: str = "acuity", by: Any = "panels", **more: Any) -> Callable[..., Any]:
    matrix = np.diag([1.2, 1.2, 1.2, 1.0])
    matrix[:3, 3] = (0.3, 1.5, -3.5) if display is not ROOM else (-3.2, 1.4, -2.0)

    def draw(device: Any, _folder: Path) -> Iterator[Picture]:
        layer = PointsLayer(_ball(), RoomPlacement(matrix=matrix), Policy.parse(policy), **more)
        yield from _pictures(device, display, layer, by)

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
    "mesh-turned": Scene(2, _mesh(TURNED, "acuity", by="quilts")),
    "mesh-anaglyph": Scene(6, _mesh(WALL, "budget:2500", stereo="anaglyph", depth="shared")),
    "terrain-wall": Scene(6, _terrain(WALL, _CLOSE, "scheel")),
    "terrain-room": Scene(6, _terrain(ROOM, _CLOSE, look=TerrainLook(contour_interval_m=100.0))),
    "terrain-turned": Scene(2, _terrain(TURNED, _CLOSE, "full", eye_m=VIEWER.position_m, overlay="patches")),
    "terrain-drape": Scene(6, _terrain(WALL, _FAR, look=TerrainLook("drape", 200.0, 30.0))),
    "points-wall": Scene(6, _points(WALL)),
    "points-room": Scene(6, _points(ROOM, "contrast+gaze", shape="square")),
    "points-turned": Scene(2, _points(TURNED, "full", by="quilts", lit=True)),
    "points-simplified": Scene(6, _points(WALL, "budget:6000", overlay="simplified")),
}


# ---------------------------------------------------------------------- pictures and reports


def drawn(name: str, device: Any, folder: Path) -> tuple[Rgb, list[list[dict[str, Any]]]]:
    """A scene as one picture, and what is told of its quilts: all but times, and what was there before.

    Parameters
    ----------
    folder
        Where contents are made, once.
    """
    scene = SCENES[name]
    pictures: dict[str, Rgb] = {}
    reports: dict[int, FrameReport] = {}
    for part, picture, report in scene.draw(device, folder):
        pictures[part] = picture[..., :3].copy()
        reports[id(report)] = report
    whole = _montage([pictures[part] for part in sorted(pictures, key=_place)], scene.columns)
    return whole, [told(report) for report in reports.values()]


def _place(part: str) -> tuple[str, str]:
    """Where a panel or quilt lies in the picture of all: by rows, from the left."""
    column, _, row = part.rpartition(",")
    return row, column.replace("left", "a")


def told(report: FrameReport) -> list[dict[str, Any]]:
    """A report as plain numbers, a row for every layer: without times, uploads and the names of contents."""
    frame = {"number": report.number, "time_s": report.time_s, "scale": report.scale}
    return [frame | _plain(row) for row in report.layers]


def _plain(row: Any) -> dict[str, Any]:
    fields = {each.name: getattr(row, each.name) for each in dataclasses.fields(row)}
    kept = {name: each for name, each in fields.items() if not name.endswith("_ms") and name not in ("uploads", "name")}
    return {name: list(each) if isinstance(each, tuple) else each for name, each in kept.items()}


def _montage(pictures: list[Rgb], columns: int) -> Rgb:
    """Pictures side by side, each in a field of the largest size, in rows of so many."""
    height, width = (max(picture.shape[axis] for picture in pictures) + 2 for axis in (0, 1))
    rows = -(-len(pictures) // columns)
    whole = np.full((rows * height, columns * width, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = number // columns * height, number % columns * width
        whole[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return whole


def kept(name: str) -> tuple[Rgb, list[list[dict[str, Any]]]]:
    """What was kept of a scene."""
    with Pillow.open(HERE / f"{name}.png") as picture:
        return np.asarray(picture.convert("RGB")), json.loads(REPORTS.read_text())[name]


def _keep_all() -> None:
    from limen.gpu.device import open_device

    reports = {}
    with open_device() as device, tempfile.TemporaryDirectory() as folder:
        for name in SCENES:
            picture, reports[name] = drawn(name, device, Path(folder))
            Pillow.fromarray(picture).save(HERE / f"{name}.png", optimize=True)
            print(name, *picture.shape[1::-1])
    REPORTS.write_text(json.dumps(reports, indent=1) + "\n")


if __name__ == "__main__":
    _keep_all()
