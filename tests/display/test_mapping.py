"""Quilts that a display's owner wrote: kept, checked, saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import limen
from limen.display.mapping import overlaps
from limen.display.packing import pack_outlines
from limen.errors import DisplayError, FormatError
from limen.geometry import signed_area

WALL = """name = "wall"
[[grid]]
name = "a"
size_px = [100, 50]
columns = 3
centre_m = [0, 1, -2]
pitch_mm = 1
[[quilt]]
size_px = [200, 100]
output = "HDMI-1"
[[quilt.panel]]
name = "a/0,0"
offset_px = [0, 0]
[[quilt.panel]]
name = "a/2,0"
offset_px = [100, 0]
turn_deg = 270
[[quilt]]
size_px = [100, 50]
panel = [{ name = "a/1,0", offset_px = [0, 0], turn_deg = 180 }]
"""


def _load(tmp_path: Path, text: str) -> limen.Display:
    path = tmp_path / "wall.toml"
    path.write_text(text)
    return limen.Display.load(path)


def test_a_mapping_is_kept_written_and_read_again(tmp_path: Path) -> None:
    display = _load(tmp_path, WALL)
    first, second = display.quilts
    assert (first.panels, first.offsets_px, first.turns, first.output) == ((0, 2), ((0, 0), (100, 0)), (0, 3), "HDMI-1")
    assert (second.panels, second.turns, second.output) == ((1,), (2,), "")
    assert _load(tmp_path, display.to_toml()).quilts == display.quilts


def test_parts_keep_the_places_and_previews_have_none(tmp_path: Path) -> None:
    display = _load(tmp_path, WALL)
    (only,) = display.select("a/2,*").quilts
    assert (only.panels, only.offsets_px, only.turns, only.output) == ((0,), ((100, 0),), (3,), "HDMI-1")
    swapped = display.part([2, 0, 1])
    assert [quilt.panels for quilt in swapped.quilts] == [(1, 0), (2,)]
    assert display.scaled(0.5).quilts == ()


@pytest.mark.parametrize("name", ["teapot", "icosahedron"])
def test_a_packing_is_saved_with_the_display(name: str, tmp_path: Path) -> None:
    display = limen.Display.preset(name)
    assert display.quilts == ()
    quilts = pack_outlines(display, max_size_px=6000)
    again = _load(tmp_path, display.to_toml(quilts))
    assert list(again.quilts) == quilts
    maps = [each.quilt_from_panel(shown) for each, shown in ((quilts[0], display), (again.quilts[0], again))]
    np.testing.assert_allclose(maps[1], maps[0], atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("offset_px = [100, 0]", "offset_px = [99, 0]", "quilt 1: panels 'a/0,0' and 'a/2,0' overlap"),
        ("offset_px = [100, 0]", "offset_px = [160, 0]", "panel 'a/2,0' reaches from 160,0 to 210,100 px, out of"),
        ('name = "a/2,0"', 'name = "a/9,0"', r"\[\[quilt\]\] 1 holds 'a/9,0', and no panel has that name"),
        ('name = "a/2,0"', 'name = "a/1,0"', "panel 'a/1,0' is in two quilts"),
        ("size_px = [200, 100]", "size_px = [200, 99]", "panel 'a/2,0' reaches from 100,0 to 150,100 px"),
        ("columns = 3", "columns = 4", "panel 'a/3,0' is in no quilt"),
    ],
)  # fmt: skip
def test_a_mapping_that_cannot_be_is_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(DisplayError, match=words):
        _load(tmp_path, WALL.replace(old, new))


def test_turns_are_quarters(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"wall\.toml:\d+: Invalid enum value 45"):
        _load(tmp_path, WALL.replace("270", "45"))


@given(st.integers(0, 2**32))
@settings(max_examples=30)
def test_overlaps_are_those_that_a_raster_shows(seed: int) -> None:
    """Triangles on a fine raster share samples well inside both, or are told apart."""
    random = np.random.default_rng(seed)
    triangles = random.uniform(0, 10, (8, 3, 2))
    forward = np.array([signed_area(triangle) > 0 for triangle in triangles])
    triangles = np.where(forward[:, None, None], triangles, triangles[:, ::-1])
    outlines = np.concatenate([triangles, np.repeat(triangles[:, -1:], 5, axis=1)], axis=1)
    samples = np.stack(np.meshgrid(*[np.linspace(0, 10, 200)] * 2), axis=-1).reshape(-1, 2)
    edges = np.roll(triangles, -1, axis=1) - triangles
    away = samples[:, None, None] - triangles[None]
    depth = (edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0]) / np.linalg.norm(edges, axis=2)
    inside = depth.min(axis=2)
    found = set(overlaps(outlines))
    for a in range(8):
        for b in range(a + 1, 8):
            both = np.minimum(inside[:, a], inside[:, b]).max()
            if both > 0.01:
                assert (a, b) in found
            elif both < -0.3:
                assert (a, b) not in found
