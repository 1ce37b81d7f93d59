"""Pictures of what was counted and walked: PNG or SVG, as bytes for a report or as a file.

Colours are Okabe, Ito 2008 (*Color Universal Design*), told apart by colour-blind readers too; every line is
labelled where it ends, so that none depends on its colour.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from limen.data.pages import PAGE
from limen.errors import InputError
from limen.study.traffic import Counts, Report, Row
from limen.track.replay import write_atomically
from limen.track.session import Session
from limen.track.walk import Heat

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["save", "traffic_picture", "traffic_plot", "walk_picture", "walk_plot"]

Format = Literal["png", "svg"]

_INK, _GREY = "#222222", "#8a8a8a"
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.edgecolor": _GREY,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "limen",  # the same picture gives the same bytes
}


def traffic_plot(report: Report, path: str | Path) -> None:
    """Draw `traffic_picture` to a .png or .svg file.

    Raises
    ------
    InputError
        If the name ends in neither.
    StorageError
        If the file cannot be written.
    """
    save(path, lambda kind: traffic_picture(report, kind))


def walk_plot(heat: Heat, spots: Sequence[Sequence[tuple[float, float]]], session: Session, path: str | Path) -> None:
    """Draw `walk_picture` to a .png or .svg file; raises as `traffic_plot`."""
    save(path, lambda kind: walk_picture(heat, spots, session, kind))
