"""The benchmarks that there are."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["BENCHMARKS", "Benchmark"]


class Benchmark(NamedTuple):
    """One benchmark.

    Parameters
    ----------
    function
        ``module:function`` that makes its tables; it is told whether to be quick, and says what it does.
    help
        What it measures, in a few words.
    options
        What else it can be told.
    """

    function: str
    help: str
    options: tuple[str, ...] = ()


BENCHMARKS = {
    "image": Benchmark("limen.study.bench.image:bench_image", "pages selected, streamed, read, drawn and made"),
    "kernels": Benchmark("limen.study.bench.kernels:bench_kernels", "filters for pages, as the observer sees them"),
    "panels": Benchmark("limen.study.bench.panels:bench_panels", "ways to bring triangles to many panels", ("plot",)),
    "lens": Benchmark("limen.study.bench.lens:bench_lens", "ways to draw lenses"),
    "terrain": Benchmark(
        "limen.study.bench.terrain:bench_terrain", "triangles and frames of terrains", ("content", "crop")
    ),
    "points": Benchmark("limen.study.bench.points:bench_points", "how fast clouds are built", ("content",)),
    "mesh": Benchmark("limen.study.bench.mesh:bench_mesh", "meshes of fewer triangles", ("content", "plot")),
    "layers": Benchmark("limen.study.bench.layers:bench_layers", "layers in one frame, and each alone"),
}
"""By name; the first is the one to begin with."""
