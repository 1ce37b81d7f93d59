"""How many triangles or splats fit a time: a budget in milliseconds becomes a number by feedback from frame to frame.

References
----------
Funkhouser, Séquin 1993, *Adaptive Display Algorithm for Interactive Frame Rates During Visualization of Complex Virtual
Environments*, section 4 (reactive algorithms, and how they oscillate).
"""

from __future__ import annotations

import statistics
from collections import deque
from dataclasses import replace

from limen.viewing.policy import Policy

__all__ = ["FrameTimeBudget"]

_BEGIN, _LEAST = 20_000, 500
_FRAMES = 3  # whose median counts: one frame that was held up changes nothing
_GAIN, _STEP = 0.7, 2.0  # part of the way that is gone at once, and the largest change from frame to frame
_DEAD = 0.05  # off the budget by less, nothing changes


class FrameTimeBudget:
    """Of one renderer: told what every frame took, it says how many items the next may have.

    A frame's time is taken to grow with their number, in proportion at most; then going part of the way never
    overshoots. A part of the time that no number of items changes only makes it go slower.

    Parameters
    ----------
    parts
        How many parts are drawn for a frame, each told by itself: the time is divided among them.
    """

    def __init__(self, parts: int = 1) -> None:
        self._parts = max(parts, 1)
        self._most_ms: float | None = None
        self._items = float(_BEGIN)
        self._per_item_ms: deque[float] = deque(maxlen=_FRAMES)

    def within(self, policy: Policy) -> Policy:
        """The policy with a number of items in place of a time; any other as it is."""
        if policy.max_ms is None:
            return policy
        if policy.max_ms != self._most_ms:
            self._most_ms = policy.max_ms
            self._per_item_ms.clear()
        return replace(policy, max_ms=None, max_items=round(self._items))

    def spent(self, policy: Policy, ms: float) -> None:
        """What drawing a part took from choosing to the last pixel, milliseconds, with the number last given."""
        if policy.max_ms is None or not ms > 0:
            return
        self._per_item_ms.append(ms / self._items)
        usual_ms = statistics.median(self._per_item_ms) * self._items
        ratio = policy.max_ms / self._parts / usual_ms
        if abs(ratio - 1) > _DEAD:
            self._items = max(self._items * min(max(ratio**_GAIN, 1 / _STEP), _STEP), _LEAST)
