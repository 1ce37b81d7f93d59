"""The benchmark of panels as a picture: frames over the number of panels, and what the frames consist of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from limen.study.bench.table import Row
from limen.study.bench.timing import steady_ms
from limen.study.plots import COLOURS, GREY, STYLE, Format, figure_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["panels_picture"]


def panels_picture(rows: Sequence[Row], parts: Sequence[Row], kind: Format = "svg") -> bytes:
    """The points of figure 18 by their steadier times: whole frames of every way, and the parts of those that sort."""
    shown = [row for row in rows if row["figure"] == 18 and row["frames"]]
    unit = "ms of processor time" if any(row.get("frame_cpu_ms") for row in shown) else "ms"
    with rc_context(STYLE):
        figure = Figure(figsize=(9, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        _frames(left, shown)
        _parts(right, parts)
        left.set_ylabel(f"{unit} a frame")
        right.set_ylabel(unit)
        return figure_bytes(figure, kind)


def _frames(axes: Axes, rows: Sequence[Row]) -> None:
    for number, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
        line = sorted((row["panels"], steady_ms(row, "frame")) for row in rows if row["method"] == method)
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(*zip(*line, strict=True), color=colour, marker="o", markersize=4)
        axes.annotate(
            method,
            line[-1],
            xytext=(6, 0),
            textcoords="offset points",
            color=colour,
            va="center",
            annotation_clip=False,
        )
    axes.set(xscale="log", yscale="log", xlabel="panels")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.grid(axis="y", color=GREY, alpha=0.25)


def _parts(axes: Axes, parts: Sequence[Row]) -> None:
    names = list(dict.fromkeys(row["part"] for row in parts if row["part"] != "depth by fragments"))
    # In the order of a frame, though one way has a part that the other has not.
    names.sort(key=lambda name: name == "drawing")
    frames = sorted({(row["panels"], row["method"]) for row in parts})
    ms = {(row["panels"], row["method"], row["part"]): row["ms"] for row in parts}
    below = [0.0] * len(frames)
    for number, name in enumerate(names):
        sizes = [ms.get((*frame, name), 0.0) for frame in frames]
        axes.bar(range(len(frames)), sizes, bottom=below, color=COLOURS[number % len(COLOURS)], label=name, width=0.75)
        below = [low + size for low, size in zip(below, sizes, strict=True)]
    axes.set_xticks(range(len(frames)), [f"{method} {panels:,}" for panels, method in frames], rotation=90, fontsize=8)
    axes.legend(frameon=False, fontsize=8, loc="upper left")
