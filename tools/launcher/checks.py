"""What `./limen test` runs, in .venv: every check, each in one line, and pytest; a failure hides nothing.

The check that takes long runs beside pytest, and its line comes after pytest's.

With ``--backend both`` pytest runs twice: all tests on the best adapter, then those that draw each kind of content
(marked ``drawing``) on OpenGL, which many machines have nothing else than.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from limen.system import cache_folder

__all__ = [
    "BESIDE",
    "CHECKS",
    "Check",
    "Round",
    "arguments_from",
    "backend_from",
    "compiled_once",
    "rounds",
    "run_all",
    "threads_shared",
]

ROOT = Path(__file__).resolve().parents[2]
_SHOWN_LINES = 40
_IMPORT_LINTER = "from importlinter.cli import lint_imports_command as c; c()"

CHECKS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("ruff check", ("-m", "ruff", "check", "--quiet", "--output-format", "concise", ".")),
    ("ruff format", ("-m", "ruff", "format", "--check", "--quiet", ".")),
    ("import directions", ("-c", _IMPORT_LINTER)),
)
"""Name and arguments to Python. The shaders, the documentation and the examples are checked by tests."""

BESIDE: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("mypy --strict", ("-m", "mypy", "--cache-dir", str(cache_folder() / "mypy"))),
)
"""As ``CHECKS``: half a minute on one core, while pytest's processes start and have work of their own.

What it knows of a file is kept for all checkouts, as the code of compiled loops is.
"""

_MODEST = 5
"""How nice such a check is: pytest's tests have time limits, and it has time until they end."""

_ALL_AT_ONCE = ("-n", "2", "--dist", "loadfile", "--no-loadscope-reorder")
"""Two processes, a file to each, in the order of tests/support/costs.py: most tests keep one core busy, and software
graphics a little more."""

_OPTION = "--backend"
_BACKENDS = ("vulkan", "opengl", "both")


class Round(NamedTuple):
    """One run of pytest, on the adapter that ``LIMEN_ADAPTER`` names; ``must``: it is an error if there is none."""

    adapter: str
    arguments: tuple[str, ...]
    must: bool = True


def backend_from(words: Sequence[str]) -> tuple[str, list[str]]:
    """The backend that is asked for (or ""), and what is left for pytest.

    Raises
    ------
    ValueError
        If it is none of the three; the message is the one line to show.
    """
    rest, backend = list(words), ""
    for place, word in enumerate(words):
        if word == _OPTION or word.startswith(f"{_OPTION}="):
            given = word.partition("=")[2] if "=" in word else "".join(words[place + 1 : place + 2])
            if given not in _BACKENDS:
                raise ValueError(f"{_OPTION} takes vulkan, opengl or both, got '{given}'")
            backend = given
            del rest[place : place + (1 if "=" in word else 2)]
            break
    return backend, rest


def rounds(backend: str, arguments: Sequence[str]) -> list[Round]:
    """What pytest runs, in order; without a backend limen chooses the adapter."""
    chosen = tuple(arguments or _ALL_AT_ONCE)
    if backend != "both":
        return [Round(backend, chosen, must=bool(backend))]
    return [Round("", chosen, must=False), Round("opengl", chosen if arguments else (*chosen, "-m", "drawing"), False)]


def run_all(words: Sequence[str]) -> int:
    """0 if all is well, 1 if a check or a test failed; with arguments pytest alone decides."""
    began = time.monotonic()
    try:
        backend, arguments = backend_from(words)
    except ValueError as error:
        sys.stderr.write(f"limen: {error}\n")
        return 2
    if arguments:
        return max(_pytest(each) for each in rounds(backend, arguments))
    beside = [Check(name, words, _MODEST) for name, words in BESIDE]
    try:
        failed = [name for name, words in CHECKS if not Check(name, words).fine()]
        codes = [_pytest(each) for each in rounds(backend, ())]
        failed += [each.name for each in beside if not each.fine()]
    finally:
        for each in beside:
            each.end()
    failed += ["pytest"] if any(codes) else []
    _say(
        f"{time.monotonic() - began:.0f} s in all; "
        + (f"failed: {', '.join(failed)}" if failed else "every check is fine")
    )
    return 1 if failed else 0


