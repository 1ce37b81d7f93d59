"""Every option of every verb is heard or refused, never ignored.

Of the verbs that take several kinds of content, `limen.cli.heard` says what is heard with what, and
`test_options_of_content.py` tries every cell; here are all other verbs, and that every option has its row. An option
that is heard changes what is asked of whoever does the verb's work; one that is refused ends with code 2 and one line
that names it, before anything is written.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from cyclopts import App

from limen.cli import heard
from limen.cli.app import app, main
from limen.cli.heard import SHOW, TRAFFIC, VERIFY
from support.desk import WALL, Desk

COMMON = {"--json", "--quiet", "--verbose"}
PAGE = Path(__file__).resolve().parents[2] / "docs/reference/options.md"


# ---------------------------------------------------------------- all options there are


def options_of(verb: App) -> set[str]:
    """Options of a verb, without what it takes by place."""
    return {
        argument.names[0]
        for argument in verb.assemble_argument_collection()
        if argument.parse and argument.names[0].startswith("--")
    }


def verbs(under: App = app, path: str = "") -> Iterator[tuple[str, App]]:
    for name in under:
        if name.startswith("-"):
            continue
        verb = under[name]
        below = [each for each in verb if not each.startswith("-")]
        if below:
            yield from verbs(verb, f"{path}{name} ")
        else:
            yield path + name, verb


def test_every_option_of_every_verb_has_a_row() -> None:
    rows: dict[str, set[str]] = {verb: set(options) for verb, options in ROWS.items()}
    rows |= {"show": set(SHOW), "traffic": set(TRAFFIC), "verify": set(VERIFY)}
    found = {verb: options_of(command) for verb, command in verbs()}
    assert set(found) == set(rows)
    for verb, options in found.items():
        assert options >= COMMON, verb
        assert options - COMMON - BY_PLACE.get(verb, set()) == rows[verb], verb


BY_PLACE = {"sample": {"--kind", "--out"}, "info": {"--file"}, "ingest": {"--src", "--dst"}}
"""What cyclopts takes by name, too, and nobody does."""


def test_the_documentation_shows_the_tables() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for table in (
        heard.kinds_table(SHOW, ways=True),
        heard.kinds_table(TRAFFIC, (*heard.KINDS, "one-to-one")),
        heard.kinds_table(VERIFY),
    ):
        assert table in text, f"paste this into {PAGE.name}:\n{table}"


class Row(NamedTuple):
    """With and without the option, other things are asked for at the verb's `DOORS`; or its wrong value is refused."""

    base: str
    more: str
    refused: bool = False


