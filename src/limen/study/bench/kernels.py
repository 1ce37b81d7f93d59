"""Filters for halving and drawing pages, as the independent observer sees them."""

from __future__ import annotations

from limen.study.bench.table import FIGURES, Say, Table, figure
from limen.study.charts import CHARTS, chart
from limen.study.kernels import kernel_rows
from limen.study.observer import Observer

__all__ = ["bench_kernels"]

_CHART_PX = 544  # a little more than the observer's 256 samples at 0.64 arcminutes for two pixels
_FILTERS = (
    ("box", "bilinear"),
    ("box", "catmull-rom"),
    ("mitchell", "catmull-rom"),
    ("magic-sharp", "catmull-rom"),
    ("lanczos-2", "bilinear"),
    ("lanczos-3", "catmull-rom"),
    ("lanczos-3", "lanczos-3"),
    ("lanczos-2", "catmull-rom"),
)
"""Halving and drawing; limen's own are the last."""


def bench_kernels(quick: bool, say: Say) -> list[Table]:
    """The table of ``limen bench kernels``."""
    observer = Observer()
    seeds, size_px = range(1 if quick else 3), (_CHART_PX, _CHART_PX)
    contents = {name: [chart(name, size_px, seed) for seed in seeds] for name in CHARTS}
    rows = []
    for texel_arcmin in (0.64,) if quick else (0.64, 1.0):
        say(f"level 1, a texel of which subtends {texel_arcmin:g} arcminutes")
        for row in kernel_rows(observer, contents, _FILTERS[-1:] if quick else _FILTERS, 1, texel_arcmin):
            what = f"{row.halving} + {row.drawing}, {row.texel_arcmin:g}', {row.content}"
            rows += [figure(what, row.jod, "JOD"), figure(what, row.drop_p99, "JOD, largest drop")]
    return [Table(FIGURES, rows)]
