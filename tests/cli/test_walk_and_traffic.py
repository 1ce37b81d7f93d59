from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image as Picture

from limen.cli.app import main
from limen.data import sample_image
from limen.track.replay import read_session


def limen(*words: object) -> int:
    """The exit code of a command line."""
    try:
        main([str(word) for word in words])
    except SystemExit as leaving:
        return int(leaving.code or 0)
    return 0


@pytest.fixture
def short(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / "short.csv"
    assert limen("walk", "--display", "rostock", "--seconds", 2, path) == 0
    capsys.readouterr()
    return path


def answer(capsys: pytest.CaptureFixture[str]) -> Any:
    out = capsys.readouterr()
    return json.loads(out.out)


def test_walk(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path, picture = tmp_path / "two.csv", tmp_path / "two.svg"
    words = (
        "walk",
        "--display",
        "cave",
        "--seconds",
        3,
        "--viewers",
        2,
        "--seed",
        4,
        "--picture",
        picture,
        path,
        "--json",
    )
    assert limen(*words) == 0
    found = answer(capsys)
    assert found["path"] == str(path)
    assert found["frames"] == 360
    assert found["length_m"] == pytest.approx(2 * 3 * 1.252, rel=0.05)
    session = read_session(path)
    assert (session.name, session.display, len(session.tracks)) == ("two", "cave", 2)
    assert picture.stat().st_size > 1000
    first = path.read_bytes()
    assert limen(*words) == 0
    assert path.read_bytes() == first


def test_traffic_as_json(short: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    words = (
        "traffic",
        "one-to-one",
        "--display",
        "rostock",
        "--panels",
        "wall/0,*",
        "wall/1,*",
        "--session",
        short,
        "--json",
    )
    assert limen(*words, "--policy", "full", "acuity", "--acuity-arcmin", 1, "human", "--plot", tmp_path / "t.svg") == 0
    found = answer(capsys)
    (session,) = found["sessions"]
    assert (session["name"], session["frames"]) == ("short", 60)
    assert [(row["policy"], row["acuity_arcmin"]) for row in session["rows"]] == [
        ("full", None),
        ("acuity", 1.0),
        ("acuity", 0.64),
    ]
    for row in session["rows"]:
        assert row["bytes_mean"] == pytest.approx(row["pages_mean"] * 9000)
        assert 0 <= row["saving"] < 1
        assert row["pages_mean"] <= row["pages_p99"]
    assert session["floor_samples_mean"] > 0
    assert found["panels"] == 8
    assert (tmp_path / "t.svg").stat().st_size > 1000


def test_traffic_as_a_table(short: Path, capsys: pytest.CaptureFixture[str]):
    assert limen("traffic", "one-to-one", "--display", "rostock", "--session", short, "--rate-hz", 5, "--per-node") == 0
    out = capsys.readouterr().out
    assert "acuity 0.64'" in out
    assert "every node fetches for itself" in out
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 110


def test_a_session_of_another_display_is_remarked(short: Path, capsys: pytest.CaptureFixture[str]):
    assert limen("traffic", "one-to-one", "--display", "cave", "--session", short, "--rate-hz", 1, "--json") == 0
    out = capsys.readouterr()
    assert "made for 'rostock'" in out.err
    json.loads(out.out)


def test_traffic_of_an_image(short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    image = tmp_path / "world.tif"
    sample_image(image, 0.01, aspect=1.6)
    words = ("traffic", image, "--display", "rostock", "--session", short, "--rate-hz", 1, "--json")
    pages = []
    for fit in ("contain", "one-to-one", "cover"):
        assert limen(*words, "--fit", fit, "--policy", "full") == 0
        found = answer(capsys)
        assert found["image_px"] == [4000, 2500]
        assert 2_000 < found["page_bytes"] < 60_000
        pages.append(found["sessions"][0]["rows"][0]["pages_mean"])
    assert pages[2] < pages[0] == 160, "all pages of 4000 x 2500 texels; less where the edges are cut off"
    assert pages[1] == 160
    assert limen(*words, "--fit", "stretch") == 2
    assert "stretch" in capsys.readouterr().err
    picture = tmp_path / "grey.png"
    Picture.new("L", (700, 300), 128).save(picture)
    assert limen("traffic", picture, *words[2:], "--policy", "full") == 0
    assert answer(capsys)["page_bytes"] > 0, "measured, though no page is stored"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("walk", "--display", "nowhere", "--seconds", "1", "x.csv"), "no display is named 'nowhere'"),
        (("walk", "--display", "cave", "--seconds", "0", "x.csv"), "seconds must"),
        (("walk", "--display", "cave", "--seconds", "soon", "x.csv"), "soon"),
        (("walk", "--display", "cave", "--seconds", "1"), "OUT"),
        (("walk", "--display", "cave", "--seconds", "1", "x.csv", "--picture", "x.gif"), ".png or .svg"),
        (("walk", "--display", "cave", "--seconds", "1", "nowhere/x.csv"), "make it first"),
        (("traffic", "one-to-one", "--display", "cave", "--session", "D"), "no session is named 'D'"),
        (("traffic", "one-to-one", "--display", "cave", "--session", "none.csv"), "no such session file"),
        (("traffic", "one-to-one", "--display", "cave", "--policy", "best"), "no policy is named 'best'"),
        (("traffic", "one-to-one", "--display", "cave", "--acuity-arcmin", "0"), "acuity must lie above 0"),
        (("traffic", "one-to-one", "--display", "cave", "--panels", "ceiling/*"), "no panel of 'cave' matches"),
        (("traffic", "one-to-one", "--display", "cave", "--rate-hz", "0"), "rate_hz must"),
        (("traffic", "one-to-one", "--display", "cave", "--plot", "t.gif"), ".png or .svg"),
        (("traffic", "--display", "cave"), "CONTENT"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    words: tuple[str, ...],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    assert limen(*words) == 2
    out = capsys.readouterr()
    assert out.out == ""
    assert says in out.err
    assert len(out.err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_pointers_are_written_and_count_as_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    found = []
    for words in ((), ("--pointers", 2)):
        path = tmp_path / "walk.csv"
        assert limen("walk", "--display", "rostock", "--seconds", 1, *words, path, "--json") == 0
        report = answer(capsys)
        session = read_session(path)
        assert (report["viewers"], report["pointers"]) == (len(session.tracks), len(session.pointers))
        assert limen("traffic", "one-to-one", "--display", "rostock", "--session", path, "--rate-hz", 5, "--json") == 0
        found.append(answer(capsys)["sessions"])
    assert len(session.pointers) == 2
    assert found[0] == found[1]
    assert found[1][0]["viewers"] == 1


def test_scheels_policy_is_refused_where_there_are_no_terrains(short: Path, capsys: pytest.CaptureFixture[str]):
    words = ("traffic", "one-to-one", "--display", "rostock", "--session", short, "--rate-hz", 5, "--policy", "scheel")
    assert limen(*words) == 2
    assert "take acuity for anything else" in capsys.readouterr().err
