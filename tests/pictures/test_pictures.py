"""Pictures of displays and quilts: polygons, bezels and backs where they are."""

from __future__ import annotations

import math

import numpy as np
import pytest

import limen
from limen.display.packing import lit_fill, pack_outlines
from limen.display.panel import Panel
from limen.pictures.quilts import draw_quilts
from limen.pictures.room import Camera, draw_room

SIZE = (400, 300)
RED, GREEN = (250, 20, 20), (20, 250, 20)


def _triangle(**fields: object) -> limen.Display:
    """One metre wide and high, its tip up, around (0, 1, -2), facing +z."""
    good = {
        "name": "t", "size_px": (100, 100), "origin_m": (-0.5, 1.5, -2), "right": (1, 0, 0), "down": (0, -1, 0),
        "pitch_m": (0.01, 0.01), "outline_px": ((0, 100), (50, 0), (100, 100)),
    }  # fmt: skip
    return limen.Display("x", (Panel(**{**good, **fields}),))  # type: ignore[arg-type]


def _expected(display: limen.Display, camera: Camera, grown_m: float = 0.0) -> np.ndarray:
    """By rays through pixel centres: how deep each hits inside the outline, metres; -inf where it misses the plane."""
    (panel,) = display.panels
    eye, target = np.array(camera.eye_m), np.array(camera.target_m)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    scale = math.tan(math.radians(camera.fov_deg) / 2) / (SIZE[1] / 2)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    rays = forward + (x - SIZE[0] / 2)[..., None] * scale * right + (y - SIZE[1] / 2)[..., None] * scale * down
    normal = np.array(panel.normal)
    hit = eye + rays * (((panel.outline_m[0] - eye) @ normal) / (rays @ normal))[..., None]
    corners = panel.outline_m
    inward = -np.cross(normal, np.roll(corners, -1, axis=0) - corners)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return np.asarray(((hit[..., None, :] - corners) * inward).sum(axis=-1).min(axis=-1))


@pytest.mark.parametrize("eye", [(0.0, 1.0, 1.0), (1.5, 1.8, 0.2), (-1.0, 0.3, 0.5)])
def test_a_lit_triangle_is_drawn_with_its_picture_its_bezel_and_nothing_else(eye: tuple[float, float, float]) -> None:
    display = _triangle(bezel_m=0.05)
    camera = Camera(eye, (0, 1, -2))
    picture = np.zeros((100, 100, 3), np.uint8)
    picture[:60], picture[60:] = RED, GREEN
    drawn = draw_room(display, pictures={"t": picture}, size_px=SIZE, camera=camera).astype(int)
    depth = _expected(display, camera)
    lit = np.abs(drawn - RED).max(axis=2) < 40
    lit |= np.abs(drawn - GREEN).max(axis=2) < 40
    assert lit[depth > 0.04].mean() > 0.97, "all but the edge between the colours and the name"
    assert not lit[depth < -0.02].any()
    dark = drawn.max(axis=2) < 40
    frame = (depth < -0.02) & (depth > -0.04)
    assert dark[frame].mean() > 0.95
    rows = (
        np.nonzero(np.abs(drawn - RED).max(axis=2) < 40)[0].mean(),
        np.nonzero(np.abs(drawn - GREEN).max(axis=2) < 40)[0].mean(),
    )
    assert rows[0] < rows[1], "upright"


def test_a_back_hides_what_is_behind_it_and_shows_no_picture() -> None:
    """A tetrahedron's sides face outward; from any side, no picture of a far side shows through."""
    corners = np.array([[0, 1.5, 0], [0.5, 0.8, 0.4], [-0.5, 0.8, 0.4], [0, 0.8, -0.6]])
    from limen.display.mesh import PolygonMesh, panels_of_mesh

    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    panels = panels_of_mesh(PolygonMesh(corners, faces), "t", 0.01)
    assert all(np.dot(panel.normal, panel.outline_m.mean(axis=0) - corners.mean(axis=0)) > 0 for panel in panels)
    display = limen.Display("x", tuple(panels))
    far = {panels[1].name: np.full((8, 8, 3), RED, np.uint8), panels[2].name: np.full((8, 8, 3), RED, np.uint8)}
    seen = draw_room(display, pictures=far, size_px=SIZE, camera=Camera((0, 1, 3), (0, 1, 0))).astype(int)
    assert not (np.abs(seen - RED).max(axis=2) < 60).any()
    near = draw_room(display, pictures=far, size_px=SIZE, camera=Camera((0.4, 2, -3), (0, 1, 0))).astype(int)
    assert (np.abs(near - RED).max(axis=2) < 40).sum() > 1000
    open_box = limen.Display("x", tuple(panel for panel in panels if panel.name not in far))
    inside = draw_room(open_box, size_px=SIZE, camera=Camera((0.4, 2, -3), (0, 1, 0))).astype(int)
    brown = (inside[..., 0] > inside[..., 2] + 2) & (inside[..., 0] < 100)
    assert brown.sum() > 300, "backs are seen where nothing is before them"


@pytest.mark.parametrize("name", ["sphere", "teapot", "desk"])
def test_every_display_fills_its_picture(name: str) -> None:
    """Wherever the camera was put, the display reaches across most of the picture, and not out of it."""
    display = limen.Display.preset(name)
    lit = {panel.name: np.full((1, 1, 3), RED, np.uint8) for panel in display.panels}
    drawn = draw_room(display, pictures=lit, size_px=SIZE).astype(int)
    rows, columns = np.nonzero(np.abs(drawn - RED).max(axis=2) < 100)
    across, down = np.ptp(columns) / SIZE[0], np.ptp(rows) / SIZE[1]
    assert max(across, down) > 0.7
    assert rows.min() > 2
    assert rows.max() < SIZE[1] - 2


def test_a_picture_of_a_quilt_shows_outlines() -> None:
    display = limen.Display.preset("icosahedron")
    quilts = pack_outlines(display, max_size_px=5000)
    drawn = draw_quilts(display, quilts, width_px=800).astype(int)
    assert drawn.shape[1] == 800
    scale = 800 / max(quilt.size_px[0] for quilt in quilts)
    expected = sum(lit_fill(display, quilt) * math.prod(quilt.size_px) for quilt in quilts) * scale**2
    free = (np.abs(drawn - (38, 41, 47)).max(axis=2) < 4) | (np.abs(drawn - (24, 26, 30)).max(axis=2) < 4)
    assert (~free).sum() == pytest.approx(expected, rel=0.03)
