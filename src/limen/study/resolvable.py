"""The floor: how many samples of a display an eye could resolve, which no policy can safely go under.

A square metre of panel, seen from ``D`` under the angle ``theta`` off its normal, fills ``cos(theta) / D^2`` of the
eye's solid angle. At one sample per acuity in both directions that is ``cos(theta) / (D tan(acuity))^2`` samples, fewer
by the square of what eccentricity adds to the acuity where the gaze is made use of; the panel and the image themselves
hold no more than their pixels and texels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from limen.geometry import Floats
from limen.layers.image.select import ImageOnDisplay
from limen.study.resolvable_kernels import sum_demands
from limen.viewing.tolerance import Tolerance
from limen.vision.resolution import ECCENTRICITY_PER_DEG

__all__ = ["PanelSamples", "places_of", "resolvable_samples"]


class PanelSamples(NamedTuple):
    """Midpoints of the rectangles that panels are cut into, to sum over."""

    position_m: Floats  # (Q, 3)
    normal: Floats  # (Q, 3)
    area_m2: Floats  # (Q,)
    most_per_m2: Floats  # (Q,): what pixels and texels hold


def places_of(view: ImageOnDisplay, cell_m: float = 0.1) -> PanelSamples:
    """The panels of a view, cut into cells of at most ``cell_m``, at least 4 x 4.

    At 0.1 m the sum is within 0.03 % of its limit for a viewer 0.35 m or more from the Reality Deck's walls.
    """
    parts: list[Floats] = []
    for number, panel in enumerate(view.display.panels):
        counts = (max(4, math.ceil(side / cell_m)) for side in panel.size_m)
        grid = np.stack(np.meshgrid(*((np.arange(count) + 0.5) / count for count in counts)), axis=-1).reshape(-1, 2)
        position = panel.position_m(grid * np.array(panel.size_px))
        most = np.full(len(grid), 1 / math.prod(panel.pitch_m))
        if view.maps is not None:
            texels = np.abs(view.maps.scale[number])
            most *= min(1.0, float(texels.prod()))
            at = grid * np.array(panel.size_px) * view.maps.scale[number] + view.maps.offset[number]
            most *= ((at >= 0) & (at < np.array(view.pyramid.size_px))).all(axis=1)
        area = np.full(len(grid), math.prod(panel.size_m) / len(grid))
        parts.append(np.column_stack([position, np.tile(panel.normal, (len(grid), 1)), area, most]))
    rows = np.concatenate(parts)
    columns = (rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7])
    return PanelSamples(*(np.ascontiguousarray(column) for column in columns))


def resolvable_samples(places: PanelSamples, tolerances: Sequence[Tolerance]) -> Floats:
    """Samples that the eyes could resolve; where several look, the finest demand counts, place by place.

    Parameters
    ----------
    places
        Where to evaluate; see `places_of`.
    tolerances
        Of the same eyes, with other acuities, or with and without their gaze.

    Returns
    -------
    Samples for each tolerance, shape (A,).
    """
    out = np.zeros(len(tolerances))
    finest = np.array([1 / np.square(tolerance.tan_angle) for tolerance in tolerances])
    gaze = np.array([tolerance.gaze for tolerance in tolerances])
    slack = np.array([tolerance.slack_deg for tolerance in tolerances])
    sum_demands(*places, np.ascontiguousarray(tolerances[0].eyes_m), finest, gaze, slack, ECCENTRICITY_PER_DEG, out)
    return out
