"""Pictures of what was counted and walked: PNG or SVG, as bytes for a report or as a file.

Colours are Okabe, Ito 2008 (*Color Universal Design*), told apart by colour-blind readers too; every line is
labelled where it ends, so that none depends on its colour.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from limen.data.pages import PAGE
from limen.data.store.atomic import write_bytes
from limen.errors import InputError
from limen.geometry import Floats
from limen.study.traffic import Counts, Report, Row
from limen.track.room import Room
from limen.track.session import Session
from limen.track.walk import Heat

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "COLOURS",
    "GREY",
    "INK",
    "STYLE",
    "Format",
    "figure_bytes",
    "format_of",
    "traffic_picture",
    "traffic_plot",
    "walk_picture",
    "walk_plot",
]

Format = Literal["png", "svg"]

_LINE_IN = 0.29
"""Height of a line of text beside a strip, inches."""

INK, GREY = "#222222", "#8a8a8a"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "limen",  # the same picture gives the same bytes
}


def format_of(path: str | Path) -> Format:
    """The kind of picture that a file's name asks for.

    Raises
    ------
    InputError
        If it ends in neither .png nor .svg.
    """
    match Path(path).suffix.lower():
        case ".png":
            return "png"
        case ".svg":
            return "svg"
    raise InputError(f"{path}: a picture's name must end in .png or .svg")


def traffic_plot(report: Report, path: str | Path) -> None:
    """Draw `traffic_picture` to a .png or .svg file.

    Raises
    ------
    InputError
        If the name ends in neither.
    StorageError
        If the file cannot be written.
    """
    write_bytes(path, traffic_picture(report, format_of(path)))


def walk_plot(heat: Heat, hotspots: Sequence[Floats], session: Session, path: str | Path) -> None:
    """Draw `walk_picture` to a .png or .svg file; raises as `traffic_plot`."""
    write_bytes(path, walk_picture(heat, hotspots, session, format_of(path)))


def traffic_picture(report: Report, kind: Format = "svg") -> bytes:
    """Pages per frame over time, a strip for each session and a line for each policy, with mean savings.

    The axis is logarithmic: a level of the pyramid is the same step everywhere.
    """
    with rc_context(STYLE):
        count = len(report.counts)
        lines = 1 + max(len(counts.policies) for counts in report.counts)
        height = max(2.0, _LINE_IN * lines)
        figure = Figure(figsize=(9.0, 1.1 + height * count), layout="constrained")
        strips = figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        limits = _limits(report.counts)
        for strip, counts in zip(strips, report.counts, strict=True):
            _strip(strip, counts, report.page_bytes, limits, height)
        strips[-1].set_xlabel("time, s")
        display = report.view.display
        size = f"{len(display.panels)} panels, {display.total_px / 1e9:.3g} gigapixels"
        title = f"Pages that a frame needs: {report.content} on {display.name}, {size}"
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.5, color=INK)
        return figure_bytes(figure, kind)


def _limits(counts: Sequence[Counts]) -> tuple[float, float]:
    values = np.concatenate([np.append(each.pages.ravel(), each.human_samples / PAGE**2) for each in counts])
    values = values[values > 0] if (values > 0).any() else np.ones(1)
    return float(values.min()) / 1.3, float(values.max()) * 1.4


def _strip(axes: Axes, counts: Counts, page_bytes: float, limits: tuple[float, float], height_in: float) -> None:
    axes.set(yscale="log", ylim=limits)
    axes.set_title(f"Session {counts.session}", loc="left", fontsize=10, color=INK)
    axes.yaxis.set_major_locator(LogLocator(10, subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.6g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.grid(axis="y", color="#e4e4e4", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.margins(x=0)
    labels: list[tuple[float, str, str]] = []
    colours = iter(COLOURS * (1 + len(counts.policies) // len(COLOURS)))
    for policy, pages, row in zip(counts.policies, counts.pages, counts.summary(page_bytes).rows, strict=True):
        colour = INK if policy.name == "full" else next(colours)
        axes.plot(counts.time_s, np.maximum(pages, 1e-3), color=colour, linewidth=1.3)
        labels.append((row.pages_mean, _label(row), colour))
    floor = counts.human_samples / PAGE**2
    axes.plot(counts.time_s, np.maximum(floor, 1e-3), color=GREY, linewidth=1.2, linestyle=(0, (2.2, 1.4)))
    axes.fill_between(counts.time_s, limits[0], np.maximum(floor, limits[0]), color="#efefef", linewidth=0)
    labels.append((float(floor.mean()), f"floor  {floor.mean():,.0f}  human eyes", GREY))
    _end_labels(axes, labels, limits, _LINE_IN / height_in)


def _label(row: Row) -> str:
    if row.acuity_arcmin is None:
        return f"{row.policy}  {row.pages_mean:,.0f}"
    return f"{row.policy} {row.acuity_arcmin:g}′  {row.pages_mean:,.0f}  −{row.saving * 100:.1f} %"


def _end_labels(axes: Axes, labels: list[tuple[float, str, str]], limits: tuple[float, float], step: float) -> None:
    """Names of the lines right of the axes at their means, moved apart where they would overlap.

    ``step`` is the share of the strip's height that one line of text takes.
    """
    low, high = np.log(limits[0]), np.log(limits[1])
    places: list[float] = []
    for value, _, _ in sorted(labels):
        wanted = (np.log(max(value, limits[0])) - low) / (high - low)
        places.append(float(max(wanted, places[-1] + step) if places else wanted))
    over = max(0.0, places[-1] - 1.0)
    for number in range(len(places) - 1, -1, -1):  # what stuck out at the top moves down, and pushes the others
        ceiling = places[-1] - over if number == len(places) - 1 else places[number + 1] - step
        places[number] = min(places[number], ceiling)
    for place, (_, text, colour) in zip(places, sorted(labels), strict=True):
        axes.annotate(
            text, (1.012, place), xycoords="axes fraction", va="center", fontsize=9, color=colour, annotation_clip=False
        )


def walk_picture(heat: Heat, hotspots: Sequence[Floats], session: Session, kind: Format = "svg") -> bytes:
    """The floor from above: heat map, panels, and every viewer's path with its hotspots, (S, 2) for each."""
    room = heat.room
    wide, deep = room.size_m
    with rc_context(STYLE):
        scale = 8.0 / max(wide, deep)
        figure = Figure(figsize=(max(4.5, wide * scale) + 1.2, max(2.6, deep * scale) + 1.0), layout="constrained")
        axes = figure.subplots()
        extent = (room.low[0], room.high[0], room.high[1], room.low[1])
        visits = np.ma.masked_equal(heat.visits, 0)
        shown = axes.imshow(visits, extent=extent, origin="upper", cmap="YlOrBr", vmax=float(visits.max()) * 1.4)
        bar = figure.colorbar(shown, ax=axes, shrink=0.6, pad=0.02)
        bar.set_label("visits to a cell")
        bar.outline.set_visible(False)
        _walls(axes, room)
        for number, (track, spots) in enumerate(zip(session.tracks, hotspots, strict=True)):
            colour = COLOURS[number % len(COLOURS)]
            axes.plot(track.position_m[:, 0], track.position_m[:, 2], color=colour, linewidth=0.9, alpha=0.75)
            axes.plot(*spots.T, "o", color=colour, markersize=6, markeredgecolor="white", label=f"{track.viewer}")
            axes.plot(*spots[0], "o", markersize=11, markerfacecolor="none", markeredgecolor=colour)
        axes.set(xlabel="x, m", ylabel="z, m", aspect="equal")
        axes.set_xlim(room.low[0] - 0.15, room.high[0] + 0.15)
        axes.set_ylim(room.high[1] + 0.15, room.low[1] - 0.15)
        people = "1 viewer" if len(session.tracks) == 1 else f"{len(session.tracks)} viewers"
        title = f"Session {session.name} in front of {session.display}: {session.duration_s:g} s, {people}, "
        axes.set_title(title + f"{session.length_m:.0f} m; ring: the start", loc="left", fontsize=10.5, color=INK)
        return figure_bytes(figure, kind)


def _walls(axes: Axes, room: Room) -> None:
    rows = room.rows
    end = rows.start + rows.along * rows.length_m[:, None]
    axes.add_collection(LineCollection(list(np.stack([rows.start, end], axis=1)), colors=INK, linewidths=4.0))
    for low, high in rows.tables:
        axes.fill([low[0], high[0], high[0], low[0]], [low[1], low[1], high[1], high[1]], color=GREY, alpha=0.5)


def figure_bytes(figure: Figure, kind: Format) -> bytes:
    FigureCanvasAgg(figure)
    out = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(out, format=kind, dpi=160, facecolor="white", bbox_inches="tight", metadata=metadata)
    return out.getvalue()
