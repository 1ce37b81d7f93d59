"""Panels: their lit outlines, and their light."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.display.panel import Panel
from limen.errors import DisplayError, FormatError
from limen.geometry import signed_area


def _panel(**fields: object) -> Panel:
    good = {
        "name": "p", "size_px": (40, 30), "origin_m": (1, 2, 3), "right": (0, 0, 1), "down": (0, -1, 0),
        "pitch_m": (0.01, 0.02),
    }  # fmt: skip
    return Panel(**{**good, **fields})  # type: ignore[arg-type]


@given(st.integers(3, 8), st.booleans(), st.integers(0, 7))
def test_the_outline_in_the_room_is_clockwise_whatever_the_files_order(
    corners: int, backward: bool, first: int
) -> None:
    angles = np.linspace(0, 2 * math.pi, corners, endpoint=False)
    outline = np.roll(np.stack([20 + 15 * np.cos(angles), 15 + 14 * np.sin(angles)], axis=1), first, axis=0)
    panel = _panel(outline_px=tuple(map(tuple, (outline[::-1] if backward else outline).tolist())))
    assert signed_area(panel.lit_outline_px) > 0, "pixels' y points down, so this is clockwise"
    points = panel.outline_m
    assert points.shape == (corners, 3)
    # Clockwise as seen: by the right-hand rule the area vector points away from the viewer.
    area = sum(np.cross(points[k - 1], points[k]) for k in range(corners)) / 2
    expected = signed_area(panel.lit_outline_px) * panel.pitch_m[0] * panel.pitch_m[1]
    np.testing.assert_allclose(area, -np.array(panel.normal) * expected, atol=1e-12)
    again = panel.position_m(np.array(sorted(map(tuple, outline.tolist()))))
    np.testing.assert_allclose(sorted(map(tuple, points.tolist())), sorted(map(tuple, again.tolist())), atol=1e-12)


def test_without_an_outline_the_whole_grid_is_lit() -> None:
    panel = _panel()
    np.testing.assert_array_equal(panel.outline_m, panel.corners_m)


@pytest.mark.parametrize(
    "field",
    [{"gain": 0.0}, {"gain": 1.5}, {"gain": math.nan}, {"falloff": -1.0}, {"bezel_m": -0.1}, {"bezel_m": math.inf}],
)
def test_light_that_cannot_be_is_refused(field: dict[str, float]) -> None:
    (name,) = field
    with pytest.raises(DisplayError, match=f"panel 'p': {name.removesuffix('_m')} must"):
        _panel(**field)


def test_gain_falloff_and_bezel_come_from_files_and_survive_being_written(tmp_path) -> None:
    text = """name = "x"
[[grid]]
name = "a"
size_px = [256, 128]
centre_m = [0, 1, -2]
columns = 2
pitch_mm = 1
bezel_mm = [4, 6]
gain = 0.9
falloff = 0.5
[[panel]]
name = "p"
size_px = [9, 9]
corners_m = [[0, 0, 0], [1, 0, 0], [1, -1, 0]]
bezel_mm = 7.5
[[adjust]]
panels = "a/1,*"
gain = 0.8
bezel_mm = 1
"""
    path = tmp_path / "wall.toml"
    path.write_text(text)
    display = limen.Display.load(path)
    light = [(panel.gain, panel.falloff, panel.bezel_m) for panel in display.panels]
    assert light == [(0.9, 0.5, 0.002), (0.8, 0.5, 0.001), (1.0, 0.0, 0.0075)]
    path.write_text(display.to_toml())
    again = [(panel.gain, panel.falloff, panel.bezel_m) for panel in limen.Display.load(path).panels]
    np.testing.assert_allclose(again, light, rtol=1e-12)
    path.write_text(text.replace("gain = 0.9", "gain = 2"))
    with pytest.raises(FormatError, match=r"wall\.toml:9: .*<= 1"):
        limen.Display.load(path)
