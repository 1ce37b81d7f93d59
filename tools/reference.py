"""Writes the pages of the reference that are made from the code: its command line and its Python names.

``python tools/reference.py`` writes them anew; a test says when that is due.
"""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from cyclopts import App

import limen
from limen.cli.app import app

FOLDER = Path(__file__).resolve().parents[1] / "docs/reference"
COMMON = ("--json", "--quiet", "--verbose")
"""Options that every verb takes: told once."""


# ---------------------------------------------------------------- the command line


def verbs(under: App = app, path: str = "") -> Iterator[tuple[str, App]]:
    """Every verb by what is typed for it: ``walk``, ``calibrate boards``."""
    for name in under:
        if not name.startswith("-"):
            verb = under[name]
            below = list(verbs(verb, f"{path}{name} "))
            yield from below or [(path + name, verb)]


def cli_page() -> str:
    """All verbs with all that they take, as ``--help`` tells it."""
    told = [(name, _help(verb)) for name, verb in verbs()]
    parts = [
        "# The command line",
        "Made of the help of every verb by `tools/reference.py`. `limen VERB --help` shows the same. In a checkout, "
        "`./limen VERB` sets up what is missing first.",
        "\n".join(["| verb | does |", "|---|---|", *(f"| [`{n}`](#{_anchor(n)}) | {t[0]} |" for n, t in told)]),
        "Every verb takes these:",
        _rows(argument for argument in told_arguments(dict(verbs())["doctor"]) if argument.names[0] in COMMON),
        "A verb ends with 0 when it is done, 2 when what it was given is wrong (one line on stderr says what), 1 when "
        "limen itself is at fault, and 130 when it was interrupted. Results are printed on stdout, progress and "
        "remarks on stderr. What `--json` prints is in [JSON](json.md); which option is heard with which content is in "
        "[What is heard with what](options.md).",
    ]
    for (name, verb), (_, told_of) in zip(verbs(), told, strict=True):
        arguments = [argument for argument in told_arguments(verb) if argument.names[0] not in COMMON]
        parts += [f"## {name}", *told_of]
        if arguments:
            parts.append(_rows(arguments))
    return "\n\n".join(parts) + "\n"


def told_arguments(verb: App) -> list[Any]:
    """What a verb's help lists: by place first."""
    arguments = [each for each in verb.assemble_argument_collection(parse_docstring=True) if each.parse and each.show]
    return sorted(arguments, key=lambda argument: argument.index is None)


def _help(verb: App) -> list[str]:
    """What a verb does in a sentence, its example, and what more its help says."""
    summary, _, example = verb.help.strip().partition("\n\n")
    more = inspect.getdoc(verb.default_command) or ""
    more = re.split(r"\n\n\w+\n-{4,}\n", more)[0].partition("\n\n")[2]
    code = example.removeprefix("Example: ")
    return [summary, *([f"```bash\n{code}\n```"] if code else []), *([_prose(more)] if more else [])]


def _rows(arguments: Any) -> str:
    rows = ["| takes | what | default |", "|---|---|---|"]
    for argument in arguments:
        told = _cell(argument.parameter.help or "")
        rows.append(f"| {_cell(_typed(argument))} | {told} | {_default(argument)} |")
    return "\n".join(rows)


def _typed(argument: Any) -> str:
    names = [argument.names[0], *(name for name in argument.names[1:] if re.fullmatch(r"-\w", name))]
    if argument.index is not None:
        return f"`{argument.name.removeprefix('--').upper().replace('-', '_')}`{' ...' if _many(argument.hint) else ''}"
    value = _value(argument.hint)
    return ", ".join(f"`{name}{' ' + value if value else ''}`" for name in names)


def _value(hint: Any) -> str:
    """What follows an option: nothing, a number, one of several words."""
    hint = _inner(hint)
    if hint is bool:
        return ""
    if typing.get_origin(hint) is typing.Literal:
        return "|".join(map(str, typing.get_args(hint)))
    if _many(hint):
        return f"{_value(typing.get_args(hint)[0])} ..."
    union = [_value(each) for each in typing.get_args(hint)]
    named = {int: "N", float: "F", str: "TEXT", Path: "PATH"}
    return named.get(hint) or "|".join(dict.fromkeys(union)) or "TEXT"


def _inner(hint: Any) -> Any:
    """A type without what says that it may be left out."""
    if typing.get_origin(hint) is typing.Annotated:
        return _inner(typing.get_args(hint)[0])
    rest = [each for each in typing.get_args(hint) if each is not type(None)]
    return _inner(rest[0]) if len(rest) == 1 and type(None) in typing.get_args(hint) else hint


def _many(hint: Any) -> bool:
    return typing.get_origin(_inner(hint)) in (list, tuple)


def _default(argument: Any) -> str:
    if argument.required:
        return "required"
    default = argument.field_info.default
    empty = default in (None, inspect.Parameter.empty, "", [], (), False)
    return "" if empty else f"`{' '.join(map(str, default)) if isinstance(default, list | tuple) else default}`"


