from __future__ import annotations

import json

import numpy as np
import pytest
import pyvips

from limen.cli.app import main


def run(capsys, *words):
    try:
        main([str(word) for word in words])
        code = 0
    except SystemExit as ended:
        code = ended.code
    text = capsys.readouterr()
    return code or 0, text.out, text.err


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "a.png"
    pyvips.Image.new_from_array(np.zeros((500, 600, 3), np.uint8)).pngsave(str(path))
    return path


def test_info_ingest_and_sample_speak_json(capsys, tmp_path, picture):
    code, out, _ = run(capsys, "ingest", picture, tmp_path / "a.tif", "--json")
    report = json.loads(out)
    assert code == 0
    assert {"path", "seconds", "peak_rss_mib", "pixels", "bytes"} <= report.keys()
    code, out, _ = run(capsys, "info", tmp_path / "a.tif", "--json")
    found = json.loads(out)
    assert (found["kind"], found["size"], found["levels"][-1]) == ("image", [600, 500], [150, 125])
    code, out, _ = run(capsys, "sample", "image", tmp_path / "s.tif", "--size", 400, "--aspect", 2, "--json")
    assert json.loads(out)["size"] == [400, 200]


def test_info_speaks_to_people(capsys, picture):
    code, out, _ = run(capsys, "info", picture)
    assert code == 0
    assert "600 x 500 texels" in out


def test_a_mesh_is_made_and_told(capsys, tmp_path):
    code, out, _ = run(capsys, "sample", "mesh", tmp_path / "m.glb", "--size", 2000, "--json")
    made = json.loads(out)
    assert code == 0
    assert abs(made["size"] - 2000) < 100
    code, out, _ = run(capsys, "info", tmp_path / "m.glb", "--json")
    found = json.loads(out)
    assert (code, found["kind"], found["size"], found["levels"]) == (0, "mesh", made["size"], [made["size"]])
    assert (found["vertices"], found["textures"], found["texture_px"]) == (made["vertices"], 1, [1024, 256])
    assert np.shape(found["bounds"]) == (2, 3)
    code, out, _ = run(capsys, "info", tmp_path / "m.glb")
    assert f"{made['size']:,} triangles" in out
    assert "kept as 1024 x 256 texels" in out


def test_points_are_made_told_and_made_ready(capsys, tmp_path):
    source, folder = tmp_path / "p.laz", tmp_path / "p.points"
    code, out, _ = run(capsys, "sample", "points", source, "--size", 5000, "--seed", 3, "--json")
    made = json.loads(out)
    assert (code, made["size"]) == (0, 5000)
    code, out, _ = run(capsys, "info", source, "--json")
    raw = json.loads(out)
    assert (code, raw["kind"], raw["size"], raw["ready"], raw["unit_m"]) == (0, "points", 5000, False, 1.0)
    code, out, err = run(capsys, "ingest", source, folder, "--json")
    report = json.loads(out)
    assert (code, err, report["size"], report["chunks"]) == (0, "", 5000, 2)
    assert {"path", "seconds", "peak_rss_mib", "bytes"} <= report.keys()
    code, out, _ = run(capsys, "info", folder, "--json")
    ready = json.loads(out)
    assert (ready["ready"], ready["levels"]) == (True, [5000, 625, 79, 10, 2, 1])
    assert np.allclose(ready["bounds"], raw["bounds"])
    code, out, _ = run(capsys, "info", folder)
    assert "5,000 points, 2 chunks, 6 levels" in out
    assert "normals: estimated" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["ingest", "p.laz", "p.tif"], "is a cloud of points"),
        (["ingest", "p.laz", "q.points", "--quality", "50"], "--quality"),
        (["sample", "points", "q.laz", "--aspect", "2"], "--size says how many points"),
        (["sample", "points", "q.xyz"], "ends in .las, .laz or .ply"),
        (["bench", "image", "--content", "p.laz"], "'terrain', 'points' and 'mesh'"),
    ],
)
def test_what_is_not_for_points_is_said(capsys, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    run(capsys, "sample", "points", "p.laz", "--size", 100)
    code, _, err = run(capsys, *words)
    assert code == 2
    assert says in err


def test_a_terrain_is_made_told_and_made_ready(capsys, tmp_path):
    source, folder = tmp_path / "t.tif", tmp_path / "t.terrain"
    code, out, _ = run(capsys, "sample", "terrain", source, "--size", 300, "--seed", 3, "--json")
    made = json.loads(out)
    assert (code, made["size"], made["spacing_m"]) == (0, [300, 300], 30.0)
    code, out, _ = run(capsys, "info", source, "--json")
    raw = json.loads(out)
    assert (code, raw["kind"], raw["size"], raw["ready"]) == (0, "terrain", [300, 300], False)
    assert raw["bounds"] == [300_000.0, 4_391_000.0, 309_000.0, 4_400_000.0]
    code, out, err = run(capsys, "ingest", source, folder, "--json")
    report = json.loads(out)
    assert (code, err, report["posts"], report["void_share"]) == (0, "", 90_000, 0.0)
    assert {"path", "seconds", "peak_rss_mib", "triangles", "bytes"} <= report.keys()
    code, out, _ = run(capsys, "info", folder, "--json")
    ready = json.loads(out)
    assert (ready["ready"], ready["levels"]) == (True, [[300, 300], [150, 150]])
    assert ready["height_range_m"] == raw["height_range_m"]
    assert ready["triangles"][-1] == report["triangles"]
    code, out, _ = run(capsys, "info", folder)
    assert "300 x 300 posts, 30 x 30 m apart" in out
    assert "WGS 84 / UTM zone 11N" in out
    code, out, err = run(capsys, "ingest", source, tmp_path / "t2.tif")
    assert (code, err.count("\n")) == (2, 1)
    assert "name DST so" in err
    code, out, err = run(capsys, "ingest", source, folder, "--spacing-m", "10", "--band", "1")
    assert (code, json.loads(run(capsys, "info", folder, "--json")[1])["spacing_m"]) == (0, [10.0, 10.0])


@pytest.mark.parametrize(
    "words",
    [
        ("info", "nowhere.tif"),
        ("ingest", "nowhere.tif", "b.tif"),
        ("sample", "points", "out.xyz"),
        ("ingest", "nowhere.laz", "b.points"),
        ("info", "nowhere.points"),
        ("sample", "terrain", "out.png"),
        ("sample", "terrain", "out.tif", "--gigapixels", "1"),
        ("ingest", "nowhere.tif", "b.terrain"),
        ("ingest", "nowhere.tif", "b.terrain", "--quality", "80"),
        ("ingest", "nowhere.tif", "b.tif", "--spacing-m", "30"),
        ("info", "nowhere.terrain"),
        ("sample", "cheese", "out.tif"),
        ("sample", "mesh", "out.tif"),
        ("sample", "mesh", "out.ply", "--gigapixels", "1"),
        ("sample", "image", "out.tif", "--size", "9", "--gigapixels", "1"),
        ("sample", "image", "nowhere/out.tif", "--size", "9"),
    ],
)
def test_wrong_input_is_one_line_and_code_2(capsys, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert err.startswith("limen: ")
    assert err.count("\n") == 1
