"""Programs that tests start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

__all__ = ["CHILD", "LIMEN", "PYTHON", "finished", "started"]

CHILD = (sys.executable, "-P", str(Path(__file__).with_name("child.py")))
"""Before any command: it gets the default signals, and ends with the tests."""

PYTHON = (*CHILD, sys.executable)
LIMEN = (*PYTHON, "-m", "limen.cli")


@contextmanager
def started(words: Sequence[object], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A program that runs beside the test; it and all that it started have ended when the block is left.

    The words begin with ``LIMEN``, ``PYTHON`` or ``CHILD``.
    """
    options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen(list(map(str, words)), **options) as process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def finished(words: Sequence[object], timeout_s: float, **options: Any) -> subprocess.CompletedProcess[str]:
    """A program after its end, which has to come within so many seconds."""
    with started(words, **options) as process:
        out, err = process.communicate(timeout=timeout_s)
    return subprocess.CompletedProcess(list(words), process.returncode, out, err)
