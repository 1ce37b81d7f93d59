"""Made-up hand-held pointers: their holders let them wander from one place of the display to the next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from limen.track.session import Track

if TYPE_CHECKING:
    from limen.display.display import Display
    from limen.geometry import Floats

__all__ = ["wandering_pointer"]

_LEG_S = (1.0, 3.0)  # from one place that is pointed at to the next
_BELOW_M, _BESIDE_M = 0.4, 0.2  # from the eyes to the right hand: never nearer to a wall than the body is


def wandering_pointer(display: Display, holder: Track, name: str, seed: Sequence[int]) -> Track:
    """A pointer in the right hand of a viewer, sampled when the viewer is; the same arguments give the same track.

    The place pointed at moves smoothly between places drawn at random on the panels that face the hand then (on any, if
    none does), large panels more often, and takes 1 to 3 s from one to the next.
    """
    rng = np.random.default_rng(list(seed))
    hand = _hand_m(holder)
    count = int((holder.time_s[-1] - holder.time_s[0]) / _LEG_S[0]) + 2
    ends_s = holder.time_s[0] + np.append(0.0, rng.uniform(*_LEG_S, count).cumsum())
    first = np.searchsorted(holder.time_s, ends_s).clip(max=len(hand) - 1)
    places = np.array([_place_m(display, hand[sample], rng) for sample in first])
    leg = np.searchsorted(ends_s, holder.time_s, side="right").clip(1, count) - 1
    share = (holder.time_s - ends_s[leg]) / (ends_s[leg + 1] - ends_s[leg])
    smooth = (share * share * (3 - 2 * share))[:, None]
    way = places[leg] * (1 - smooth) + places[leg + 1] * smooth - hand
    away = np.linalg.norm(way, axis=1, keepdims=True)
    direction: Floats = np.where(away > 1e-3, way / np.maximum(away, 1e-3), holder.direction)
    # To the micrometre, as the viewers are, so that a file holds the very same session.
    return Track(name, holder.time_s, np.round(hand, 6) + 0.0, np.asarray(np.round(direction, 6) + 0.0))


def _hand_m(holder: Track) -> Floats:
    """(N, 3): to the right of where the head points, and below."""
    across = np.cross(holder.direction, [0.0, 1.0, 0.0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    right = np.where(length > 1e-6, across / np.maximum(length, 1e-6), [1.0, 0.0, 0.0])
    return np.asarray(holder.position_m + right * _BESIDE_M - np.array([0.0, _BELOW_M, 0.0]))


def _place_m(display: Display, hand_m: Floats, rng: np.random.Generator) -> Floats:
    """A place on a panel, (3,)."""
    facing = ((hand_m - display.middles_m) * display.normals).sum(axis=1) > 0
    area = (display.arrays.size_px * display.arrays.pitch_m).prod(axis=1)
    weight = area * facing if facing.any() else area
    corners = display.outlines_m[rng.choice(len(weight), p=weight / weight.sum())]
    return np.asarray(rng.dirichlet(np.ones(len(corners))) @ corners)
