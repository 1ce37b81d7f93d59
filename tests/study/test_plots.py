from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from limen.display.display import Display
from limen.errors import InputError, MissingFileError
from limen.study.plots import traffic_picture, traffic_plot, walk_picture
from limen.study.traffic import Report, count_traffic, one_to_one_view, policies_of
from limen.track.walk import heat_map, make_walk, plan_of


@pytest.fixture(scope="module")
def report() -> Report:
    display = Display.preset("rostock")
    view = one_to_one_view(display)
    policies = policies_of(["full", "acuity"], ["1", "0.64", "0.5"])
    counts = (
        count_traffic(view, make_walk(display, 4.0, seed, name=f"{seed}"), policies, rate_hz=5) for seed in (1, 2)
    )
    return Report("one-to-one", view, 5.0, 9000.0, False, tuple(counts))


def test_a_picture_of_either_kind(report: Report, tmp_path: Path):
    traffic_plot(report, tmp_path / "t.png")
    with Image.open(tmp_path / "t.png") as picture:
        assert picture.width > 1000
        assert np.asarray(picture.convert("L")).std() > 10
    svg = traffic_picture(report)
    assert ET.fromstring(svg.decode()).tag.endswith("svg")
    assert svg == traffic_picture(report)


def test_names_that_cannot_be(report: Report, tmp_path: Path):
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        traffic_plot(report, tmp_path / "t.jpg")
    with pytest.raises(MissingFileError, match="make it first"):
        traffic_plot(report, tmp_path / "nowhere" / "t.png")


@pytest.mark.parametrize("name", ["reality-deck", "cube", "desktop"])
def test_a_walk_over_the_floor_plan(name: str):
    display = Display.preset(name)
    heat = heat_map(display, 1)
    plans = [plan_of(heat, 1, number, 20.0) for number in range(2)]
    spots = [plan.corners_m[plan.stops] for plan in plans]
    picture = walk_picture(heat, spots, make_walk(display, 10.0, 1, viewers=2), "png")
    assert picture.startswith(b"\x89PNG")
