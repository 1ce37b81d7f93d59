"""Distances between surfaces, against plain minimisation and known shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import nnls

from limen.study.surfaces import distances, samples_of, surface_error


def plain_distance(point: Any, corners: Any) -> float:
    """The least of |point - sum of shares x corners| over shares that are not negative and add up to one."""
    weight = 1e4  # of the sum being one
    left = np.vstack([corners.T, np.full(3, weight)])
    share = nnls(left, np.append(point, weight))[0]
    return float(np.linalg.norm(point - share / share.sum() @ corners))


@given(
    arrays(float, (4, 3), elements=st.integers(-6, 6).map(float)),
    arrays(float, (9, 3), elements=st.integers(-6, 6).map(float)),
    arrays(np.int64, (5, 3), elements=st.integers(0, 8)),
)
@settings(max_examples=60, deadline=None)
def test_the_distance_is_that_of_the_nearest_triangle(points: Any, places: Any, triangles: Any) -> None:
    nearest = [min(plain_distance(point, places[corners]) for corners in triangles) for point in points]
    np.testing.assert_allclose(distances(points, places, triangles), nearest, atol=1e-3)


def grid(side: int, height: float) -> tuple[Any, Any]:
    i, k = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    places = np.stack([i / (side - 1), k / (side - 1), np.full(i.shape, height)], axis=-1).reshape(-1, 3)
    a = (i * side + k)[:-1, :-1].ravel()
    return places, np.concatenate([np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)])


def test_two_parallel_squares_are_as_far_apart_as_they_are() -> None:
    error = surface_error(*grid(2, 0.0), *grid(20, 0.25), samples=2000)
    assert error.rms == pytest.approx(0.25, abs=1e-5)
    assert error.largest == pytest.approx(0.25, abs=1e-5)


def test_samples_lie_on_their_triangles_and_fill_them_by_area() -> None:
    places = np.array([[0.0, 0, 0], [3, 0, 0], [0, 1, 0], [-1, 0, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    points, chosen = samples_of(places, triangles, 4000)
    assert (chosen == 0).mean() == pytest.approx(0.75, abs=0.03)
    np.testing.assert_array_equal(points[:, 0] < 0, chosen == 1)
    assert (points[:, 1] >= 0).all()
    assert points[chosen == 0].mean(axis=0)[:2] == pytest.approx([1, 1 / 3], abs=0.05)
