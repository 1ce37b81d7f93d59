"""What a frame took, and what it could not have: a row for every layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["FrameReport", "LayerReport", "Picture"]


@dataclass(frozen=True, slots=True)
class LayerReport:
    """One layer in one frame.

    Parameters
    ----------
    panels_active
        Panels that show something of it.
    items
        What it is made of, in the quilt that has most of it: pages of an image, triangles of a mesh, patches of a
        terrain, splats of points.
    drawn
        Triangles or splats, once for every panel that they are drawn on.
    chunks, missing, uploads
        What was wanted of files: how much, how much of that is not there (yet), and how much came for this frame.
    error_px
        The largest that is left out or made wrong, in pixels of its panel.
    allowed_px
        The smallest and the largest error that active panels may have, where it is one for each panel.
    distance_factor
        How many times farther away all viewers would have to be for nobody to see what is left out: 1 or less, where
        they are nobody can. None where that is not known.
    """

    kind: str
    name: str
    policy: str
    panels_active: int
    items: int
    drawn: int
    chunks: int
    missing: int
    uploads: int
    error_px: float
    allowed_px: tuple[float, float] | None
    distance_factor: float | None
    select_ms: float
    stream_ms: float
    draw_ms: float

    @classmethod
    def of(cls, quilts: Sequence[LayerReport]) -> LayerReport:
        """One for all quilts of a frame."""
        sums = ("panels_active", "drawn", "chunks", "missing", "uploads", "select_ms", "stream_ms", "draw_ms")
        allowed = [each.allowed_px for each in quilts if each.allowed_px is not None]
        factors = [each.distance_factor for each in quilts if each.distance_factor is not None]
        return replace(
            quilts[0],
            items=max(each.items for each in quilts),
            error_px=max(each.error_px for each in quilts),
            allowed_px=(min(low for low, _ in allowed), max(high for _, high in allowed)) if allowed else None,
            distance_factor=max(factors, default=None),
            **{part: sum(getattr(each, part) for each in quilts) for part in sums},
        )


@dataclass(frozen=True, slots=True)
class FrameReport:
    """One frame.

    Parameters
    ----------
    scale
        Panels were drawn with so many times their true pixels along each side; all that is told is of these.
    layers
        A row for each that was drawn, in their order.
    """

    number: int
    time_s: float
    scale: float
    layers: tuple[LayerReport, ...]

    @property
    def missing(self) -> int:
        """How much is not there (yet) of all layers."""
        return sum(each.missing for each in self.layers)

    @classmethod
    def of(cls, quilts: Sequence[FrameReport]) -> FrameReport:
        """One for all quilts of a frame."""
        rows = zip(*(each.layers for each in quilts), strict=True)
        return replace(quilts[0], layers=tuple(LayerReport.of(row) for row in rows))


class Picture(NamedTuple):
    """What a panel, or a quilt, shows.

    Parameters
    ----------
    pixels
        uint8 (h, w, 4), sRGB; valid until the next picture is asked for.
    report
        Of the quilt that it is, or is a part of.
    """

    name: str
    pixels: NDArray[np.uint8]
    report: FrameReport
