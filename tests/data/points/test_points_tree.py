"""Laws of the hierarchy of points, of what is stored: spheres, colours, normals, radii."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data import build_points
from limen.data.points.nodes import ALL_AROUND, CHUNK_NODES, FAN, LEVEL_BEGIN, unpacked_normal
from limen.data.points.tree import Lattice, arranged, hilbert_order, pack_normals, pack_points
from limen.data.store.resample import LINEAR_OF_SRGB
from limen.errors import InputError
from support.point_reference import levels_of, plain_radii

CLOUDS = {
    "one point": lambda r: np.array([[1.0, 2.0, 3.0]]),
    "two points": lambda r: np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    "all in one place": lambda r: np.full((6000, 3), 7.0),
    "every point twice": lambda r: np.repeat(r.random((2500, 3)), 2, axis=0),
    "a line": lambda r: r.random((700, 1)) * [3.0, 1.0, 0.0],
    "a cube and one far away": lambda r: np.concatenate([r.random((4200, 3)), [[1e6, -1e6, 1e6]]]),
    "a plane far from the origin": lambda r: r.random((9000, 3)) * [100.0, 80.0, 0.0] + [6.3e5, 8.5e6, 400.0],
    "tiny": lambda r: r.random((5000, 3)) * 1e-7,
}


@pytest.fixture(params=CLOUDS)
def cloud(request):
    chance = np.random.default_rng(5)
    places = CLOUDS[request.param](chance)
    normals = chance.normal(size=places.shape) + np.array([0.0, 0.0, 2.0])
    rgb = chance.integers(0, 256, places.shape)
    return places, build_points(places, rgb, normals, chance.integers(0, 256, len(places)))


def check_spheres(points):
    levels = levels_of(points)
    for lower, upper in itertools.pairwise(levels):
        parent = np.arange(len(lower.radius)) // FAN
        apart = np.linalg.norm(lower.place - upper.place[parent], axis=1)
        assert np.all(apart + lower.radius <= upper.radius[parent] * (1 + 1e-12))


def test_every_sphere_holds_those_of_its_children(cloud):
    check_spheres(cloud[1])


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 5000), st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6), st.floats(-1e7, 1e7), st.integers(0, 3))
def test_spheres_of_random_clouds_hold_their_children(count, seed, size, where, power):
    """The higher the power, the denser the cloud near one corner."""
    places = np.random.default_rng(seed).random((count, 3)) ** (2**power) * size + where
    check_spheres(build_points(places, estimate_normals=False))


def test_points_are_where_they_were_and_none_is_missing(cloud):
    places, points = cloud
    stored = levels_of(points)[0].place + points.origin
    step = float(points.frames.step.max()) + 1e-9 * np.abs(places).max() + np.ptp(places) * 2.0**-29
    ours, theirs = (each[np.lexsort(each.round(12).T)] for each in (stored, places))
    # Sorting may swap points that differ by less than a step, so distances are to the nearest.
    from scipy.spatial import cKDTree

    assert len(stored) == len(places)
    assert cKDTree(ours).query(theirs)[0].max() <= 2 * step
    assert cKDTree(theirs).query(ours)[0].max() <= 2 * step
    assert np.allclose(points.bounds, [places.min(axis=0), places.max(axis=0)])


def test_colours_are_means_of_light(cloud):
    levels = levels_of(cloud[1])
    count = len(levels[0].rgb)
    light, grey = LINEAR_OF_SRGB[levels[0].rgb].astype(float), levels[0].intensity.astype(float)
    for number, level in enumerate(levels[1:], 1):
        begins = np.arange(0, count, FAN**number)
        held = np.diff(np.append(begins, count))[:, None]
        mean = np.add.reduceat(light, begins, axis=0) / held
        low, high = (LINEAR_OF_SRGB[np.clip(level.rgb.astype(int) + d, 0, 255)] for d in (-1, 1))
        # A code is a rounded mean; those of tops are means of rounded ones, and bottom and top are as dark as they go.
        assert np.all((mean >= low - 2e-3) & (mean <= high + 2e-3))
        assert np.all(np.abs(np.add.reduceat(grey, begins) / held[:, 0] - level.intensity) <= 2.0)


def test_cones_hold_all_normals_below(cloud):
    levels = levels_of(cloud[1])
    for number, level in enumerate(levels[1:], 1):
        below = np.arange(len(levels[0].cone)) // FAN**number
        along = (levels[0].normal * level.normal[below]).sum(axis=1)
        apart_deg = np.degrees(np.arccos(np.clip(along, -1, 1)))
        assert np.all(apart_deg <= level.half_angle_deg[below] + 1e-5)  # what an arc cosine makes of 1 - 1e-16
        assert np.all(level.cone != ALL_AROUND)


def test_cones_of_two_sides_hold_either_side():
    chance = np.random.default_rng(6)
    flat = np.concatenate([chance.random((5000, 2)) * 9, np.zeros((5000, 1))], axis=1)
    flat[:, 2] = 0.4 * np.sin(flat[:, 0]) * np.cos(flat[:, 1])
    points = build_points(flat)
    levels = levels_of(points)
    assert points.two_sided
    assert (levels[0].cone != ALL_AROUND).mean() > 0.9
    for lower, upper in itertools.pairwise(levels):
        parent = np.arange(len(lower.cone)) // FAN
        narrow = (lower.cone != ALL_AROUND) & (upper.cone[parent] < 254)
        along = np.abs((lower.normal * upper.normal[parent]).sum(axis=1))
        apart_deg = np.degrees(np.arccos(np.clip(along, -1, 1))) + lower.half_angle_deg
        assert narrow.any()
        assert np.all((apart_deg <= upper.half_angle_deg[parent] + 1e-6)[narrow])


def test_a_node_is_lit_if_half_of_its_points_have_normals():
    places = np.stack([np.arange(64.0), np.zeros(64), np.zeros(64)], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (64, 1))
    normals[:32] = 0.0  # four whole groups, along a line
    levels = levels_of(build_points(places, normals=normals))
    assert sorted(levels[1].cone.tolist()) == [0] * 4 + [ALL_AROUND] * 4
    assert levels[2].cone.tolist() == [0]
    normals[:40] = 0.0
    assert levels_of(build_points(places, normals=normals))[2].cone.tolist() == [ALL_AROUND]


def test_estimated_normals_are_those_of_a_ball():
    chance = np.random.default_rng(7)
    out = chance.normal(size=(40_000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    level = levels_of(build_points(out * 3.0 + 50.0))[0]
    known = level.cone != ALL_AROUND
    radial = level.place / np.linalg.norm(level.place, axis=1, keepdims=True)
    off_deg = np.degrees(np.arccos(np.clip(np.abs((level.normal * radial).sum(axis=1)), 0, 1)))
    assert known.mean() > 0.9
    assert np.median(off_deg[known]) < 1.5
    assert np.percentile(off_deg[known], 95) < 6.0


def test_leaves_and_wires_have_no_normals():
    chance = np.random.default_rng(8)
    leaves = levels_of(build_points(chance.random((8000, 3))))[0]
    wire = levels_of(build_points(np.linspace([0, 0, 0], [5, 1, 2], 3000)))[0]
    assert (leaves.cone == ALL_AROUND).mean() > 0.7
    assert np.all(wire.cone == ALL_AROUND)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 63, 64, 65, 1500])
def test_points_are_split_at_medians_and_radii_are_what_plain_numpy_says(count):
    places = np.random.default_rng(count).random((count, 3)) * [4.0, 1.0, 2.0]
    lattice = Lattice.around(places.min(axis=0), places.max(axis=0))
    packed = pack_points(lattice, places, np.zeros((count, 3), np.uint8))
    tidy, radii = arranged(packed, hilbert_order(packed["place"]), lattice.step, estimate=False)
    stored = tidy["place"].astype(float)
    assert np.array_equal(np.sort(tidy["place"], axis=0), np.sort(packed["place"], axis=0))
    assert np.allclose(radii, plain_radii(stored) * lattice.step, rtol=1e-5)
    for begin in range(0, count, 64):
        check_halves(stored[begin : begin + 64], 64)


def check_halves(group, size):
    if len(group) <= 8 or size == 8:
        return
    half = size // 2
    first, second = group[:half], group[half:]
    if len(second):
        widest = np.ptp(group, axis=0).argmax()
        assert first[:, widest].max() <= second[:, widest].min()
    check_halves(first, half)
    check_halves(second, half)


def test_splats_close_a_grid_and_one_far_away_stays_small():
    grid = np.stack(np.meshgrid(np.arange(64.0), np.arange(64.0), [0.0]), axis=-1).reshape(-1, 3)
    level = levels_of(build_points(np.concatenate([grid, [[30.0, 30.0, 500.0]]])))[0]
    assert np.all(level.radius[np.abs(level.place[:, 2] - level.place[:, 2].min()) < 1] >= np.sqrt(0.5))
    assert level.radius.max() < 10.0


def test_nothing_is_stored_beyond_the_last_point():
    points = build_points(np.random.default_rng(9).random((5000, 3)))
    last = points.read_chunk(1)
    assert (points.chunks, points.points_of_chunk(0), points.points_of_chunk(1)) == (2, 4096, 904)
    assert last.shape == (CHUNK_NODES,)
    assert not last[LEVEL_BEGIN[0] + 904 :].view(np.uint8).any()
    assert [len(top) for top in points.tops] == points.levels[4:] == [2, 1]


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_packed_normals_come_back(vector):
    normal = np.array(vector) / np.linalg.norm(vector)
    back = unpacked_normal(pack_normals(np.array([vector])))[0]
    assert np.degrees(np.arccos(np.clip(back @ normal, -1, 1))) < 1.0


@pytest.mark.parametrize(
    ("given_", "says"),
    [
        ({"positions": np.zeros((0, 3))}, "at least one point"),
        ({"positions": np.zeros((4, 2))}, r"shape \(N, 3\)"),
        ({"positions": [[0, 0, np.nan], [0, 0, 0]]}, "1 of 2 positions are not finite"),
        ({"positions": np.zeros((2, 3)), "rgb": np.zeros((2, 3))}, "whole numbers"),
        ({"positions": np.zeros((2, 3)), "rgb": np.full((2, 3), 256)}, "0 ... 255"),
        ({"positions": np.zeros((2, 3)), "intensity": [1, 2, 3]}, r"shape \(2,\)"),
        ({"positions": np.zeros((2, 3)), "normals": np.zeros((1, 3))}, "normals must be of shape"),
    ],
)
def test_what_cannot_be_built_is_said(given_, says):
    with pytest.raises(InputError, match=says):
        build_points(**given_)


def test_a_chunk_that_does_not_exist_is_said():
    with pytest.raises(InputError, match="chunks 0 to 0"):
        build_points([[0, 0, 0]]).read_chunk(1)
