"""Meshes from the command line: what is written, where the mesh stands, and what is refused."""

from __future__ import annotations

import json
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Picture

import limen
from limen.cli.app import main
from limen.cli.show_files import check_files
from limen.data import sample_image
from limen.data.samples.mesh import sample_mesh
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from support.processes import CHILD, LIMEN, finished, started

SEEN_PX = (320, 240)
Show = Callable[..., list[dict[str, Any]]]


@pytest.fixture(scope="module")
def knot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "knot.ply"
    sample_mesh(path, 2000)
    return path


@pytest.fixture(scope="module")
def slab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box of 1 x 0.2 x 0.6 about (5, 5, 5), without colours."""
    path = tmp_path_factory.mktemp("mesh") / "slab.ply"
    corners = [(5 + x / 2, 5 + y / 10, 5 + z * 0.3) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    write_ply(path, corners, [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    return path


def write_ply(path: Path, corners: list[Any], triangles: list[Any]) -> None:
    header = f"ply\nformat ascii 1.0\nelement vertex {len(corners)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, corner)) for corner in corners] + [f"3 {a} {b} {c}" for a, b, c in triangles]
    path.write_text(header + "\n".join(rows) + "\n")


def run(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@pytest.fixture
def show(device: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Show:
    """``limen show ... --json`` with the tests' adapter, as opening one takes seconds; the frames of its answer."""
    monkeypatch.setattr("limen.cli.show_files.open_device", lambda: nullcontext(device))
    monkeypatch.setattr("limen.cli.onlookers._SEEN_PX", SEEN_PX)
    count = 0

    def shown(*words: object) -> list[dict[str, Any]]:
        nonlocal count
        count += 1
        code = run("show", *words, "--out", tmp_path / str(count), "--format", "png", "--json")
        assert code == 0, capsys.readouterr().err
        frames: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["frames"]
        assert not list(tmp_path.rglob("*.partial*"))
        return frames

    return shown


def pictures(frame: dict[str, Any]) -> dict[str, NDArray[np.int64]]:
    """The frame's pictures (H, W, 3) by their names."""
    return {Path(name).stem: np.asarray(Picture.open(name)).astype(int)[..., :3] for name in frame["files"]}


