"""Splats: every way to find the nearest gives one picture, and it is the one that the definition gives."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest

from limen.data.points.build import build_points
from limen.data.points.file import Points
from limen.data.points.nodes import LEVEL_BEGIN
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.layers.common.panel_uniforms import PANEL_VIEW
from limen.layers.points.draw import uniforms as records
from limen.layers.points.draw.drawer import CHUNK_BYTES, METHODS, PointsDrawer, Shape
from limen.layers.points.layer import PointsLayer
from limen.viewing.projection import QuiltView
from support.clouds import ball
from support.drawing import Easel, eyes_view
from support.splats import drawer_of, leaves_of, part_of

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]


@cache
def a_ball() -> Points:
    return ball(3000)


STANDS = np.array([[0.3, 0, 0, 0], [0, 0.3, 0, 0], [0, 0, 0.3, -1.0], [0, 0, 0, 1.0]])


def corner_panels() -> Display:
    """Two panels at an angle, with a frame between them."""
    pitch = (0.4 / 200, 0.3 / 150)
    left = Panel("left", (200, 150), (-0.4, 0.15, 0.0), (1, 0, 0), (0, -1, 0), pitch)
    right = Panel("right", (200, 150), (0.01, 0.15, 0.0), (0.94, 0, 0.34), (0, -1, 0), pitch)
    return Display("corner", (left, right))


@pytest.mark.parametrize("shape", ["round", "square"])
def test_all_ways_to_find_the_nearest_give_the_same_picture(device: Any, shape: Shape) -> None:
    display = corner_panels()
    (quilt,) = pack_outlines(display)
    view = eyes_view(display, quilt, (0.0, 0.0, 0.6))
    part = part_of(view, STANDS, leaves_of(a_ball(), 2))
    pictures: dict[Any, Any] = {}
    with Easel(device, background=(0.1, 0.0, 0.1)) as easel:
        for method in METHODS if device.has_wide_atomics else METHODS[1:]:
            drawer = drawer_of(device, a_ball(), shape=shape, method=method)
            pictures[method] = easel.picture(drawer, view, part)
            drawer.most_placed = 700  # as if an adapter could hold no more: batches
            pictures[method, "in batches"] = easel.picture(drawer, view, part)
            drawer.destroy()
    first, *others = pictures.values()
    assert (first[..., 1] > 60).sum() > 2000
    for other in others:
        assert np.array_equal(first, other)


def test_the_nearest_disc_that_a_pixel_sees_is_drawn(device: Any) -> None:
    """Against the definition: a disc facing the eye, in plain NumPy, for every pixel and every point."""
    size = (96, 72)
    display = Display.window(size)
    view = eyes_view(display, Quilt(size, (0,), ((0, 0),)), np.zeros(3))
    rng = np.random.default_rng(4)
    places = rng.uniform(-1, 1, (60, 3)) * [0.12, 0.09, 0.1]
    rgb = rng.integers(0, 256, (60, 3)).astype(np.uint8)
    cloud = build_points(places, rgb, estimate_normals=False)
    stands = np.eye(4)
    stands[2, 3] = -0.8
    picture = drawn(device, cloud, view, stands)
    expected, sure = plain_picture(cloud, view.eyes[0], size, stands)
    assert sure.mean() > 0.9  # pixels that no disc's edge goes through
    differs = np.abs(picture[..., :3].astype(int) - expected).max(axis=-1) > 1
    assert not (differs & sure).any()


def drawn(device: Any, cloud: Any, view: QuiltView, stands: Any) -> Any:
    """All points of a cloud, as they are coloured."""
    drawer = drawer_of(device, cloud)
    with Easel(device) as easel:
        picture = easel.picture(drawer, view, part_of(view, stands, leaves_of(cloud), lit=False))
    drawer.destroy()
    return picture


def plain_picture(cloud: Any, views: Any, size: tuple[int, int], stands: Any) -> tuple[Any, Any]:
    from limen.data.points.nodes import radius_of_code

    nodes = cloud.read_chunk(0)[LEVEL_BEGIN[0] : LEVEL_BEGIN[0] + cloud.size]
    frame = cloud.frames
    ways = frame.origin[0] + frame.step[0] * nodes["place"].astype(float) + stands[:3, 3]
    radii = radius_of_code(nodes["radius"], frame.radius[0])
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    ndc = np.stack([x / size[0] * 2 - 1, 1 - y / size[1] * 2, np.ones_like(x)], axis=-1)
    rays = ndc @ np.linalg.inv(views.clip[0]).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    picture, nearest = np.zeros((*x.shape, 3), int), np.full(x.shape, np.inf)
    sure = np.ones(x.shape, bool)
    for way, radius, rgb in zip(ways, radii, nodes["rgb"], strict=True):
        away = np.linalg.norm(way)
        off = np.arccos(np.clip(rays @ way / away, -1, 1))
        deep = float(views.clip[0, 2] @ way)
        inside = off <= np.arctan(radius / away)
        sure &= np.abs(off - np.arctan(radius / away)) > 1e-4
        middle = np.floor([(c @ way / deep * s + 1) / 2 * n for c, s, n in
                           ((views.clip[0, 0], 1, size[0]), (views.clip[0, 1], -1, size[1]))]).astype(int)  # fmt: skip
        if 0 <= middle[0] < size[0] and 0 <= middle[1] < size[1]:
            inside[middle[1], middle[0]] = True
        seen = inside & (deep < nearest)
        picture[seen], nearest[seen] = rgb, deep
    return picture, sure


def test_a_point_of_no_size_has_a_pixel(device: Any) -> None:
    cloud = build_points(np.zeros((5, 3)), np.full((5, 3), 255, np.uint8))
    size = (31, 31)
    view = eyes_view(Display.window(size), Quilt(size, (0,), ((0, 0),)), np.zeros(3))
    stands = np.eye(4)
    stands[2, 3] = -1.0
    picture = drawn(device, cloud, view, stands)
    assert (picture[..., 0] == 255).sum() == 1
    assert picture[15, 15, 0] == 255


def test_structs_are_what_the_shaders_say() -> None:
    texts = [shader_text("limen.layers.points.draw", name) for name in ("points.wgsl", "points_wide.wgsl")]
    for name, dtype in (("Cloud", records.CLOUD), ("Rays", records.RAYS), ("Placed", records.PLACED)):
        fields = wgsl_struct(name, dtype).splitlines()
        for text in texts:
            begin = text.index(fields[0])
            body = [line for line in text[begin : text.index("}", begin) + 1].splitlines() if "//" not in line]
            assert body == fields
    assert wgsl_struct("PanelView", PANEL_VIEW) in re.sub(r"^\s*//.*\n", "", texts[0], flags=re.MULTILINE)
    assert wgsl_struct("ChunkRow", records.CHUNK_ROW) in texts[0]


def test_a_shape_that_is_not_there_is_refused(device: Any) -> None:
    with pytest.raises(InputError, match="round, square"):
        PointsDrawer(device, PointsLayer(a_ball(), shape="oval"), CHUNK_BYTES)  # type: ignore[arg-type]
