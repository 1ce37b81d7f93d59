"""What `./limen test` runs, in .venv: every check, each in one line, then pytest; a failure hides nothing.

With ``--backend both`` pytest runs twice: all tests on the best adapter, then those that draw each kind of content
(marked ``drawing``) on OpenGL, which many machines have nothing else than.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

__all__ = ["CHECKS", "Round", "arguments_from", "backend_from", "rounds", "run_all"]

ROOT = Path(__file__).resolve().parents[2]
_SHOWN_LINES = 40
_IMPORT_LINTER = "from importlinter.cli import lint_imports_command as c; c()"

CHECKS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("ruff check", ("-m", "ruff", "check", "--quiet", "--output-format", "concise", ".")),
    ("ruff format", ("-m", "ruff", "format", "--check", "--quiet", ".")),
    ("mypy --strict", ("-m", "mypy")),
    ("import directions", ("-c", _IMPORT_LINTER)),
)
"""Name and arguments to Python. The shaders, the documentation and the examples are checked by tests."""


_ALL_AT_ONCE = ("-n", "2", "--dist", "loadscope")
"""Two processes, a file to each: most tests keep one core busy, and software graphics a little more."""

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
    failed = [] if arguments else [name for name, check in CHECKS if not _check(name, check)]
    codes = [_pytest(each) for each in rounds(backend, arguments)]
    if arguments:
        return max(codes)
    failed += ["pytest"] if any(codes) else []
    _say(
        f"{time.monotonic() - began:.0f} s in all; "
        + (f"failed: {', '.join(failed)}" if failed else "every check is fine")
    )
    return 1 if failed else 0


def _pytest(wanted: Round) -> int:
    """Straight to the terminal, after everything else, so that its closing line is the one that stays in view."""
    variables = {**os.environ, "LIMEN_ADAPTER": wanted.adapter or os.environ.get("LIMEN_ADAPTER", "")}
    adapter, found = _adapter(variables)
    _say(f"{'tests draw with' if found else 'NOTHING IS DRAWN IN THESE TESTS:'} {adapter}")
    if not found and wanted.adapter:
        return 2 if wanted.must else 0
    return subprocess.call([sys.executable, "-m", "pytest", *wanted.arguments], cwd=ROOT, env=variables)


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


def _check(name: str, words: Sequence[str]) -> bool:
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    _say(f"{name:<18} {'ok' if done.returncode == 0 else 'FAILED':<7} {time.monotonic() - began:4.1f} s")
    if done.returncode:
        lines = done.stdout.rstrip().splitlines()
        if len(lines) > _SHOWN_LINES:
            # Pytest's lines come after these and should not need scrolling for.
            _say(f"... {len(lines) - _SHOWN_LINES} lines more: {sys.executable} {shlex.join(words)}")
        _say("\n".join(lines[-_SHOWN_LINES:]))
    return done.returncode == 0


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
