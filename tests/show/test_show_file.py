"""Show files: what they say is what layers made by hand are, and what is wrong in one is told with its line."""

from __future__ import annotations

import json
from contextlib import ExitStack
from importlib.resources import files as resource_files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

import limen
from limen.data.samples.mesh import sample_mesh, torus_knot
from limen.errors import FormatError, InputError, MissingFileError
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.points.layer import PointsLayer
from limen.layers.terrain.layer import TerrainLayer
from limen.show.entries import schema
from limen.show.show import Show
from limen.show.show_file import light_of, open_show
from limen.viewing.standing import standing_viewer
from support.clouds import ball
from support.ground import write_dem

WALL = limen.Display.named("rostock").scaled(1 / 24)

ALL = """
title = "All kinds"
stereo = "anaglyph"
background = "#204060"
camera = "fixed"

[[layer]]
kind = "image"
content = "map.png"
policy = "acuity+gaze"
acuity_arcmin = "1.5"
overlay = "levels"

[layer.placement]
fit = "cover"
zoom = 2.0
centre = [0.25, 0.5]
lens_mode = "acuity"
lens = [{ radius_px = 20.0, centre_px = [30.0, 40.0], magnification = 3.0 }, { radius_px = 10.0, drop_off = "linear" }]

[[layer]]
kind = "mesh"
content = "knot.ply"
policy = "contrast"
placement = { size_m = 1.5, at_m = [0.0, 1.0, -2.0], up = "z", turn_deg = 30.0, turning = true }

[[layer]]
kind = "mesh"
content = "knot.ply"
style = { rippling = true }

[[layer]]
kind = "points"
content = "ball.ply"
placement = { matrix = [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3]] }
style = { lit = true, splats = "square" }

[[layer]]
kind = "terrain"
content = "hills.tif"
placement = { target = [0.4, 0.6], heading_deg = 20.0, pitch_deg = 30.0, range_m = 9000.0, flight = "orbit" }
style = { drape = "map.png", sun_azimuth_deg = 100.0, rule = "middle", field_deg = 60.0, contour_interval_m = "auto" }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("show")
    Picture.fromarray(np.random.default_rng(0).integers(0, 256, (60, 90, 3), dtype=np.uint8)).save(made / "map.png")
    sample_mesh(made / "knot.ply", 1000)
    cloud = ball(300)
    places = cloud.read_chunk(0)["place"][:300].astype(float) if cloud.chunks else np.zeros((1, 3))
    rows = "\n".join(" ".join(map(str, place)) for place in places.tolist())
    header = "ply\nformat ascii 1.0\nelement vertex 300\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    (made / "ball.ply").write_text(f"{header}end_header\n{rows}\n")
    write_dem(made / "hills.tif")
    (made / "all.toml").write_text(ALL)
    return made


def test_the_published_schema_is_that_of_the_code() -> None:
    published = (resource_files("limen.show") / "show.schema.json").read_text()
    assert json.loads(published) == json.loads(json.dumps(schema()))


def test_layers_are_what_the_file_says(folder: Path) -> None:
    with Show.open(folder / "all.toml", WALL) as show:
        assert (show.name, show.stereo, show.background) == ("All kinds", "anaglyph", light_of("#204060"))
        assert show.eye_m == standing_viewer(WALL).position_m
        image, turning, rippling, points, terrain = show.layers
        assert isinstance(image, ImageLayer)
        placed: Any = image.placement
        assert (placed.fit, placed.zoom, placed.centre, placed.tessellation.mode) == (
            "cover",
            2.0,
            (0.25, 0.5),
            "acuity",
        )
        assert [lens.magnification for lens in placed.lenses] == [3.0]
        assert [lens.drop_off for lens in placed.carried] == ["linear"]
        assert (image.policy.label, image.overlay) == ("acuity+gaze 1.5'", "levels")
        assert isinstance(turning, MeshLayer)
        assert turning.policy.name == "contrast"
        assert turning.tree is not None
        stands = turning.stands
        assert (stands.size_m, stands.at_m, stands.up, stands.turn_deg) == (1.5, (0.0, 1.0, -2.0), "z", 30.0)
        assert turning.state(1.0, WALL).motion is not None
        assert isinstance(rippling, MeshLayer)
        assert rippling.deformed is not None
        assert not np.array_equal(rippling.deformed(0.0).positions, rippling.deformed(1.0).positions)
        assert isinstance(points, PointsLayer)
        assert (points.is_lit, points.shape) == (True, "square")
        state: Any = points.state(0.0, WALL)
        np.testing.assert_array_equal(state.placement.matrix, [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]])
        assert isinstance(terrain, TerrainLayer)
        looked: Any = terrain.state(0.0, WALL).placement
        assert (looked.target, looked.heading_deg, looked.range_m) == ((0.4, 0.6), 20.0, 9000.0)
        later: Any = terrain.state(1.0, WALL).placement
        assert later.heading_deg != 20.0
        assert (terrain.settings.rule, terrain.settings.field_deg) == ("middle", 60.0)
        assert (terrain.look.colours, terrain.look.azimuth_deg) == ("drape", 100.0)
        assert terrain.draped is not None


WRONG = {
    "no such field": ('policy = "contrast"', 'polcy = "contrast"', "polcy", "unknown field `polcy`"),
    "no number": ("size_m = 1.5", 'size_m = "big"', "size_m", r"layer\[1\].placement.size_m"),
    "a field of another kind": ("style = { rippling", "style = { lit = 1, rippling", "lit = 1", "unknown field `lit`"),
    "another kind": ('kind = "points"', 'kind = "mesh"', "lit = true", "unknown field"),
    "not its kind": ('kind = "image"', 'kind = "points"', "fit = ", "unknown field"),
    "no such policy": ('policy = "contrast"', 'policy = "any"', '"knot.ply"', "no policy is named 'any'"),
    "a policy of another kind": ('policy = "contrast"', 'policy = "scheel"', '"knot.ply"', "scheel is not for a mesh"),
    "no such overlay": ('overlay = "levels"', 'overlay = "patches"', '"map.png"', "'patches' is not for an image"),
    "no such file": ('content = "ball.ply"', 'content = "cube.ply"', "cube.ply", "cube.ply: there is no such file"),
    "no kind": ('kind = "terrain"\n', "", "[[layer]]\ncontent", "missing required field `kind`"),
    "no content": ('content = "hills.tif"\n', "", '[[layer]]\nkind = "terrain"', "missing required field `content`"),
    "a zoom that cannot be": ("zoom = 2.0", "zoom = -2.0", '"map.png"', "zoom must be positive"),
    "a drape that is not seen": (
        'drape = "map.png"',
        'drape = "map.png", colours = "plain"',
        '"hills.tif"',
        "drape is",
    ),
    "two placements": ("matrix = [[2", "size_m = 2.0, matrix = [[2", '"ball.ply"', "leave out its other fields"),
    "a matrix of another shape": ("[0, 0, 2, 3]]", "[0, 0, 2]]", '"ball.ply"', "finite numbers of the shape"),
    "no colour": ('"#204060"', '"blue"', "blue", "background"),
    "no TOML": ("[[layer]]\nkind", "[[layer]\nkind", "", "not valid TOML"),
    "nothing": (ALL[ALL.index("[[layer]]") :], "", "", "missing required field `layer`"),
}
"""What is written in place of what, what stands in the line that is told, and what is said."""


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_told_with_line_and_field(name: str, folder: Path) -> None:
    before, after, marked, message = WRONG[name]
    assert before in ALL
    text = ALL.replace(before, after, 1)
    wrong = folder / "wrong.toml"
    wrong.write_text(text)
    with ExitStack() as stack, pytest.raises((FormatError, InputError, MissingFileError), match=message) as caught:
        open_show(wrong, WALL, stack)
    told = str(caught.value)
    assert "wrong.toml" in told
    if marked:
        assert f"wrong.toml:{1 + text[: text.index(marked)].count(chr(10))}:" in told, told


def test_there_is_no_such_show(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such show file"):
        Show.open(tmp_path / "none.toml")


def test_what_was_opened_is_closed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[object] = []
    monkeypatch.setattr(limen.Image, "close", lambda image: closed.append(image))
    with limen.open(folder / "map.png") as own, Show([folder / "map.png", own, torus_knot(500)], WALL) as show:  # type: ignore[union-attr]
        assert [layer.kind for layer in show.layers] == ["image", "image", "mesh"]
        opened: Any = show.layers[0]
        assert not closed
    assert closed[0] is opened.image
    with Show.open(folder / "all.toml", WALL) as show:
        closed.clear()
    assert len(closed) == 2, "the image, and the drape"
    with pytest.raises(InputError, match="cannot be shown"):
        Show([3])  # type: ignore[list-item]