ROWS: dict[str, dict[str, Row]] = {
    "demo": {
        "--content": Row("", "--content image.tif"),
        "--out": Row("", "--out there"),
        "--fit": Row("", "--fit cover"),
    },
    "doctor": {},
    "info": {},
    "sample": {
        "--gigapixels": Row("image out.tif", "--gigapixels 2"),
        "--size": Row("mesh out.ply", "--size 300"),
        "--seed": Row("points out.ply", "--seed 3"),
        "--aspect": Row("image out.tif", "--aspect 2"),
    },
    "ingest": {
        "--quality": Row("image.tif out.tif", "--quality 80"),
        "--subsampling": Row("image.tif out.tif", "--subsampling 420"),
        "--band": Row("terrain.tif out.terrain", "--band 2"),
        "--spacing-m": Row("terrain.tif out.terrain", "--spacing-m 3"),
    },
    "display": {
        "--ppi": Row("panels.obj --ppi 100", "--ppi 50"),
        "--scale": Row("panels.obj --ppi 100", "--scale 0.5"),
        "--inside": Row("panels.obj --ppi 100", "--inside"),
        "--quilt": Row("wall.toml", "--quilt"),
        "--picture": Row("wall.toml", "--picture room.png"),
        "--to-toml": Row("wall.toml", "--to-toml copy.toml"),
    },
    "walk": {
        "--display": Row("out.csv --seconds 2 --display desktop", "--display wall.toml"),
        "--seconds": Row("out.csv --display desktop --seconds 2", "--seconds 3"),
        "--seed": Row("out.csv --display desktop --seconds 2", "--seed 3"),
        "--viewers": Row("out.csv --display desktop --seconds 2", "--viewers 2"),
        "--rate-hz": Row("out.csv --display desktop --seconds 2", "--rate-hz 30"),
        "--gaze": Row("out.csv --display desktop --seconds 2", "--gaze"),
        "--pointers": Row("out.csv --display desktop --seconds 2", "--pointers 1"),
        "--picture": Row("out.csv --display desktop --seconds 2", "--picture walk.gif", refused=True),
    },
    "bench": {
        "--quick": Row("panels", "--quick"),
        "--plot": Row("panels", "--plot plot.gif", refused=True),
        "--content": Row("terrain", "--content terrain.tif"),
        "--crop": Row("terrain --content terrain.tif", "--crop 0,0,9,9"),
    },
    "calibrate boards": {
        "--display": Row("--display desktop --out there", "--display wall.toml"),
        "--panels": Row("--display wall.toml --out there", "--panels b"),
        "--out": Row("--display wall.toml --out there", "--out elsewhere"),
    },
    "calibrate solve": {
        "--display": Row("image.tif --out x.toml --display desktop", "--display wall.toml"),
        "--panels": Row("image.tif --out x.toml --display wall.toml", "--panels a"),
        "--out": Row("image.tif --display wall.toml --out x.toml", "--out y.toml"),
        "--camera": Row("image.tif --out x.toml --display wall.toml", "--camera none.toml", refused=True),
        "--save-camera": Row("image.tif --out x.toml --display wall.toml", "--save-camera camera.toml"),
        "--fix": Row("image.tif --out x.toml --display wall.toml", "--fix a"),
        "--report": Row("image.tif --out x.toml --display wall.toml", "--report found.gif", refused=True),
    },
    "calibrate rehearse": {
        "--display": Row("--display desktop", "--display wall.toml"),
        "--panels": Row("--display wall.toml", "--panels a"),
        "--photos": Row("--display wall.toml", "--photos 3"),
        "--megapixels": Row("--display wall.toml", "--megapixels 1"),
        "--off-mm": Row("--display wall.toml", "--off-mm 5"),
        "--off-deg": Row("--display wall.toml", "--off-deg 1"),
        "--seed": Row("--display wall.toml", "--seed 4"),
        "--out": Row("--display wall.toml", "--out there"),
    },
}

DOORS: dict[str, tuple[str, ...]] = {
    "demo": ("limen.cli.demo.run_demo",),
    "sample": ("limen.data.opening.sample",),
    "ingest": ("limen.data.opening.ingest",),
    "display": ("limen.cli.display._print",),
    "walk": ("limen.cli.walk.make_walk",),
    "bench": ("limen.cli.bench._measured",),
    "calibrate boards": ("limen.cli.calibrate.write_picture",),
    "calibrate solve": ("limen.cli.calibrate.CameraRow",),
    "calibrate rehearse": ("limen.cli.calibrate.rehearse",),
}
"""Who does each verb's work; it is written down what they are asked for, and there the verb ends."""


