"""Terrains from the command line: made ready, shown, counted, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from limen.cli.app import main
from support.ground import write_dem


@pytest.fixture(scope="module")
def land(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("land")
    assert run("ingest", write_dem(folder / "hills.tif"), folder / "hills.terrain", "-q") == 0
    return folder / "hills.terrain"


def run(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def result(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    capsys.readouterr()
    assert run(*words, "--json", "-q") == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def picture(path: str) -> Any:
    return np.asarray(Picture.open(path)).astype(int)


@pytest.mark.gpu
def test_show_writes_panels_and_what_is_seen_of_the_lit_wall(
    land: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("show", land, "--display", "rostock", "--session", "A", "--policy", "scheel", "--scale", "0.05")
    frames = result(
        capsys, *words, "--frames", 2, "--camera", "fixed", "--out", tmp_path, "--simulate", "--format", "png"
    )
    first, second = frames["frames"]
    assert second["time_s"] > first["time_s"]
    for frame in (first, second):
        (layer,) = frame["layers"]
        assert 0 < layer["panels_active"] <= 24
        assert layer["missing"] == 0
        assert layer["drawn"] > 0
        assert layer["items"] > 0
        assert layer["chunks"] > 0
        smallest, largest = layer["allowed_px"]
        assert layer["error_px"] <= largest
        assert smallest <= largest
        names = {Path(file).name for file in frame["files"]}
        assert {"eye.png", "elsewhere.png", "afar.png", "wall-0,0.png", "wall-5,3.png"} <= names
    afar = next(file for file in first["files"] if file.endswith("afar.png"))
    assert (picture(afar).max(axis=-1) > 60).mean() > 0.02


@pytest.mark.gpu
def test_overlays_contours_and_flights_change_the_picture(
    land: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def drawn(name: str, *options: object) -> Any:
        words = ("show", land, "--out", tmp_path / name, "--scale", "0.1", "--format", "png", *options)
        (frame,) = result(capsys, *words)["frames"]
        return picture(frame["files"][0])

    plain = drawn("plain")
    options = {
        "panels": ("--overlay", "panels"), "patches": ("--overlay", "patches"), "lines": ("--contours", "50"),
        "sun": ("--sun-azimuth-deg", "90"), "grey": ("--colours", "plain"), "turned": ("--heading-deg", "-60"),
        "steep": ("--pitch-deg", "75"), "near": ("--range-m", "6000"), "aside": ("--target", "0.2,0.7"),
        "high": ("--exaggeration", "3"), "flight": ("--flight", "traverse"),
    }  # fmt: skip
    for name, words in options.items():
        assert (np.abs(drawn(name, *words) - plain).max(axis=-1) > 12).mean() > 0.005, name


def test_traffic_counts_panels_triangles_and_bytes(land: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("traffic", land, "--display", "rostock", "--session", "A", "--rate-hz", "0.1")
    counted = result(capsys, *words, "--policy", "full", "acuity", "scheel", "--camera", "fixed")
    (session,) = counted["sessions"]
    full, acuity, scheel = session["rows"]
    assert [row["policy"] for row in session["rows"]] == ["full", "acuity", "scheel"]
    assert session["frames"] == 14
    assert session["floor_samples_mean"] > 1e5
    assert full["saving"] == 0
    assert full["panels_active_mean"] == 24
    assert scheel["panels_active_mean"] < 24
    assert full["triangles_mean"] >= acuity["triangles_mean"] >= scheel["triangles_mean"] > 0
    assert 0 < acuity["saving"] <= scheel["saving"] < 1
    assert full["bytes_mean"] > full["pages_mean"] * counted["page_bytes"]


def test_traffic_counts_what_of_a_drape_is_too_faint(
    land: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A drape all grey is left at its coarsest page by `contrast`, noise is not."""
    noise = np.random.default_rng(3).choice([20, 230], size=(512, 1024)).astype(np.uint8)
    Picture.fromarray(noise).save(tmp_path / "noise.png")
    Picture.fromarray(np.full_like(noise, 120)).save(tmp_path / "grey.png")
    words = ("traffic", land, "--display", "rostock", "--session", "A", "--rate-hz", "0.05", "--policy", "acuity")

    def pages(*options: object) -> list[float]:
        counted = result(capsys, *words, *options)
        assert (counted["drape_page_bytes"] is None) == ("--drape" not in options)
        return [row["pages_mean"] for row in counted["sessions"][0]["rows"]]

    (bare,) = pages()
    grey, noisy = (pages("contrast", "--drape", tmp_path / f"{name}.png") for name in ("grey", "noise"))
    assert grey[0] == noisy[0] > bare + 5
    assert grey[1] == bare + 1
    assert noisy[1] == noisy[0]


