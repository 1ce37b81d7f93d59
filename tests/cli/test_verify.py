"""``limen verify``: what it prints, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image as Picture

from limen.cli import verify as verb
from limen.cli.app import main
from limen.errors import InputError
from limen.study.charts import chart
from limen.study.observer_controls import Control


def limen(*words: object) -> int:
    """The exit code of a command line."""
    try:
        main([str(word) for word in words])
    except SystemExit as leaving:
        return int(leaving.code or 0)
    return 0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "text.png"
    Picture.fromarray(chart("text", (1280, 720), 2)).save(path)
    return path


def quick_controls(monkeypatch: pytest.MonkeyPatch, jod: float = 10.0) -> None:
    """They have a test of their own, and take seconds."""
    monkeypatch.setattr(verb, "run_controls", lambda observer: [Control("identity", "text", jod, 10.0, 10.0)])


@pytest.mark.gpu
def test_verdicts_as_json(
    page: Path, tmp_path: Path, device: Any, observer: Any, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    quick_controls(monkeypatch)
    plot = tmp_path / "verdict.svg"
    words = ("verify", page, "--display", "desktop", "--policy", "acuity", "contrast", "--views", 4)
    assert limen(*words, "--distance-factors", 1, 30, "--plot", plot, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [(row["policy"], row["distance_factor"]) for row in found["rows"]] == [
        ("acuity", 1.0), ("acuity", 30.0), ("contrast", 1.0), ("contrast", 30.0),
    ]  # fmt: skip
    for row in found["rows"]:
        assert row["eccentricity_deg"] == 0
        assert row["jod_min"] <= row["jod_mean"] <= 10
        assert row["false_alarms"] == 0
        assert row["detected"] == (0 if row["distance_factor"] == 1 else 1)
        assert 0 <= row["worst_window"] < 4
    assert len(found["windows"]) == 4
    assert found["controls"]
    assert plot.stat().st_size > 1000


@pytest.mark.gpu
def test_verdicts_as_a_table(
    page: Path, device: Any, observer: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick_controls(monkeypatch)
    words = ("verify", page, "--display", "desktop", "--policy", "acuity+gaze", "--views", 1, "--distance-factors", 1)
    assert limen(*words, "--eccentricity-deg", 12, "--strict") == 0
    out = capsys.readouterr().out
    assert "acuity+gaze 0.64'" in out
    assert "12°" in out
    assert "Detected: JOD under 9.80" in out


@pytest.mark.gpu
def test_strict_is_an_exit_code(
    page: Path, device: Any, observer: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick_controls(monkeypatch)
    words = ("verify", page, "--display", "desktop", "--policy", "acuity", "--views", 2, "--strict")
    assert limen(*words, "--distance-factors", 1, 30) == 0
    assert limen(*words, "--distance-factors", 1, "--acuity-arcmin", 12) == 1
    assert "not imperceptible" in capsys.readouterr().err
    assert limen(*words, "--distance-factors", 2) == 2
    assert "--distance-factors" in capsys.readouterr().err


def test_an_observer_that_fails_its_controls_reports_nothing_else(
    page: Path, observer: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick_controls(monkeypatch, jod=9.9)
    assert limen("verify", page, "--display", "desktop", "--json") == 1
    answer = capsys.readouterr()
    found = json.loads(answer.out)
    assert found["rows"] == found["windows"] == []
    assert found["controls"][0]["jod"] == 9.9
    assert "controls failed" in answer.err


def test_without_the_observer_the_commands_are_named(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def absent(*_given: object) -> None:
        raise InputError("the independent observer is not installed (torch): run `pip install ...`")

    monkeypatch.setattr(verb, "Observer", absent)
    assert limen("verify", page, "--display", "desktop") == 2
    assert "pip install" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--plot", "x.jpg"), ".png or .svg"),
        (("--policy", "sharp"), "no policy is named 'sharp'"),
        (("--distance-factors", "0"), "distance_factor"),
        (("--session", "Z"), "no session is named 'Z'"),
    ],
)
def test_wrong_words_are_refused_before_any_work(
    page: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert limen("verify", page, "--display", "desktop", *words) == 2
    answer = capsys.readouterr()
    assert said in answer.err
    assert answer.out == ""
