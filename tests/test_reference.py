"""Pages of the reference are as the code is: those that are made of it, and those that are written by hand."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from limen.cli.app import main

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "docs/reference"


def made() -> Any:
    """The tool that writes pages, which is no module of the package."""
    spec = importlib.util.spec_from_file_location("reference", ROOT / "tools/reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["cli.md", "python.md"])
def test_pages_that_are_made_of_the_code_are_as_it_is(page: str) -> None:
    tool = made()
    assert page in tool.PAGES
    written = (REFERENCE / page).read_text(encoding="utf-8")
    assert tool.PAGES[page]() == written, "the code says something else: run `python tools/reference.py`"


# ---------------------------------------------------------------- what --json prints


def printed(kind: Any, path: str = "") -> set[str]:
    """Paths of all that a type is printed as: ``frames[].layers``, ``frames[].layers[].kind``, ..."""
    match msgspec.inspect.type_info(kind) if isinstance(kind, type) else kind:
        case msgspec.inspect.StructType(fields=fields) | msgspec.inspect.DataclassType(fields=fields):
            begin = f"{path}." if path else ""
            return set().union(*(printed(field.type, begin + field.encode_name) for field in fields))
        case msgspec.inspect.ListType(item_type=item) | msgspec.inspect.VarTupleType(item_type=item):
            below = printed(item, f"{path}[]")
            return {path} if below == {f"{path}[]"} else {path} | below
        case msgspec.inspect.UnionType(types=types):
            return set().union(*(printed(each, path) for each in types))
    return {path}


def rows_of(page: str, heading: str) -> dict[str, list[str]]:
    """The rows of all tables under a heading of a page of the reference, by their first cell."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    section = re.split(rf"^#+ {re.escape(heading)}$", text, flags=re.MULTILINE)[1]
    section = re.split(r"^#{1,3} ", section, flags=re.MULTILINE)[0]
    cells = [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in section.splitlines()
        if line.startswith("| `")
    ]
    return {row[0].strip("`"): row[1:] for row in cells}


PRINTED: dict[str, str] = {
    "display": "limen.cli.display:DisplayReport",
    "doctor": "limen.cli.doctor:DoctorReport",
    "calibrate boards": "limen.cli.calibrate:BoardsReport",
    "calibrate solve": "limen.cli.calibrate:CalibrateReport",
    "calibrate rehearse": "limen.calibrate.rehearse:Rehearsal",
}


@pytest.mark.parametrize("verb", PRINTED)
def test_json_is_told_field_by_field(verb: str) -> None:
    module, _, name = PRINTED[verb].partition(":")
    assert set(rows_of("json.md", verb)) == printed(getattr(importlib.import_module(module), name))


def test_json_of_show_is_told_field_by_field() -> None:
    from limen.frame.report import FrameReport

    frames = {"frames", "frames[].files"} | printed(FrameReport, "frames[]")
    assert set(rows_of("json.md", "show")) == frames


def test_json_of_a_walk_is_told_field_by_field(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["walk", "--display", "desktop", "--seconds", "1", "--json", str(tmp_path / "walk.csv")])
    assert set(rows_of("json.md", "walk")) == set(json.loads(capsys.readouterr().out))
