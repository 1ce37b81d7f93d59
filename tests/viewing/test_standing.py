"""Where somebody stands whom nobody tracks."""

from __future__ import annotations

import numpy as np
import pytest

from limen.display.display import Display
from limen.viewing.standing import standing_viewer


@pytest.mark.parametrize(
    ("name", "facing", "height_m"),
    [("cube", 3, 1.41), ("rostock", 24, 1.7), ("desktop", 1, 1.2), ("cave", 4, 1.7), ("reality-deck", 416, 1.7),
     ("desk", 816, 1.55)],
)  # fmt: skip
def test_a_viewer_stands_where_panels_are_seen(name: str, facing: int, height_m: float) -> None:
    display = Display.preset(name)
    viewer = standing_viewer(display)
    eye = np.array(viewer.position_m)
    assert sum(np.dot(eye - panel.centre_m, panel.normal) > 0.05 for panel in display.panels) == facing
    assert viewer.position_m[1] == pytest.approx(height_m, abs=0.06)


def test_a_viewer_looks_at_the_display() -> None:
    for name in ("cube", "rostock", "desk", "teapot"):
        display = Display.preset(name)
        viewer = standing_viewer(display)
        way = display.bounds_m.mean(axis=0) - viewer.position_m
        assert np.dot(way / np.linalg.norm(way), viewer.direction) > 0.95, name
    for name in ("cave", "reality-deck"):
        assert standing_viewer(Display.preset(name)).direction == (0, 0, -1)
