"""Pairs of triangles and panels from the GPU, against brute force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from limen.display.display import Display
from limen.display.quilt import pack
from limen.viewing.projection import GUARD_PX, QuiltPanels
from support.brute import ROUNDING_PX, soup
from support.brute import pairs as brute_pairs
from support.displays import DISPLAYS

pytestmark = pytest.mark.gpu


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
