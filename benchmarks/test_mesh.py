"""How long normals of a deforming mesh take: ``pytest benchmarks/test_mesh.py --benchmark-enable``."""

from __future__ import annotations

from typing import Any

import pytest

from limen.data.samples.mesh import ripple, torus_knot


@pytest.mark.parametrize("triangles", [69_716, 871_000])
def test_a_deformed_frame(benchmark: Any, triangles: int) -> None:
    rest = ripple(torus_knot(triangles), 0.0)  # the first deformation also finds which vertices share a normal
    moved = benchmark(rest.deformed, rest.positions * 1.1)
    assert moved.size == rest.size
