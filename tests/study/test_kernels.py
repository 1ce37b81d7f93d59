"""The kernels' table: what filters cost, as the observer sees it, and where a level starts to show."""

from __future__ import annotations

import numpy as np
import pytest

from limen.errors import InputError
from limen.study.bench.kernels import bench_kernels
from limen.study.charts import chart
from limen.study.kernels import angle_that_passes, drawn_level, judged, kernel_rows
from limen.study.observer import Observer

LIMEN = ("lanczos-2", "catmull-rom")


@pytest.fixture(scope="module")
def page() -> np.ndarray:
    return chart("text", (544, 544), 1)


def test_rows_hold_the_worst_window(observer: Observer, page: np.ndarray) -> None:
    plain = np.full_like(page, 200)
    rows = list(kernel_rows(observer, {"text": [plain, page], "plain": [plain]}, [LIMEN], 1, 0.64))
    assert [(row.halving, row.drawing, row.content) for row in rows] == [(*LIMEN, "text"), (*LIMEN, "plain")]
    text, grey = rows
    alone = judged(observer, (drawn_level(page, 1, *LIMEN), page), 1, 0.64, 0.0)
    assert (text.jod, text.drop_p99) == (alone.jod, alone.drop_p99)
    assert (grey.jod, grey.strict, grey.practical) == (10.0, True, True)


def test_what_pages_are_halved_and_drawn_with_passes_at_the_acuity_that_levels_switch_at(observer: Observer) -> None:
    """The measurement that the kernel and the default acuity stand on (docs/explain/observer.md)."""
    contents = {name: [chart(name, (544, 544))] for name in ("photograph", "text", "noise", "pink")}
    ours = {row.content: row for row in kernel_rows(observer, contents, [LIMEN], 1, 0.64)}
    assert all(row.practical and row.jod > 9.93 for row in ours.values())
    assert ours["photograph"].strict
    worse = kernel_rows(observer, contents, [("box", "bilinear")], 1, 0.64)
    # At least twice the loss, in every content.
    assert all(10 - row.jod > 2 * (10 - ours[row.content].jod) for row in worse)


def test_the_angle_found_is_where_passing_ends(observer: Observer, page: np.ndarray) -> None:
    pair = (drawn_level(page, 1, *LIMEN), page)
    found = angle_that_passes(observer, [pair], 1, lambda verdict: verdict.practical, between_arcmin=(0.62, 1.6))
    assert 0.7 < found < 1.0
    assert judged(observer, pair, 1, 0.97 * found, 0.0).practical
    assert not judged(observer, pair, 1, 1.05 * found, 0.0).practical
    assert angle_that_passes(
        observer, [pair], 1, lambda verdict: True, between_arcmin=(0.62, 0.8), steps=4
    ) == pytest.approx(0.8, rel=0.02)


def test_contents_too_small_are_refused(observer: Observer, page: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"1000 x 1000 px are judged at 0\.64', here are 544 x 544"):
        judged(observer, (page, page), 2, 0.64, 0.0)


def test_the_benchmarks_quick_table(observer: Observer) -> None:
    said: list[str] = []
    (table,) = bench_kernels(True, said.append)
    rows = table.rows
    assert len(rows) == 10
    assert len(said) == 1
    assert {row["unit"] for row in rows} == {"JOD", "JOD, largest drop"}
    assert all(row["what"].startswith("lanczos-2 + catmull-rom, 0.64'") for row in rows)
    assert all(9.9 < row["value"] <= 10 for row in rows if row["unit"] == "JOD")
