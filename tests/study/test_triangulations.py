"""Triangulations of real mountains: they cover every post, keep their error, and are hardly more than greedy ones."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.data.terrain.tin_tree import Grown
from limen.study.baselines.triangulators import PEERS
from limen.study.bench.terrain_source import parse_crop, posts_of, write_crop
from limen.study.triangulations import build_trees, drawn, patches_at, true_error_m
from support.trees import collect, cut_at

ERRORS_M = (100.0, 50.0, 20.0)


@pytest.fixture(scope="module")
def sierra(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Terrain:
    """769 x 513 posts of the Sierra Nevada, from file to file."""
    folder = tmp_path_factory.mktemp("sierra")
    whole = data_dir / "terrain/california_nevada_3arcsec_10801x4801.tif"
    crop = write_crop(whole, parse_crop("1900,3700,513,769"), folder / "sierra.tif")
    ingest_terrain(crop, folder / "sierra.terrain")
    return Terrain.open(folder / "sierra.terrain")


@pytest.fixture(scope="module")
def tree(sierra: Terrain) -> list[Grown]:
    """What was built of it, in memory."""
    (built,) = build_trees(posts_of(sierra), [float(error) for error in sierra.header.errors_m])
    return built


def test_real_mountains_keep_their_error_wherever_patches_of_any_fineness_meet(
    sierra: Terrain, tree: list[Grown]
) -> None:
    posts, block = posts_of(sierra), collect(tree)
    rng = np.random.default_rng(5)
    for error_m in ERRORS_M:
        triangles = drawn(patches_at(posts, [tree], error_m), sierra.size_posts)
        assert 0 < true_error_m(posts, triangles) <= error_m
    # Fine and coarse side by side: a random half of the coarse cut's nodes by their last patch.
    chosen = []
    for number in cut_at(block.nodes, block.patches, 100.0):
        node = block.patches.node[number]
        last = int(block.nodes.first_patch[node + 1]) - 1
        chosen.append(last if rng.random() < 0.5 and block.contents[last] is not None else number)
    mixed = drawn([block.contents[number] for number in chosen], sierra.size_posts)  # type: ignore[misc]
    assert true_error_m(posts, mixed) <= 100.0


def test_a_file_holds_what_was_built(sierra: Terrain, tree: list[Grown]) -> None:
    stored = cut_at(sierra.nodes, sierra.patches, 50.0)
    read = drawn((sierra.read_patch(int(number)) for number in stored), sierra.size_posts)
    built = drawn(patches_at(posts_of(sierra), [tree], 50.0), sierra.size_posts)
    assert {tuple(sorted(corners)) for corners in read.tolist()} == {tuple(sorted(c)) for c in built.tolist()}


@pytest.mark.parametrize("error_m", ERRORS_M)
def test_greedy_insertion_over_the_whole_needs_hardly_fewer_triangles(sierra: Terrain, error_m: float) -> None:
    if importlib.util.find_spec("pydelatin") is None:
        pytest.skip("pydelatin IS NOT INSTALLED, so limen was not compared with it: pip install 'limen[bench]'")
    posts = posts_of(sierra)
    triangles = drawn(patches_at(posts, build_trees(posts, [error_m]), error_m), sierra.size_posts)
    assert len(triangles) <= 1.35 * PEERS["delatin"](posts)(error_m).triangles
