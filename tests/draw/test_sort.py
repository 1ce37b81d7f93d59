"""Pairs of triangles and panels from the GPU, against brute force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from brute import pairs as brute_pairs
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import pack
from limen.geometry import as_vec3
from limen.viewing.projection import GUARD_PX, QuiltPanels

pytestmark = pytest.mark.gpu

ROUNDING_PX = 0.02


def polygons(vertices: NDArray[Any], faces: Any, pixels_per_m: float, name: str = "face") -> Display:
    """A display of flat polygons, counter-clockwise from the front."""
    panels = []
    for number, face in enumerate(faces):
        corners = vertices[list(face)].astype(float)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        normal /= np.linalg.norm(normal)
        right = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
        down = np.cross(right, normal)
        place = np.stack([(corners - corners[0]) @ right, (corners - corners[0]) @ down], axis=1)
        origin = corners[0] + place.min(axis=0) @ np.array([right, down])
        outline = (place - place.min(axis=0)) * pixels_per_m
        width, height = (int(side) for side in np.maximum(np.ceil(outline.max(axis=0)), 1))
        panels.append(
            Panel(
                f"{name}/{number},0", (width, height), as_vec3(origin, "origin"), as_vec3(right, "right"),
                as_vec3(down, "down"), (1 / pixels_per_m,) * 2, outline_px=tuple((x, y) for x, y in outline),
            )
        )  # fmt: skip
    return Display(name, tuple(panels))


def icosahedron(pixels_per_m: float = 300.0) -> Display:
    g = (1 + 5**0.5) / 2
    vertices = np.array(
        [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g), (g, 0, -1),
         (g, 0, 1), (-g, 0, -1), (-g, 0, 1)], dtype=float,
    )  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
             (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
             (8, 6, 7), (9, 8, 1)]  # fmt: skip
    return polygons(vertices * 0.4 + [0, 1.2, 0], faces, pixels_per_m)


def stairs() -> Display:
    """Panels behind each other as seen from the front: overlapping in view, none of them flat to it."""
    rng = np.random.default_rng(5)
    faces, vertices = [], []
    for number in range(24):
        middle = rng.uniform([-0.6, 0.8, -1.0], [0.6, 1.6, 0.2])
        normal = np.array([0, 0, 1.0]) + rng.normal(0, 0.4, 3)
        right = np.cross([0, 1.0, 0], normal)
        right /= np.linalg.norm(right)
        up = np.cross(normal, right) / np.linalg.norm(normal)
        angles = np.linspace(0, 2 * np.pi, 3 + number % 6, endpoint=False) + rng.uniform(0, 6)
        vertices.append(middle + 0.25 * (np.cos(angles)[:, None] * right + np.sin(angles)[:, None] * up))
        faces.append(range(len(faces) and faces[-1].stop, (len(faces) and faces[-1].stop) + len(angles)))
    return polygons(np.concatenate(vertices), faces, 250.0)


DISPLAYS = {
    "cube": (Display.preset("cube").scaled(0.25), (0.7, 1.8, 0.9)),
    "cave": (Display.preset("cave").scaled(0.1), (0.3, 1.6, 0.2)),
    "icosahedron": (icosahedron(), (0.9, 1.5, 1.8)),
    "stairs": (stairs(), (0.1, 1.3, 2.0)),
}


def soup(rng: np.random.Generator, count: int, size_m: float, middle: Any, spread_m: float) -> tuple[Any, Any]:
    """Triangles of about one size, anywhere."""
    centres = rng.normal(middle, spread_m, (count, 1, 3))
    positions = (centres + rng.normal(0, size_m, (count, 3, 3))).reshape(-1, 3).astype(np.float32)
    return positions, np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)


def gpu_pairs(device: Any, display: Display, eyes: Any, positions: Any, triangles: Any, **options: Any) -> Any:
    """(list of pairs for each eye, views, ways) of one quilt with all panels."""
    from limen.layers.mesh.draw.sort import TriangleSorter

    (quilt,) = pack(display, max_size_px=8192)
    eyes = np.asarray(eyes, dtype=float).reshape(-1, 3)
    windows = QuiltPanels(display, quilt, len(eyes))
    views = [windows.seen_from(eye, copy) for copy, eye in enumerate(eyes)]
    eye_from_mesh = np.repeat(np.eye(3, 4)[None], len(eyes), axis=0)
    eye_from_mesh[:, :, 3] = -eyes
    sorter = TriangleSorter(device, positions, triangles, **options)
    sorter.sort(views, eye_from_mesh)
    found = sorter.read_pairs()
    sorter.destroy()
    count = len(quilt.panels)
    by_eye = [[(int(t), int(v) - eye * count) for t, v in found if int(v) // count == eye] for eye in range(len(eyes))]
    return by_eye, views, [positions.astype(float) - eye for eye in eyes]


def check(device: Any, display: Display, eye: Any, positions: Any, triangles: Any) -> int:
    (found,), (views,), (ways,) = gpu_pairs(device, display, eye, positions, triangles)
    assert len(found) == len(set(found)), "a pair must be drawn once"
    needed = brute_pairs(views, ways, triangles, GUARD_PX)
    allowed = brute_pairs(views, ways, triangles, -ROUNDING_PX)
    assert needed <= set(found), f"lost {sorted(needed - set(found))[:5]}"
    assert set(found) <= allowed, f"drawn in vain {sorted(set(found) - allowed)[:5]}"
    return len(needed)


@pytest.mark.parametrize("size_m", [0.003, 0.05, 0.5, 5.0])
@pytest.mark.parametrize("name", DISPLAYS)
def test_pairs_are_those_of_brute_force(device: Any, name: str, size_m: float) -> None:
    display, eye = DISPLAYS[name]
    middle = np.mean([panel.centre_m for panel in display.panels], axis=0)
    positions, triangles = soup(np.random.default_rng(1), 400, size_m, middle, 0.5)
    assert check(device, display, eye, positions, triangles) > 40


@pytest.mark.parametrize("name", DISPLAYS)
def test_triangles_around_the_eye_and_through_it(device: Any, name: str) -> None:
    """Beside, behind and through the eye: what homogeneous coordinates are for."""
    display, eye = DISPLAYS[name]
    positions, triangles = soup(np.random.default_rng(2), 400, 1.0, eye, 0.4)
    assert check(device, display, eye, positions, triangles) > 40


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    corners=st.lists(st.floats(-3, 3, width=16), min_size=9, max_size=9),
    eye=st.tuples(st.floats(-2, 2), st.floats(0.2, 3), st.floats(-2, 3)),
    name=st.sampled_from(sorted(DISPLAYS)),
)
def test_any_triangle_from_anywhere(device: Any, corners: list[float], eye: Any, name: str) -> None:
    positions = np.array(corners, np.float32).reshape(3, 3) + np.float32([0, 1.2, 0])
    way = positions.astype(float) - eye
    volume = abs(np.linalg.det(way)) / max(np.prod(np.linalg.norm(way, axis=1)), 1e-12)
    if volume < 1e-4:  # seen edge-on, where single precision cannot tell
        return
    check(device, DISPLAYS[name][0], eye, positions, np.array([[0, 1, 2]], np.uint32))


def test_where_there_is_no_room_it_is_made(device: Any) -> None:
    display, eye = DISPLAYS["stairs"]
    positions, triangles = soup(np.random.default_rng(3), 300, 0.3, (0, 1.2, -0.5), 0.4)
    (roomy,), *_ = gpu_pairs(device, display, eye, positions, triangles)
    (tight,), *_ = gpu_pairs(device, display, eye, positions, triangles, first_pairs=1)
    assert len(roomy) > 300
    assert sorted(tight) == sorted(roomy)


def test_two_eyes_at_once_see_what_each_sees_alone(device: Any) -> None:
    display, eye = DISPLAYS["stairs"]
    positions, triangles = soup(np.random.default_rng(4), 300, 0.1, (0, 1.2, -0.5), 0.4)
    eyes = np.array(eye) + np.array([[-0.2, 0, 0], [0.2, 0, 0]])
    both, *_ = gpu_pairs(device, display, eyes, positions, triangles)
    for seen, one in zip(both, eyes, strict=True):
        (alone,), *_ = gpu_pairs(device, display, one, positions, triangles)
        assert sorted(seen) == sorted(alone)
    assert sorted(both[0]) != sorted(both[1])


def test_an_eye_that_no_panel_faces_sees_nothing(device: Any) -> None:
    positions, triangles = soup(np.random.default_rng(6), 50, 0.5, (0, 1.2, 0), 0.4)
    (found,), *_ = gpu_pairs(device, Display.preset("cube"), (0.0, 1.2, 0.0), positions, triangles)
    assert found == []


def test_a_mesh_of_no_end_is_refused(device: Any) -> None:
    from limen.errors import DeviceLimitError
    from limen.layers.mesh.draw.sort import TriangleSorter

    many = np.zeros((12_000_000, 3), np.uint32)
    with pytest.raises(DeviceLimitError, match="simplify"):
        TriangleSorter(device, np.zeros((3, 3), np.float32), many)
