"""The verbs that draw, from the command line: their JSON, their files, and what they say on bad days."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from limen.cli.app import main
from limen.data import sample_image
from limen.display.display import Display
from limen.study import demo
from limen.study.traffic import count_traffic
from limen.track.walk import session_named
from limen.viewing.placement import OnSurface, texel_pointed_at
from support.processes import CHILD, LIMEN, finished, started


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("world") / "world.tif"
    sample_image(path, 0.01)
    return path


def limen(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@pytest.mark.gpu
def test_show_writes_what_it_promises(world, tmp_path, capsys):
    out = tmp_path / "frames"
    words = ("show", world, "--display", "rostock", "--session", "A", "--frames", 2, "--out", out, "--scale", 0.1)
    assert limen(*words, "--panels", "wall/0,*", "--simulate", "--json") == 0
    frames = json.loads(capsys.readouterr().out)["frames"]
    assert len(frames) == 2
    for frame in frames:
        assert set(frame) == {"number", "time_s", "scale", "layers", "files"}
        (layer,) = frame["layers"]
        assert {"kind", "name", "policy", "panels_active", "items", "drawn", "chunks", "missing", "uploads"} <= set(
            layer
        )
        assert {"error_px", "allowed_px", "distance_factor", "select_ms", "stream_ms", "draw_ms"} <= set(layer)
        assert (layer["kind"], layer["name"]) == ("image", "world.tif")
        assert len(frame["files"]) == 4 + 2
        assert layer["items"] > 0
    assert frames[0]["time_s"] < frames[1]["time_s"]
    pictures = [Path(name) for frame in frames for name in frame["files"]]
    assert all(path.exists() for path in pictures)
    with Picture.open(pictures[0]) as panel:
        assert panel.size == (192, 120)
    assert not list(tmp_path.rglob("*.partial*"))


@pytest.mark.gpu
def test_the_overlay_shows_near_detail_in_red(world, tmp_path, capsys):
    words = ("show", world, "--display", "rostock", "--fit", "cover", "--overlay", "levels", "--format", "png")
    assert limen(*words, "--viewer", "-1.4,2,-1.3", "--out", tmp_path, "--scale", 0.25, "--json") == 0
    files = [Path(name) for name in json.loads(capsys.readouterr().out)["frames"][0]["files"]]
    by_name = {path.stem: np.asarray(Picture.open(path)).astype(int).mean(axis=(0, 1)) for path in files}
    near, far = by_name["wall-0,0"], by_name["wall-5,3"]
    assert near[0] - near[1] > far[0] - far[1], "more red beside the viewer"


@pytest.mark.gpu
@pytest.mark.parametrize("policy", ["acuity", "contrast"])
def test_a_preview_tells_what_the_true_panels_need(policy, world, tmp_path, capsys):
    words = ("show", world, "--display", "rostock", "--panels", "wall/2,1", "--fit", "cover", "--policy", policy)
    frames = []
    for scale in ("1", "0.1"):
        assert limen(*words, "--viewer", "-1.4,2,-1.3", "--out", tmp_path / scale, "--scale", scale, "--json") == 0
        frames += json.loads(capsys.readouterr().out)["frames"]
    true, small = frames
    (few,), (many,) = small["layers"], true["layers"]
    assert (few["items"], few["chunks"], few["error_px"]) == (many["items"], many["chunks"], many["error_px"])
    assert (true["scale"], small["scale"]) == (1.0, pytest.approx(0.1))


@pytest.mark.gpu
def test_a_window_opens_and_closes(world):
    """A real window on a virtual screen, drawn for some seconds."""
    if shutil.which("xvfb-run") is None:
        pytest.skip("NO VIRTUAL SCREEN: install xvfb to test windows")
    for words, late in (([], 0.1), (["--display", "rostock", "--session", "A", "--overlay", "levels"], 0.3)):
        window = [*CHILD, "xvfb-run", "-a", *LIMEN, "show", world, *words, "--seconds", 3, "--json"]
        done = finished(window, timeout_s=120)
        assert done.returncode == 0, done.stderr
        (shown,) = json.loads(done.stdout)["frames"][0]["layers"]
        assert shown["items"] > 0
        # Before a still viewer everything has come; before a walking one, nearly.
        assert shown["missing"] <= late * shown["items"]


@pytest.mark.timeout(600)  # it makes an image of 0.66 gigapixels
@pytest.mark.gpu
def test_demo_leaves_a_report_that_stands_alone(world, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "_PAPERS_HZ", 0.5)
    monkeypatch.setattr(demo, "_FILM_FRAMES", 3)
    monkeypatch.setattr(demo, "_PREVIEW_SCALE", 1 / 40)
    # Its own walk, too, is looked at once a second: what every frame needs is counted by tests of the counting.
    monkeypatch.setattr(demo, "count_traffic", partial(count_traffic, rate_hz=1.0))
    assert limen("demo", "--content", world, "--out", tmp_path / "demo", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    report = Path(result["report"])
    text = report.read_text()
    assert not re.findall(r'(?:src|href)="(?!data:|#)', text), "nothing is loaded from elsewhere"
    assert "$" not in re.sub(r"data:[^\"]+", "", text), "every placeholder is filled"
    for name in result["pictures"]:
        path = Path(name)
        assert path.exists()
        if path.suffix == ".jpg":
            assert np.asarray(Picture.open(path)).std() > 5, f"{path.name} is blank"
    rows = result["traffic"]["sessions"][0]["rows"]
    assert [row["policy"] for row in rows] == ["full", "acuity", "acuity", "acuity", "acuity+gaze", "contrast+gaze"]
    paper = result["traffic_one_to_one"]["sessions"]
    assert [session["name"] for session in paper] == ["A", "B", "C"]
    assert 0.86 < paper[0]["rows"][1]["saving"] < 0.90


def test_display_lists_draws_and_converts(tmp_path, capsys):
    words = ("display", "rostock", "--picture", tmp_path / "room.png", "--to-toml", tmp_path / "copy.toml", "--json")
    assert limen(*words) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["name"] == "rostock"
    assert report["total_px"] == 24 * 1920 * 1200
    assert {"name", "size_px", "size_m", "pitch_m", "optimal_distance_m"} <= set(report["panels"][0])
    assert {panel["luminance_cd_m2"] for panel in report["panels"]} == {100}
    assert np.asarray(Picture.open(tmp_path / "room.png")).std() > 5
    assert limen("display", "rostock", "--quilt", "--picture", tmp_path / "quilt.png", "--json") == 0
    quilts = json.loads(capsys.readouterr().out)["quilts"]
    assert [quilt["panels"] for quilt in quilts] == [4] * 6, "one for each node"
    assert all(0.99 < quilt["fill"] < 1 for quilt in quilts), "a gap around each panel"
    assert np.asarray(Picture.open(tmp_path / "quilt.png"))[::10, ::10].std() > 5
    assert limen("display", tmp_path / "copy.toml") == 0
    assert "24 panels" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("show", "none.tif", "--out", "x"), "none.tif: there is no such file"),
        (("show", "cut.tif", "--out", "x"), "cut.tif"),
        (("show", "text.tif", "--out", "x"), "text.tif"),
        (("show", "world.tif", "--display", "nowhere", "--out", "x"), "no display is named 'nowhere'"),
        (("show", "world.tif", "--display", "bad.toml", "--out", "x"), "bad.toml:5: Object contains unknown"),
        (("show", "world.tif", "--display", "empty.toml", "--out", "x"), "empty.toml: no panels"),
        (("show", "world.tif", "--display", "rostock", "--session", "nan.csv", "--out", "x"), "nan.csv:3: x_m"),
        (("show", "world.tif", "--viewer", "1,2", "--out", "x"), "--viewer takes three numbers"),
        (("show", "world.tif", "--policy", "best", "--out", "x"), "no policy is named 'best'"),
        (("show", "world.tif", "--acuity-arcmin", "0", "--out", "x"), "acuity must lie above 0"),
        (("show", "world.tif", "--frames", "0", "--out", "x"), "--frames must be at least 1"),
        (("show", "world.tif", "--scale", "2", "--out", "x"), "scale must lie above 0"),
        (("show", "world.tif", "--out", "world.tif/x"), "world.tif"),
        (("display", "rostock", "--picture", "room.gif"), "must end in .png or .jpg"),
        (("demo", "--content", "none.jpg"), "none.jpg: there is no such file"),
        (("bench", "everything"), "no benchmark is named 'everything'"),
        (("shoe", "world.tif"), "did you mean 'show'"),
        (("show",), "CONTENT"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(words, says, world, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(world, "world.tif")
    Path("cut.tif").write_bytes(world.read_bytes()[:5000])
    Path("text.tif").write_text("this is not a picture")
    Path("empty.toml").write_text("name = 'nothing'\n")
    Path("bad.toml").write_text("name = 'x'\n[[grid]]\nname = 'a'\nsize_px = [9, 9]\ncolour = 'red'\n")
    Path("nan.csv").write_text(
        '# limen session 1: {"name": "n", "display": "rostock", "rate_hz": 60}\n'
        "time_s,viewer,x_m,y_m,z_m,direction_x,direction_y,direction_z\n0.0,v,nan,1.7,0,0,0,-1\n"
    )
    before = sorted(Path().iterdir())
    assert limen(*words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1, captured.err
    assert says in captured.err
    assert "Traceback" not in captured.err
    left = [path for path in sorted(Path().iterdir()) if path not in before]
    assert not [path for path in left if path.is_file()], "nothing half-written"


@pytest.mark.parametrize("verb", [("show",), ("demo", "--content")])
def test_without_an_adapter_one_line_says_what_to_install(verb, world, tmp_path):
    environment = {**os.environ, "VK_DRIVER_FILES": "/nonexistent.json", "VK_LOADER_DRIVERS_DISABLE": "*"}
    environment |= {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json", "LIBGL_DRIVERS_PATH": "/nonexistent"}
    environment |= {"WGPU_BACKEND_TYPE": "Vulkan", "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run(
        [*LIMEN, *verb, str(world), "--out", str(tmp_path / "x")],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "no graphics adapter" in done.stderr
    assert "mesa-vulkan-drivers" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.gpu
def test_a_window_without_a_screen_says_so(world):
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = finished([*LIMEN, "show", world], timeout_s=120, env=environment)
    assert done.returncode == 2, done.stderr
    assert "--out" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


def wait_until_at_work(running: subprocess.Popen[str], out: Path) -> None:
    """Until it writes, or has worked for longer than it takes to start; 6 s where nobody tells how long that is."""
    spent, starting_s = Path(f"/proc/{running.pid}/stat"), 2.5
    ends = time.monotonic() + (60 if spent.exists() else 6)
    while time.monotonic() < ends and running.poll() is None and not any(out.iterdir()):
        if spent.exists():
            ticks = sum(map(int, spent.read_text().rpartition(")")[2].split()[11:13]))
            if ticks > starting_s * os.sysconf("SC_CLK_TCK"):
                break
        time.sleep(0.05)


@pytest.mark.gpu
@pytest.mark.parametrize("words", [
    ("show", "{world}", "--display", "reality-deck", "--out", "{out}"),
    ("sample", "image", "{out}/big.tif", "--gigapixels", "1"),
    ("traffic", "one-to-one", "--display", "reality-deck", "--session", "A", "B", "C", "--rate-hz", "120"),
    ("demo", "--content", "{world}", "--out", "{out}"),
])  # fmt: skip
def test_ctrl_c_ends_cleanly(words, world, tmp_path):
    filled = [word.format(world=world, out=tmp_path) for word in words]
    with started([*LIMEN, *filled]) as running:
        wait_until_at_work(running, tmp_path)
        assert running.poll() is None, running.communicate()[1]
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=60)
    # Python ends by the signal itself, after our own message, where Ctrl-C fell into code made from a string
    # (a dataclass's `__init__`, say); a shell calls both 130.
    assert running.returncode in {130, -signal.SIGINT}, err
    assert "Traceback" not in err
    assert "interrupted" in err
    assert not [path for path in tmp_path.rglob("*") if "partial" in path.name or path.name == "big.tif"]


@pytest.mark.gpu
def test_lenses_change_what_they_reach(tmp_path, capsys):
    width, height = 3200, 2000
    squares = np.random.default_rng(0).integers(0, 256, (50, 80, 3), dtype=np.uint8)
    Picture.fromarray(squares.repeat(40, axis=0).repeat(40, axis=1)).save(tmp_path / "squares.png")
    words = (
        "show",
        tmp_path / "squares.png",
        "--display",
        "desktop",
        "--scale",
        0.1,
        "--format",
        "png",
        "--json",
        "--out",
    )
    assert limen(*words, tmp_path / "plain") == 0
    plain = json.loads(capsys.readouterr().out)["frames"][0]
    lens = f"{width / 2},{height / 2},{height / 4},6"
    assert (
        limen(*words, tmp_path / "lens", "--lens", lens, "--lens-drop-off", "gaussian", "--lens-shape", "rectangular")
        == 0
    )
    through = json.loads(capsys.readouterr().out)["frames"][0]
    before, after = (np.asarray(Picture.open(frame["files"][0])).astype(int) for frame in (plain, through))
    how = ("--lens-drop-off", "gaussian", "--lens-shape", "rectangular", "--lens-mode", "coarse", "--overlay", "error")
    track = tmp_path / "still.csv"
    track.write_text(f"time_s,x_px,y_px,radius_px,magnification\n0,{lens}\n")
    assert limen(*words[:-2], "--quiet", "--out", tmp_path / "coarse", "--lens", track, *how) == 0
    coarse = np.asarray(Picture.open(next((tmp_path / "coarse").rglob("*.png")))).astype(int)
    red = (coarse[..., 0] > coarse[..., 1:3].max(axis=-1) + 80).mean()
    assert 0.01 < red < 0.3, "two triangles a page do not show a lens"
    changed = np.abs(after - before).max(axis=-1) > 12
    assert 0.02 < changed.mean() < 0.3
    assert not changed[:, : changed.shape[1] // 4].any()
    assert through["layers"][0]["items"] > plain["layers"][0]["items"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--lens", "1,2,3"), "give X,Y,RADIUS,MAGNIFICATION"),
        (("--lens", "a,b,c,d"), "give X,Y,RADIUS,MAGNIFICATION"),
        (("--lens", "1,2,0,4"), "radius_px must be above 0"),
        (("--lens", "1,2,9,0.5"), "magnification must be 1 or more"),
        (("--lens", "1,2,9,nan"), "magnification must be 1 or more"),
        (("--lens", "1,2,9,4", "--lens-focus", "1"), "focus must lie from 0 to below 1"),
        (("--lens", "1,2,9,4", "--lens-heights", "none.png"), "there is no such file"),
        (("--lens", "none.csv"), "none.csv: cannot be read"),
    ],
)
def test_lenses_that_cannot_be_are_one_line(world, tmp_path, capsys, words, says):
    assert limen("show", world, "--display", "desktop", "--out", tmp_path / "out", *words) == 2
    said = capsys.readouterr().err
    assert says in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.gpu
def test_a_sessions_pointers_carry_lenses(tmp_path, capsys):
    squares = np.random.default_rng(0).integers(0, 256, (50, 120, 3), dtype=np.uint8)
    Picture.fromarray(squares.repeat(20, axis=0).repeat(20, axis=1)).save(tmp_path / "squares.png")
    walk = tmp_path / "walk.csv"
    assert limen("walk", "--display", "rostock", "--seconds", 4, "--pointers", 1, walk) == 0
    capsys.readouterr()
    words = (
        "show",
        tmp_path / "squares.png",
        "--display",
        "rostock",
        "--scale",
        0.1,
        "--format",
        "png",
        "--session",
        walk,
    )
    assert limen(*words, "--lens", "pointer,200,5", "--out", tmp_path / "carried", "--json") == 0
    frame = json.loads(capsys.readouterr().out)["frames"][0]
    display, session = Display.preset("rostock"), session_named(str(walk), Display.preset("rostock"))
    (pointer,) = session.pointers_at(frame["time_s"])
    shown = display.scaled(0.1)
    x, y = texel_pointed_at(shown, OnSurface().panel_maps(shown, (2400, 1000)), pointer)
    assert limen(*words, "--lens", f"{x},{y},200,5", "--out", tmp_path / "fixed") == 0
    one, other = (
        np.concatenate([np.asarray(Picture.open(path)) for path in sorted((tmp_path / name).rglob("wall-*.png"))])
        for name in ("carried", "fixed")
    )
    np.testing.assert_allclose(one.astype(int), other.astype(int), atol=1)


def test_without_a_pointer_nothing_is_carried(tmp_path, capsys):
    Picture.new("RGB", (64, 64)).save(tmp_path / "black.png")
    words = (
        "show",
        tmp_path / "black.png",
        "--display",
        "rostock",
        "--lens",
        "pointer,20,4",
        "--out",
        tmp_path / "out",
    )
    assert limen(*words) == 2
    assert "nobody points: give a --session with pointers" in capsys.readouterr().err