@pytest.fixture
def calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards and what was found, without OpenCV."""
    board = SimpleNamespace(module_px=1.0, ids=(0,), first_id=0)
    found = SimpleNamespace(display=WALL, camera=SimpleNamespace(to_toml=lambda: ""))
    monkeypatch.setattr("limen.cli.calibrate.load", lambda: None)
    monkeypatch.setattr("limen.cli.calibrate.boards_of_part", lambda _whole, part: [board] * len(part.panels))
    monkeypatch.setattr("limen.cli.calibrate.draw_board", lambda _board, panel: panel)
    for field in ("size_px", "focal_px", "centre_px", "distortion"):
        setattr(found.camera, field, ())
    monkeypatch.setattr("limen.cli.calibrate.found", found, raising=False)


@pytest.mark.usefixtures("calibration")
@pytest.mark.parametrize("verb", [verb for verb, rows in ROWS.items() if rows])
def test_other_verbs_hear(verb: str, desk: Desk) -> None:
    from limen.cli import calibrate as module

    desk.watch("limen.cli.display.write_bytes", "limen.cli.display.write_picture", answer=None)
    desk.watch("limen.cli.calibrate.write_bytes", answer=None)
    desk.watch("limen.cli.calibrate.calibrate", answer=module.found)  # type: ignore[attr-defined]
    desk.watch(*DOORS[verb])
    plain: dict[tuple[str, ...], Any] = {}  # many options are compared with the same
    for option, row in ROWS[verb].items():
        base, more = [*verb.split(), *row.base.split()], row.more.split()
        changed = list(base)
        if option in base:
            at = base.index(option)
            changed[at : at + len(more)] = more
        else:
            changed += more
        if row.refused:
            desk.refuses(more[-1], *changed)
            continue
        code, said, asked = desk.run(*changed)
        if tuple(base) not in plain:
            plain[tuple(base)] = desk.run(*base)[2]
        assert code == 0, (changed, said)
        assert asked, changed
        assert asked != plain[tuple(base)], f"limen {verb} ignores {option}"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("sample mesh x.ply --gigapixels 1", "--gigapixels is of images"),
        ("sample terrain x.tif --aspect 2", "--aspect is of images"),
        ("sample image x.tif --size 100 --gigapixels 1", "--size and --gigapixels both say"),
        ("ingest points.ply x.points --quality 80", "--quality is of images"),
        ("ingest mesh.ply x.mesh --subsampling 420", "--subsampling is of images"),
        ("ingest image.tif x.tif --band 2", "--band is of terrains"),
        ("ingest image.tif x.tif --spacing-m 2", "--spacing-m is of terrains"),
        ("display wall.toml --ppi 100", "--ppi is for mesh files"),
        ("display wall.toml --scale 0.5", "--scale is for mesh files"),
        ("display wall.toml --inside", "--inside is for mesh files"),
        ("bench image --content image.tif", "--content is for the benchmarks"),
        ("bench image --crop 0,0,9,9", "--crop is for the benchmark"),
        ("bench image --plot plot.png", "--plot is for the benchmarks 'panels' and 'mesh'"),
        ("calibrate solve image.tif --display wall.toml --out x.toml --panels c", "no panel of 'two' matches c"),
        ("info image.tif mesh.ply", "limen info takes one file at a time: leave out 'mesh.ply'"),
        ("ingest image.tif x.tif mesh.ply", "leave out 'mesh.ply'"),
        ("sample image x.tif y.tif", "leave out 'y.tif'"),
        ("demo image.tif", "--content alone: leave out 'image.tif'"),
        ("doctor now", "limen doctor takes options alone"),
        ("display wall.toml desktop", "leave out 'desktop'"),
        ("walk x.csv y.csv --display desktop --seconds 1", "leave out 'y.csv'"),
        ("bench image mesh", "leave out 'mesh'"),
        ("verify image.tif mesh.ply --display wall.toml", "one content at a time: leave out 'mesh.ply'"),
        ("calibrate boards wall.toml --display wall.toml --out x", "calibrate boards takes options alone"),
        ("traffic image.tif mesh.ply terrain.tif --display wall.toml", "leave out 'mesh.ply', 'terrain.tif'"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("calibration")
def test_other_verbs_refuse(words: str, says: str, desk: Desk) -> None:
    desk.refuses(says, *words.split())


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("show", "m.ply", "--size-m", "nan"), "--size-m"),
        (("show", "m.ply", "--turn-deg", "inf"), "--turn-deg"),
        (("show", "m.ply", "--seconds", "nan"), "--seconds"),
        (("verify", "m.ply", "--distance-factors", "1", "inf"), "--distance-factors"),
        (("verify", "m.ply", "--eccentricity-deg", "nan"), "--eccentricity-deg"),
        (("sample", "image", "w.tif", "--gigapixels", "-inf"), "--gigapixels"),
    ],
)
def test_numbers_that_are_none_are_refused_by_name(
    words: tuple[str, ...], option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (2, "")
    (line,) = told.err.strip().splitlines()
    assert option in line
    assert "finite" in line
