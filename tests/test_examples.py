"""Every example runs, in a process of its own and an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.processes import PYTHON, finished

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.py"))


@pytest.mark.gpu
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    done = finished([*PYTHON, "-W", "error", example], timeout_s=200, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_there_are_examples() -> None:
    if not EXAMPLES:
        pytest.skip("examples/ is still empty")
