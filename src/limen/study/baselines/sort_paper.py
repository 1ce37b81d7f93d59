"""The published way of sorting triangles to panels, as a named alternative to be compared with.

Two passes: a ray from the eye through every vertex finds the nearest panel, and triangles whose corners agree are done;
the others are tested against every panel. Then the pairs are split by panel and the triangles' vertices copied there,
warped already. Nothing is slower than it has to be: rays go through the leaves of the octree in order and stop at the
first hit, the second pass compares rectangles before it tests exactly, and its panels are spread over the adapter.

The first pass is wrong where panels overlap in view: a triangle that is three times on the nearest panel is given to
that one alone, though it may also show beside it, on a panel behind (a teapot's handle, a knot).
`limen.layers.mesh.draw.sort` has those pairs too. Both agree on displays that do not overlap in view, but for the guard
band, which the first pass does not know.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.2, algorithms 2 to 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.layers.common.panel_uniforms import view_rows
from limen.layers.mesh.draw.sorter import GROUP, Groups, Parts, Sorter, Steps
from limen.study.baselines.octree import LEAVES, Octree
from limen.viewing.projection import GUARD_PX, PanelProjections

__all__ = ["PAPER_FRAME", "PaperSorter"]

_VERTEX_BYTES = 32
_COPY_OFFSET = 32  # of the workgroups of `copy` in `arguments`, bytes

PAPER_FRAME = np.dtype(
    [
        ("vertices", "<u4"),
        ("triangles", "<u4"),
        ("panels", "<u4"),
        ("pair_capacity", "<u4"),
        ("eyes", "<u4"),
        ("padding_a", "<u4"),
        ("padding_b", "<u4"),
        ("padding_c", "<u4"),
        ("leaves_per_m", "<f4", 4),
        ("eye_leaves", "<f4", (2, 4)),
        ("eye_from_mesh", "<f4", (6, 4)),
        ("camera", "<f4", (6, 4)),
    ]
)


class PaperSorter(Sorter):
    """The sorter of Harish and Narayanan; see `Sorter` for its parameters."""

    package = "limen.study.baselines"
    shader = "sort_paper.wgsl"
    bindings = (
        "frame", "views", "positions", "triangles", "ways", "leaves", "waiting", "found", "counters", "arguments",
        "extents", "tally", "pairs", "warped",
    )  # fmt: skip
    written = (
        "views", "ways", "waiting", "found", "counters", "arguments", "extents", "tally", "pairs", "warped",
    )  # fmt: skip
    steps: ClassVar[Steps] = {
        "locate": ("frame", "views", "positions", "ways", "leaves"),
        "assign": ("frame", "triangles", "ways", "waiting", "found", "counters", "tally"),
        "project": ("frame", "views", "extents"),
        "plan": ("frame", "counters", "arguments"),
        "search": ("frame", "views", "triangles", "ways", "waiting", "found", "counters", "extents", "tally"),
        "scan": ("frame", "counters", "arguments", "tally"),
        "copy": ("frame", "views", "triangles", "ways", "found", "counters", "tally", "pairs", "warped"),
    }
    parts: ClassVar[Parts] = {
        "first pass": ("locate", "assign"),
        "second pass": ("project", "plan", "search"),
        "split and warp": ("scan", "copy"),
    }
    source = 1

    _octree: Octree | None = None

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        octree = self._octree_of(views[0].outline_m)
        rows = view_rows(views, [np.array(GUARD_PX)] * self.eyes).reshape(self.eyes, -1)
        row = np.zeros(1, PAPER_FRAME)
        row["vertices"], row["triangles"], row["panels"] = self.vertex_count, self.triangle_count, self.panels
        row["eyes"] = self.eyes
        row["leaves_per_m"][0, :3] = octree.leaves_per_m
        row["eye_from_mesh"][0, : 3 * self.eyes] = eye_from_mesh.reshape(-1, 4)
        for eye, view in enumerate(views):
            rows["corners"][eye, :, 0, 3] = _heights_m(view)
            row["eye_leaves"][0, eye, :3] = (view.eye_m - octree.low_m) * octree.leaves_per_m
            row["camera"][0, 3 * eye : 3 * eye + 3, :3] = _camera(view)
        self.buffers["views"].write(rows)
        self.buffers["waiting"].reserve(self.triangle_count * self.eyes * 4)
        self.buffers["extents"].reserve(self.panels * self.eyes * 16)
        self.buffers["tally"].reserve(self.panels * self.eyes * 4)
        return row

    def _sizes(self) -> dict[str, Groups]:
        return {
            "locate": (-(-self.vertex_count // GROUP), self.eyes, 1),
            "assign": (-(-self.triangle_count // GROUP), self.eyes, 1),
            "project": (-(-self.panels * self.eyes // GROUP), 1, 1),
            "search": 0,
            "copy": _COPY_OFFSET,
        }

    def _reserve(self) -> None:
        super()._reserve()
        self.buffers["found"].reserve(self.pair_capacity * 8)
        self.buffers["warped"].reserve(self.pair_capacity * 3 * _VERTEX_BYTES)

    def _clear(self, encoder: Any) -> None:
        super()._clear(encoder)
        encoder.clear_buffer(self.buffers["tally"].buffer, 0, self.panels * self.eyes * 4)

    def _octree_of(self, outline_m: Floats) -> Octree:
        """Of panels that do not move: made once."""
        if self._octree is None or self._octree.outline_m is not outline_m:
            self._octree = Octree.of(outline_m)
            entries = np.zeros(len(self._octree.entries) + len(self._octree.entries) % 2, np.uint32)
            entries[: len(self._octree.entries)] = self._octree.entries
            ends = np.stack([self._octree.starts[:-1], self._octree.starts[1:]], axis=1)
            assert len(ends) == LEAVES**3
            self.buffers["leaves"].write(np.concatenate([ends.astype(np.uint32).ravel(), entries]))
        return self._octree


def _heights_m(view: PanelProjections) -> Floats:
    """How high the eye stands above each panel's plane; 0 where it is not in front."""
    return np.where(view.facing, np.einsum("na,na->n", view.clip[:, 2], view.outline_m[:, 0] - view.eye_m), 0.0)


def _camera(view: PanelProjections) -> Floats:
    """Right, up and forward of a camera that looks at the middle of what the eye sees: shape (3, 3)."""
    forward = view.corners[view.facing, 0].sum(axis=0)
    length = float(np.linalg.norm(forward))
    forward = forward / length if length > 1e-9 else np.array([0.0, 0.0, -1.0])
    right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward])
