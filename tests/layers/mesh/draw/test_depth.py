"""Both depths: surfaces that nearly touch keep their order, and the shared one goes on across the borders of panels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data import NO_TEXTURE, Mesh
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.layers.mesh.layer import MeshLayer
from limen.viewing.projection import NEAR_M, QuiltView
from support.displays import DISPLAYS
from support.drawing import drawn_mesh, looking_at_panels, mesh_view

pytestmark = pytest.mark.gpu

EYE = np.array([0.9, 1.5, 1.8])
DISPLAY = DISPLAYS["icosahedron"][0]
WRONG = {"panel": 0.0022, "shared": 0.000_1}
"""Share of pixels whose order may be wrong at 3 m and a gap of 1e-5 m; a z of 24 bits divided by w gets 18 % wrong."""


def mesh_of(positions: NDArray[Any], colours: NDArray[Any]) -> Mesh:
    """Triangles that share no corner, one colour each: positions (T, 3, 3), colours (T, 3)."""
    count = 3 * len(positions)
    rgba = np.full((count, 4), 255, np.uint8)
    rgba[:, :3] = np.repeat(colours, 3, axis=0)
    return Mesh(
        path=None, positions=positions.reshape(-1, 3).astype(np.float32),
        triangles=np.arange(count, dtype=np.uint32).reshape(-1, 3),
        normals=np.tile(np.float32([0, 0, 1]), (count, 1)), colours=rgba, uv=np.zeros((count, 2), np.float32),
        layers=np.full(count, NO_TEXTURE, np.uint32), textures=np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip


def drawn(device: Any, display: Display, mesh: Mesh, depth: Any, eye: Any = EYE) -> Any:
    """(picture, depth, view)"""
    (quilt,) = pack_outlines(display)
    view = mesh_view(display, quilt, mesh, eye)
    picture, depths = drawn_mesh(device, MeshLayer(mesh, depth=depth), view)
    return picture.astype(int), depths, view


@pytest.mark.parametrize("depth", WRONG)
def test_order_at_a_gap_of_a_hundredth_of_a_millimetre(device: Any, depth: Any) -> None:
    """Red triangles, tilted any way, 3 m from the eye, and green ones 1e-5 m nearer along each ray to a corner."""
    rng = np.random.default_rng(3)
    toward = np.array([0, 1.2, 0]) - EYE
    forward = toward / np.linalg.norm(toward)
    right = np.cross(forward, [0, 1, 0]) / np.linalg.norm(np.cross(forward, [0, 1, 0]))
    up = np.cross(right, forward)
    ways = []
    for x, y in np.stack(np.meshgrid(np.linspace(-0.45, 0.45, 24), np.linspace(-0.45, 0.45, 24)), -1).reshape(-1, 2):
        corners = np.array([[0, 0], [1, 0], [0, 1]]) * 0.035 + [x, y]
        way = (forward + corners[:, :1] * right + corners[:, 1:] * up) * 3
        ways.append(way * (1 + rng.uniform(-0.02, 0.02, (3, 1))))
    back = np.float32(np.array(ways) + EYE).astype(float)
    rays = back - EYE
    front = np.float32(back - rays / np.linalg.norm(rays, axis=2, keepdims=True) * 1e-5).astype(float)
    gap_m = np.linalg.norm(rays, axis=2) - np.linalg.norm(front - EYE, axis=2)
    assert gap_m.min() > 0.9e-5, "what the right order is must not depend on rounding"
    assert gap_m.max() < 1.1e-5
    red, green = np.tile([[255, 0, 0]], (len(back), 1)), np.tile([[0, 255, 0]], (len(back), 1))
    # The back before the front and the other way round, so that keeping the first or the last is no way out.
    half = len(back) // 2
    places = np.concatenate([back[:half], front, back[half:]])
    picture, *_ = drawn(device, DISPLAY, mesh_of(places, np.concatenate([red[:half], green, red[half:]])), depth)
    shows_front, shows_back = picture[..., 1] > picture[..., 0], picture[..., 0] > picture[..., 1]
    assert shows_front.sum() > 10_000
    # Rims, where rounding lets only one of the two cover a pixel, are no matter of depth: those have no front beside.
    assert shows_back.sum() <= WRONG[depth] * shows_front.sum(), f"{shows_back.sum() / shows_front.sum():.3%}"


def test_shared_depth_goes_on_across_every_border(device: Any) -> None:
    """In its guard band a panel shows what its neighbour shows: both are compared with the truth on the same rays."""
    wall = np.array([[[-9, -9, -1.5], [9, -9, -1.0], [0, 14, -2.0]]], float)
    colour = np.array([[200, 200, 200]])
    steps = {}
    for depth in ("panel", "shared"):
        _, depths, view = drawn(device, DISPLAY, mesh_of(wall, colour), depth)
        forward = looking_at_panels(view.panels, EYE)
        errors = [_rim_errors(depths, view, panel, wall[0], forward) for panel in np.flatnonzero(view.facing)]
        assert min(len(each) for each in errors) > 30, "every panel has a border"
        steps[depth] = 2 * np.abs(np.concatenate(errors)).max()
    assert steps["shared"] < 1e-4
    assert steps["panel"] > 0.1, "the depth along each panel's normal is another one"


def _rim_errors(depths: Any, view: QuiltView, panel: int, wall: Any, forward: Any) -> NDArray[Any]:
    """Relative errors of the depth at pixels within 2 px of a panel's outline, on either side of it."""
    (views,) = view.eyes
    height, width = depths.shape
    y, x = np.indices(depths.shape) + 0.5
    clip = np.stack([2 * x / width - 1, 1 - 2 * y / height, np.ones_like(x)], axis=-1).reshape(-1, 3)
    ways = clip @ np.linalg.inv(views.clip[panel]).T
    edges = views.edges[panel, : views.corner_count[panel]]
    inside = (ways @ edges.T).min(axis=1) / (ways @ views.clip[panel, 2]) - view.panels.guard_px
    at = np.flatnonzero((np.abs(inside) < 1.4) & (depths.reshape(-1) > 0))
    normal = np.cross(wall[1] - wall[0], wall[2] - wall[0])
    reach = normal @ (wall[0] - EYE) / (ways[at] @ normal)
    truth = NEAR_M / (reach * (ways[at] @ forward))
    return depths.reshape(-1)[at] / truth - 1
