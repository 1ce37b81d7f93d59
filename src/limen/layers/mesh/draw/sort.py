"""Sorts the triangles of a mesh to the panels that they touch, on the GPU, every frame.

The pairs are exact up to the guard band: every panel whose outline a triangle covers is there, and none that the
triangle, seen from the eye, does not come near. Their order is of no matter, since one draw takes them all.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.2.1, sorts in two passes over
all panels; this does the same with a grid of directions, and asks the second pass for few panels instead of all.
Ericson 2005, *Real-Time Collision Detection*, section 5.2.1 (separating axes).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.layers.common.panel_uniforms import view_rows
from limen.layers.mesh.directions import direction_grid
from limen.layers.mesh.draw.sorter import DRAW_OFFSET, GROUP, Groups, Parts, Sorter, Steps
from limen.layers.mesh.draw.uniforms import grid_words, sort_frame
from limen.viewing.projection import PanelProjections

__all__ = ["DRAW_OFFSET", "TriangleSorter"]


class TriangleSorter(Sorter):
    """limen's way of sorting; see `Sorter` for its parameters."""

    shader = "sort.wgsl"
    bindings = (
        "frame", "views", "positions", "triangles", "ways", "grid", "waiting", "pairs", "counters", "arguments",
    )  # fmt: skip
    written = ("ways", "waiting", "pairs", "counters", "arguments")
    steps: ClassVar[Steps] = {
        "locate": ("frame", "views", "positions", "ways", "grid"),
        "assign": ("frame", "triangles", "ways", "waiting", "pairs", "counters"),
        "plan": ("counters", "arguments"),
        "search": ("frame", "views", "triangles", "ways", "grid", "waiting", "pairs", "counters"),
        "finish": ("frame", "counters", "arguments"),
    }
    parts: ClassVar[Parts] = {"first pass": ("locate", "assign"), "second pass": ("plan", "search", "finish")}

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        grids = [direction_grid(view) for view in views]
        words, begins = grid_words(grids)
        self.buffers["views"].write(view_rows(views, [grid.erosion_px for grid in grids]))
        self.buffers["grid"].write(words)
        self.buffers["waiting"].reserve(self.triangle_count * self.eyes * 4)
        return sort_frame(
            grids, begins, eye_from_mesh, vertices=self.vertex_count, triangles=self.triangle_count, panels=self.panels
        )

    def _sizes(self) -> dict[str, Groups]:
        return {
            "locate": (-(-self.vertex_count // GROUP), self.eyes, 1),
            "assign": (-(-self.triangle_count // GROUP), self.eyes, 1),
            "search": 0,
        }
