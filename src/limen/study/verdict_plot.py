"""The study's figure: how often the observer sees a difference, against how wrong the distance was."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from limen.data.store.atomic import write_bytes
from limen.study.plots import COLOURS, GREY, INK, STYLE, Format, figure_bytes, format_of
from limen.study.verify import VerifyRow

__all__ = ["verdict_picture", "verdict_plot"]

_DASHES = ("-", (0, (5, 1.5)), (0, (2.2, 1.4)), (0, (1, 1.2)))


def verdict_plot(rows: Sequence[VerifyRow], title: str, path: str | Path) -> None:
    """Draw `verdict_picture` to a .png or .svg file.

    Raises
    ------
    InputError
        If the name ends in neither.
    StorageError
        If the file cannot be written.
    """
    write_bytes(path, verdict_picture(rows, title, format_of(path)))


def verdict_picture(rows: Sequence[VerifyRow], title: str, kind: Format = "svg") -> bytes:
    """Share of windows detected over the distance factor: a colour for each policy, a dash for each eccentricity.

    The line of the catch pairs is what a subject says who sees nothing (Luebke, Hallen 2001, section 6.2).
    """
    lines: dict[tuple[str, float], list[VerifyRow]] = {}
    for row in rows:
        lines.setdefault((_name(row), row.eccentricity_deg), []).append(row)
    colours = {name: COLOURS[number % len(COLOURS)] for number, name in enumerate(dict.fromkeys(map(_name, rows)))}
    angles = sorted({row.eccentricity_deg for row in rows})
    factors = sorted({row.distance_factor for row in rows})
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 4.2), layout="constrained")
        axes = figure.subplots()
        widest = len(colours)
        for (name, angle), points in lines.items():
            points = sorted(points, key=lambda row: row.distance_factor)
            axes.plot(
                [row.distance_factor for row in points],
                [100 * row.detected for row in points],
                color=colours[name],
                linestyle=_DASHES[angles.index(angle) % len(_DASHES)],
                marker="o",
                markersize=4,
                # Policies that do equally well lie on each other: the first are wider than the last.
                linewidth=1.3 + 1.5 * (widest - 1 - list(colours).index(name)),
                label=f"{name}, {angle:g}° off the gaze" if len(angles) > 1 else name,
            )
        catch = 100 * float(np.mean([row.false_alarms for row in rows]))
        axes.axhline(catch, color=GREY, linewidth=1.4, linestyle=(0, (1, 1.2)), label="catch pairs")
        axes.axvline(1.0, color=GREY, linewidth=0.7, linestyle=":")
        axes.set(xscale="log", ylim=(-3, 103), xlabel="distance that the policy was told, over the true one")
        axes.set_ylabel(f"windows detected, % of {rows[0].windows}")
        axes.set_xticks(factors)
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_title(title, loc="left", fontsize=10.5, color=INK)
        axes.legend(frameon=False, fontsize=8.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
        return figure_bytes(figure, kind)


def _name(row: VerifyRow) -> str:
    return row.policy if row.acuity_arcmin is None else f"{row.policy} {row.acuity_arcmin:g}′"
