"""Which options are heard with what: an option that would be ignored is refused by its name, in one line.

`SHOW` is the table of ``limen show``, `TRAFFIC` and `VERIFY` are those of the other verbs that take several kinds of
content. ``docs/reference/options.md`` is made of them, and ``tests/cli/test_options_of_content.py`` tries every cell.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args, get_type_hints

from cyclopts import Parameter

from limen.errors import InputError

__all__ = [
    "KINDS",
    "OF_SHOW_FILES",
    "SHOW",
    "TRAFFIC",
    "VERIFY",
    "WAYS",
    "Heard",
    "Kind",
    "Way",
    "given_options",
    "kinds_table",
    "noun_of",
    "refuse_kind",
    "refuse_way",
]

Kind: TypeAlias = Literal["image", "mesh", "points", "terrain", "one-to-one"]
Way: TypeAlias = Literal["browse", "wall", "outputs", "files"]
WAYS: tuple[Way, ...] = get_args(Way)
"""How content is shown: in a window of its own, on a simulated display in a window, on this machine's screens (a window
for every quilt), or as files."""

KINDS: tuple[Kind, ...] = ("image", "mesh", "points", "terrain")
_NOUNS = {
    "image": ("an image", "images"),
    "mesh": ("a mesh", "meshes"),
    "points": ("a cloud of points", "points"),
    "terrain": ("a terrain", "terrains"),
    "one-to-one": ("one-to-one", "one-to-one"),
}
_DISPLAYED: tuple[Way, ...] = ("wall", "outputs", "files")
_WINDOWS: tuple[Way, ...] = ("browse", "wall", "outputs")
_NEEDS: dict[tuple[Way, ...], str] = {
    _DISPLAYED: "is about a display's panels: give --display too",
    ("wall", "outputs"): "is of displays that are shown live: give --display, and leave out --out",
    ("files",): "is of pictures that are written: give --out too",
    _WINDOWS: "is of windows: leave it out, or leave out --out",
}
"""What an option that is heard in some ways alone has to be given with."""


class Heard(NamedTuple):
    """With what an option is heard."""

    kinds: tuple[Kind, ...] = KINDS
    ways: tuple[Way, ...] = WAYS
    unless: str = ""
    """What is said of the option where the content is of no kind that it is for, in place of a list of these."""


_IMAGE, _MESH, _TERRAIN, _POINTS = (Heard((kind,)) for kind in ("image", "mesh", "terrain", "points"))
_STANDS = Heard(("mesh", "points"))
_LOOKED_AT = (
    "--target", "--heading-deg", "--pitch-deg", "--range-m", "--exaggeration", "--flight", "--camera", "--cut",
    "--rule", "--field-deg", "--drape",
)  # fmt: skip
_LOOKS = ("--colours", "--contours", "--sun-azimuth-deg", "--sun-altitude-deg")

SHOW: dict[str, Heard] = {
    "--display": Heard(ways=_DISPLAYED),
    "--panels": Heard(ways=_DISPLAYED),
    "--session": Heard(ways=_DISPLAYED),
    "--viewer": Heard(ways=_DISPLAYED),
    "--tracker": Heard(ways=("wall", "outputs")),
    "--gaze": Heard(),
    "--policy": Heard(),
    "--acuity-arcmin": Heard(),
    "--fit": _IMAGE,
    "--max-triangles": _TERRAIN,
    "--overlay": Heard(),
    "--out": Heard(ways=("files",)),
    "--frames": Heard(ways=("files",)),
    "--scale": Heard(ways=("files",)),
    "--format": Heard(ways=("files",)),
    "--simulate": Heard(ways=("files",)),
    "--seen-from": Heard(("mesh", "points", "terrain"), ("files",)),
    "--window": Heard(ways=_WINDOWS),
    "--port": Heard(ways=_WINDOWS),
    "--seconds": Heard(ways=_WINDOWS),
    **dict.fromkeys(("--size-m", "--at", "--up", "--turn-deg", "--tilt-deg", "--animate"), _STANDS),
    **dict.fromkeys(("--background", "--stereo"), Heard(("mesh", "points", "terrain"))),
    "--depth": _MESH,
    "--write": Heard(ways=("files",)),
    **dict.fromkeys((*_LOOKED_AT, *_LOOKS), _TERRAIN),
    "--splats": _POINTS,
    "--lit": _POINTS,
    **dict.fromkeys(
        ("--lens", "--lens-focus", "--lens-drop-off", "--lens-shape", "--lens-heights", "--lens-mode"), _IMAGE
    ),
}
"""Options of ``limen show``, in the order of its help."""

OF_SHOW_FILES = (
    "--display", "--panels", "--session", "--viewer", "--tracker", "--gaze", "--out", "--frames", "--scale", "--format",
    "--simulate", "--seen-from", "--write", "--window", "--port", "--seconds",
)  # fmt: skip
"""Options of ``limen show`` that are heard with a show file, which says all else."""

_COUNTED = Heard((*KINDS, "one-to-one"))
_PAGES = Heard(("image", "one-to-one"))
_NOT_COUNTED = Heard((), unless="it changes no number of triangles or pages")

TRAFFIC: dict[str, Heard] = {
    **dict.fromkeys(("--display", "--panels", "--session", "--policy", "--acuity-arcmin", "--rate-hz"), _COUNTED),
    "--fit": _IMAGE,
    "--max-triangles": _TERRAIN,
    "--per-node": _PAGES,
    "--plot": _PAGES,
    **dict.fromkeys(_LOOKED_AT, _TERRAIN),
    **dict.fromkeys(_LOOKS, _NOT_COUNTED),
}
"""Options of ``limen traffic``."""

_JUDGED = Heard(("image", "mesh", "points"))
_MOVED = Heard(("mesh", "points"))

VERIFY: dict[str, Heard] = {
    "--display": _JUDGED,
    "--panels": _JUDGED,
    "--session": Heard(("image",), unless="they are judged from random views, without a session"),
    "--policy": _JUDGED,
    "--acuity-arcmin": _JUDGED,
    "--views": _JUDGED,
    "--distance-factors": _JUDGED,
    "--eccentricity-deg": _JUDGED,
    "--fit": _IMAGE,
    "--seed": _JUDGED,
    "--changes": _MOVED,
    "--speed-deg-s": _MOVED,
    "--strict": _JUDGED,
    "--plot": _JUDGED,
}
"""Options of ``limen verify``, which judges no terrains."""


def given_options(verb: Callable[..., None], values: Mapping[str, Any]) -> list[str]:
    """The options that ask for something else than is done without them, by the names that people type.

    Parameters
    ----------
    verb
        Whose defaults they are.
    values
        Of its parameters; groups of options are dataclasses. Content and what every verb hears are no such options.
    """
    hints, defaults = get_type_hints(verb, include_extras=True), inspect.signature(verb).parameters
    found: list[str] = []
    for name, value in values.items():
        if name == "common" or defaults[name].kind is inspect.Parameter.POSITIONAL_ONLY:
            continue
        if is_dataclass(value) and not isinstance(value, type):
            own, first = get_type_hints(type(value), include_extras=True), type(value)()
            found += [
                _typed(each.name, own[each.name])
                for each in fields(value)
                if getattr(value, each.name) != getattr(first, each.name)
            ]
        elif value != defaults[name].default:
            found.append(_typed(name, hints[name]))
    return found


def _typed(name: str, hint: Any) -> str:
    """The option of a parameter: named after it, or as its annotation says."""
    for note in getattr(hint, "__metadata__", ()):
        if isinstance(note, Parameter) and note.name:
            return str(next(iter(note.name)))
    return "--" + name.replace("_", "-")


def refuse_way(table: Mapping[str, Heard], given: Iterable[str], way: Way) -> None:
    """Refuse options that would be ignored in the way that content is to be shown.

    Raises
    ------
    InputError
        Naming the first, and what it has to be given with.
    """
    for option in given:
        if way not in table[option].ways:
            raise InputError(f"{option} {_NEEDS[table[option].ways]}")


def refuse_kind(table: Mapping[str, Heard], given: Iterable[str], *kinds: Kind) -> None:
    """Refuse options that are for no content of these kinds.

    Raises
    ------
    InputError
        Naming the first, and what it is for.
    """
    for option in given:
        heard = table[option]
        if not any(_hears(kind, heard) for kind in kinds):
            why = f": {heard.unless}" if heard.unless else f", which is for {_listed(heard.kinds)}"
            what = " and ".join(dict.fromkeys(noun_of(kind) for kind in kinds))
            raise InputError(f"this content is {what}: leave out {option}{why}")


def _hears(kind: Kind, heard: Heard) -> bool:
    """Kinds of other packages hear what all of limen's own do that lie on panels, or stand in the room, as they do."""
    if kind in _NOUNS:
        return kind in heard.kinds
    from limen.layers.registry import KINDS as LAYERS

    alike = {own for own in KINDS if LAYERS[own].on_panels == LAYERS[kind].on_panels}
    return alike <= set(heard.kinds)


def noun_of(kind: Kind) -> str:
    """What people call content of this kind, with its article."""
    if kind not in _NOUNS:  # of another package
        from limen.layers.registry import KINDS as LAYERS

        return LAYERS[kind].noun
    return _NOUNS[kind][0]


def _listed(kinds: Sequence[Kind]) -> str:
    *first, last = (_NOUNS[kind][1] for kind in kinds)
    return f"{', '.join(first)} and {last}" if first else last


def kinds_table(table: Mapping[str, Heard], kinds: Sequence[Kind] = KINDS, *, ways: bool = False) -> str:
    """A table of the documentation, in Markdown: a line for every option."""
    columns = ("option", *kinds, *(WAYS if ways else ()))
    lines = [" | ".join(columns), " | ".join("---" for _ in columns)]
    for option, heard in table.items():
        cells = [kind in heard.kinds for kind in kinds] + ([way in heard.ways for way in WAYS] if ways else [])
        lines.append(" | ".join([f"`{option}`", *("yes" if cell else "-" for cell in cells)]))
    return "\n".join(f"| {line} |" for line in lines)
