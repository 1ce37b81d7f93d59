"""Displays: presets, files, and what is wrong with them."""

from __future__ import annotations

import json
import math
from importlib.resources import files as resource_files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.display import files
from limen.display.panel import Panel
from limen.errors import DisplayError, FormatError, InputError, MissingFileError
from limen.viewing.placement import OnSurface

GRID = 'name = "x"\n[[grid]]\nname = "a"\nsize_px = [256, 128]\ncentre_m = [0, 1, -2]\n'
PANEL = "name = 'x'\n[[panel]]\nname = 'p'\nsize_px = [9, 9]\n"


def load(tmp_path, text):
    path = tmp_path / "wall.toml"
    path.write_text(text)
    return limen.Display.load(path)


def test_the_reality_deck_is_the_papers_room():
    deck = limen.Display.preset("reality-deck")
    assert len(deck.panels) == 416
    assert deck.total_px == 416 * 2560 * 1440
    assert {name: len(panels) for name, panels in deck.grids().items()} == {
        "back": 128, "left": 80, "front": 128, "right": 80,
    }  # fmt: skip
    panels = {panel.name: panel for panel in deck.panels}
    front, back = panels["front/7,3"], panels["back/7,3"]
    assert back.centre_m[2] - front.centre_m[2] == pytest.approx(5.98)
    assert panels["right/0,0"].centre_m[0] - panels["left/0,0"].centre_m[0] == pytest.approx(10.06)
    assert deck.bounds_m[0][1] == pytest.approx(0.33, abs=1e-4)
    nodes = sorted(len(names) for names in deck.nodes.values())
    assert nodes == [16, 16, *[24] * 16]


def test_walls_of_the_reality_deck_meet_on_the_unrolled_surface_as_in_the_room():
    """Turning to the right in the room is moving to the right on the surface."""
    panels = {panel.name: panel for panel in limen.Display.preset("reality-deck").panels}
    for left, right in (("left/9,4", "front/0,4"), ("front/15,4", "right/0,4"), ("right/9,4", "back/0,4")):
        edge = panels[left].surface_m[0] + panels[left].size_m[0]
        assert panels[right].surface_m[0] == pytest.approx(edge)
        gap = np.linalg.norm(panels[left].corners_m[1] - panels[right].corners_m[0])
        assert gap < 0.26, "neighbours on the surface are neighbours in the room"


@pytest.mark.parametrize("name", files.preset_names())
def test_every_preset_faces_its_viewers_and_survives_being_written(name, tmp_path):
    preset = limen.Display.preset(name)
    middle = preset.bounds_m.mean(axis=0)
    if name not in ("teapot", "spring", "knot"):  # of these, no single point is inside
        seen_from_inside = name in ("cave", "desk", "desktop", "reality-deck", "rostock")
        middle = np.array([0, 1.3, 0]) if name == "desk" else middle
        for panel in preset.panels:
            inward = float(np.dot(middle - panel.outline_m.mean(axis=0), panel.normal))
            assert inward >= -1e-9 if seen_from_inside else inward <= 1e-9
    again = load(tmp_path, preset.to_toml())
    assert [panel.name for panel in again.panels] == [panel.name for panel in preset.panels]
    np.testing.assert_allclose(again.arrays.origin_m, preset.arrays.origin_m, atol=1e-9)
    np.testing.assert_allclose(again.arrays.surface_m, preset.arrays.surface_m, atol=1e-9)
    assert again.surface == pytest.approx(preset.surface)
    outlines = [np.concatenate([panel.outline_m for panel in each.panels]) for each in (preset, again)]
    np.testing.assert_allclose(outlines[1], outlines[0], atol=1e-9)


def test_rostock_has_the_stated_pitch():
    panel = limen.Display.preset("rostock").panels[0]
    assert panel.pitch_m[0] == pytest.approx(0.303e-3)
    assert panel.size_m == pytest.approx((0.582, 0.364), abs=1e-3)


