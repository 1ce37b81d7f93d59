"""The parts of a frame under pytest-benchmark: ``pytest benchmarks --benchmark-enable``; as tests they run once.

``limen bench image`` prints the table of the documentation from the same parts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvips

from limen.data import ingest, sample_image
from limen.data.image.contrast import ContrastSurvey
from limen.data.image.file import open_image
from limen.data.pages import PAGE
from limen.layers.image.select import select
from limen.stream.pages import drawable_pages
from limen.study.bench.image import blank_stream, measure_walk, one_to_one_room, walk_viewers
from limen.system import worker_count
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of

ROOM = one_to_one_room()


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("world") / "world.tif"
    sample_image(path, 0.01)
    return path


@pytest.mark.parametrize("policy", [Policy("full"), Policy("acuity", 1.0), Policy()], ids=lambda policy: policy.label)
def test_select_pages_of_416_panels(benchmark, policy):
    viewers = list(walk_viewers(2.0))
    tolerances = [tolerance_of(people, policy) for people in viewers]
    steps = iter(range(10**9))
    cut = benchmark(lambda: select(ROOM, tolerances[next(steps) % len(tolerances)]))
    assert len(cut) > 0


def test_stream_update_with_all_pages_resident(benchmark):
    cut = select(ROOM, tolerance_of(next(walk_viewers(1.0)), Policy()))
    with blank_stream(ROOM.pyramid) as stream:
        while stream.update(cut.pages, budget=len(cut)).statistics.missing:
            stream.wait()

        def update() -> None:
            stream.update(cut.pages)
            stream.touch(drawable_pages(ROOM.pyramid, stream.resident, cut.pair_page)[1])

        benchmark(update)


def test_a_steady_walk_fits_the_upload_budget():
    """Not a timing: 99 % of frames need at most 64 uploads, at the default acuity, over all 416 panels."""
    walk = measure_walk(ROOM, Policy(), 5, 0.4)
    assert float(np.mean(np.array(walk.needed) <= 64)) >= 0.99


@pytest.mark.parametrize("reader", ["limen", "pyvips"])
def test_read_a_random_page(benchmark, world, reader):
    with open_image(world) as image:
        base = image.pyramid.levels[0]
        pages = [(c, r) for r in range(base.rows - 1) for c in range(base.columns - 1)]
        order = iter(np.random.default_rng(0).permutation(len(pages)).tolist() * 10_000)
        region = pyvips.Region.new(pyvips.Image.new_from_file(str(world), access="random"))

        def read() -> object:
            column, row = pages[next(order)]
            if reader == "limen":
                return image.read_page((0, column, row), 0)
            return region.fetch(column * PAGE, row * PAGE, PAGE, PAGE)

        assert benchmark(read) is not None


def test_measure_the_contrast_of_all_pages(benchmark, world):
    def survey() -> bool:
        with open_image(world) as image, ContrastSurvey(image, workers=worker_count(), keep=False) as pages:
            pages.run()
            return pages.complete

    assert benchmark(survey)


def test_ingest(benchmark, world, tmp_path):
    assert benchmark(lambda: ingest(world, tmp_path / "made.tif")).facts["pages"] > 100
