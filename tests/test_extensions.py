"""Packages that add to limen: the examples of the documentation, as an installer would lay them down."""

from __future__ import annotations

import re
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import limen
from limen.cli.app import main
from limen.data import opening
from limen.data.samples.mesh import torus_knot
from limen.errors import InputError
from limen.extensions import extension
from limen.frame.renderer import Renderer
from limen.layers import registry
from limen.layers.registry import KINDS
from limen.show.show import Show
from limen.track.tracker import open_tracker

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples/extensions"
PAGE = ROOT / "docs/contribute/add-a-kind.md"
EYE = limen.Viewer((0.0, 1.7, 2.0))


def install(folder: Path, package: Path) -> None:
    """A package of one module, and what is told of it: a wheel holds no more."""
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    for module in package.glob("*.py"):
        shutil.copy(module, folder)
    told = folder / f"{package.name}-{project['version']}.dist-info"
    told.mkdir()
    (told / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = (
        f"[{group}]\n" + "".join(f"{name} = {what}\n" for name, what in points.items())
        for group, points in project["entry-points"].items()
    )
    (told / "entry_points.txt").write_text("\n".join(groups))


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """All examples; what was loaded of them is forgotten afterwards."""
    for package in EXAMPLES.iterdir():
        install(tmp_path, package)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(registry, "KINDS", registry._Kinds(KINDS))
    return tmp_path


def test_a_file_format_is_opened_by_its_ending(installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (installed / "scan.xyz").write_text("0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n")
    points: Any = limen.open(installed / "scan.xyz")
    assert (points.kind, points.size) == ("points", 3)
    (layer,) = Show([installed / "scan.xyz"]).layers
    assert layer.kind == "points"
    assert opening.kind_of_file(installed / "scan.xyz") == "points"
    with pytest.raises(SystemExit, match="0"):
        main(["info", str(installed / "scan.xyz")])
    assert f"{installed / 'scan.xyz'}: points" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"scan\.xyz: is read by another package, and cannot be made ready"):
        opening.ingest(installed / "scan.xyz", installed / "scan.points")


def test_a_tracker_is_opened_by_its_name(installed: Path) -> None:
    tracker = open_tracker("circling:20")
    (before,), (after,) = tracker.viewers(0.0), tracker.viewers(10.0)
    assert before.position_m == (0.0, 1.7, 3.0)
    np.testing.assert_allclose(after.position_m, (0.0, 1.7, 1.0), atol=1e-9)
    assert len(tracker.pointers(1.0)) == 1
    tracker.close()
    with pytest.raises(InputError, match="no tracker is named 'sitting': install a package"):
        open_tracker("sitting")


@pytest.mark.gpu
@pytest.mark.drawing
def test_a_kind_of_layers_is_drawn_beside_those_that_there_are(installed: Path, device: Any) -> None:
    """Grid lines on the floor: lines, where they are to be, and each pixel theirs or that of a mesh among them."""
    from limen_grid import GridLayer  # type: ignore[import-not-found]

    wall = limen.Display.named("rostock").scaled(1 / 12)
    grid = drawn(device, wall, [GridLayer()])
    lit = {name: picture[..., 1] > 100 for name, picture in grid.items()}
    assert 0 < sum(each.sum() for each in lit.values()) < 0.2 * sum(each.size for each in lit.values())
    found = 0
    for place in ((x, 0.0, z) for x in range(-3, 4) for z in range(-5, 0)):
        for panel in wall.panels:
            pixel = seen_at(panel, np.array(place))
            if pixel is not None:
                found += 1
                around = lit[panel.name][pixel[1] - 1 : pixel[1] + 2, pixel[0] - 1 : pixel[0] + 2]
                assert around.any(), f"the crossing at {place} is seen on {panel.name} at {pixel}"
    assert found > 5
    knot = limen.MeshLayer(torus_knot(800), limen.RoomPlacement(size_m=2.0, at_m=(0.0, 0.6, -2.5)))
    both, alone = drawn(device, wall, [GridLayer(), knot]), drawn(device, wall, [knot])
    for name, picture in both.items():
        apart = [np.abs(picture - other[name]).max(axis=-1) > 1 for other in (grid, alone)]
        assert not (apart[0] & apart[1]).any()


def drawn(device: Any, display: limen.Display, layers: list[Any]) -> dict[str, Any]:
    with Renderer(device, display, layers, background=(0.0, 0.0, 0.0)) as renderer:
        frame = renderer.state(0.0, viewers=(EYE,))
        return {each.name: each.pixels[..., :3].astype(int) for each in renderer.pictures(frame)}


def seen_at(panel: Any, place: Any) -> tuple[int, int] | None:
    """The pixel of a panel through which a place is seen, not at its border; None if it is seen on another."""
    eye, normal = np.array(EYE.position_m), np.array(panel.normal)
    away = (panel.centre_m - eye) @ normal / ((place - eye) @ normal)
    hit = eye + away * (place - eye) - panel.origin_m
    x, y = int(hit @ np.array(panel.right) // panel.pitch_m[0]), int(hit @ np.array(panel.down) // panel.pitch_m[1])
    inside = 1 <= x < panel.size_px[0] - 1 and 1 <= y < panel.size_px[1] - 1
    return (x, y) if inside and away > 0 else None


# ---------------------------------------------------------------- the page that makes a kind


def blocks_of_page() -> dict[str, str]:
    """Its pieces of code by the files that they are of, each file's joined in their order."""
    files: dict[str, list[str]] = {}
    for file, code in re.findall(r'```\w+ title="([^"]+)"\n(.*?)```', PAGE.read_text(), flags=re.DOTALL):
        files.setdefault(file, []).append(code)
    return {file: "\n".join(codes) for file, codes in files.items()}


def lines_of(code: str) -> list[str]:
    return [line for line in code.splitlines() if line]


def test_the_page_shows_all_of_the_example() -> None:
    written = (EXAMPLES / "limen_grid/limen_grid.py").read_text()
    assert lines_of(blocks_of_page()["limen_grid.py"]) == lines_of(written)
    assert lines_of(blocks_of_page()["pyproject.toml"]) == lines_of(
        (EXAMPLES / "limen_grid/pyproject.toml").read_text()
    )
    assert len(written.splitlines()) < 150


@pytest.mark.gpu
@pytest.mark.drawing
def test_a_kind_is_shown_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the reader of the page, beside others; it hears what all kinds do that stand in the room."""
    package, site, blocks = tmp_path / "limen_grid", tmp_path / "site", blocks_of_page()
    package.mkdir()
    site.mkdir()
    for file in ("limen_grid.py", "pyproject.toml"):
        (package / file).write_text(blocks[file] + "\n" + blocks[f"{file}, at its end"])
    module = package / "limen_grid.py"
    module.write_text(
        module.read_text().replace("import wgpu\n", "import wgpu\nfrom limen.errors import FormatError\n")
    )
    install(site, package)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.delitem(sys.modules, "limen_grid", raising=False)
    monkeypatch.setattr(registry, "KINDS", registry._Kinds(KINDS))
    monkeypatch.chdir(tmp_path)
    Path("room.grid").write_text("5\n")
    Path("bad.grid").write_text("far\n")

    def shown(*options: str) -> str:
        with pytest.raises(SystemExit):
            main(["show", "--display", "rostock", "--scale", "0.05", "--out", "pictures", *options])
        return capsys.readouterr().err

    assert "no number" in shown("bad.grid")
    assert "the policy acuity is not for grid lines: give full" in shown("room.grid", "--policy", "acuity")
    assert "this content is grid lines: leave out --fit, which is for images" in shown("room.grid", "--fit", "cover")
    assert "leave out --size-m" in shown("room.grid", "--size-m", "1")
    assert not shown("room.grid", "--stereo", "anaglyph", "--background", "#000000", "--simulate", "--quiet")
    assert Path("pictures/frame-0000/eye.jpg").exists()


def test_what_cannot_be_loaded_is_named(installed: Path) -> None:
    told = installed / "limen_broken-1.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: limen-broken\nVersion: 1\n")
    (told / "entry_points.txt").write_text(
        "[limen.layers]\nbroken = no_such_module:KIND\nwrong = math:pi\n[limen.readers]\nxyz = math:sqrt\n"
    )
    assert extension("limen.layers", "nothing") is None
    with pytest.raises(InputError, match=r"'broken' of limen.layers, in limen-broken, cannot be imported"):
        registry.KINDS["broken"]
    with pytest.raises(InputError, match=r"'wrong' of limen.layers is a float, and has to be a Kind"):
        registry.KINDS["wrong"]
    with pytest.raises(InputError, match="is in limen-broken and limen-xyz: uninstall all but one"):
        extension("limen.readers", "xyz")
    with pytest.raises(InputError, match="no kind of layers is named 'sound': there are image, mesh"):
        registry.KINDS["sound"]
