"""The benchmark of layers, on samples of the least size."""

from __future__ import annotations

from typing import Any

import pytest

from limen.layers.registry import KINDS
from limen.study.bench import layers as bench

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]


def test_all_layers_together_draw_what_each_draws_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "_QUICK", bench._Size(0.002, 1_000, 129, 5_000, 0.125, 3))
    said: list[str] = []
    (table,) = bench.bench_layers(True, said.append)
    rows: dict[str, Any] = {row["layers"]: row for row in table.rows}
    assert list(rows) == [*KINDS, "together"]
    *alone, together = table.rows
    assert together["drawn"] == sum(row["drawn"] for row in alone) > 1_000
    assert all(row["drawn"] > 0 for row in alone if row["layers"] != "image")
    assert all(row["frame_ms"] > 0 and row["frames"] == 3 for row in table.rows)
    assert together["frame_ms"] > max(row["frame_ms"] for row in alone) / 2
    assert 0.2 < together["over_alone"] < 3
    assert table.notes[0].endswith(f"{together['over_alone']:.2f} (aim: at most 1.10)")
    assert any("megapixels, on " in text for text in said)
