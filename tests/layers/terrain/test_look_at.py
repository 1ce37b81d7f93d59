"""How a terrain stands behind a display."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data.terrain.model import Nodes
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.terrain.look_at import BEHIND, Flight, in_flight, room_from_posts
from limen.viewing.placement import LookAt
from limen.viewing.standing import standing_viewer


class _Land(NamedTuple):
    size_posts: tuple[int, int] = (1001, 501)
    spacing_m: tuple[float, float] = (70.0, 90.0)
    low_high: tuple[float, float] = (-80.0, 4400.0)

    @property
    def nodes(self) -> Nodes:
        columns, rows = self.size_posts
        rects = np.array([[0, 0, 500, rows - 1], [500, 0, columns - 1, rows - 1]], np.int32)
        heights = np.array([self.low_high] * 2, np.float32)
        return Nodes(rects, heights, np.full((2, 4), -1, np.int32), np.arange(3, dtype=np.int32), 2)


def _placed(matrix: Floats, column: float, row: float, height: float) -> Floats:
    return matrix[:3, :3] @ [column, row, height] + matrix[:3, 3]


WALL = Display.named("rostock")
EYE = standing_viewer(WALL).position_m


@settings(max_examples=60, deadline=None)
@given(
    heading=st.floats(-720, 720), pitch=st.floats(10, 90), x=st.floats(0, 1), y=st.floats(0, 1),
    range_m=st.floats(100, 1e5),
)  # fmt: skip
def test_the_target_is_straight_ahead_at_its_range(heading, pitch, x, y, range_m):
    land = _Land(low_high=(100.0, 100.0))
    matrix = room_from_posts(land, WALL, EYE, LookAt((x, y), heading, pitch, range_m))
    middle = np.mean([panel.centre_m for panel in WALL.panels], axis=0)
    ahead = (middle - EYE) / np.linalg.norm(middle - EYE)
    scale = np.linalg.norm(matrix[:3, 2])  # room metres for a metre of height
    way = _placed(matrix, x * 1000, y * 500, 100.0) - EYE
    np.testing.assert_allclose(np.cross(way / np.linalg.norm(way), ahead)[0], 0, atol=1e-9)
    assert np.linalg.norm(way) == pytest.approx(BEHIND * np.linalg.norm(middle - EYE))
    # It is right side up, not mirrored, and as long as it is wide: a rotation but for the scale.
    axes = np.stack([matrix[:3, 0] / 70, matrix[:3, 2], matrix[:3, 1] / 90], axis=1) / scale
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) > 0
    lowered = float(axes[:, 1] @ way / np.linalg.norm(way))
    assert lowered == pytest.approx(-np.sin(np.radians(pitch)), abs=1e-9)


def test_north_is_up_on_a_map_and_east_to_the_right():
    matrix = room_from_posts(_Land(), WALL, EYE, LookAt(pitch_deg=90))
    north, south = _placed(matrix, 500, 0, 0), _placed(matrix, 500, 500, 0)
    west, east = _placed(matrix, 0, 250, 0), _placed(matrix, 1000, 250, 0)
    assert north[1] > south[1]
    assert east[0] > west[0]
    looking_east = room_from_posts(_Land(), WALL, EYE, LookAt(pitch_deg=90, heading_deg=90))
    assert _placed(looking_east, 1000, 250, 0)[1] > _placed(looking_east, 0, 250, 0)[1]


@settings(max_examples=60, deadline=None)
@given(heading=st.floats(0, 360), pitch=st.floats(0, 90), x=st.floats(0, 1), y=st.floats(0, 1))
def test_without_a_range_all_of_it_is_seen_and_fills_the_wall_one_way(heading, pitch, x, y):
    land = _Land()
    matrix = room_from_posts(land, WALL, EYE, LookAt((x, y), heading, pitch))
    corners = [
        _placed(matrix, column, row, height) for column in (0, 1000) for row in (0, 500) for height in land.low_high
    ]
    ways = np.array(corners) - EYE
    assert (ways[:, 2] < 0).all()
    low, high = WALL.bounds_m
    seen = np.array(EYE) + ways * ((low[2] - EYE[2]) / ways[:, 2])[:, None]  # where they lie on the wall
    share = np.stack([(seen[:, 0] - low[0]) / (high - low)[0], (seen[:, 1] - low[1]) / (high - low)[1]], axis=1)
    assert share.min() > -1e-6
    assert share.max() < 1 + 1e-6
    assert min(share.min(), 1 - share.max()) < 1e-6


def test_in_a_room_the_ground_is_level_and_inside_an_object_it_stands():
    cave = Display.named("cave")
    matrix = room_from_posts(_Land(), cave, standing_viewer(cave).position_m, LookAt(range_m=5000, pitch_deg=50))
    np.testing.assert_allclose(matrix[:3, 2] / np.linalg.norm(matrix[:3, 2]), [0, 1, 0], atol=1e-12)
    cube = Display.named("cube")
    inside = room_from_posts(_Land(), cube, (0, 0, 9))
    low, high = cube.bounds_m
    for column, row, height in [(0, 0, -80), (1000, 500, 4400)]:
        place = _placed(inside, column, row, height)
        assert ((place > low - 1e-9) & (place < high + 1e-9)).all()


@pytest.mark.parametrize("flight", ["orbit", "traverse"])
def test_a_flight_stays_over_the_terrain_and_above_its_ground(flight: Flight):
    land = _Land()
    for time_s in np.linspace(0, 240, 50):
        look = in_flight(LookAt(pitch_deg=15), flight, land, float(time_s))
        matrix = room_from_posts(land, WALL, EYE, look)
        eye = np.linalg.solve(matrix[:3, :3], np.array(EYE) - matrix[:3, 3])
        if 0 <= eye[0] <= 1000 and 0 <= eye[1] <= 500:
            assert eye[2] > 4400
    assert in_flight(LookAt(), "none", land, 9.0) == LookAt()


def test_a_traverse_heads_where_it_goes():
    land = _Land()
    for time_s in np.linspace(0.5, 119.5, 40):
        here, there = (np.array(in_flight(LookAt(), "traverse", land, t).target) for t in (time_s, time_s + 1e-3))
        step = (there - here) * [70_000, 45_000]
        heading = np.radians(in_flight(LookAt(), "traverse", land, float(time_s)).heading_deg)
        assert np.array([np.sin(heading), -np.cos(heading)]) @ step > 0.99 * np.linalg.norm(step)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"target": (1.2, 0.5)}, "target"),
        ({"pitch_deg": 91}, "pitch_deg"),
        ({"range_m": 0.0}, "range_m"),
        ({"exaggeration": -1.0}, "exaggeration"),
        ({"heading_deg": float("nan")}, "heading_deg"),
    ],
)
def test_what_cannot_be_looked_at(fields, says):
    with pytest.raises(InputError, match=says):
        LookAt(**fields)
