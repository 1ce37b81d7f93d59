"""Pictures of one mesh with as many triangles, each made in another way, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from limen.study.plots import GREY, STYLE, Format, figure_bytes

__all__ = ["MeshComparison", "Rgb", "mesh_picture"]

Rgb: TypeAlias = NDArray[np.uint8]
_PART_PX = 360
"""Of every picture's side: pixels remain pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshComparison:
    """One view of the mesh as each way draws it, and the JOD of its windows (none of the full mesh)."""

    pictures: dict[str, Rgb]
    jod: dict[str, float]


def mesh_picture(seen: MeshComparison, kind: Format = "png") -> bytes:
    """The part in which pictures differ most from that of all triangles, of every way, and the verdict on the view."""
    full = seen.pictures["all triangles"].astype(int)
    others = [picture for maker, picture in seen.pictures.items() if maker != "all triangles"]
    differs = sum(np.abs(picture - full).sum(axis=-1) for picture in others)
    sums = np.cumsum(np.cumsum(np.pad(differs, ((1, 0), (1, 0))), axis=0), axis=1)
    side = min(_PART_PX, *full.shape[:2])
    inside = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    row, column = np.unravel_index(int(inside.argmax()), inside.shape)
    with rc_context(STYLE):
        figure = Figure(figsize=(2.6 * len(seen.pictures), 2.9), layout="constrained")
        for axes, (maker, picture) in zip(
            figure.subplots(1, len(seen.pictures), squeeze=False)[0], seen.pictures.items(), strict=True
        ):
            axes.imshow(picture[row : row + side, column : column + side], interpolation="nearest")
            axes.set_axis_off()
            axes.set_title(maker, fontsize=9)
            if maker in seen.jod:
                axes.text(
                    0.5,
                    -0.04,
                    f"{seen.jod[maker]:.2f} JOD",
                    transform=axes.transAxes,
                    ha="center",
                    va="top",
                    color=GREY,
                )
        return figure_bytes(figure, kind)
