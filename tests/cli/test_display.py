"""``limen display`` of meshes: checked, packed, written, refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import limen
from limen.cli.app import main

CUBE = "\n".join(
    [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    + ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4", ""]
)


def _run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    try:
        main([str(word) for word in words])
        code = 0
    except SystemExit as ended:
        code = int(ended.code or 0)
    text = capsys.readouterr()
    return code, text.out, text.err


def _report(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    code, out, err = _run(capsys, *words, "--json")
    assert code == 0, err
    return dict(json.loads(out))


def test_a_mesh_is_packed_drawn_and_saved_with_its_quilt(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_text(CUBE)
    saved, picture = tmp_path / "box.toml", tmp_path / "q.png"
    report = _report(
        capsys, "display", tmp_path / "box.obj", "--ppi", 25.4, "--scale", 0.5, "--quilt", "--to-toml", saved,
        "--picture", picture,
    )  # fmt: skip
    assert report["name"] == "box"
    assert [panel["size_px"] for panel in report["panels"]] == [[500, 500]] * 6
    assert {tuple(round(n) for n in panel["normal"]) for panel in report["panels"]} == {
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1),
    }  # fmt: skip
    (quilt,) = report["quilts"]
    assert quilt["panels"] == 6
    assert 0.7 < quilt["fill"] < 1
    assert picture.stat().st_size > 1000
    display = limen.Display.load(saved)
    assert [list(each.size_px) for each in display.quilts] == [quilt["size_px"]]
    again = _report(capsys, "display", saved, "--quilt")
    assert again["quilts"] == report["quilts"]
    inside = _report(capsys, "display", tmp_path / "box.obj", "--ppi", 25.4, "--inside")
    assert [panel["normal"] for panel in inside["panels"]] == [
        pytest.approx([-n for n in panel["normal"]]) for panel in report["panels"]
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("box.obj",), "give --ppi"),
        (("box.obj", "--ppi", 0), "pixels per inch must be above 0"),
        (("gone.obj", "--ppi", 100), "gone.obj: no such mesh file"),
        (("cube", "--inside"), "is for mesh files"),
        (("box.obj", "--ppi", 1e6), "size_px must be from 1 to 65535"),
        (("box.obj", "--ppi", 600, "--quilt"), "panel 'box/0' has"),
    ],
)
def test_wrong_words_are_answered_in_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[object, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.obj").write_text(CUBE)
    code, out, err = _run(capsys, "display", *words)
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert not out
