"""Every option of every verb is heard or refused, never ignored.

Of the verbs that take several kinds of content, `limen.cli.heard` says what is heard with what; here every cell of
its tables is tried, as are the rows below of all other verbs. An option that is heard changes what reaches the
renderer (or whatever does the verb's work), and nothing is drawn to see that; an option that is refused ends with
code 2 and one line that names it, before anything is written.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np
import pytest
from cyclopts import App
from PIL import Image as Picture

from clouds import ball
from ground import write_dem
from limen.cli import heard
from limen.cli.app import app, main
from limen.cli.heard import SHOW, TRAFFIC, VERIFY, WAYS, Heard, Kind, Way
from limen.data import sample_image, sample_mesh
from limen.data.image import Image
from limen.data.mesh import Mesh
from limen.data.opening import open_content
from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import LimenError

COMMON = {"--json", "--quiet", "--verbose"}
PAGE = Path(__file__).resolve().parents[2] / "docs/options.md"


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


# ---------------------------------------------------------------- what reaches whoever does the work


class Enough(BaseException):
    """Whatever is asked for has reached whoever does the work."""


def told(value: Any) -> Any:
    """What of a request counts, to be compared: nothing that differs from call to call."""
    if isinstance(value, Display):
        sizes = [(panel.name, panel.size_px, panel.origin_m, panel.node) for panel in value.panels]
        return (value.name, sizes, value.quilts)
    if isinstance(value, Image | Mesh):
        return str(value.path)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if hasattr(value, "kind") and hasattr(value, "name"):  # a terrain or points
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [(each.name, told(getattr(value, each.name))) for each in dataclasses.fields(value)]
    if isinstance(value, msgspec.Struct):
        return told(msgspec.to_builtins(value))
    if isinstance(value, Mapping):
        return {str(key): told(each) for key, each in value.items()}
    if isinstance(value, SimpleNamespace):
        return told(vars(value))
    if isinstance(value, list | tuple | set):
        return [told(each) for each in value]
    if isinstance(value, type(None) | str | int | float | bool | Path):
        return value
    name = getattr(value, "__qualname__", "")
    if any(word in name for word in ("tour", "pointers")) or hasattr(value, "func"):  # of time
        return [told(value(time_s)) for time_s in (0.0, 0.7)]
    return type(value).__name__


Values: TypeAlias = dict[tuple[str, str], Any]
"""Of parameters and, for groups of options, of their fields."""


class Verb:
    """A verb whose words are understood once: cyclopts takes a tenth of a second for all options of ``limen show``."""

    def __init__(self, function: Callable[..., None]) -> None:
        self.function = function
        self._known: dict[tuple[str, ...], Values] = {}

    def values(self, *words: str) -> Values:
        if words not in self._known:
            _, bound, _ = app.parse_args([self.function.__name__, "content", *words], exit_on_error=False)
            values: Values = {}
            for name, value in bound.arguments.items():
                if dataclasses.is_dataclass(value):
                    first = type(value)()
                    for field in (each.name for each in dataclasses.fields(value)):
                        if getattr(value, field) != getattr(first, field):
                            values[name, field] = getattr(value, field)
                elif name != "content":
                    values[name, ""] = value
            self._known[words] = values
        return self._known[words]

    def by_option(self, *words: str) -> dict[str, Values]:
        """The same, by the options' names."""
        found = {}
        for key, value in self.values(*words).items():
            (option,) = heard.given_options(self.function, self.arguments({key: value}))
            found[option] = {key: value}
        return found

    def arguments(self, *values: Values) -> dict[str, Any]:
        arguments: dict[str, Any] = {}
        for each in values:
            for (name, field), value in each.items():
                if not field:
                    arguments[name] = value
                    continue
                group = arguments.get(name, signature(self.function).parameters[name].default)
                arguments[name] = dataclasses.replace(group, **{field: value})
        return arguments