@pytest.mark.gpu
def test_a_budget_of_triangles_is_kept_and_costs_error(
    land: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("show", land, "--out", tmp_path, "--scale", "0.2", "--policy", "full")
    (free,), (tight,) = (result(capsys, *words, *more)["frames"] for more in ((), ("--max-triangles", 500)))
    few, many = (frame["layers"][0] for frame in (tight, free))
    assert few["drawn"] < 1000 < many["drawn"]  # fans along borders come on top of the budget
    assert few["error_px"] > many["error_px"]
    counted = result(capsys, "traffic", land, "--display", "rostock", "--session", "A", "--rate-hz", "0.05",
                     "--policy", "acuity", "--max-triangles", "5000")  # fmt: skip
    assert counted["sessions"][0]["rows"][0]["triangles_p99"] <= 5000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ("show", "LAND", "--overlay", "levels"),
            "--overlay levels is not for a terrain: give --overlay panels or patches",
        ),
        (("show", "LAND", "--stereo", "polarised"), "stereo"),
        (("show", "LAND", "--target", "2,0"), "target must be two numbers from 0 to 1"),
        (("show", "LAND", "--target", "here"), "--target takes two numbers"),
        (("show", "LAND", "--pitch-deg", "95"), "pitch_deg must be from 0"),
        (("show", "LAND", "--contours", "many"), "--contours takes metres"),
        (("show", "LAND", "--colours", "drape"), "--colours drape needs --drape"),
        (("show", "LAND", "--drape", "nowhere.png"), "nowhere.png"),
        (("traffic", "LAND", "--display", "rostock", "--plot", "a.png"), "leave out --plot, which is for images"),
        (
            ("traffic", "LAND", "--display", "rostock", "--fit", "contain"),
            "leave out --fit, which is for images",
        ),
        (
            ("traffic", "one-to-one", "--display", "rostock", "--max-triangles", "9"),
            "leave out --max-triangles, which is for terrains",
        ),
        (("show", "LAND", "--fit", "contain"), "this content is a terrain: leave out --fit"),
        (("show", "LAND", "--max-triangles", "0"), "max_triangles must be at least 1"),
        (("show", "LAND", "--drape", "LAND"), "is a terrain, and an image is wanted here"),
        (("demo", "--content", "LAND"), "is a terrain, and an image is wanted here"),
        (("demo", "--content", "DEM"), "is a terrain, and an image is wanted here"),
        (("demo", "--content", "MESH"), "is a mesh, and an image is wanted here"),
        (
            ("traffic", "one-to-one", "--display", "rostock", "--camera", "fixed"),
            "leave out --camera, which is for terrains",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    land: Path, words: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = tmp_path / "triangle.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    files = {"LAND": land, "DEM": land.with_name("hills.tif"), "MESH": mesh}
    given = [files.get(word, word) for word in words]
    if words[0] in ("show", "demo"):
        given += ["--out", tmp_path / "never"]
    capsys.readouterr()
    assert run(*given) == 2
    captured = capsys.readouterr()
    assert says in captured.err
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "never").exists()