def _pytest(wanted: Round) -> int:
    """Straight to the terminal, after all that may be long, so that its closing lines stay in view."""
    variables = compiled_once({**os.environ, "LIMEN_ADAPTER": wanted.adapter or os.environ.get("LIMEN_ADAPTER", "")})
    adapter, found = _adapter(variables)
    _say(f"{'tests draw with' if found else 'NOTHING IS DRAWN IN THESE TESTS:'} {adapter}")
    if not found and wanted.adapter:
        return 2 if wanted.must else 0
    if wanted.arguments[: len(_ALL_AT_ONCE)] == _ALL_AT_ONCE:
        variables = threads_shared(variables)
    return subprocess.call([sys.executable, "-m", "pytest", *wanted.arguments], cwd=ROOT, env=variables)


def compiled_once(variables: dict[str, str]) -> dict[str, str]:
    """Where Python may write no bytecode beside what it was made from, it writes it into .limen, for all the processes.

    They start dozens of programs, and each would spend seconds on compiling all of limen again.
    """
    if not variables.get("PYTHONDONTWRITEBYTECODE"):
        return variables
    kept = variables.get("PYTHONPYCACHEPREFIX") or str(ROOT / ".limen/bytecode")
    return {**variables, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": kept}


def threads_shared(variables: dict[str, str]) -> dict[str, str]:
    """Each of two processes has half of the cores for its linear algebra, unless somebody has said otherwise.

    OpenBLAS and OpenMP wait for each other's threads in busy loops: with more threads than cores a product of small
    matrices takes ten times as long.
    """
    half = str(max(1, (os.cpu_count() or 1) // 2))
    return {"OPENBLAS_NUM_THREADS": half, "OMP_WAIT_POLICY": "PASSIVE", **variables}


_ASK = """
import sys
from limen.errors import NoAdapterError
from limen.gpu.device import open_device
try:
    with open_device() as device:
        print(device.adapter_name)
except NoAdapterError as error:
    sys.exit(str(error))
"""


def _adapter(variables: dict[str, str]) -> tuple[str, bool]:
    """The adapter's name and True, or why there is none and False."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", _ASK], env=variables, capture_output=True, text=True, check=False
    )
    said = (done.stderr if done.returncode else done.stdout).strip() or f"exit code {done.returncode}"
    return said.splitlines()[-1], done.returncode == 0


class Check:
    """A check that has been started; its one line, and what it complains about, come when it is asked for them."""

    def __init__(self, name: str, words: Sequence[str], modest: int = 0) -> None:
        self.name = name
        self._words = words
        self._began = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, *words], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        if modest and sys.platform != "win32":
            os.setpriority(os.PRIO_PROCESS, self._process.pid, os.getpriority(os.PRIO_PROCESS, 0) + modest)
        self._text, self._took_s = "", 0.0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """In a thread: a full pipe would hold the check up, and it may end long before it is asked for."""
        self._text, _ = self._process.communicate()
        self._took_s = time.monotonic() - self._began

    def fine(self) -> bool:
        """Wait for it, and say how it went."""
        try:
            self._reader.join()
        except BaseException:
            self.end()
            raise
        code = self._process.returncode
        _say(f"{self.name:<18} {'ok' if code == 0 else 'FAILED':<7} {self._took_s:4.1f} s")
        if code:
            lines = self._text.rstrip().splitlines()
            if len(lines) > _SHOWN_LINES:
                # Other lines should not need scrolling for.
                _say(f"... {len(lines) - _SHOWN_LINES} lines more: {sys.executable} {shlex.join(self._words)}")
            for line in lines[-_SHOWN_LINES:]:
                _say(line)
        return code == 0

    def end(self) -> None:
        """At once, if it still runs."""
        self._process.kill()
        self._reader.join()


def arguments_from(words: Sequence[str], folder: Path) -> list[str]:
    """Pytest runs in the checkout; paths were typed where the user stands."""
    absolute = []
    for word in words:
        path, colons, rest = word.partition("::")
        here = folder / path
        absolute.append(f"{here.resolve()}{colons}{rest}" if path and here.exists() else word)
    return absolute


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    try:
        sys.exit(run_all(arguments_from(sys.argv[1:], Path.cwd())))
    except KeyboardInterrupt:
        sys.exit(130)