# ---------------------------------------------------------------- Python


def python_page() -> str:
    """Every name of `limen`, with its docstring, and those of what its classes do."""
    parts = [
        "# Python",
        "Made of the docstrings of `limen.__all__` by `tools/reference.py`. Names are imported when they are first "
        "used: `import limen` costs milliseconds and touches no graphics driver.",
        "Every error is a `limen.LimenError` with one line that says what to do, and also the built-in error that "
        "fits: a missing file is a `FileNotFoundError` too.",
        "\n".join(["| name | is |", "|---|---|", *map(_listed, limen.__all__)]),
    ]
    for name in limen.__all__:
        thing = getattr(limen, name)
        parts += [f"## limen.{name}", *_told(name, thing)]
        if inspect.isclass(thing):
            for part, member in _members(thing):
                parts += [f"### {name}.{part}", *_told(f"{name}.{part}", member)]
    return "\n\n".join(parts) + "\n"


def _told(name: str, thing: Any) -> list[str]:
    signature = _signature(name, thing).replace("'", '"')
    return [*([f"```python\n{signature}\n```"] if signature else []), _sections(inspect.getdoc(_function(thing)) or "")]


def _members(cls: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties of its own that say what they are."""
    for name, member in vars(cls).items():
        is_member = isinstance(member, property | classmethod | staticmethod) or inspect.isfunction(member)
        if is_member and not name.startswith("_") and inspect.getdoc(_function(member)):
            yield name, member


def _function(member: Any) -> Any:
    if isinstance(member, property):
        return member.fget
    return member.__func__ if isinstance(member, classmethod | staticmethod) else member


def _signature(name: str, thing: Any) -> str:
    """As it is called, a parameter a line where that is too long; nothing for what is not called."""
    try:
        signature = inspect.signature(_function(thing))
    except (TypeError, ValueError):
        return ""
    returns = "" if inspect.isclass(thing) else f" -> {_annotation(signature.return_annotation)}"
    if isinstance(thing, property):
        return name + returns.replace(" ->", ":")
    shown: list[str] = []
    keyword_only = False
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword_only:
            keyword_only = True
            shown.append("*")
        if parameter.name not in ("self", "cls"):
            shown.append(_parameter(parameter))
    line = f"{name}({', '.join(shown)}){returns}"
    return line if len(line) <= _WIDTH else "\n".join([f"{name}(", *(f"    {each}," for each in shown), f"){returns}"])


def _parameter(parameter: inspect.Parameter) -> str:
    text = parameter.name
    if parameter.annotation is not parameter.empty:
        text += f": {_annotation(parameter.annotation)}"
    if parameter.default is parameter.empty:
        return text
    default = repr(parameter.default)
    return f"{text} = {default if len(default) < _SHORT and not default.startswith('<') else '...'}"


def _annotation(annotation: Any) -> str:
    return annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)


_WIDTH, _SHORT = 110, 30
_SECTION = re.compile(r"^([A-Z]\w+)\n-{3,}\n", re.MULTILINE)


def _sections(doc: str) -> str:
    """A docstring in numpydoc's form as Markdown."""
    pieces = _SECTION.split(doc)
    out = [_prose(pieces[0])]
    for title, body in zip(pieces[1::2], pieces[2::2], strict=True):
        if title == "References":
            out.append(f"*{title}.* {_prose(body)}")
        else:
            items = re.split(r"^(?=\S)", body, flags=re.MULTILINE)
            listed = [_item(*item.partition("\n")) for item in items if item.strip()]
            out.append(f"**{title}**\n\n" + "\n".join(listed))
    return "\n\n".join(part for part in out if part.strip())


def _item(head: str, _: str, text: str) -> str:
    return f"* `{head.strip()}`: {_flat(inspect.cleandoc(text))}" if text.strip() else f"* {_flat(head)}"


def _prose(text: str) -> str:
    """Text of a docstring: double backquotes are code, single ones names, and lines with prompts examples."""
    blocks = []
    for block in re.split(r"\n{2,}", text.strip()):
        if block.lstrip().startswith(">>>"):
            blocks.append(f"```python\n{block}\n```")
        else:
            blocks.append(block.replace("``", "`"))
    return "\n\n".join(blocks)


def _flat(text: str) -> str:
    return " ".join(_prose(text).split())


def _listed(name: str) -> str:
    first = (inspect.getdoc(getattr(limen, name)) or "").partition("\n\n")[0]
    return f"| [`{name}`](#{_anchor('limen.' + name)}) | {_cell(first)} |"


def _cell(text: str) -> str:
    return " ".join(text.replace("``", "`").split()).replace("|", "\\|")


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


PAGES: dict[str, Callable[[], str]] = {"cli.md": cli_page, "python.md": python_page}
"""What is made, by the name of its page."""

if __name__ == "__main__":
    for page, make in PAGES.items():
        (FOLDER / page).write_text(make(), encoding="utf-8")