@given(turn=st.floats(-math.pi, math.pi), tilt=st.floats(-1.2, 1.2), columns=st.integers(1, 4), rows=st.integers(1, 3))
def test_a_grid_is_flat_and_its_bezels_are_kept(turn, tilt, columns, rows):
    facing = [math.sin(turn) * math.cos(tilt), math.sin(tilt), math.cos(turn) * math.cos(tilt)]
    entry = {
        "name": "g", "size_px": [200, 100], "centre_m": [1.0, 2.0, 3.0], "columns": columns, "rows": rows,
        "pitch_mm": 1.0, "bezel_mm": [4.0, 6.0], "facing": facing,
    }  # fmt: skip
    content = files.msgspec.convert({"name": "d", "grid": [entry]}, files.DisplayFile)
    panels = files._panels(content)
    normals = np.array([panel.normal for panel in panels])
    np.testing.assert_allclose(normals, np.broadcast_to(facing, normals.shape), atol=1e-9)
    corners = np.concatenate([panel.corners_m for panel in panels])
    np.testing.assert_allclose((corners - [1, 2, 3]) @ np.array(facing), 0, atol=1e-9)
    np.testing.assert_allclose((corners.max(axis=0) + corners.min(axis=0)) / 2, [1, 2, 3], atol=1e-9)
    if columns > 1:
        step = np.array(panels[1].origin_m) - np.array(panels[0].origin_m)
        assert np.linalg.norm(step) == pytest.approx(0.204)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (GRID + 'diagonal_in = "27"\n', 6, "Expected `float | null`"),
        (GRID + "diagonal_in = 27\ncolums = 3\n", 7, "unknown field `colums`"),
        (GRID.replace("256", "0") + "diagonal_in = 27\n", 4, ">= 1"),
        (GRID.replace("centre_m = [0, 1, -2]\n", "") + "diagonal_in = 27\n", 2, "missing required field `centre_m`"),
        (
            GRID + "diagonal_in = 27\n[[panel]]\nname = 'p'\nsize_px = [1, 1]\ncorners_m = [[0, 0, 0]]\n",
            10,
            "length >= 3",
        ),
    ],
)
def test_a_wrong_field_is_named_with_its_line(tmp_path, text, line, words):
    with pytest.raises(FormatError) as caught:
        load(tmp_path, text)
    assert f"wall.toml:{line}:" in str(caught.value)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "x"\n', "no panels"),
        (GRID, "exactly one of"),
        (GRID + "diagonal_in = 27\npitch_mm = 1\n", "exactly one of"),
        (GRID + "diagonal_in = 27\nfacing = [0, 1, 0]\n", "parallel"),
        (GRID + "diagonal_in = 27\ncolumns = 3\nnodes = ['a', 'b']\n", "2 names for 3 columns"),
        (GRID + "diagonal_in = 27\n" + GRID[len('name = "x"\n') :] + "diagonal_in = 27\n", "are named 'a/0,0'"),
        (PANEL + "corners_m = [[0,0,0],[1,0,0],[1.5,-1,0]]\n", "not a rectangle"),
        (PANEL + "corners_m = [[0,0,0],[0,0,0],[0,-1,0]]\n", "in one place"),
        (PANEL + "corners_m = [[0,0,0],[1,0,0],[1,-1,0]]\noutline_px = [[0,0],[9,0],[2,2],[0,9]]\n", "convex"),
    ],
)  # fmt: skip
def test_an_impossible_display_is_refused(tmp_path, text, words):
    with pytest.raises(DisplayError, match=words):
        load(tmp_path, text)


