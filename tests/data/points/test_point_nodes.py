"""The numbers of an implicit tree of points, and what its bytes mean."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from limen.data.points.nodes import (
    ALL_AROUND,
    CHUNK_NODES,
    CHUNK_POINTS,
    FAN,
    LEVEL_BEGIN,
    NODE,
    TOP,
    counts_of_levels,
    half_angle_deg,
    radius_of_code,
    unpacked_normal,
)


def test_levels_of_a_chunk_lie_one_after_the_other():
    sizes = [CHUNK_POINTS // FAN**level for level in range(5)]
    assert [begin + size for begin, size in zip(LEVEL_BEGIN[1:], sizes[1:], strict=True)] == list(LEVEL_BEGIN[:-1])
    assert LEVEL_BEGIN[0] + sizes[0] == CHUNK_NODES


def test_nodes_are_words_for_shaders():
    assert NODE.itemsize == 16
    assert TOP.itemsize == 24


@given(st.integers(1, 10**9))
def test_every_level_holds_an_eighth_up_to_one_root(points):
    counts = counts_of_levels(points)
    assert counts[-1] == 1
    assert all(upper * FAN >= lower > (upper - 1) * FAN for lower, upper in pairwise(counts))


@given(st.integers(-127, 127), st.integers(-127, 127))
def test_normals_are_unit_vectors_and_their_codes_come_back(u, v):
    normal = unpacked_normal(np.array([u, v], np.int8))
    assert abs(np.linalg.norm(normal) - 1) < 1e-12
    flat = normal / np.abs(normal).sum()
    if flat[2] >= 0:
        assert np.allclose(flat[:2] * 127, [u, v], atol=1e-9)


def test_radii_grow_by_octaves_and_nothing_is_nothing():
    radii = radius_of_code(np.array([0, 243, 255], np.uint8), 8.0)
    assert np.allclose(radii, [0.0, 4.0, 8.0])


def test_an_unknown_cone_is_all_around():
    assert half_angle_deg(np.array([0, 254, ALL_AROUND], np.uint8)).tolist() == [0.0, 180.0, 180.0]
