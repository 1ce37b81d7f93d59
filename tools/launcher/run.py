"""One way to run a program quietly during set-up."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Result", "run"]


@dataclass(frozen=True)
class Result:
    """How a program ended; ``text`` is what it wrote to stdout, ``remarks`` to stderr."""

    code: int
    text: str
    remarks: str

    @property
    def reason(self) -> str:
        """The end of what it complained about, in one line."""
        lines = [line.strip() for line in (self.remarks or self.text).splitlines() if line.strip()]
        return " | ".join(lines[-3:]) or f"exit code {self.code}"


def run(
    command: Sequence[str | Path],
    folder: Path | None = None,
    variables: Mapping[str, str] | None = None,
    timeout_s: float | None = None,
) -> Result:
    """Run to the end. Interrupted, it is asked to stop and waited for: a killed package manager leaves ruins."""
    words = [str(word) for word in command]
    try:
        process = subprocess.Popen(
            words,
            cwd=folder,
            env=None if variables is None else dict(variables),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
    except OSError as error:
        return Result(127, "", f"{words[0]}: {error.strerror}")
    try:
        text, remarks = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return Result(124, "", f"{words[0]} gave no answer within {timeout_s:g} s")
    except BaseException:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
        raise
    return Result(process.returncode, text, remarks)
