"""A desk for tests of the command line: somebody at the door of each renderer writes down what is asked of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np
import pytest

from limen.cli import heard
from limen.cli.app import app, main
from limen.cli.heard import Kind
from limen.data.image.file import Image
from limen.data.mesh.mesh import Mesh
from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import LimenError
from limen.show.show import Show


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
    if isinstance(value, Show):
        return told({name: each for name, each in vars(value).items() if not name.startswith("_")})
    if hasattr(value, "kind") and hasattr(value, "name") and not hasattr(value, "selector"):  # a terrain or points
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [(each.name, told(getattr(value, each.name))) for each in dataclasses.fields(value)]
    if isinstance(value, msgspec.Struct):
        return told(msgspec.to_builtins(value, enc_hook=np.ndarray.tolist))
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
                elif name not in ("content", "contents"):
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
            several = "contents" in signature(verb.function).parameters
            verb.function([Path(content)] if several else content, **verb.arguments(*values))
        except Enough:
            return "", self.asked
        except LimenError as error:
            return str(error), self.asked
        raise AssertionError(f"{content}: nobody was asked for anything")


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


POINTS = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
POINTS += "end_header\n0 0 0\n1 0 0\n0 1 1\n"
NAMES: dict[Kind, str] = {
    "image": "image.tif",
    "mesh": "mesh.ply",
    "points": "points.ply",
    "terrain": "terrain.tif",
    "one-to-one": "one-to-one",
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
    "--tracker": Try(("--tracker", "circling:20")),
    "--gaze": Try(("--gaze", "0.4,0.1,-1"), ("--policy", "contrast+gaze")),
    "--policy": Try(("--policy", "contrast")),
    "--acuity-arcmin": Try(("--acuity-arcmin", "2"), ("--policy", "contrast")),
    "--fit": Try(("--fit", "cover")),
    "--max-triangles": Try(("--max-triangles", "500")),
    "--frames": Try(("--frames", "2")),
    "--scale": Try(("--scale", "0.5")),
    "--format": Try(("--format", "png")),
    "--simulate": Try(("--simulate",)),
    "--seen-from": Try(("--seen-from", "1,1,1"), ("--simulate",)),
    "--window": Try(("--window", "browser")),
    "--port": Try(("--port", "8123"), ("--window", "browser")),
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


def assert_refused(option: str, said: str, asked: list[Any]) -> None:
    assert option in said, said
    assert "\n" not in said
    assert not asked, f"{option} is refused when somebody has been asked already"


def keep_open(monkeypatch: pytest.MonkeyPatch, image: Image) -> None:
    """Every run would close it."""
    close = Image.close
    monkeypatch.setattr(Image, "close", lambda self: None if self is image else close(self))
