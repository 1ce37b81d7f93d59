"""Compiled loop of what eyes could resolve."""

from __future__ import annotations

import math

import numpy as np

from limen.compiled import compiled
from limen.geometry import Floats

__all__ = ["sum_demands"]


@compiled(error_model="python")
def sum_demands(
    position: Floats,
    normal: Floats,
    area: Floats,
    most: Floats,
    eyes: Floats,
    per_tan2: Floats,
    gaze: Floats,
    slack_deg: Floats,
    per_deg: float,
    out: Floats,
) -> None:
    """Add to ``out`` (A,) what the most demanding of the eyes resolves of every place, for each of A tolerances."""
    seen = np.empty(len(eyes))
    sight = np.empty((len(eyes), 3))
    for q in range(len(area)):
        for k in range(len(eyes)):
            x = eyes[k, 0] - position[q, 0]
            y = eyes[k, 1] - position[q, 1]
            z = eyes[k, 2] - position[q, 2]
            square = max(x * x + y * y + z * z, 1e-12)
            height = max(0.0, x * normal[q, 0] + y * normal[q, 1] + z * normal[q, 2])
            seen[k] = height / (square * math.sqrt(square))
            sight[k] = -x / math.sqrt(square), -y / math.sqrt(square), -z / math.sqrt(square)
        for a in range(len(out)):
            demand = 0.0
            for k in range(len(eyes)):
                coarser = 1.0
                if gaze[a, k, 0] != 0.0 or gaze[a, k, 1] != 0.0 or gaze[a, k, 2] != 0.0:
                    ahead = sight[k, 0] * gaze[a, k, 0] + sight[k, 1] * gaze[a, k, 1] + sight[k, 2] * gaze[a, k, 2]
                    beside = math.degrees(math.acos(min(max(ahead, -1.0), 1.0))) - slack_deg[a, k]
                    coarser += per_deg * max(beside, 0.0)
                demand = max(demand, seen[k] * per_tan2[a, k] / (coarser * coarser))
            out[a] += min(demand, most[q]) * area[q]
