"""No doctest is left out, though modules without any are not looked into; and every module can be imported."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

from support.doctests import PACKAGE, pytest_ignore_collect

MODULES = sorted(PACKAGE.rglob("*.py"))


def test_exactly_the_modules_without_doctests_are_left_out() -> None:
    parser = doctest.DocTestParser()
    with_some = {path for path in MODULES if parser.get_examples(path.read_text(encoding="utf-8"))}
    assert len(with_some) > 20
    assert {path for path in MODULES if not pytest_ignore_collect(path)} == with_some


def test_other_files_are_for_pytest_to_decide(tmp_path: Path) -> None:
    (tmp_path / "plain.py").touch()
    assert pytest_ignore_collect(tmp_path / "plain.py") is None
    assert pytest_ignore_collect(Path(__file__)) is None
    assert pytest_ignore_collect(PACKAGE) is None


def test_pytest_asks(request: pytest.FixtureRequest) -> None:
    assert request.config.hook.pytest_ignore_collect(collection_path=PACKAGE / "__init__.py", config=request.config)


def test_every_module_can_be_imported_without_a_warning() -> None:
    """Also one that nothing else in the tests needs."""
    for path in MODULES:
        words = ("limen", *path.relative_to(PACKAGE).with_suffix("").parts)
        if words[-1] != "__main__":
            importlib.import_module(".".join(words).removesuffix(".__init__"))