def lit(picture: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where something is, brighter than the background."""
    return np.asarray(picture.max(axis=-1) > 40)


@pytest.mark.gpu
@pytest.mark.parametrize("how", ["ripple", "turn"])
def test_frames_are_told_and_an_animation_moves(knot: Path, show: Show, how: str) -> None:
    frames = show(knot, "--display", "cube", "--scale", 0.1, "--frames", 2, "--animate", how)
    assert [frame["time_s"] for frame in frames] == [0.0, 0.25]
    for frame in frames:
        (layer,) = frame["layers"]
        assert {"policy", "items", "chunks", "error_px", "stream_ms"} <= set(layer)
        assert layer["panels_active"] == 3
        assert layer["drawn"] > 1500, "about every triangle is on a panel"
        assert min(layer["select_ms"], layer["draw_ms"]) > 0
        assert len(frame["files"]) == 5
    first, second = (pictures(frame) for frame in frames)
    assert list(first) == ["front-0,0", "right-0,0", "back-0,0", "left-0,0", "top-0,0"]
    assert lit(first["front-0,0"]).sum() > 100
    assert np.abs(first["front-0,0"] - second["front-0,0"]).max() > 40


@pytest.mark.gpu
def test_the_eye_sees_the_mesh_as_if_the_display_were_not_there(knot: Path, show: Show, device: Any) -> None:
    from limen.display.panel import Panel
    from limen.geometry import as_vec3
    from limen.layers.common.room_placement import mesh_in_room
    from limen.viewing.eye_camera import eye_camera
    from limen.viewing.standing import standing_viewer

    (frame,) = show(knot, "--display", "cube", "--scale", 0.3, "--simulate")
    seen = pictures(frame)
    assert set(seen) >= {"eye", "elsewhere", "afar"}
    cube = limen.Display.preset("cube")
    viewer, mesh = standing_viewer(cube), limen.open(knot)
    assert isinstance(mesh, limen.Mesh)
    camera = eye_camera(cube, np.array(viewer.position_m), SEEN_PX, viewer.direction)
    right, down, forward = camera.axes
    pitch_m = 1 / camera.focal_px
    corner = np.array(camera.eye_m) + forward - (right * SEEN_PX[0] + down * SEEN_PX[1]) * pitch_m / 2
    panel = Panel("eye", SEEN_PX, as_vec3(corner, ""), as_vec3(right, ""), as_vec3(down, ""), (pitch_m, pitch_m))
    alone = limen.Display("eye", (panel,))
    stands = mesh_in_room(mesh.bounds, cube)
    direct = limen.render(mesh, alone, [viewer], placement=stands, device=device)["eye"].astype(int)[..., :3]
    assert lit(direct).mean() > 0.05
    assert (lit(direct) & lit(seen["eye"])).sum() > 0.95 * (lit(direct) | lit(seen["eye"])).sum()
    both = lit(direct) & lit(seen["eye"])
    assert np.abs(direct - seen["eye"])[both].mean() < 8
    apart = lit(seen["elsewhere"]) ^ lit(seen["eye"])
    assert apart.sum() > 0.3 * lit(seen["eye"]).sum(), "from elsewhere the scene is bent"
    assert lit(seen["afar"]).sum() > 100
    (from_the_eye,) = show(
        knot, "--display", "cube", "--scale", 0.3, "--simulate", "--seen-from", ",".join(map(str, viewer.position_m))
    )
    again = pictures(from_the_eye)
    np.testing.assert_allclose(again["elsewhere"], again["eye"], atol=2)


@pytest.mark.gpu
def test_the_overlay_tints_panels(slab: Path, show: Show) -> None:
    words = (slab, "--display", "rostock", "--panels", "wall/[23],1", "--scale", 0.05)
    (plain,), (tinted,) = show(*words), show(*words, "--overlay", "panels")
    colours = []
    for name, picture in pictures(tinted).items():
        without = pictures(plain)[name]
        on = lit(without)
        assert on.any()
        assert np.ptp(without[on].mean(axis=0)) < 3, "the slab is grey"
        colours.append(picture[on].mean(axis=0))
        assert np.ptp(colours[-1]) > 10
    assert np.abs(colours[0] - colours[1]).max() > 10


@pytest.mark.gpu
def test_two_eyes_come_in_three_ways(slab: Path, show: Show) -> None:
    words = (slab, "--display", "desktop", "--scale", 0.1)
    seen = {how: pictures(show(*words, "--stereo", how)[0]) for how in ("anaglyph", "side-by-side", "sequential")}
    after = seen["sequential"]
    assert len(after) == 2
    left, right = (next(picture for name, picture in after.items() if name.endswith(eye)) for eye in ("left", "right"))
    np.testing.assert_array_equal(next(iter(seen["side-by-side"].values())), np.concatenate([left, right], axis=1))
    (mixed,) = seen["anaglyph"].values()
    np.testing.assert_array_equal(mixed[..., 0], left[..., 0])
    np.testing.assert_array_equal(mixed[..., 1:], right[..., 1:])
    columns = [np.nonzero(lit(picture))[1].mean() for picture in (left, right)]
    assert columns[0] < columns[1] - 1, "what is behind the screen is farther left for the left eye"


@pytest.mark.gpu
def test_quilts_are_written_whole(knot: Path, show: Show) -> None:
    words = (knot, "--display", "cube", "--scale", 0.1)
    (frame,) = show(*words, "--write", "quilts")
    ((name, quilt),) = pictures(frame).items()
    assert name == "quilt-0"
    panels = pictures(show(*words)[0])
    assert lit(quilt).sum() >= sum(int(lit(picture).sum()) for picture in panels.values()) > 100
    (both,) = pictures(show(*words, "--write", "quilts", "--stereo", "side-by-side")[0]).values()
    assert lit(both[:, : both.shape[1] // 2]).any()
    assert lit(both[:, both.shape[1] // 2 :]).any()


@pytest.mark.gpu
def test_the_quilts_of_a_display_are_written_as_its_file_has_them(knot: Path, show: Show, tmp_path: Path) -> None:
    wall = tmp_path / "wall.toml"
    (panel,) = Display.preset("desktop").scaled(0.1).panels
    size = panel.size_px
    quilt = f'[[quilt]]\nsize_px = [{size[0] + 30}, {size[1] + 20}]\noutput = "left"\n'
    place = f'[[quilt.panel]]\nname = "{panel.name}"\noffset_px = [9, 7]\n'
    wall.write_text(Display("desk", (panel,)).to_toml() + quilt + place)
    (frame,) = show(knot, "--display", wall, "--write", "quilts")
    (name,) = frame["files"]
    assert Path(name).stem == "left"
    with Picture.open(name) as picture:
        assert picture.size == (size[0] + 30, size[1] + 20)
    assert frame["scale"] == 1


@pytest.mark.gpu
def test_a_part_of_a_wall_shows_what_the_whole_shows(knot: Path, show: Show) -> None:
    words = (knot, "--display", "rostock", "--session", "A", "--frames", 2, "--scale", 0.05)
    whole, part = show(*words), show(*words, "--panels", "wall/2,*")
    assert whole[0]["time_s"] < whole[1]["time_s"]
    assert len(whole[0]["files"]) == 24
    assert len(part[0]["files"]) == 4
    for everything, some in zip(whole, part, strict=True):
        all_of_it = pictures(everything)
        for name, picture in pictures(some).items():
            assert (np.abs(picture - all_of_it[name]).max(axis=-1) > 8).mean() < 0.003, name
    assert any(lit(picture).any() for picture in pictures(part[0]).values())
    assert any((pictures(whole[0])[name] != picture).any() for name, picture in pictures(whole[1]).items())


@pytest.mark.gpu
def test_a_mesh_lies_where_it_is_put(slab: Path, show: Show) -> None:
    """On the desktop's screen (0.6 x 0.34 m about (0, 1.2, -0.7)) itself, where it is seen in its own size."""
    screen = limen.Display.preset("desktop").scaled(0.1).panels[0]
    words = (slab, "--display", "desktop", "--scale", 0.1, "--viewer", "0,1.2,9")

    def extent(*more: object) -> tuple[float, float, float, float]:
        """Middle and size of what is lit, metres in the room."""
        (picture,) = pictures(show(*words, *more)[0]).values()
        rows, columns = np.nonzero(lit(picture))
        x = screen.origin_m[0] + np.array([columns.min(), columns.max() + 1]) * screen.pitch_m[0]
        y = screen.origin_m[1] - np.array([rows.min(), rows.max() + 1]) * screen.pitch_m[1]
        return (float(x.mean()), float(y.mean()), float(np.ptp(x)), float(np.ptp(y)))

    pixel = 2 * screen.pitch_m[0]
    at = ("--size-m", 0.2, "--at", "-0.1,1.25,-0.7")
    assert extent(*at) == pytest.approx((-0.1, 1.25, 0.2, 0.04), abs=pixel)
    assert extent(*at, "--up", "z") == pytest.approx((-0.1, 1.25, 0.2, 0.12), abs=pixel)
    assert extent(*at, "--turn-deg", 90) == pytest.approx((-0.1, 1.25, 0.12, 0.04), abs=pixel)
    # Its front 1.94 m from an eye that is 1 m before the screen: half as large, and half as far from the middle.
    words = words[:-2]
    near = ("--at", "-0.1,1.2,-1.7", "--size-m", 0.2, "--viewer", "0,1.2,0.3")
    expected = (-0.1 / 1.94, 1.2, 0.2 / 1.94, 0.04 / 1.94)
    assert extent(*near) == pytest.approx(expected, abs=pixel)


@pytest.mark.gpu
def test_the_background_has_the_colour_asked_for(slab: Path, show: Show) -> None:
    (picture,) = pictures(show(slab, "--display", "desktop", "--scale", 0.1, "--background", "#336699")[0]).values()
    np.testing.assert_allclose(picture[0, 0], (0x33, 0x66, 0x99), atol=1)


@pytest.mark.gpu
def test_a_viewer_in_a_panels_plane_sees_nothing_on_it(knot: Path, show: Show) -> None:
    """The cube's front lies in z = 0.15: it stays dark, and the others show what they should."""
    (frame,) = show(knot, "--display", "cube", "--scale", 0.1, "--viewer", "0.6,1.2,0.15", "--simulate")
    seen = pictures(frame)
    assert frame["layers"][0]["panels_active"] == 1
    assert not lit(seen["front-0,0"]).any()
    assert lit(seen["right-0,0"]).any()


@pytest.mark.gpu
def test_inside_an_object_every_panel_is_dark(knot: Path, show: Show) -> None:
    (frame,) = show(knot, "--display", "cube", "--scale", 0.1, "--viewer", "0,1.2,0")
    assert frame["layers"][0]["panels_active"] == frame["layers"][0]["drawn"] == 0
    assert not any(lit(picture).any() for picture in pictures(frame).values())


SESSION = """# limen session 1: {"name": "two", "display": "rostock", "rate_hz": 1}
time_s,viewer,x_m,y_m,z_m,direction_x,direction_y,direction_z
0.0,ann,-0.5,1.7,0.5,0,0,-1
0.0,bob,0.5,1.7,1.5,0,0,-1
1.0,bob,0.6,1.7,1.5,0,0,-1
5.0,bob,0.9,1.7,1.5,0,0,-1
"""


@pytest.mark.gpu
def test_the_first_of_several_viewers_is_drawn_for_and_a_lost_one_stays(
    knot: Path, tmp_path: Path, device: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ann's tracker is lost after a second: she is taken to stand where she was, and no frame is missing."""
    monkeypatch.setattr("limen.cli.show_files.open_device", lambda: nullcontext(device))
    (tmp_path / "two.csv").write_text(SESSION)
    words = ("show", knot, "--display", "rostock", "--panels", "wall/2,*", "--scale", 0.05, "--frames", 3)
    assert run(*words, "--session", tmp_path / "two.csv", "--out", tmp_path / "two", "--json") == 0
    told = capsys.readouterr()
    assert told.err.count("drawn for one viewer: the first of 2 ('ann')") == 1
    frames = json.loads(told.out)["frames"]
    assert len(frames) == 3
    assert run(*words[:-2], "--viewer", "-0.5,1.7,0.5", "--out", tmp_path / "ann", "--json") == 0
    told = capsys.readouterr()
    assert "viewer" not in told.err
    (alone,) = json.loads(told.out)["frames"]
    for frame in frames:
        for name, picture in pictures(frame).items():
            np.testing.assert_array_equal(picture, pictures(alone)[name])


@pytest.mark.gpu
def test_a_wall_of_many_panels_is_drawn_small(knot: Path, show: Show) -> None:
    (frame,) = show(knot, "--display", "reality-deck", "--panels", "front/*", "--scale", 0.1)
    names = [panel.name for panel in limen.Display.preset("reality-deck").select("front/*").panels]
    seen = pictures(frame)
    assert sorted(seen) == sorted(name.replace("/", "-") for name in names)
    assert {picture.shape for picture in seen.values()} == {(144, 256, 3)}
    dark = sum(not lit(picture).any() for picture in seen.values())
    assert 4 < len(seen) - dark < len(seen) / 2, "the mesh fills the height of the wall, and not its width"


@pytest.mark.gpu
def test_a_display_too_fine_to_be_simulated_is_simulated_coarser(
    knot: Path, show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (knot, "--display", "rostock", "--scale", 0.1, "--simulate", "--animate", "turn", "--frames", 2)
    fine = pictures(show(*words)[1])
    monkeypatch.setattr("limen.cli.onlookers._LIT_PX", 200_000)
    coarse = pictures(show(*words)[1])
    assert set(coarse) == set(fine)
    np.testing.assert_array_equal(coarse["wall-2,1"], fine["wall-2,1"])
    both, either = lit(coarse["eye"]) & lit(fine["eye"]), lit(coarse["eye"]) | lit(fine["eye"])
    assert 0.85 < both.sum() / either.sum() < 1, "the same, drawn with larger pixels"


NAN = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n" + (
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n"
)


@pytest.mark.gpu
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("none.ply",), "none.ply: there is no such file"),
        (("nan.ply",), "not finite, the first is vertex 1"),
        (("point.ply",), "lie in one point"),
        (("knot.ply", "--background", "teal"), "#rrggbb, got 'teal'"),
        (("knot.ply", "--background", "#12345g"), "#rrggbb, got '#12345g'"),
        (("knot.ply", "--stereo", "polarised"), "stereo"),
        (("knot.ply", "--overlay", "levels"), "--overlay levels is not for a mesh: give --overlay panels"),
        (("world.tif", "--overlay", "panels"), "--overlay panels is not for an image: give --overlay levels or error"),
        (("world.tif", "--stereo", "anaglyph"), "this content is an image"),
        (("knot.ply", "--size-m", "0"), "positive number of metres, got 0"),
        (("knot.ply", "--at", "1,2"), "--at takes three numbers"),
        (("knot.ply", "--seen-from", "1,2,3"), "give --simulate too"),
        (("knot.ply", "--seen-from", "1,2", "--simulate"), "--seen-from takes three numbers"),
        (("knot.ply", "--stereo", "sequential", "--simulate"), "what one eye sees"),
        (("knot.ply", "--panels", "left/*", "--display", "rostock"), "no panel of 'rostock' matches left/*"),
        (("knot.ply", "--session", "A", "--viewer", "0,0,0"), "--session or --viewer, not both"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(
    words: tuple[str, ...], says: str, knot: Path, tmp_path: Path, device: Any,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("limen.cli.show_files.open_device", lambda: nullcontext(device))
    shutil.copy(knot, "knot.ply")
    Path("nan.ply").write_text(NAN)
    write_ply(Path("point.ply"), [(1, 2, 3)] * 3, [(0, 1, 2)])
    if words[0] == "world.tif":
        sample_image(Path("world.tif"), 0.0001)
        capsys.readouterr()
    assert run("show", *words, "--out", "out") == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert len(told.err.strip().splitlines()) == 1, told.err
    assert says in told.err
    assert not Path("out").exists()


@pytest.mark.gpu
def test_ctrl_c_leaves_whole_pictures(knot: Path, tmp_path: Path) -> None:
    words = ["show", str(knot), "--display", "cube", "--scale", "0.1", "--frames", "10000", "--out", str(tmp_path)]
    with started([*LIMEN, *words]) as running:
        deadline = time.monotonic() + 60
        while not list(tmp_path.rglob("*.jpg")) and running.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=60)
    assert running.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert written
    for path in written:
        assert path.suffix == ".jpg"
        Picture.open(path).load()


@pytest.mark.gpu
def test_a_window_opens_and_closes(knot: Path) -> None:
    """A real window on a virtual screen: the simulated cube, walked around."""
    if shutil.which("xvfb-run") is None:
        pytest.skip("NO VIRTUAL SCREEN: install xvfb to test windows")
    window = [*CHILD, "xvfb-run", "-a", *LIMEN, "show", knot, "--display", "cube", "--seconds", 1, "--json"]
    done = finished(window, timeout_s=120)
    assert done.returncode == 0, done.stderr
    (frame,) = json.loads(done.stdout)["frames"]
    assert frame["layers"][0]["panels_active"] == 3
    assert frame["layers"][0]["drawn"] > 1500


@pytest.mark.parametrize(
    ("outputs", "write", "simulated", "says"),
    [
        (("a/b", "A-b"), "quilts", (), "of 'A-b' and of 'a/b' would be one file"),
        (("", "quilt-0"), "quilts", (), "of 'quilt-0' and of 'quilt-0' would be one file"),
        (("left", "room"), "quilts", ("room", "surface"), "of 'room' and of '--simulate' would be one file"),
    ],
)
def test_pictures_that_would_be_written_over_each_other_are_refused(
    outputs: tuple[str, str], write: Any, simulated: tuple[str, ...], says: str
) -> None:
    wall = Display.preset("rostock").select(["wall/0,0", "wall/1,0"])
    width, height = wall.panels[0].size_px
    quilts = tuple(Quilt((width, height), (k,), ((0, 0),), output=name) for k, name in enumerate(outputs))
    with pytest.raises(InputError, match=says):
        check_files(replace(wall, quilts=quilts), write, simulated)
    check_files(replace(wall, quilts=quilts), "panels", simulated)
