"""What `./limen test` runs, in .venv: every check, each in one line, then pytest; a failure hides nothing."""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

__all__ = ["CHECKS", "arguments_from", "run_all"]

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


def run_all(arguments: Sequence[str]) -> int:
    """0 if all is well, 1 if a check or a test failed; with arguments pytest alone decides."""
    began = time.monotonic()
    failed = [] if arguments else [name for name, words in CHECKS if not _check(name, words)]
    # Last, and straight to the terminal, so that its closing line is the one that stays in view.
    code = subprocess.call([sys.executable, "-m", "pytest", *(arguments or _ALL_AT_ONCE)], cwd=ROOT)
    if arguments:
        return code
    if code:
        failed.append("pytest")
    _say(
        f"{time.monotonic() - began:.0f} s in all; "
        + (f"failed: {', '.join(failed)}" if failed else "every check is fine")
    )
    return 1 if failed else 0


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
