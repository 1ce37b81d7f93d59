"""./limen test: what runs beside pytest is reported after it, ends with it, and hides nothing."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest

from support.costs import FIRST, in_order
from support.processes import PYTHON, started

ROOT = Path(__file__).resolve().parents[1]
TOOLS = ROOT / "tools"


@pytest.fixture
def checks() -> Iterator[ModuleType]:
    """As ./limen finds it."""
    sys.path.insert(0, str(TOOLS))
    yield importlib.import_module("launcher.checks")
    sys.path.remove(str(TOOLS))


def put_up(checks: ModuleType, monkeypatch: pytest.MonkeyPatch, before: str, beside: str, code: int = 0) -> None:
    """Checks that say something or fail, as their Python does; pytest only says that it ran."""
    monkeypatch.setattr(checks, "CHECKS", (("first", ("-c", before)),))
    monkeypatch.setattr(checks, "BESIDE", (("beside", ("-c", beside)),))
    monkeypatch.setattr(checks, "_pytest", lambda each: print("tests ran") or code)


@pytest.mark.parametrize(
    ("before", "beside", "code", "failed"),
    [
        ("", "", 0, ""),
        ("", "", 1, "pytest"),
        ("", "exit('wrong type')", 0, "beside"),
        ("exit('wrong type')", "", 0, "first"),
        ("exit(1)", "exit('wrong type')", 1, "first, beside, pytest"),
    ],
)
def test_a_check_beside_pytest_is_told_after_it_and_hides_nothing(
    checks: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    before: str,
    beside: str,
    code: int,
    failed: str,
) -> None:
    put_up(checks, monkeypatch, before, beside, code)
    assert checks.run_all([]) == (1 if failed else 0)
    said = capsys.readouterr().out
    lines = said.splitlines()
    words = [line.split()[0] for line in lines]
    assert words.index("first") < words.index("tests") < words.index("beside")
    assert lines[-1].endswith(f"failed: {failed}" if failed else "every check is fine")
    assert ("wrong type" in lines) == ("wrong type" in before + beside)


def test_with_arguments_nothing_runs_beside(
    checks: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put_up(checks, monkeypatch, "exit(1)", "exit(1)")
    assert checks.run_all(["-k", "x"]) == 0
    assert capsys.readouterr().out == "tests ran\n"


def test_a_check_that_says_more_than_a_pipe_holds_comes_to_its_end(
    checks: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put_up(checks, monkeypatch, "", "print('wrong\\n' * 50_000); exit(1)")
    assert checks.run_all([]) == 1
    said = capsys.readouterr().out
    assert said.count("wrong\n") == 40
    assert "49960 lines more" in said


_INTERRUPTED = """
import sys, time
from launcher import checks
slow = "import os, sys, time; open(sys.argv[1], 'w').write(f'{os.getpid()}\\\\n'); time.sleep(60)"
checks.CHECKS = ()
checks.BESIDE = (("beside", ("-c", slow, sys.argv[1])),)
checks._pytest = lambda each: time.sleep(60)
checks.run_all([])
"""


def test_an_interrupt_ends_what_runs_beside(tmp_path: Path) -> None:
    note = tmp_path / "beside"
    with started([*PYTHON, "-c", _INTERRUPTED, note], env={**os.environ, "PYTHONPATH": str(TOOLS)}) as process:
        while not (note.exists() and note.read_text().endswith("\n")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGINT)  # to it alone: a terminal would tell the other too
        _, remarks = process.communicate(timeout=20)
    assert remarks.splitlines()[-1].startswith("KeyboardInterrupt")
    with pytest.raises(ProcessLookupError), suppress(PermissionError):
        os.kill(int(note.read_text()), 0)


def test_where_no_bytecode_may_be_written_it_is_kept_in_the_notes(
    checks: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert checks.compiled_once({"A": "b"}) == {"A": "b"}
    monkeypatch.setattr(checks, "ROOT", tmp_path)
    variables = checks.compiled_once({**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPYCACHEPREFIX": ""})
    (tmp_path / "one.py").write_text("import two")
    (tmp_path / "two.py").touch()
    subprocess.run([sys.executable, tmp_path / "one.py"], env=variables, check=True)
    (written,) = (path for path in tmp_path.rglob("two.*.pyc"))
    assert written.is_relative_to(tmp_path / ".limen/bytecode")
    chosen = {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPYCACHEPREFIX": "/there"}
    assert checks.compiled_once(chosen)["PYTHONPYCACHEPREFIX"] == "/there"


def test_two_processes_share_the_cores_and_one_has_them_all(
    checks: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert checks.threads_shared({"A": "b"})["OPENBLAS_NUM_THREADS"] == "3"
    assert checks.threads_shared({"OPENBLAS_NUM_THREADS": "5"})["OPENBLAS_NUM_THREADS"] == "5"
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    assert checks.threads_shared({})["OPENBLAS_NUM_THREADS"] == "1"
    ran: list[dict[str, str]] = []
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setattr(checks, "_adapter", lambda _variables: ("some", True))
    monkeypatch.setattr(checks.subprocess, "call", lambda _words, cwd, env: ran.append(env) or 0)
    for arguments in ((), ("tests/cli",)):
        for each in checks.rounds("both", arguments):
            checks._pytest(each)
    assert [env.get("OPENBLAS_NUM_THREADS") for env in ran] == ["1", "1", None, None]


# What runs first


class Item:
    def __init__(self, nodeid: str) -> None:
        self.nodeid = nodeid


def test_expensive_files_come_first_then_those_of_many_tests() -> None:
    ids = ["a::x", "b::x", "b::y", f"{FIRST[1]}::x", f"{FIRST[0]}::y", f"{FIRST[0]}::x", "c::x"]
    ordered = [item.nodeid for item in in_order([Item(each) for each in ids])]
    assert ordered == [f"{FIRST[0]}::y", f"{FIRST[0]}::x", f"{FIRST[1]}::x", "b::x", "b::y", "a::x", "c::x"]


def test_what_comes_first_is_there() -> None:
    assert [name for name in FIRST if not (ROOT / name).is_file()] == []
