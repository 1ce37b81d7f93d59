"""Frames of terrains on few posts: what is drawn against the true surface, and beside VTK's full grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import rasterio

from limen.data.terrain.elevation import PostRect
from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.layers.terrain.layer import TerrainLayer
from limen.study.baselines.packages import INSTALL, missing_package
from limen.study.bench import terrain as bench
from limen.study.bench import terrain_frames, terrain_table
from limen.study.bench.terrain_frames import (
    TerrainPanel,
    choice_of,
    displacement,
    frame_aims,
    frame_rows,
    one_panel,
)
from limen.study.bench.terrain_source import parse_crop, posts_of, prepared, write_crop
from limen.study.bench.terrain_table import PAPER, table2, table2_rows
from limen.viewing.policy import Policy
from support import terrains

SPACING_M = 30.0
ACUITY = Policy("acuity")
STAGE = TerrainPanel(one_panel().display.scaled(0.25), replace(one_panel().viewer, acuity_arcmin=10.0))
"""With a viewer who sees so little that not all posts need to be drawn."""


def silent(_text: str) -> None:
    pass


@pytest.fixture(scope="module")
def dem(tmp_path_factory: Any) -> Path:
    """200 x 160 posts with a void, 30 m apart."""
    heights_m = np.round(terrains.hills(160, 200, roughness=1.2, relief_m=300.0)).astype(np.int16)
    heights_m[20:30, 150:170] = -32768
    path = tmp_path_factory.mktemp("dem") / "dem.tif"
    place = rasterio.Affine(SPACING_M, 0, 500_000, 0, -SPACING_M, 4_000_000)
    with rasterio.open(
        path, "w", driver="GTiff", width=200, height=160, count=1, dtype="int16", crs="EPSG:32611", transform=place,
        nodata=-32768,
    ) as raster:  # fmt: skip
        raster.write(heights_m, 1)
    return path


@pytest.fixture(scope="module")
def terrain(dem: Path) -> Iterator[Terrain]:
    with prepared(dem, None, 0, silent) as made:
        yield made


def test_a_crop_is_part_of_its_raster_where_it_was(dem: Path, tmp_path: Path) -> None:
    crop = PostRect(column=140, row=10, columns=50, rows=40)
    path = write_crop(dem, crop, tmp_path / "crop.tif")
    with rasterio.open(dem) as whole, rasterio.open(path) as part:
        place = rasterio.windows.Window(*crop)
        assert (part.read(1) == whole.read(1, window=place)).all()
        assert (part.read_masks(1) == whole.read_masks(1, window=place)).all()
        assert (part.read_masks(1) == 0).sum() == 200
        assert part.crs == whole.crs
        moved = whole.transform
        assert (part.transform.c, part.transform.f) == (moved.c + 140 * SPACING_M, moved.f - 10 * SPACING_M)
        assert (part.transform.a, part.transform.e) == (moved.a, moved.e)
    with pytest.raises(InputError, match=r"--crop 10,140,40,61: is not all inside .*dem.tif, which has 160 rows"):
        write_crop(dem, crop._replace(columns=61), tmp_path / "crop.tif")


@pytest.mark.parametrize("text", ["1,2,3", "a,b,c,d", "", "-1,0,5,5", "0,0,1,5"])
def test_what_is_no_crop_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^--crop '"):
        parse_crop(text)


def test_what_was_made_is_gone_afterwards(dem: Path) -> None:
    with prepared(dem, PostRect(0, 0, 65, 65), 0, silent) as made:
        folder = made.path
        assert folder.is_dir()
        assert made.size_posts == (65, 65)
        assert made.spacing_m == (SPACING_M, SPACING_M)
        with prepared(folder, None, 0, silent) as same:
            assert same.path == folder
        with (
            pytest.raises(InputError, match="name the DEM that it was made of"),
            prepared(folder, PostRect(0, 0, 9, 9), 0, silent),
        ):
            pass
        assert folder.is_dir()
    assert not folder.exists()


def test_no_place_in_view_is_drawn_farther_off_than_the_viewer_can_tell(terrain: Terrain) -> None:
    posts = posts_of(terrain)
    choice = choice_of(terrain, STAGE, ACUITY)
    seen = displacement(terrain, posts, choice)
    allowed_px = float(choice.allowed_px[0])
    assert seen.posts == 160 * 200 - 200  # all of the terrain is in view, and the void does not count
    assert seen.holes == 0
    assert 0 < seen.error_px <= allowed_px
    assert seen.error_px <= choice.cut.panel_error_px[0] + 1e-6
    # What is off by more is told: a post of another terrain, 500 m higher between the vertices of the same patches.
    vertices = {(int(x), int(y)) for p in choice.cut.pair_patch for x, y in terrain.read_patch(int(p)).posts}
    column, row = next((x, y) for y in range(80, 160) for x in range(100, 200) if (x, y) not in vertices)
    bent = posts._replace(heights_m=posts.heights_m.copy())
    bent.heights_m[row, column] += 500
    assert displacement(terrain, bent, choice).error_px > allowed_px


@pytest.mark.gpu
def test_the_triangles_that_are_measured_are_as_many_as_are_drawn(device: Any, terrain: Terrain) -> None:
    from limen.study.triangulations import drawn

    choice = choice_of(terrain, STAGE, ACUITY)
    patches = [terrain.read_patch(int(patch)) for patch in choice.cut.pair_patch]
    layer = TerrainLayer(terrain, policy=ACUITY, reference_m=STAGE.viewer.position_m)
    with Renderer(device, STAGE.display, [layer]) as renderer:
        frame = renderer.state(0.0, viewers=(STAGE.viewer,))
        reports = [report for _, _, report in renderer.pictures(frame)]
    assert reports[0].layers[0].drawn == len(drawn(patches, terrain.size_posts))
    assert reports[0].missing == 0


@pytest.mark.gpu
def test_limen_beside_all_triangles(device: Any, terrain: Terrain) -> None:
    said: list[str] = []
    rows = frame_rows(device, terrain, posts_of(terrain), 2, said.append, STAGE)
    assert [row["method"] for row in rows] == (["limen"] if missing_package("vtk") else ["limen", "vtk"])
    for row in rows:
        assert row["frame_ms"] > 0
        assert row["frames"] == 2
        assert row["max_error_px"] <= row["allowed_px"]
    if missing_package("vtk"):
        assert any("vtk: skipped" in text for text in said)
    else:
        assert rows[0]["triangles"] < rows[1]["triangles"] == 2 * 159 * 199


@pytest.mark.gpu
def test_both_draw_the_same_view(device: Any, terrain: Terrain) -> None:
    if missing_package("vtk"):
        pytest.skip(f"{missing_package('vtk')} IS NOT INSTALLED, so limen was not compared with VTK: {INSTALL}")
    from limen.study.baselines.full_grid import FullGrid, hillshade
    from limen.study.bench.terrain_frames import LOOK

    display, viewer = STAGE
    posts = posts_of(terrain)
    room_from_posts = choice_of(terrain, STAGE, ACUITY).room_from_posts
    with Renderer(
        device, display, [TerrainLayer(terrain, LOOK, policy=ACUITY, reference_m=viewer.position_m)]
    ) as renderer:
        ours = next(iter(renderer.pictures(renderer.state(0.0, viewers=(viewer,))))).pixels[..., 0].astype(float)
    eye_m = np.array(viewer.position_m)
    grid = FullGrid(posts, room_from_posts, display.panels[0], eye_m, hillshade(posts, LOOK))
    grid.draw()
    theirs = grid.picture()[..., 0].astype(float)
    grid.close()
    assert ours.shape == theirs.shape == (300, 480)
    land = (theirs > 0) & (ours > 40)
    assert 0.2 < land.mean() < 0.95
    assert ((theirs > 0) ^ (ours > 40)).mean() < 0.02  # the void, which only limen cuts out, and outlines
    same, mirrored = (np.corrcoef(ours[land], other[land])[0, 1] for other in (theirs, theirs[:, ::-1]))
    assert same > 0.9 > mirrored + 0.3


@pytest.mark.gpu
def test_the_papers_table_with_frames(device: Any, terrain: Terrain, monkeypatch: Any) -> None:
    monkeypatch.setattr(terrain_table, "table2_rows", lambda wall: table2_rows(wall, PAPER[-2:]))
    wall = Display.preset("rostock").scaled(0.1)
    rows = table2(device, terrain, 1, silent, wall)
    assert [row["distance_m"] for row in rows] == [0.5, 0.2]
    assert [row["active_panels"] for row in rows] == [8, 4]
    for row in rows:
        assert row["frame_ms"] > 0
        assert row["triangles"] > 0
        assert set(row) <= set(terrain_table.TABLE2)
    assert rows[0]["paper_frames_per_s"] == 20.0


def test_aims_are_ratios_of_the_rows() -> None:
    limen = {"method": "limen", "frame_ms": 10, "frame_cpu_ms": 5, "allowed_px": 0.6, "max_error_px": 0.5}
    vtk = {**limen, "method": "vtk", "frame_ms": 600, "frame_cpu_ms": 400}
    error, ratio = frame_aims([limen, vtk])
    assert "0.500 px (aim: at most 0.600)" in error
    assert "60, by processor time 80 (aim: 50)" in ratio
    assert len(list(frame_aims([limen]))) == 1


@pytest.mark.gpu
def test_the_command(dem: Path, monkeypatch: Any, capsys: Any) -> None:
    from limen.cli.app import main

    monkeypatch.setattr(bench, "table2", lambda *_: [])
    monkeypatch.setattr(terrain_frames, "one_panel", lambda: STAGE)
    with pytest.raises(SystemExit) as ended:
        main(["bench", "terrain", "--quick", "--json", "--content", str(dem), "--crop", "0,0,129,129"])
    assert ended.value.code in (0, None)
    out, err = capsys.readouterr()
    report = msgspec.json.decode(out)
    assert report["name"] == "terrain"
    assert {row["method"] for row in report["rows"]} >= {"limen", "grid"}
    assert {"method", "max_error_m", "true_error_m", "triangles", "build_s"} <= set(report["rows"][0])
    assert report["frames"][0]["method"] == "limen"
    assert "aim" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["panels", "--content", "dem.tif"],
            "for the benchmarks 'terrain', 'points' and 'mesh', not 'panels'",
        ),
        (["terrain", "--crop", "0,0,9,9"], "--crop takes part of a DEM: name it with --content"),
        (["terrain", "--content", "dem.tif", "--crop", "0,0,9"], "give ROW,COLUMN,ROWS,COLUMNS"),
    ],
)
def test_wrong_arguments(arguments: list[str], message: str, capsys: Any) -> None:
    from limen.cli.app import main

    with pytest.raises(SystemExit) as ended:
        main(["bench", *arguments])
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
