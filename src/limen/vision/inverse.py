"""The highest frequency at which a model of sensitivity sees a contrast: one search, for arrays of any shape."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.vision.castle_csf import FREQUENCY_CPD
from limen.vision.models import Model

__all__ = ["highest_visible_cpd"]

_STEPS_PER_OCTAVE = 6
_ROUNDS = 4


@cache
def _ladder(top_cpd: float) -> Floats:
    """Frequencies from the lowest of the models to the highest, evenly in their logarithm."""
    count = int(np.ceil(np.log2(top_cpd / FREQUENCY_CPD[0]) * _STEPS_PER_OCTAVE)) + 1
    return np.geomspace(min(FREQUENCY_CPD[0], top_cpd / 2), top_cpd, max(count, 2))


def highest_visible_cpd(model: Model, log_needed: Floats, where: tuple[Floats, Floats, Floats, Floats]) -> Floats:
    """The highest frequency, up to ``model.top_cpd``, whose ``log10 S`` reaches ``log_needed``; 0 where none does.

    From above, the first rung of a ladder that is seen; then Ridders' method up to the next rung. Only rungs can be
    missed between which the peak of the sensitivity lies, and there they differ from it by less than 1 %.

    Parameters
    ----------
    log_needed
        ``log10`` of one over the contrast.
    where
        Eccentricity, luminance (in range), temporal frequency and area; they broadcast with ``log_needed``.
    """
    ladder = _ladder(model.top_cpd)
    shape = np.broadcast_shapes(log_needed.shape, *(each.shape for each in where))
    rung = np.full(shape, -1, np.int64)
    low, high = np.zeros(shape), np.zeros(shape)  # by how much the rung is seen, and the next one is not
    above = np.zeros(shape)
    for number in range(len(ladder) - 1, -1, -1):
        excess = np.broadcast_to(model.log_sensitivity(ladder[number], *where) - log_needed, shape)
        found = (rung < 0) & (excess >= 0)
        rung[found], low[found], high[found] = number, excess[found], above[found]
        if (rung >= 0).all():
            break
        above = excess
    result = np.where(rung >= 0, ladder[rung], 0.0)
    between = (rung >= 0) & (rung < len(ladder) - 1)
    if between.any():
        places = [np.broadcast_to(each, shape)[between] for each in (log_needed, *where)]
        result[between] = _between(model, places, ladder, rung[between], low[between], high[between])
    return result


def _between(
    model: Model, places: list[Floats], ladder: Floats, rung: NDArray[np.int64], low: Floats, high: Floats
) -> Floats:
    """Where the excess falls through zero between a rung and the next, by Ridders' method in log frequency.

    Plain false position creeps where the sensitivity's peak lies just above the first rung.
    """
    left, right = np.log(ladder[rung]), np.log(ladder[rung + 1])

    def excess_at(log_frequency: Floats) -> Floats:
        return model.log_sensitivity(np.exp(log_frequency), *places[1:]) - places[0]

    for _ in range(_ROUNDS):
        middle = (left + right) / 2
        at_middle = excess_at(middle)
        bent = np.sqrt(np.maximum(at_middle**2 - low * high, 1e-300))
        guess = np.clip(middle + (middle - left) * at_middle / bent, left, right)
        for place, excess in ((middle, at_middle), (guess, excess_at(guess))):
            seen, inside = excess >= 0, (place > left) & (place < right)
            left, low = np.where(seen & inside, place, left), np.where(seen & inside, excess, low)
            right, high = np.where(~seen & inside, place, right), np.where(~seen & inside, excess, high)
    return np.asarray(np.exp(left + (right - left) * np.clip(low / np.maximum(low - high, 1e-300), 0.0, 1.0)))
