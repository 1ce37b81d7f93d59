"""The benchmark of terrains: its rasteriser against brute force, its peers, and its rows, on few posts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import InputError
from limen.study.baselines import triangulators
from limen.study.baselines.packages import INSTALL, MADE_BY, missing_package
from limen.study.baselines.triangulators import PEERS, Made, grid_triangles
from limen.study.bench.table import Row
from limen.study.bench.terrain import aims, ladder_m, triangle_rows
from limen.study.triangulations import (
    Posts,
    Triangles,
    build_trees,
    drawn,
    patches_at,
    residuals_m,
    true_error_m,
)
from support import terrains
from support.trees import refine

ERRORS_M = (40.0, 15.0, 5.0)


def silent(_text: str) -> None:
    pass


def hills(rows: int = 65, columns: int = 65, roughness: float = 0.6) -> Posts:
    return Posts(terrains.hills(rows, columns, roughness=roughness, relief_m=60.0), None)


def corners_of(triangles: Triangles, columns: int) -> list[terrains.Triangle]:
    places = [(int(number) % columns, int(number) // columns) for number in triangles.reshape(-1)]
    return [(places[k], places[k + 1], places[k + 2]) for k in range(0, len(places), 3)]


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 24), st.integers(2, 30), st.floats(1.0, 80.0), st.booleans())
def test_residuals_are_those_of_brute_force(rows: int, columns: int, error_m: float, clockwise: bool) -> None:
    posts = hills(rows, columns)
    tin = refine(posts.heights_m, None, [error_m])[0]
    number = tin.posts[:, 1] * np.int32(columns) + tin.posts[:, 0]
    triangles = number[np.concatenate([tin.core, tin.rims])][:, :: -1 if clockwise else 1]
    plain = terrains.vertical_errors_m(posts.heights_m, corners_of(triangles, columns))
    assert np.abs(residuals_m(posts, triangles)) == pytest.approx(plain, abs=1e-4)
    assert true_error_m(posts, triangles) == pytest.approx(plain.max(), abs=1e-4)


def test_a_residual_is_the_surface_less_the_height() -> None:
    posts = Posts(np.array([[0, 9, 4], [0, 0, 0]], np.float32), None)
    triangles = np.array([[0, 3, 2], [3, 4, 2], [4, 5, 2]], np.int32)
    assert residuals_m(posts, triangles).tolist() == [[0, -7, 0], [0, 0, 0]]
    assert true_error_m(posts, triangles) == 7
    void = np.zeros((2, 3), bool)
    void[0, 1] = True
    assert true_error_m(posts._replace(void=void), triangles) == 0


def test_a_hole_is_no_small_error() -> None:
    posts = Posts(np.zeros((3, 3), np.float32), None)
    whole, _ = grid_triangles((3, 3), 1, 2)
    assert true_error_m(posts, whole) == 0
    with pytest.raises(InputError, match=r"1 of 9 posts are covered by none"):
        true_error_m(posts, whole[(whole != 0).all(axis=1)])


@pytest.mark.parametrize("error_m", [60.0, 12.0, 0.0])
def test_what_is_drawn_is_whole_and_keeps_its_error(error_m: float) -> None:
    posts = hills(150, 270)
    trees = build_trees(posts, ladder_m(200.0, ERRORS_M))
    patches = list(patches_at(posts, trees, error_m))
    triangles = drawn(patches, (270, 150))
    border = terrains.side_posts(patches)
    plain = [triangle for patch in patches for triangle in terrains.fanned(patch, border)]
    assert sorted(corners_of(triangles, 270)) == sorted(plain)
    assert sum(terrains.twice_area(triangle) for triangle in plain) == 2 * 149 * 269
    assert true_error_m(posts, triangles) <= error_m + 1e-4
    if not error_m:
        assert len(triangles) == 2 * 149 * 269


def test_blocks_cover_a_terrain_of_several_roots(monkeypatch: Any) -> None:
    monkeypatch.setattr("limen.study.triangulations.BLOCK", 64)
    posts = hills(130, 65)
    trees = build_trees(posts, [20.0, 5.0])
    assert [tree[0].rect for tree in trees] == [(0, 0, 64, 64), (0, 64, 64, 128), (0, 128, 64, 129)]
    for error_m in (20.0, 5.0):
        assert true_error_m(posts, drawn(patches_at(posts, trees, error_m), (65, 130))) <= error_m


@pytest.mark.parametrize(("size", "step", "chunk"), [((65, 65), 4, 16), ((30, 41), 8, 16), ((2, 7), 2, 16)])
def test_grids_hold_every_post_of_a_step(size: tuple[int, int], step: int, chunk: int) -> None:
    triangles, per_chunk = grid_triangles(size, step, chunk)
    rows, columns = (-(-(count - 1) // step) for count in size)
    assert len(triangles) == per_chunk.sum() == 2 * rows * columns
    assert per_chunk.shape == tuple(-(-(count - 1) // chunk) for count in size)
    areas = [terrains.twice_area(triangle) for triangle in corners_of(triangles, size[1])]
    assert min(areas) > 0
    assert sum(areas) == 2 * (size[0] - 1) * (size[1] - 1)


def test_a_grids_chunks_are_each_as_coarse_as_their_own_posts_allow(monkeypatch: Any) -> None:
    monkeypatch.setattr(triangulators, "_CHUNKS", (16,))
    heights_m = np.zeros((33, 33), np.float32)
    heights_m[5, 5] = 10.0  # one chunk of four must show every post, or stay off by 10 m
    make = PEERS["grid"](Posts(heights_m, None))
    assert make(1.0)[:2] == (3 * 2 + 2 * 16 * 16, 0.0)
    assert make(10.0)[:2] == (4 * 2, 10.0)
    heights_m[5, 5], heights_m[16, 5] = 0.0, 10.0  # on a border: two chunks
    assert PEERS["grid"](Posts(heights_m, None))(1.0).triangles == 2 * 2 + 2 * 2 * 16 * 16


@pytest.mark.parametrize("peer", list(PEERS))
def test_peers_keep_the_error_that_they_are_told(peer: str) -> None:
    missing = missing_package(peer)
    if missing:
        pytest.skip(f"{missing} IS NOT INSTALLED, so limen was not compared with {peer}: {INSTALL}")
    make = PEERS[peer](hills(roughness=2.0))
    made = [make(error_m) for error_m in ERRORS_M]
    for one, error_m in zip(made, ERRORS_M, strict=True):
        assert 0.2 * error_m < one.true_error_m <= error_m + 1e-4
    assert made[0].triangles < made[1].triangles < made[2].triangles < 2 * 64 * 64


def test_martini_says_what_it_cannot_do() -> None:
    with pytest.raises(InputError, match=r"2\^n \+ 1 rows and columns, and not 65 and 64"):
        PEERS["martini"](hills(65, 64))


@pytest.mark.parametrize("worse", [0.5, 1.0, 1.9, 2.4])
def test_a_parameter_that_is_no_bound_is_searched_for(worse: float) -> None:
    asked = []

    def mesh(parameter_m: float) -> Made:
        asked.append(parameter_m)
        return Made(int(1e6 / (parameter_m + 1)), worse * parameter_m, 0.0)

    made = triangulators._largest_parameter(mesh, 50.0)
    assert made.true_error_m <= 50.0
    assert made.true_error_m >= 0.99 * 50.0 * min(worse, 1.0)
    assert len(asked) <= 12


def test_all_ways_are_measured_and_what_is_missing_is_named(monkeypatch: Any) -> None:
    monkeypatch.setitem(MADE_BY, "delatin", "a_package_that_nobody_has")
    said: list[str] = []
    rows = triangle_rows(hills(65, 64), ERRORS_M, said.append)
    assert [row["method"] for row in rows] == ["limen"] * 3 + ["grid"] * 3
    assert any("delatin: skipped, a_package_that_nobody_has is not installed" in text for text in said)
    assert any(text.startswith("martini: skipped") for text in said)
    for row in rows:
        assert row["true_error_m"] <= row["max_error_m"] + 1e-4
        assert row["build_s"] > 0
    by_method = {(row["method"], row["max_error_m"]): row["triangles"] for row in rows}
    assert all(by_method["limen", error_m] < by_method["grid", error_m] for error_m in ERRORS_M)


def test_a_ladder_holds_what_is_asked_for_in_steps_of_the_square_root_of_2() -> None:
    ladder = ladder_m(3000.0, (200.0, 20.0))
    assert ladder == sorted(ladder, reverse=True)
    assert {200.0, 20.0} <= set(ladder)
    assert min(ladder) == 8.0
    assert 1500 / 2**0.5 <= max(ladder) <= 1500
    assert max(np.divide(ladder[:-1], ladder[1:])) <= 2**0.5 + 1e-9


def test_aims_are_ratios_of_the_rows() -> None:
    def row(method: str, error_m: float, triangles: int) -> Row:
        return {"method": method, "max_error_m": error_m, "triangles": triangles}

    rows = [row("limen", 20, 110), row("limen", 50, 60), row("delatin", 20, 100), row("martini", 50, 240)]
    delatin, martini = aims(rows)
    assert "1.10 at 20 m" in delatin
    assert "50 m" not in delatin
    assert "0.25 at 50 m" in martini
    assert aims(rows[:2]) == []