class Desk:
    """Runs the command line in this process, with somebody at the door of each renderer who writes down what comes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys
        self.asked: list[Any] = []

    def watch(self, *places: str, answer: Any = Enough) -> None:
        """Write down what is asked of these functions, and answer, or end there."""
        for place in places:
            self._monkeypatch.setattr(place, self._watcher(place, answer))

    def _watcher(self, place: str, answer: Any) -> Callable[..., Any]:
        def watcher(*args: Any, **fields: Any) -> Any:
            self.asked.append((place, told(args), told(fields)))
            if answer is Enough:
                raise Enough
            return answer

        return watcher

    def run(self, *words: object) -> tuple[int, str, list[Any]]:
        """Exit code, what is said on stderr, and what was asked for."""
        self.asked = []
        try:
            main([str(word) for word in words])
            code = 0
        except Enough:
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        said = self._capsys.readouterr()
        if code:
            assert said.out == "", said.out
        return code, said.err, self.asked

    def refuses(self, says: str, *words: object) -> str:
        """Make sure of one line that says this, and that nothing was asked of anybody."""
        code, said, asked = self.run(*words)
        assert (code, asked) == (2, []), (words, said)
        assert said.count("\n") == 1, (words, said)
        assert says in said, words
        return said

    def call(self, verb: Verb, content: str, *values: Values) -> tuple[str, list[Any]]:
        """The same of words that are understood already: what is said where it is refused, and what was asked for."""
        self.asked = []
        try:
            verb.function(content, **verb.arguments(*values))
        except Enough:
            return "", self.asked
        except LimenError as error:
            return str(error), self.asked
        raise AssertionError(f"{content}: nobody was asked for anything")


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], files: Path) -> Iterator[Desk]:
    here = Path.cwd()
    os.chdir(files)
    before = {path: path.stat().st_mtime_ns for path in files.rglob("*")}
    yield Desk(monkeypatch, capsys)
    assert {path: path.stat().st_mtime_ns for path in files.rglob("*")} == before, "something was written"
    os.chdir(here)


WALL = Display(
    "two",
    tuple(
        Panel(name, (40, 30), (left, 0.5, -1.0), (1, 0, 0), (0, -1, 0), (0.02, 0.02), surface_m=(left + 0.8, 0.0))
        for name, left in (("a", -0.8), ("b", 0.0))
    ),
    quilts=(Quilt((100, 40), (0, 1), ((5, 5), (55, 5)), output="one"),),
)
SESSION = """# limen session 1: {"name": "walk", "display": "two", "rate_hz": 2}
time_s,viewer,role,x_m,y_m,z_m,direction_x,direction_y,direction_z
0.0,v,viewer,0.1,0.2,0.5,0,0,-1
0.5,v,viewer,0.3,0.2,0.5,0,0,-1
0.0,p,pointer,0.1,0.2,0.5,0,0,-1
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small file of every kind, a wall with a [[quilt]], and a session."""
    folder = tmp_path_factory.mktemp("options")
    sample_image(folder / "image.tif", 0.0001)
    sample_mesh(folder / "mesh.ply", 200)
    write_dem(folder / "terrain.tif")
    away = np.hypot(*(np.mgrid[:33, :33] / 16 - 1))
    Picture.fromarray(np.uint8(255 * np.clip(1 - away, 0, 1))).save(folder / "heights.png")
    (folder / "points.ply").write_text(POINTS)
    (folder / "wall.toml").write_text(WALL.to_toml())
    nodes = dataclasses.replace(
        WALL, panels=tuple(dataclasses.replace(panel, node=panel.name) for panel in WALL.panels)
    )
    (folder / "nodes.toml").write_text(nodes.to_toml())
    (folder / "walk.csv").write_text(SESSION)
    (folder / "other.csv").write_text(SESSION.replace("0.1,0.2,0.5", "0.2,0.2,0.5"))
    (folder / "panels.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


POINTS = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
POINTS += "end_header\n0 0 0\n1 0 0\n0 1 1\n"
NAMES: dict[Kind, str] = {
    "image": "image.tif",
    "mesh": "mesh.ply",
    "points": "points.ply",
    "terrain": "terrain.tif",
    "one-to-one": "one-to-one",
}


@pytest.fixture(scope="module")
def contents(files: Path) -> Iterator[dict[str, Any]]:
    """What the files hold, opened once."""
    land = SimpleNamespace(kind="terrain", name="terrain", transform=None, crs="", size_posts=(321, 257))
    image = open_content(files / NAMES["image"])
    yield {
        NAMES["image"]: image,
        NAMES["mesh"]: open_content(files / NAMES["mesh"]),
        NAMES["points"]: ball(300),
        NAMES["terrain"]: land,
    }
    image.close()


# ---------------------------------------------------------------- limen show

WAYS_WORDS: dict[Way, tuple[str, ...]] = {
    "browse": (),
    "wall": ("--display", "wall.toml"),
    "outputs": ("--display", "wall.toml", "--window", "outputs"),
    "files": ("--display", "wall.toml", "--out", "out"),
}


class Try(NamedTuple):
    """Words that should change something, and others that they need."""

    words: tuple[str, ...]
    given: tuple[str, ...] = ()


LENS = ("--lens", "100,100,50,4")
TRIES: dict[str, Try] = {
    "--panels": Try(("--panels", "a")),
    "--session": Try(("--session", "walk.csv")),
    "--viewer": Try(("--viewer", "-0.4,0.3,1")),
    "--gaze": Try(("--gaze", "0.4,0.1,-1"), ("--policy", "contrast+gaze")),
    "--policy": Try(("--policy", "contrast")),
    "--acuity-arcmin": Try(("--acuity-arcmin", "2"), ("--policy", "contrast")),
    "--fit": Try(("--fit", "cover")),
    "--most-triangles": Try(("--most-triangles", "500")),
    "--frames": Try(("--frames", "2")),
    "--scale": Try(("--scale", "0.5")),
    "--format": Try(("--format", "png")),
    "--simulate": Try(("--simulate",)),
    "--seen-from": Try(("--seen-from", "1,1,1"), ("--simulate",)),
    "--window": Try(("--window", "outputs")),
    "--seconds": Try(("--seconds", "3")),
    "--size-m": Try(("--size-m", "0.3")),
    "--at": Try(("--at", "-0.1,0,-1")),
    "--up": Try(("--up", "z")),
    "--turn-deg": Try(("--turn-deg", "-30")),
    "--tilt-deg": Try(("--tilt-deg", "50")),
    "--animate": Try(("--animate", "turn")),
    "--background": Try(("--background", "#204060")),
    "--stereo": Try(("--stereo", "anaglyph")),
    "--depth": Try(("--depth", "shared")),
    "--write": Try(("--write", "quilts")),
    "--target": Try(("--target", "0.2,0.3")),
    "--heading-deg": Try(("--heading-deg", "-20")),
    "--pitch-deg": Try(("--pitch-deg", "10")),
    "--range-m": Try(("--range-m", "900")),
    "--exaggeration": Try(("--exaggeration", "2")),
    "--flight": Try(("--flight", "orbit")),
    "--camera": Try(("--camera", "fixed")),
    "--cut": Try(("--cut", "level")),
    "--rule": Try(("--rule", "middle")),
    "--field-deg": Try(("--field-deg", "70")),
    "--drape": Try(("--drape", "image.tif")),
    "--colours": Try(("--colours", "plain")),
    "--contours": Try(("--contours", "20")),
    "--sun-azimuth-deg": Try(("--sun-azimuth-deg", "-10")),
    "--sun-altitude-deg": Try(("--sun-altitude-deg", "10")),
    "--splats": Try(("--splats", "square")),
    "--lit": Try(("--lit",)),
    "--lens": Try(LENS),
    "--lens-focus": Try(("--lens-focus", "0.2"), LENS),
    "--lens-drop-off": Try(("--lens-drop-off", "gaussian"), LENS),
    "--lens-shape": Try(("--lens-shape", "rectangular"), LENS),
    "--lens-heights": Try(("--lens-heights", "heights.png"), LENS),
    "--lens-mode": Try(("--lens-mode", "coarse"), LENS),
}
OVERLAYS: dict[Kind, str] = {"image": "levels", "mesh": "panels", "points": "simplified", "terrain": "patches"}
THE_WAY_ITSELF = {"--display", "--out"}
"""Options that choose the way, in which all others are tried."""


@pytest.fixture
def show(desk: Desk, contents: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Desk:
    """A desk where ``limen show`` ends as soon as a renderer has been asked; content is open already."""
    monkeypatch.setattr("limen.cli.show.opened_content", lambda _out, path: contents[str(path)])
    keep_open(monkeypatch, contents[NAMES["image"]])
    monkeypatch.setattr(
        "limen.cli.show.simplified_mesh",
        lambda _out, _mesh, policy: None if policy.name == "full" else SimpleNamespace(policy=policy),
    )
    desk.watch("limen.cli.show.run_live", "limen.cli.show_live.run_live_scene", "limen.cli.show_live.run_live_outputs")
    desk.watch("limen.cli.show.write_image_frames", "limen.cli.show.write_mesh_frames")
    desk.watch("limen.cli.show.write_terrain_frames", "limen.cli.show_points.write_points_frames")
    return desk


def assert_refused(option: str, said: str, asked: list[Any]) -> None:
    assert option in said, said
    assert "\n" not in said
    assert not asked, f"{option} is refused when somebody has been asked already"


def keep_open(monkeypatch: pytest.MonkeyPatch, image: Image) -> None:
    """Every run would close it."""
    close = Image.close
    monkeypatch.setattr(Image, "close", lambda self: None if self is image else close(self))


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
    if (kind, way) == ("image", "outputs"):
        assert "--window: a display's [[quilt]]" in show.call(showing, *base)[0]
        return
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
    (("image.tif", "--out", "out", "--window", "outputs", "--display", "wall.toml"), "--window says where"),
    (("image.tif", "--out", "out", "--write", "quilts"), "quilts are written of meshes and points alone"),
    (("terrain.tif", "--stereo", "anaglyph"), "leave out --stereo, which is for meshes"),
    (("points.ply", "--stereo", "anaglyph"), "leave out --stereo, which is for meshes"),
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
    (("image.tif", "mesh.ply"), "takes one content at a time (several cannot be shown together yet): leave out"),
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
    doors = {way: show.run("show", "mesh.ply", *words)[2][0][0] for way, words in WAYS_WORDS.items()}
    assert doors["browse"] == doors["wall"] != doors["outputs"] != doors["files"]
    window, wall = (show.run("show", "mesh.ply", *WAYS_WORDS[way])[2] for way in ("browse", "wall"))
    assert window != wall
    here, there = (show.run("show", "mesh.ply", "--out", out)[2] for out in ("here", "there"))
    assert here != there


# ---------------------------------------------------------------- limen traffic and verify

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
    for option, row in TRAFFIC.items():
        said, asked = count.call(counting, *base, one_of_each[option])
        if kind not in row.kinds:
            assert_refused(option, said, asked)
        elif option == "--plot":  # it is drawn when all is counted; a wrong ending is refused before
            assert "must end in" in said
        else:
            assert asked, said
            assert asked != count.call(counting, *base)[1], f"{option} is ignored of {kind}"


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
            assert asked != judge.run(*base)[2], f"{option} is ignored of {kind}"


def test_verify_refuses_what_changes_nothing(judge: Desk) -> None:
    judge.refuses("--panels", "verify", "mesh.ply", "--panels", "a")
    judge.refuses("--acuity-arcmin", "verify", "mesh.ply", "--policy", "full", "size:300", "--acuity-arcmin", "2")


# ---------------------------------------------------------------- all other verbs


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
    "sample": ("limen.data.sample_image", "limen.data.sample_mesh", "limen.data.sample_points"),
    "ingest": ("limen.data.ingest", "limen.data.ingest_terrain"),
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
        (code, said, asked), (_, _, without) = desk.run(*changed), desk.run(*base)
        assert code == 0, (changed, said)
        assert asked, changed
        assert asked != without, f"limen {verb} ignores {option}"


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
        ("bench image --plot plot.png", "--plot draws the benchmarks"),
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
        ("show image.tif mesh.ply terrain.tif", "leave out 'mesh.ply', 'terrain.tif'"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("calibration")
def test_other_verbs_refuse(words: str, says: str, desk: Desk) -> None:
    desk.refuses(says, *words.split())
