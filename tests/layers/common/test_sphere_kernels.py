"""What the loops of points and meshes allow a sphere: no more than any place of it, and of a place exactly as much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.layers.common.budget import eye_rows
from limen.layers.common.sphere_kernels import least_allowed_m
from limen.viewing.tolerance import Tolerance


def tolerances(seed: int, *, moves: bool, gazes: bool) -> Tolerance:
    """Of two eyes."""
    rng = np.random.default_rng(seed)
    gaze = rng.normal(size=(2, 3))
    motion = rng.normal(size=(2, 3, 4)) * 10 ** rng.uniform(-2, 1)
    return Tolerance(
        rng.normal(size=(2, 3)), rng.uniform(1e-4, 1e-2, 2),
        gaze / np.linalg.norm(gaze, axis=1, keepdims=True) if gazes else np.zeros((2, 3)),
        rng.uniform(0, 20, 2), motion if moves else np.zeros((2, 3, 4)),
    )  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**6), radius=st.floats(1e-3, 2), moves=st.booleans(), gazes=st.booleans())
def test_a_sphere_is_allowed_no_more_than_its_places(seed: int, radius: float, moves: bool, gazes: bool) -> None:
    tolerance = tolerances(seed, moves=moves, gazes=gazes)
    rng = np.random.default_rng(seed + 1)
    eye_m, middle = rng.normal(size=3), rng.normal(size=3) * 3
    inside = rng.normal(size=(500, 3))
    inside *= radius * rng.uniform(0, 1, (500, 1)) ** (1 / 3) / np.linalg.norm(inside, axis=1, keepdims=True)
    rows = eye_rows(tolerance, eye_m)
    assert rows.shape == (2, 20 if moves else 8)
    allowed = least_allowed_m(*(middle - eye_m), radius, rows)
    assert allowed <= tolerance.allowed_m(middle + inside).min() * (1 + 1e-9)
    place = least_allowed_m(*(middle - eye_m), 0.0, rows)
    assert place == pytest.approx(float(tolerance.allowed_m(middle)), rel=1e-6)
    assert place >= float(replace(tolerance, motion=np.zeros((2, 3, 4))).allowed_m(middle)) * (1 - 1e-9)
