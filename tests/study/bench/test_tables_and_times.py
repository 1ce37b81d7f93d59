"""What all benchmarks share: tables, times, and the list of them."""

from __future__ import annotations

import inspect
import time
from importlib import import_module

import pytest

from limen.study.bench.registry import BENCHMARKS
from limen.study.bench.table import FIGURES, Table, figure
from limen.study.bench.timing import Spent, median_of, medians, steady_ms, timed, turns

COLUMNS = {"way": "", "frame_ms": ",.1f", "pairs": ",", "note": ""}


def test_a_table_shows_what_any_row_has_in_the_order_of_its_columns() -> None:
    table = Table(COLUMNS, [{"pairs": 12_345, "way": "limen", "note": ""}, {"way": "peer", "frame_ms": 1234.56}])
    assert table.headings == ["way", "frame ms", "pairs"]
    assert table.cells == [["limen", "", "12,345"], ["peer", "1,234.6", ""]]
    assert Table(COLUMNS, []).headings == []


def test_a_row_has_nothing_that_its_table_has_no_column_for() -> None:
    with pytest.raises(ValueError, match=r"table 'parts' has no columns \['frames_ms'\]"):
        Table(COLUMNS, [{"way": "limen", "frames_ms": 1.0}], name="parts")


def test_figures_name_a_peer_where_there_are_several() -> None:
    assert figure("read", 0.5, "ms") == {"what": "read", "value": 0.5, "unit": "ms"}
    assert Table(FIGURES, [figure("read", 1 / 3, "ms", "pyvips")]).cells == [["read", "pyvips", "0.333", "ms"]]


def test_times_are_medians_of_all_calls() -> None:
    waits = iter([0.001, 0.03, 0.002, 0.001, 0.001])
    found = [timed(lambda: time.sleep(next(waits)))[1] for _ in range(5)]
    assert 1 <= median_of(found).clock_ms < 25
    assert median_of(found).cpu_ms < median_of(found).clock_ms
    assert timed(lambda: 7)[0] == 7


def test_the_steadier_time_is_the_processors_where_it_does_all_the_work() -> None:
    spent = [Spent(10.0, 4.0), Spent(30.0, 6.0), Spent(20.0, 5.0)]
    software, hardware = (medians("frame", spent, by_cpu=by_cpu) for by_cpu in (True, False))
    assert software == {"frame_ms": 20.0, "frame_cpu_ms": 5.0}
    assert hardware == {"frame_ms": 20.0, "frame_cpu_ms": None}
    assert [steady_ms(row, "frame") for row in (software, hardware, {})] == [5.0, 20.0, 0.0]
    assert [spent[0].steady_ms(by_cpu=by_cpu) for by_cpu in (True, False)] == [4.0, 10.0]


def test_every_way_is_first_in_its_turn() -> None:
    found = list(turns("abc", 4))
    assert [name for _, name in found] == list("abcbcacababc")
    assert [number for number, _ in found] == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert list(turns([], 3)) == []


@pytest.mark.parametrize("name", BENCHMARKS)
def test_the_list_of_benchmarks_says_what_each_can_be_told(name: str) -> None:
    module, _, function = BENCHMARKS[name].function.partition(":")
    told = list(inspect.signature(getattr(import_module(module), function)).parameters)
    assert told[:2] == ["quick", "say"]
    assert sorted(told[2:]) == sorted(BENCHMARKS[name].options)
