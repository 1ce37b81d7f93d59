"""A tracker for limen: somebody who walks around a place, once every so many seconds, and points ahead."""

import math

import limen


class Circling:
    """``limen show ... --tracker circling:20`` walks around once in 20 seconds."""

    def __init__(self, how):
        self._period_s = float(how or 30)

    def viewers(self, time_s):
        turn = 2 * math.pi * time_s / self._period_s
        return [limen.Viewer((math.sin(turn), 1.7, 2 + math.cos(turn)), (0.0, 0.0, -1.0), time_s=time_s)]

    def pointers(self, time_s):
        return [limen.Pointer(viewer.position_m, viewer.direction, time_s) for viewer in self.viewers(time_s)]

    def close(self):
        """Nothing is open."""
