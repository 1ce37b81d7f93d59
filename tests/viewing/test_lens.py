"""Lenses: no fold whatever they are and however they overlap, the focus in view, and the two directions inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import InputError
from limen.layers.image.lens_kernels import seen_through, smallest_reach
from limen.viewing.lens import DROP_OFFS, Lens, drop_off, jacobian_of, rows_of, shown_at, source_of

SIDE = 1000.0

lenses = st.builds(
    Lens,
    st.tuples(st.floats(-200, SIDE + 200), st.floats(-200, SIDE + 200)),
    st.one_of(st.floats(1, 900), st.tuples(st.floats(1, 900), st.floats(1, 900))),
    st.floats(1, 64),
    st.floats(0, 0.95),
    st.sampled_from(DROP_OFFS),
    st.sampled_from(["radial", "rectangular"]),
)
chains = st.lists(lenses, min_size=1, max_size=4)


def places(seed: int, count: int = 300) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-300, SIDE + 300, (count, 2))


def table(columns: int = 17, rows: int = 9) -> np.ndarray:
    x, y = np.linspace(-1, 1, columns), np.linspace(-1, 1, rows)[:, None]
    return np.exp(-3 * (x * x + y * y))


@settings(deadline=None, max_examples=80)
@given(chains, st.integers(0, 10**6))
def test_no_lenses_fold_over(chain: list[Lens], seed: int) -> None:
    at = np.concatenate(
        [places(seed), *(np.array(lens.centre_px) + places(seed) / 3000 * lens.radii_px for lens in chain)]
    )
    assert (np.linalg.det(jacobian_of(chain, at)) > 0).all()


@settings(deadline=None, max_examples=50)
@given(chains, st.integers(0, 10**6))
def test_what_is_seen_at_a_place_is_shown_there(chain: list[Lens], seed: int) -> None:
    at = places(seed, 100)
    np.testing.assert_allclose(shown_at(chain, source_of(chain, at)), at, atol=1e-6)


@given(lenses)
def test_the_focus_stays_in_view_and_is_magnified(lens: Lens) -> None:
    centre = np.array(lens.centre_px)
    np.testing.assert_array_equal(source_of([lens], centre), centre)
    np.testing.assert_allclose(jacobian_of([lens], centre), np.eye(2) / lens.magnification, atol=1e-12)
    even = centre + 0.7 * lens.focus * np.array([0.6, -0.8]) * lens.radii_px
    np.testing.assert_allclose(jacobian_of([lens], even), np.eye(2) / lens.magnification, atol=1e-9)


@settings(deadline=None, max_examples=15)
@given(st.lists(lenses.filter(lambda lens: lens.drop_off != "linear"), min_size=1, max_size=3), st.integers(0, 10**6))
def test_the_jacobian_is_that_of_small_steps(chain: list[Lens], seed: int) -> None:
    chain = [*chain, Lens((seed % 900, 400.0), (300.0, 200.0), 3.0, heights=table())]
    at = places(seed)
    found = jacobian_of(chain, at)
    for axis in range(2):
        step = 1e-4 * np.eye(2)[axis]
        small = (source_of(chain, at + step) - source_of(chain, at - step)) / 2e-4
        assert (np.abs(small - found[..., axis]).max(axis=-1) < 1e-3 * (1 + np.abs(small).max(axis=-1))).mean() > 0.97


@given(lenses, st.floats(0, 7))
def test_nothing_changes_from_the_rim_on(lens: Lens, turn: float) -> None:
    way = np.array([math.cos(turn), math.sin(turn)])
    if lens.shape == "rectangular":
        way /= np.abs(way).max()
    for far in (1.0, 1.5):
        at = np.array(lens.centre_px) + far * (1 + 1e-12) * way * lens.radii_px
        np.testing.assert_allclose(source_of([lens], at), at, rtol=1e-12)
    inside = np.array(lens.centre_px) + (1 - 1e-6) * way * lens.radii_px
    np.testing.assert_allclose(source_of([lens], inside), inside, atol=1e-4 * max(lens.radii_px))


@pytest.mark.parametrize("how", ["cosine", "quadratic"])
def test_smooth_drop_offs_have_no_edge(how: str) -> None:
    u = np.linspace(0, 1.2, 12_001)
    slope = np.diff(drop_off(u, 0.4, how)[0]) / np.diff(u)
    assert np.abs(np.diff(slope)).max() < 0.01
    linear = np.diff(drop_off(u, 0.4, "linear")[0]) / np.diff(u)
    assert np.abs(np.diff(linear)).max() > 1, "the test can tell"


@settings(deadline=None, max_examples=15)
@given(chains, st.integers(0, 10**6))
def test_the_kernel_sees_what_the_definition_says(chain: list[Lens], seed: int) -> None:
    chain = [*chain, Lens((seed % 900, 400.0), (300.0, 200.0), 3.0, heights=table())]
    rows, tables = rows_of(chain)
    at = places(seed, 100)
    np.testing.assert_allclose([seen_through(rows, tables, *each) for each in at], source_of(chain, at), atol=1e-7)


def test_a_lens_reaches_as_far_as_its_radii() -> None:
    rows, _ = rows_of([Lens((100.0, 50.0), (30.0, 10.0)), Lens((100.0, 50.0), 4.0)])
    assert smallest_reach(rows, 0.0, 0.0, 71.0, 41.0) == pytest.approx(10.0)
    assert smallest_reach(rows, 98.0, 45.0, 99.0, 47.0) == pytest.approx(4.0)
    assert math.isinf(smallest_reach(rows, 0.0, 0.0, 70.0, 100.0))
    assert math.isinf(smallest_reach(rows, 0.0, 60.0, 900.0, 70.0))


def test_magnified_by_a_table() -> None:
    lens = Lens((500.0, 500.0), 200.0, 4.0, heights=np.ones((3, 3)))
    np.testing.assert_allclose(source_of([lens], [[540.0, 500.0], [701.0, 500.0]]), [[510.0, 500.0], [701.0, 500.0]])
    at = places(3)
    bell = [Lens((500.0, 500.0), 400.0, 8.0, heights=table())]
    assert (np.linalg.det(jacobian_of(bell, at)) > 0).all()
    np.testing.assert_allclose(shown_at(bell, source_of(bell, at)), at, atol=1e-6)


@pytest.mark.parametrize(
    ("given_", "says"),
    [
        ({"radius_px": 0.0}, "radius_px must be above 0"),
        ({"radius_px": (5.0, -1.0)}, "radius_px must be above 0"),
        ({"centre_px": (math.nan, 0.0)}, "centre_px must be two finite numbers"),
        ({"magnification": 0.5}, "magnification must be 1 or more"),
        ({"magnification": math.inf}, "magnification must be 1 or more"),
        ({"focus": 1.0}, "focus must lie from 0 to below 1"),
        ({"drop_off": "steep"}, "there are linear, cosine, quadratic, gaussian"),
        ({"shape": "round"}, "radial or rectangular"),
        ({"heights": np.array([[0.0, math.nan], [0.0, 0.0]])}, "heights must be finite"),
        ({"heights": np.full((4, 4), 2.0)}, "lie from 0 to 1"),
        ({"heights": np.zeros(4)}, "2 x 2 or more"),
        ({"heights": np.array([[1.0, 1, 1], [1, 0, 1], [1, 1, 1]] * 3), "magnification": 20.0}, "fold over"),
    ],
)
def test_lenses_that_cannot_be(given_: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Lens(**({"centre_px": (0.0, 0.0), "radius_px": 10.0} | given_))  # type: ignore[arg-type]


def test_a_lens_beside_the_image_or_of_no_power_changes_nothing() -> None:
    at = places(1)
    np.testing.assert_array_equal(source_of([Lens((-5000.0, 0.0), 100.0)], at), at)
    np.testing.assert_array_equal(source_of([Lens((500.0, 500.0), 400.0, 1.0)], at), at)
