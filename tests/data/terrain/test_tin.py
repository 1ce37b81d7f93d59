"""Triangulations against brute force: the error at every post, whatever is added to the borders."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.data.terrain.model import Patch
from limen.data.terrain.tin import Tin
from limen.errors import InputError
from support import terrains
from support.trees import refine

LADDER = [64.0, 24.0, 8.0, 3.0, 1.0]
ROUNDING_M = 1e-6


def plane(rows: int, columns: int) -> NDArray[np.float32]:
    row, column = np.mgrid[0:rows, 0:columns]
    return (2.0 * column - 3.0 * row).astype(np.float32)


def step(rows: int, columns: int) -> NDArray[np.float32]:
    row, column = np.mgrid[0:rows, 0:columns]
    return np.where(column + 2 * row < columns, np.float32(0), np.float32(100))


def ridge(rows: int, columns: int) -> NDArray[np.float32]:
    row, column = np.mgrid[0:rows, 0:columns]
    return (100 - 3 * abs(column - 0.6 * row - 20)).astype(np.float32)


def noise(rows: int, columns: int) -> NDArray[np.float32]:
    return np.random.default_rng(rows * columns).normal(0, 20, (rows, columns)).astype(np.float32)


SURFACES = {"plane": plane, "step": step, "ridge": ridge, "noise": noise, "hills": terrains.hills}


def as_patch(tin: Tin, heights_m: NDArray[np.float32]) -> Patch:
    heights = heights_m[tin.posts[:, 1], tin.posts[:, 0]]
    return Patch(tin.posts, heights, tin.core, tin.rims, tin.rim_side, tin.sides)  # type: ignore[arg-type]


def border_posts(rows: int, columns: int) -> list[tuple[int, int]]:
    return [(x, y) for y in range(rows) for x in range(columns) if x in (0, columns - 1) or y in (0, rows - 1)]


def check_patch(patch: Patch, error_m: float, heights_m: NDArray[np.float32], added: set[tuple[int, int]]) -> None:
    """Nothing twice, nothing missing, and no post off by more than the error, with ``added`` posts on the borders."""
    rows, columns = heights_m.shape
    border = terrains.side_posts([patch]) | added
    triangles = terrains.fanned(patch, border)
    areas = [terrains.twice_area(triangle) for triangle in triangles]
    assert min(areas) > 0
    assert sum(areas) == 2 * (rows - 1) * (columns - 1)
    around = set(terrains.open_edges(triangles))
    assert {post for edge in around for post in edge} == border
    assert len(around) == len(border)
    errors_m = terrains.vertical_errors_m(heights_m, triangles)
    assert errors_m.min() >= 0.0
    assert errors_m.max() <= error_m + ROUNDING_M
    assert terrains.errors_between_posts_m(heights_m, triangles).max() <= error_m + ROUNDING_M


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("shape", [(2, 2), (2, 40), (40, 2), (3, 3), (3, 50), (29, 37)])
def test_error_is_kept_whatever_is_added_to_the_borders(surface: str, shape: tuple[int, int]) -> None:
    heights_m = SURFACES[surface](*shape)
    rng = np.random.default_rng(1)
    posts = border_posts(*shape)
    tins = refine(heights_m, None, LADDER)
    assert len(tins) == len(LADDER)
    for tin, bound_m in zip(tins, LADDER, strict=True):
        assert tin.error_m <= bound_m
        some = {posts[k] for k in rng.choice(len(posts), len(posts) // 3)}
        for added in (set(), some, set(posts)):
            check_patch(as_patch(tin, heights_m), tin.error_m, heights_m, added)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_error_is_kept_on_random_heights(data: st.DataObject) -> None:
    shape = data.draw(st.integers(2, 24)), data.draw(st.integers(2, 24))
    heights = data.draw(st.lists(st.integers(-50, 50), min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
    heights_m = np.array(heights, np.float32).reshape(shape)
    bound_m = data.draw(st.floats(0.0, 60.0))
    added = set(data.draw(st.lists(st.sampled_from(border_posts(*shape)), max_size=40)))
    tin = refine(heights_m, None, [bound_m])[0]
    assert tin.error_m <= bound_m
    check_patch(as_patch(tin, heights_m), tin.error_m, heights_m, added)


def test_rims_lie_on_their_sides() -> None:
    heights_m = terrains.hills(40, 60)
    for tin in refine(heights_m, None, LADDER):
        inner = {0: (1, 0), 1: (0, 59), 2: (1, 39), 3: (0, 0)}
        for (apex, a, b), side in zip(tin.rims, tin.rim_side, strict=True):
            axis, at = inner[int(side)]
            assert tin.posts[a, axis] == tin.posts[b, axis] == at
            assert tin.posts[apex, axis] != at
            assert abs(tin.posts[a] - tin.posts[b]).sum() > 1
        for number, side in enumerate(tin.sides):
            axis, at = inner[number]
            assert (tin.posts[side, axis] == at).all()
            assert (np.diff(tin.posts[side, 1 - axis]) > 0).all()
        rims = {(int(a), int(b)) for _, a, b in tin.rims}
        for a, b in (pair for side in tin.sides for pair in pairwise(map(int, side))):
            assert ((a, b) in rims or (b, a) in rims) == bool(abs(tin.posts[a] - tin.posts[b]).sum() > 1)


def hull_thickness_m(profile: NDArray[np.float64]) -> float:
    """Upper minus lower convex hull, by all chords."""
    n, thickest = len(profile), 0.0
    for k in range(1, n - 1):
        i, j = np.meshgrid(np.arange(k), np.arange(k + 1, n), indexing="ij")
        chords = profile[i] + (profile[j] - profile[i]) * (k - i) / (j - i)
        thickest = max(thickest, max(chords.max(), profile[k]) - min(chords.min(), profile[k]))
    return thickest


def simplified(profile: NDArray[np.float64], first: int, last: int, error_m: float) -> set[int]:
    """Posts that a border has on its own: the plain form of `split_side`."""
    own = profile[first : last + 1]
    if hull_thickness_m(own) <= error_m:
        return {first, last}
    middle = first + 1 + int(abs(own - np.linspace(own[0], own[-1], len(own)))[1:-1].argmax())
    return simplified(profile, first, middle, error_m) | simplified(profile, middle, last, error_m)


def test_neighbours_simplify_their_border_alike() -> None:
    """Both have the posts that the border alone asks for; a few more where triangles beside it need them."""
    heights_m = terrains.hills(65, 129)
    left, right = (refine(heights_m[:, half].copy(), None, LADDER) for half in (np.s_[:65], np.s_[64:]))
    few = 0
    for one, other, error_m in zip(left, right, LADDER, strict=True):
        alone = simplified(heights_m[:, 64].astype(np.float64), 0, 64, error_m)
        sides = [set(tin.posts[tin.sides[side], 1].tolist()) for tin, side in ((one, 1), (other, 3))]
        assert all(side >= alone for side in sides)
        few += sum(len(side - alone) for side in sides)
        if error_m == LADDER[0]:
            assert sides[0] == sides[1] == alone
    assert few < 40


def test_steps_are_nested_and_stop_at_the_largest_number_of_triangles() -> None:
    heights_m = terrains.hills(129, 97)
    tins = refine(heights_m, None, LADDER)
    for coarse, fine in pairwise(tins):
        assert (fine.posts[: len(coarse.posts)] == coarse.posts).all()
    counts = [len(tin.core) + len(tin.rims) for tin in tins]
    assert len(refine(heights_m, None, LADDER, counts[3])) == 4
    assert len(refine(heights_m, None, LADDER, counts[3] - 1)) == 3
    assert len(refine(heights_m, None, LADDER, 1)) == 1


def test_a_plane_needs_few_triangles_and_is_the_same_at_every_step() -> None:
    tins = refine(plane(129, 97), None, LADDER)
    assert all(tin is tins[0] for tin in tins)
    assert len(tins[0].core) + len(tins[0].rims) <= 6
    assert tins[0].error_m < 1e-9


def test_error_zero_is_exact() -> None:
    heights_m = noise(17, 23)
    tin = refine(heights_m, None, [0.0])[0]
    assert terrains.vertical_errors_m(heights_m, terrains.fanned(as_patch(tin, heights_m), set())).max() == 0.0


def test_posts_without_data_do_not_count() -> None:
    heights_m = terrains.hills(65, 65)
    void = np.zeros(heights_m.shape, bool)
    void[20:40, 10:50] = True
    spiky = heights_m.copy()
    spiky[void] = noise(65, 65)[void] * 10
    without = refine(spiky, None, [4.0])[0]
    tin = refine(spiky, void, [4.0])[0]
    assert len(tin.posts) < len(without.posts)
    assert not void[tin.posts[:, 1], tin.posts[:, 0]].any()
    errors_m = terrains.vertical_errors_m(spiky, terrains.fanned(as_patch(tin, spiky), set()))
    assert errors_m[~void].max() <= tin.error_m + ROUNDING_M
    assert errors_m[void].max() > 10 * tin.error_m


def test_the_worst_post_is_inserted_first() -> None:
    """One hat on a plain: the first vertex besides the corners' is its top, by the definition of greedy insertion."""
    heights_m = np.zeros((33, 33), np.float32)
    heights_m[8:12, 20:24] = 10.0
    heights_m[9, 21] = 50.0
    tin = refine(heights_m, None, [45.0])[0]
    assert [21, 9] in tin.posts.tolist()
    assert len(tin.posts) <= 4 + 2 + 1


def test_runs_are_the_same_every_time() -> None:
    heights_m = noise(60, 50)
    one, other = (refine(heights_m, None, LADDER)[-1] for _ in range(2))
    assert all((a == b).all() for a, b in zip(one[:4], other[:4], strict=True))


@pytest.mark.parametrize(
    ("heights_m", "void", "errors_m", "says"),
    [
        (np.zeros((1, 5), np.float32), None, [1.0], "rows and columns"),
        (np.zeros((5, 5)), None, [1.0], "float32"),
        (np.full((5, 5), np.nan, np.float32), None, [1.0], "finite"),
        (np.zeros((5, 5), np.float32), np.zeros((5, 4), bool), [1.0], "void"),
        (np.zeros((5, 5), np.float32), None, [], "errors_m"),
        (np.zeros((5, 5), np.float32), None, [1.0, 2.0], "descending"),
        (np.zeros((5, 5), np.float32), None, [1.0, -2.0], "below 0"),
    ],
)
def test_bad_input(heights_m: NDArray[np.float32], void: NDArray[np.bool_], errors_m: list[float], says: str) -> None:
    with pytest.raises(InputError, match=says):
        refine(heights_m, void, errors_m)
