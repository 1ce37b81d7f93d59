"""Files on the command line, opened as what they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from limen.cli.output import Output
from limen.data.opening import open_content

__all__ = ["opened_content"]


def opened_content(out: Output, path: str | Path) -> Any:
    """Open a file as what it is, with a bar while heights or points are made ready."""
    with out.progress(f"making {Path(path).name} ready", 1000) as step:
        return open_content(path, progress=lambda done: step.to(round(1000 * done)))