def test_files_that_are_not_display_files(tmp_path):
    with pytest.raises(MissingFileError, match=r"none\.toml"):
        limen.Display.named(str(tmp_path / "none.toml"))
    with pytest.raises(FormatError, match="not valid TOML"):
        load(tmp_path, "name = ")
    with pytest.raises(InputError, match="reality-deck"):
        limen.Display.named("realty-deck")
    (tmp_path / "wall.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="text file"):
        limen.Display.load(tmp_path / "wall.toml")


def test_adjustments_reach_the_panels_they_name(tmp_path):
    text = GRID + "diagonal_in = 27\ncolumns = 3\n[[adjust]]\npanels = 'a/1,*'\nnudge_px = [2, -1]\nnode = 'n'\n"
    panels = load(tmp_path, text).panels
    assert [panel.nudge_px for panel in panels] == [(0, 0), (2, -1), (0, 0)]
    assert [panel.node for panel in panels] == ["", "n", ""]


def test_white_is_stated_for_the_display_a_grid_a_panel_or_by_name_and_survives_being_written(tmp_path):
    other = GRID[len('name = "x"\n') :].replace('"a"', '"b"') + "diagonal_in = 27\n"
    corners = "corners_m = [[0,0,0],[1,0,0],[1,-1,0]]\n"
    text = (
        "luminance_cd_m2 = 250\n" + GRID + "diagonal_in = 27\ncolumns = 2\nluminance_cd_m2 = 80\n" + other
        + PANEL[len("name = 'x'\n") :] + corners + "luminance_cd_m2 = 0.001\n"
        + "[[adjust]]\npanels = 'a/1,*'\nluminance_cd_m2 = 75\n"
    )  # fmt: skip
    display = load(tmp_path, text)
    white = {panel.name: panel.luminance_cd_m2 for panel in display.panels}
    assert white == {"a/0,0": 80, "a/1,0": 75, "b/0,0": 250, "p": 0.001}
    assert load(tmp_path, display.to_toml()).arrays.luminance_cd_m2.tolist() == [80, 75, 250, 0.001]
    assert [panel.luminance_cd_m2 for panel in display.part([1, 2]).scaled(0.5).panels] == [75, 250]
    assert limen.Display.preset("rostock").panels[0].luminance_cd_m2 == 100


@pytest.mark.parametrize("value", ["0", "-5", "nan", "inf"])
@pytest.mark.parametrize(
    "where", ["luminance_cd_m2 = {}\n" + GRID + "pitch_mm = 1\n", GRID + "pitch_mm = 1\nluminance_cd_m2 = {}\n"]
)
def test_a_white_that_cannot_be_is_refused(tmp_path, where, value):
    with pytest.raises(DisplayError, match=r"wall\.toml: panel 'a/0,0': luminance_cd_m2 of white must be above 0"):
        load(tmp_path, where.format(value))


def test_selected_panels_keep_the_whole_surface():
    deck = limen.Display.preset("reality-deck")
    part = deck.select("front/*")
    assert len(part.panels) == 128
    assert part.surface == deck.surface
    assert part.select("front/0,*").surface == deck.surface
    with pytest.raises(InputError, match="no panel"):
        deck.select("nowhere/*")


def test_the_published_schema_is_the_one_that_is_checked():
    published = (resource_files("limen.display") / "display.schema.json").read_text()
    assert json.loads(published) == json.loads(json.dumps(files.schema())), "write files.schema() out again"


def test_panels_refuse_nonsense():
    good = {
        "name": "p",
        "size_px": (4, 3),
        "origin_m": (0, 0, 0),
        "right": (1, 0, 0),
        "down": (0, -1, 0),
        "pitch_m": (1, 1),
    }
    assert Panel(**good).normal == (0, 0, 1)
    for field, value in {
        "name": "", "size_px": (0, 3), "origin_m": (0, math.nan, 0), "right": (0, 0, 0), "down": (1, 0, 0),
        "pitch_m": (0, 1), "luminance_cd_m2": 0.0,
    }.items():  # fmt: skip
        with pytest.raises(DisplayError):
            Panel(**{**good, field: value})


def test_a_preview_shows_the_same_part_of_an_image():
    deck = limen.Display.preset("reality-deck")
    small = deck.select(["front/*", "left/3,*"]).scaled(1 / 20)
    assert small.surface == deck.surface
    for fit in ("contain", "one-to-one"):
        whole, preview = (
            OnSurface(fit).panel_maps(shown, (92_160, 7_200)) for shown in (deck.select("front/*"), small)
        )
        for maps, display in ((whole, deck.select("front/*")), (preview, small)):
            index = [panel.name for panel in display.panels].index("front/3,5")
            corners = [maps.scale[index] * at + maps.offset[index] for at in ([0, 0], display.panels[index].size_px)]
            np.testing.assert_allclose(corners[0][0], whole.offset[5 * 16 + 3][0], atol=1e-6)
            np.testing.assert_allclose(corners[1] - corners[0], whole.scale[0] * deck.panels[0].size_px, rtol=1e-9)
