"""Every cell of the tables of `limen.cli.heard` is tried: an option is heard of a kind of content, or refused.

An option that is heard changes what reaches the renderer, and nothing is drawn to see that.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from limen.cli import heard
from limen.cli.heard import SHOW, TRAFFIC, VERIFY, WAYS, Heard, Kind, Way
from limen.display.display import Display
from limen.viewing.viewer import Pointer, Viewer
from support.desk import LENS, NAMES, TRIES, Desk, Try, Verb, assert_refused, keep_open

WAYS_WORDS: dict[Way, tuple[str, ...]] = {
    "browse": (),
    "wall": ("--display", "wall.toml"),
    "outputs": ("--display", "wall.toml", "--window", "outputs"),
    "files": ("--display", "wall.toml", "--out", "out"),
}


def tracked_tour(time_s: float) -> list[Viewer]:
    return [Viewer((time_s, 1.0, 2.0))]


def tracked_pointers(time_s: float) -> list[Pointer]:
    return [Pointer((time_s, 1.0, 2.0), (0.0, 0.0, -1.0))]


OVERLAYS: dict[Kind, str] = {"image": "levels", "mesh": "panels", "points": "simplified", "terrain": "patches"}
TRACKED = {"circling:20": {"viewers": tracked_tour, "pointers": tracked_pointers}}
THE_WAY_ITSELF = {"--display", "--out"}
"""Options that choose the way, in which all others are tried."""


@pytest.fixture
def show(desk: Desk, contents: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Desk:
    """A desk where ``limen show`` ends as soon as a renderer has been asked; content is open already."""
    monkeypatch.setattr("limen.cli.show_content.opened_content", lambda _out, path: contents[str(path)])
    keep_open(monkeypatch, contents[NAMES["image"]])
    monkeypatch.setattr("limen.cli.show_content.open_tracker", lambda how: SimpleNamespace(close=str, **TRACKED[how]))
    monkeypatch.setattr("limen.data.mesh.store.tree_of", lambda _mesh: None)
    monkeypatch.setattr("limen.cli.show_content.FoldTree", lambda _tree: SimpleNamespace())
    desk.watch(
        "limen.cli.show_content.run_show", "limen.cli.show_content.write_frames",
    )  # fmt: skip
    return desk


def cell(row: Heard, kind: Kind, way: Way) -> bool:
    return kind in row.kinds and way in row.ways


@pytest.fixture(scope="module")
def showing() -> Verb:
    from limen.cli.show import show

    return Verb(show)


@pytest.mark.parametrize("kind", heard.KINDS)
@pytest.mark.parametrize("way", WAYS)
def test_show_hears_or_refuses(kind: Kind, way: Way, show: Desk, showing: Verb) -> None:
    base = (NAMES[kind], showing.values(*WAYS_WORDS[way]))
    one_of_each = showing.by_option(*(word for attempt in TRIES.values() for word in attempt.words))
    assert set(one_of_each) == set(TRIES)
    for option, row in SHOW.items():
        if option in THE_WAY_ITSELF or (way, option) == ("outputs", "--window"):
            continue
        overlaid = option == "--overlay"
        values = {("overlay", ""): OVERLAYS[kind]} if overlaid else one_of_each[option]
        given = () if overlaid else TRIES[option].given
        if not cell(row, kind, way):
            assert_refused(option, *show.call(showing, *base, values))
            continue
        without = show.call(showing, *base, showing.values(*given))
        asked = show.call(showing, *base, showing.values(*given), values)
        assert (without[0], asked[0]) == ("", ""), option
        assert asked[1] != without[1], f"{option} is ignored of {kind} in {way}"


TOGETHER: list[tuple[tuple[str, ...], str]] = [
    (("image.tif", "--out", "out", "--window", "outputs", "--display", "wall.toml"), "--window is of windows"),
    (
        ("image.tif", "--display", "wall.toml", "--window", "outputs", "--lens-mode", "error"),
        "--lens-mode is of a lens",
    ),
    (("image.tif", "--stereo", "anaglyph"), "leave out --stereo, which is for meshes, points and terrains"),
    (("points.ply", "--stereo", "sequential"), "give --stereo none or anaglyph, or --out"),
    (("mesh.ply", "--stereo", "sequential"), "give --stereo none or anaglyph, or --out"),
    (("mesh.ply", "--out", "out", "--stereo", "sequential", "--write", "quilts"), "--stereo sequential is written for"),
    (
        ("mesh.ply", "--out", "out", "--display", "wall.toml", "--write", "quilts", "--scale", "0.5"),
        "leave out --scale",
    ),
    (("mesh.ply", "--overlay", "simplified"), "--overlay simplified shows what a policy leaves out"),
    (("mesh.ply", "--gaze", "0,0,-1"), "--gaze changes nothing under the policy full"),
    (("image.tif", "--gaze", "0,0,-1"), "--gaze changes nothing under the policy acuity"),
    (("terrain.tif", "--gaze", "0,0,-1", "--policy", "full"), "--gaze changes nothing under the policy full"),
    (("terrain.tif", "--rule", "middle", "--policy", "full"), "--rule changes nothing under the policy full"),
    (("mesh.ply", "--acuity-arcmin", "1"), "--acuity-arcmin changes nothing under full"),
    (("image.tif", "--acuity-arcmin", "1", "--policy", "snellen"), "--acuity-arcmin changes nothing under snellen"),
    (("terrain.tif", "--acuity-arcmin", "1", "--policy", "scheel"), "--acuity-arcmin changes nothing under scheel"),
    (("mesh.ply", "--out", "out", "--policy", "budget:12ms"), "is for what is shown live"),
    (("image.tif", "--policy", "budget:300"), "the policy budget spends"),
    (("image.tif", "--policy", "acuity+motion"), "+motion"),
    (("terrain.tif", "--policy", "acuity+motion"), "+motion"),
    (("mesh.ply", "--policy", "scheel"), "the policy scheel"),
    (("image.tif", "--lens-focus", "0.2"), "--lens-focus is of a lens: give --lens too"),
    (("image.tif", "--out", "out", "--lens-mode", "coarse"), "--lens-mode is of a lens"),
    (("image.tif", *LENS, "--lens-heights", "image.tif", "--lens-focus", "0.2"), "takes the place of --lens-focus"),
    (("terrain.tif", "--drape", "image.tif", "--colours", "plain"), "--colours plain would hide the --drape"),
    (("terrain.tif", "--flight", "traverse", "--target", "0.2,0.3"), "leave out the target"),
    (("image.tif", "--display", "wall.toml", "--panels", "a", "lfet"), "no panel of 'two' matches lfet"),
    (("image.tif", "--display", "wall.toml", "--session", "walk.csv", "--viewer", "0,0,0"), "--session or --viewer"),
    (
        ("mesh.ply", "--display", "wall.toml", "--session", "walk.csv", "--tracker", "circling:20"),
        "--tracker says who looks",
    ),
    (("image.tif", "mesh.ply", "--lit"), "this content is an image and a mesh: leave out --lit, which is for points"),
    (("image.tif", "mesh.ply", "--overlay", "levels"), "--overlay levels is not for a mesh"),
    (("image.tif", "scene.toml"), "a show file says all that is shown: give it alone"),
    (("scene.toml", "--fit", "cover"), "--fit is said in a show file, for each layer: leave it out"),
]


@pytest.mark.parametrize(("words", "says"), TOGETHER, ids=lambda part: part if isinstance(part, str) else "")
def test_what_makes_no_sense_together_is_refused(words: tuple[str, ...], says: str, show: Desk) -> None:
    show.refuses(says, "show", *words)


def test_a_lens_that_a_hand_carries_has_the_mode_asked_for(show: Desk) -> None:
    """In a window the key l brings a lens, so the mode is heard without --lens."""
    plain, coarse = (show.run("show", "image.tif", *more)[2] for more in ((), ("--lens-mode", "coarse")))
    assert plain != coarse


def test_the_display_and_the_folder_say_how_content_is_shown(show: Desk) -> None:
    """What `WAYS_WORDS` takes for granted."""
    asked = {way: show.run("show", "mesh.ply", *words)[2] for way, words in WAYS_WORDS.items()}
    doors = {way: each[0][0] for way, each in asked.items()}
    assert doors["browse"] == doors["wall"] == doors["outputs"] != doors["files"]
    assert asked["browse"] != asked["wall"] != asked["outputs"] != asked["browse"]
    here, there = (show.run("show", "mesh.ply", "--out", out)[2] for out in ("here", "there"))
    assert here != there


SESSIONS = ("--session", "walk.csv")
TRAFFIC_TRIES: dict[str, tuple[str, ...]] = {
    "--display": ("--display", "wall.toml"),
    "--session": ("--session", "other.csv"),
    "--acuity-arcmin": ("--acuity-arcmin", "2"),
    "--policy": ("--policy", "snellen"),
    "--rate-hz": ("--rate-hz", "1"),
    "--per-node": ("--per-node",),
    "--plot": ("--plot", "plot.gif"),
}


@pytest.fixture
def count(desk: Desk) -> Desk:
    desk.watch(
        "limen.cli.traffic.terrain_traffic", "limen.cli.traffic.scene_traffic", "limen.study.traffic.count_traffic"
    )
    desk.watch("limen.cli.traffic.opened_content", answer=None)
    return desk


@pytest.fixture(scope="module")
def counting() -> Verb:
    from limen.cli.traffic import traffic

    return Verb(traffic)


@pytest.mark.parametrize("kind", [*heard.KINDS, "one-to-one"])
def test_traffic_hears_or_refuses(kind: Kind, count: Desk, counting: Verb) -> None:
    base = (NAMES[kind], counting.values("--display", "nodes.toml", *SESSIONS))
    words = {**{option: TRIES[option].words for option in TRIES if option in TRAFFIC}, **TRAFFIC_TRIES}
    one_of_each = counting.by_option(*(word for each in words.values() for word in each))
    assert set(one_of_each) == set(TRAFFIC)
    _, plain = count.call(counting, *base)
    for option, row in TRAFFIC.items():
        said, asked = count.call(counting, *base, one_of_each[option])
        if kind not in row.kinds:
            assert_refused(option, said, asked)
        elif option == "--plot":  # it is drawn when all is counted; a wrong ending is refused before
            assert "must end in" in said
        else:
            assert asked, said
            assert asked != plain, f"{option} is ignored of {kind}"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("one-to-one", "--display", "wall.toml", "--per-node"), "--per-node: no panel of 'two' names"),
        (
            ("image.tif", "--display", "wall.toml", "--policy", "full", "--acuity-arcmin", "1"),
            "--acuity-arcmin changes",
        ),
        (("mesh.ply", "--display", "wall.toml", "--policy", "budget:12ms"), "is for what is shown live"),
        (("one-to-one", "--display", "wall.toml", "--panels", "a", "lfet"), "matches lfet"),
        (("image.tif", "mesh.ply", "--display", "wall.toml"), "one content at a time: leave out 'mesh.ply'"),
    ],
)
def test_traffic_refuses_what_changes_nothing(words: tuple[str, ...], says: str, count: Desk) -> None:
    code, said, _ = count.run("traffic", *words, *SESSIONS)
    assert (code, said.count("\n")) == (2, 1), said
    assert says in said


VERIFY_TRIES: dict[str, Try] = {
    "--display": Try(("--display", "wall.toml", "--panels", "a")),
    "--panels": Try(("--panels", "b")),
    "--session": Try(SESSIONS),
    "--policy": Try(("--policy", "full")),
    "--acuity-arcmin": Try(("--acuity-arcmin", "2")),
    "--views": Try(("--views", "3")),
    "--distance-factors": Try(("--distance-factors", "1", "3")),
    "--eccentricity-deg": Try(("--eccentricity-deg", "7")),
    "--fit": Try(("--fit", "cover")),
    "--seed": Try(("--seed", "4")),
    "--changes": Try(("--changes",)),
    "--speed-deg-s": Try(("--speed-deg-s", "9")),
}


@pytest.fixture
def judge(desk: Desk, contents: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Desk:
    def named(session: str, _display: Display) -> SimpleNamespace:
        return SimpleNamespace(name=session)  # one for B would have to be made first

    monkeypatch.setattr("limen.cli.verify.session_named", named)
    monkeypatch.setattr("limen.cli.verify.open_content", lambda path: contents[str(path)])
    keep_open(monkeypatch, contents[NAMES["image"]])
    monkeypatch.setattr("limen.cli.verify.Observer", lambda light: light)
    monkeypatch.setattr("limen.cli.verify._controls", lambda _out, _observers: [])
    desk.watch("limen.cli.verify.choose_windows", answer=[])
    desk.watch("limen.cli.verify._judge", "limen.cli.verify._scene_report")
    return desk


@pytest.mark.parametrize("kind", ["image", "mesh", "points"])
def test_verify_hears_or_refuses(kind: Kind, judge: Desk) -> None:
    plain: dict[tuple[str, ...], list[Any]] = {}  # many options are compared with the same
    for option, row in VERIFY.items():
        base: tuple[str, ...] = ("verify", NAMES[kind])
        if kind == "image" or option == "--panels":
            base += ("--display", "desktop" if option == "--display" else "wall.toml")
        attempt = VERIFY_TRIES.get(option, Try((option,)))
        if kind not in row.kinds:
            judge.refuses(option, *base, *attempt.words)
        elif option == "--plot":
            assert "must end in" in judge.run(*base, "--plot", "plot.gif")[1]
        elif option == "--strict":
            judge.refuses("--strict", *base, "--strict", "--distance-factors", "2")
        else:
            changed = (*base[:2], *attempt.words) if option == "--display" else (*base, *attempt.words)
            code, said, asked = judge.run(*changed)
            assert code == 0, said
            plain[base] = plain.get(base) or judge.run(*base)[2]
            assert asked != plain[base], f"{option} is ignored of {kind}"


def test_verify_refuses_what_changes_nothing(judge: Desk) -> None:
    judge.refuses("--panels", "verify", "mesh.ply", "--panels", "a")
    judge.refuses("--acuity-arcmin", "verify", "mesh.ply", "--policy", "full", "size:300", "--acuity-arcmin", "2")
