"""``limen calibrate``: boards, photographs to a display file, a rehearsal, and wrong input in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image as Picture

import limen
from limen.calibrate import opencv
from limen.calibrate.boards import boards_of
from limen.calibrate.camera import Intrinsics
from limen.calibrate.rehearse import displaced
from limen.cli.app import main
from support import photographs

pytest.importorskip("cv2")


def run(capsys, *words):
    try:
        main([str(word) for word in words])
        code = 0
    except SystemExit as ended:
        code = ended.code
    text = capsys.readouterr()
    return code or 0, text.out, text.err


@pytest.fixture(scope="module")
def shoot(tmp_path_factory):
    """A folder with a display file and photographs of what hangs a little off."""
    folder = tmp_path_factory.mktemp("shoot")
    wall = photographs.wall()
    poses = photographs.around(wall, 1.35, [-35, -5, 15, 30], [0.3, -0.2, 0.5, 0.0])
    _, photos = photographs.photographed(wall, poses)
    (folder / "wall.toml").write_text(wall.to_toml())
    (folder / "photos").mkdir()
    for number, photo in enumerate(photos):
        # A tag that asks for a quarter turn, as phones write it: it must not be obeyed.
        tag = Picture.Exif()
        tag[0x0112] = 6 if number % 3 == 2 else 1
        Picture.fromarray(photo).save(folder / "photos" / f"{number}.jpg", quality=95, exif=tag)
    return folder


def test_boards_are_pictures_of_the_panels_own_pixels(capsys, tmp_path):
    out = tmp_path / "made" / "boards"
    code, text, _ = run(capsys, "calibrate", "boards", "--display", "cube", "--out", out, "--json")
    report = json.loads(text)
    cube = limen.Display.preset("cube")
    assert code == 0
    assert [row["panel"] for row in report["boards"]] == [panel.name for panel in cube.panels]
    for row, panel in zip(report["boards"], cube.panels, strict=True):
        with Picture.open(row["file"]) as picture:
            assert picture.size == panel.size_px
    assert sum(row["markers"] for row in report["boards"]) == sum(len(board.ids) for board in boards_of(cube))


def test_photographs_become_a_display_file_a_camera_and_a_picture(capsys, shoot, tmp_path):
    out, camera, picture = tmp_path / "out.toml", tmp_path / "camera.toml", tmp_path / "found.png"
    words = ("calibrate", "solve", shoot / "photos", "--display", shoot / "wall.toml", "--out", out)
    code, text, err = run(capsys, *words, "--save-camera", camera, "--report", picture, "--json")
    assert code == 0, err
    report = json.loads(text)
    truth = displaced(photographs.wall(), 0.02, 3.0, 1)
    found = limen.Display.load(out)
    gaps = [
        np.linalg.norm(a.centre_m - b.centre_m) - np.linalg.norm(c.centre_m - d.centre_m)
        for a, b, c, d in zip(found.panels, found.panels[1:], truth.panels, truth.panels[1:], strict=False)
    ]
    assert np.abs(gaps).max() < 0.0005
    assert report["rms_px"] < 0.3
    assert {row["panel"] for row in report["panels"]} == {panel.name for panel in found.panels}
    assert all(row["photos"] == 4 for row in report["panels"])
    assert len(report["photos"]) == 4
    assert report["warnings"] == []
    assert Intrinsics.load(camera).focal_px == pytest.approx(tuple(report["camera"]["focal_px"]))
    with Picture.open(picture) as drawn:
        sheet = np.asarray(drawn).astype(int)
    assert ((sheet[..., 0] > 200) & (sheet[..., 2] < 90)).mean() > 0.001, "panels are outlined in orange"
    code, text, _ = run(capsys, *words, "--camera", camera, "--fix", "wall/1,0")
    assert code == 0
    assert "wall/1,0" in text
    assert "px RMS" in text


def test_a_part_of_a_display_is_calibrated_by_the_same_boards(capsys, shoot, tmp_path):
    out = tmp_path / "out.toml"
    words = ("calibrate", "solve", shoot / "photos", "--display", shoot / "wall.toml", "--panels", "wall/[12],*")
    code, text, err = run(capsys, *words, "--out", out, "--json")
    assert code == 0, err
    report = json.loads(text)
    assert [row["panel"] for row in report["panels"]] == ["wall/1,0", "wall/2,0", "wall/1,1", "wall/2,1"]
    assert report["rms_px"] < 0.3
    before, after = limen.Display.load(shoot / "wall.toml").panels, limen.Display.load(out).panels
    same = [np.allclose(a.corners_m, b.corners_m, atol=1e-6) for a, b in zip(before, after, strict=True)]
    assert same == [True, False, False, True, False, False]


def test_mirrored_unreadable_and_missing_photographs_are_named(capsys, shoot, tmp_path):
    mirrored = tmp_path / "selfie.png"
    with Picture.open(shoot / "photos" / "0.jpg") as photo:
        photo.transpose(Picture.Transpose.FLIP_LEFT_RIGHT).save(mirrored)
    text_file, empty = tmp_path / "notes.jpg", tmp_path / "empty.jpg"
    text_file.write_text("not a picture")
    empty.touch()
    (tmp_path / "folder").mkdir()
    for path, said in (
        (mirrored, "mirrored"),
        (text_file, "no photograph that can be read"),
        (empty, "no photograph that can be read"),
        (tmp_path / "nowhere.jpg", "no such photograph"),
        (tmp_path / "folder", "no photographs in this folder"),
    ):
        words = ("calibrate", "solve", path, "--display", shoot / "wall.toml", "--out", tmp_path / "x.toml")
        code, out, err = run(capsys, *words)
        assert (code, out) == (2, "")
        assert err.count("\n") == 1
        assert path.name in err
        assert said in err
    assert not (tmp_path / "x.toml").exists()


def test_a_report_of_another_kind_is_refused_before_photographs_are_read(capsys, tmp_path):
    words = ("--display", "cube", "--out", tmp_path / "x.toml", "--report", tmp_path / "found.gif")
    code, _, err = run(capsys, "calibrate", "solve", tmp_path / "nowhere.jpg", *words)
    assert code == 2
    assert ".png or .jpg" in err


def test_a_rehearsal_says_how_well_it_went(capsys, tmp_path):
    words = ("calibrate", "rehearse", "--display", "cube", "--photos", 10, "--megapixels", 0.6, "--out", tmp_path)
    code, text, err = run(capsys, *words, "--json")
    assert code == 0, err
    report = json.loads(text)
    assert len(list(tmp_path.glob("*.jpg"))) == 10
    assert len(report["panels"]) == 5
    assert max(row["position_error_mm"] for row in report["panels"]) < 0.5


def test_a_rehearsal_of_nothing_is_refused(capsys):
    code, _, err = run(capsys, "calibrate", "rehearse", "--display", "cube", "--photos", 0)
    assert code == 2
    assert "at least 1 photograph" in err


def test_without_opencv_the_command_is_named(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(opencv.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    opencv.load.cache_clear()
    try:
        code, _, err = run(capsys, "calibrate", "boards", "--display", "cube", "--out", tmp_path)
    finally:
        opencv.load.cache_clear()
    assert code == 2
    assert "pip install" in err
    assert err.count("\n") == 1
