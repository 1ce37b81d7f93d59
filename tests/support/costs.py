"""What a run of the tests costs: the most expensive files come first, and a whole run ends by naming them.

Two processes share the files; one that comes last while the other process has nothing left is waited for.
"""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

__all__ = ["FIRST", "Costs", "in_order"]

FIRST: tuple[str, ...] = (
    "tests/frame/test_renderer.py",
    "tests/test_launcher_drivers.py",
    "tests/study/test_observer.py",
    "tests/track/test_walk.py",
    "tests/calibrate/test_solve.py",
    "tests/frame/test_layers.py",
    "tests/cli/test_show_and_demo.py",
    "tests/test_examples.py",
    "benchmarks/test_image.py",
    "tests/layers/image/draw/test_image_quilts.py",
    "tests/frame/test_repeatable.py",
    "tests/layers/image/draw/test_lens_mesh.py",
    "tests/data/image/test_image.py",
    "tests/layers/image/draw/test_sampling.py",
    "tests/cli/test_show_terrain.py",
    "tests/frame/test_images.py",
    "tests/frame/test_states.py",
    "tests/cli/test_show_mesh.py",
    "tests/data/image/test_contrast_file.py",
    "tests/layers/image/draw/test_feedback.py",
    "tests/layers/image/draw/test_pages.py",
    "tests/data/terrain/test_terrain_store.py",
)
"""The most expensive files, which the last lines of a whole run name; the others follow, those of many tests first.

Where nothing is compiled yet, the first file has nearly all loops compiled. The next four, which the other process
works on meanwhile, need none: else both would compile the same ones at the same time. For the same reason no test file
compiles while it is imported, which both processes do.
"""

_SHOWN = 10


def in_order(items: list[pytest.Item]) -> list[pytest.Item]:
    """File by file; what belongs to one file stays together and in order."""
    files = [item.nodeid.partition("::")[0] for item in items]
    many = Counter(files)
    first = {name: place for place, name in enumerate(FIRST)}
    found = {name: place for place, name in enumerate(many)}

    def place(name: str) -> tuple[int, int, int]:
        return first.get(name, len(first)), -many[name], found[name]

    return [item for _, item in sorted(zip(files, items, strict=True), key=lambda each: place(each[0]))]


class Costs:
    """Processor time of this process and its ended children, by file; workers tell it with each report."""

    def __init__(self, config: pytest.Config) -> None:
        self._whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
        self._until = _processor_s()
        self._spent: Counter[str] = Counter()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = in_order(items)

    def pytest_collection_finish(self) -> None:
        self._until = _processor_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        began, self._until = self._until, _processor_s()
        report.processor_s = self._until - began  # what a report holds comes along from worker to controller
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._spent[report.nodeid.partition("::")[0]] += getattr(report, "processor_s", 0.0)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self._whole and self._spent:
            terminalreporter.section(f"{sum(self._spent.values()):.0f} s of processor time; most of it in")
            for name, spent in self._spent.most_common(_SHOWN):
                terminalreporter.line(f"{spent:6.1f} s  {Path(name).as_posix()}")


def _processor_s() -> float:
    spent = [resource.getrusage(which) for which in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in spent)
