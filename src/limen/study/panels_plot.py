"""The benchmark of panels as a picture: frames over the number of panels, and what the frames consist of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from limen.data.store.atomic import write_bytes
from limen.study.bench_panels import PanelsRow
from limen.study.plots import COLOURS, GREY, STYLE, Format, figure_bytes, format_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["panels_picture", "panels_plot"]


def panels_plot(rows: Sequence[PanelsRow], path: str | Path) -> None:
    """Draw `panels_picture` to a .png or .svg file.

    Raises
    ------
    InputError
        If the name ends in neither.
    StorageError
        If the file cannot be written.
    """
    write_bytes(path, panels_picture(rows, format_of(path)))


def panels_picture(rows: Sequence[PanelsRow], kind: Format = "svg") -> bytes:
    """The points of figure 18 by their steadier times: whole frames of every way, and the parts of those that sort."""
    shown = [row for row in rows if row.figure == 18 and row.frames]
    with rc_context(STYLE):
        figure = Figure(figsize=(9, 3.8), layout="constrained")
        whole, parts = figure.subplots(1, 2)
        _frames(whole, shown)
        _parts(parts, [row for row in shown if row.parts_ms])
        return figure_bytes(figure, kind)


def _frames(axes: Axes, rows: Sequence[PanelsRow]) -> None:
    for number, method in enumerate(dict.fromkeys(row.method for row in rows)):
        line = sorted((row.panels, row.steady_ms[1]) for row in rows if row.method == method)
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
    axes.set(xscale="log", yscale="log", xlabel="panels", ylabel=f"{_unit(rows)} a frame")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.grid(axis="y", color=GREY, alpha=0.25)


def _parts(axes: Axes, rows: Sequence[PanelsRow]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row.parts_ms if name != "depth by fragments"))
    # In the order of a frame, though one way has a part that the other has not.
    names.sort(key=lambda name: name == "drawing")
    rows = sorted(rows, key=lambda row: (row.panels, row.method))
    below = [0.0] * len(rows)
    for number, name in enumerate(names):
        sizes = [row.parts_ms.get(name, 0.0) for row in rows]
        axes.bar(range(len(rows)), sizes, bottom=below, color=COLOURS[number % len(COLOURS)], label=name, width=0.75)
        below = [low + size for low, size in zip(below, sizes, strict=True)]
    axes.set_xticks(range(len(rows)), [f"{row.method} {row.panels:,}" for row in rows], rotation=90, fontsize=8)
    axes.set_ylabel(_unit(rows))
    axes.legend(frameon=False, fontsize=8, loc="upper left")


def _unit(rows: Sequence[PanelsRow]) -> str:
    return "ms of processor time" if any(row.frame_cpu_ms for row in rows) else "ms"
