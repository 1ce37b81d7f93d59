"""Two ways to draw many panels that sort little or nothing, to be compared with those that sort.

Nothing is slower than it has to be: panels that turn their back are left out, the hierarchy is drawn by one indirect
draw, too, and the whole scene is drawn by its indices, so that a vertex that triangles share is transformed once a
panel.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 4.2 ('spatial hierarchies' and
'independent facet rendering').
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.geometry import Floats
from limen.layers.common.panel_uniforms import view_rows
from limen.layers.mesh.draw.sorter import GROUP, Groups, Parts, Sorter, Steps
from limen.study.baselines.octree import LEAVES
from limen.viewing.projection import PanelProjections, QuiltPanels

__all__ = ["OCTREE_FRAME", "OctreeSorter", "WholeScene"]

_FIRST_MEMBERS = 4  # leaves a triangle that room is made for at first
_FIRST_MEMBERS_IN_ALL = 8_192
_HIT_BYTES = 16

OCTREE_FRAME = np.dtype(
    [
        ("vertices", "<u4"),
        ("triangles", "<u4"),
        ("panels", "<u4"),
        ("pair_capacity", "<u4"),
        ("eyes", "<u4"),
        ("member_capacity", "<u4"),
        ("padding_a", "<u4"),
        ("padding_b", "<u4"),
        ("eye_from_mesh", "<f4", (6, 4)),
    ]
)


class _SceneSorter(Sorter):
    """What both have in common: the shader, and what it reads of a frame."""

    package = "limen.study.baselines"
    shader = "sort_octree.wgsl"
    bindings = (
        "frame", "views", "positions", "triangles", "ways", "bounds", "tally", "leaves", "members", "hits", "pairs",
        "counters", "arguments",
    )  # fmt: skip
    written = ("ways", "bounds", "tally", "leaves", "members", "hits", "pairs", "counters", "arguments")

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        self.buffers["views"].write(view_rows(views, [np.array(0.0)] * self.eyes))
        self.buffers["bounds"].reserve(24)
        row = np.zeros(1, OCTREE_FRAME)
        row["vertices"], row["triangles"], row["panels"] = self.vertex_count, self.triangle_count, self.panels
        row["eyes"] = self.eyes
        row["eye_from_mesh"][0, : 3 * self.eyes] = eye_from_mesh.reshape(-1, 4)
        return row

    def _clear(self, encoder: Any) -> None:
        super()._clear(encoder)
        encoder.clear_buffer(self.buffers["bounds"].buffer, 0, 24)


class OctreeSorter(_SceneSorter):
    """An octree over the scene's triangles, built every frame; whole leaves are drawn for every panel they meet."""

    steps: ClassVar[Steps] = {
        "transform": ("frame", "positions", "ways", "bounds"),
        "count": ("frame", "positions", "triangles", "bounds", "tally"),
        "scan": ("tally", "leaves", "counters"),
        "fill": ("frame", "positions", "triangles", "bounds", "tally", "members"),
        "cull": ("frame", "views", "bounds", "leaves", "hits", "counters"),
        "plan": ("counters", "arguments"),
        "expand": ("frame", "leaves", "members", "hits", "pairs", "counters"),
        "finish": ("frame", "counters", "arguments"),
    }
    parts: ClassVar[Parts] = {
        "build": ("transform", "count", "scan", "fill"),
        "cull": ("cull", "plan", "expand", "finish"),
    }

    _member_capacity = 0

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        if not self._member_capacity:
            self._member_capacity = self.triangle_count * _FIRST_MEMBERS + _FIRST_MEMBERS_IN_ALL
        self.buffers["tally"].reserve(LEAVES**3 * 4)
        self.buffers["leaves"].reserve(LEAVES**3 * 8)
        self.buffers["hits"].reserve(LEAVES**3 * self.panels * self.eyes * _HIT_BYTES)
        return super()._prepare(views, eye_from_mesh)

    def _sizes(self) -> dict[str, Groups]:
        each = (-(-self.triangle_count // GROUP), 1, 1)
        return {
            "transform": (-(-self.vertex_count // GROUP), self.eyes, 1),
            "count": each,
            "fill": each,
            "cull": (LEAVES**3 // GROUP, self.panels * self.eyes, 1),
            "expand": 0,
        }

    def _reserve(self) -> None:
        super()._reserve()
        self.buffers["members"].reserve(self._member_capacity * 4)
        self._frame["member_capacity"] = self._member_capacity

    def _clear(self, encoder: Any) -> None:
        super()._clear(encoder)
        encoder.clear_buffer(self.buffers["tally"].buffer, 0, LEAVES**3 * 4)

    def _make_room(self, counts: Sequence[int]) -> bool:
        more_pairs = super()._make_room(counts)
        if counts[1] <= self._member_capacity:
            return more_pairs
        self._member_capacity = counts[1] + counts[1] // 4
        return True


class WholeScene(_SceneSorter):
    """Nothing sorted: the whole mesh is drawn once for every panel that faces the eye, with a scissor around it."""

    steps: ClassVar[Steps] = {"transform": ("frame", "positions", "ways", "bounds")}
    parts: ClassVar[Parts] = {"transform": ("transform",)}
    source = 2

    _views: Sequence[PanelProjections] = ()
    _boxes: tuple[QuiltPanels, list[tuple[int, ...]]] | None = None

    def _prepare(self, views: Sequence[PanelProjections], eye_from_mesh: Floats) -> NDArray[np.void]:
        self.pair_capacity = 1
        self._views = views
        return super()._prepare(views, eye_from_mesh)

    def _sizes(self) -> dict[str, Groups]:
        return {"transform": (-(-self.vertex_count // GROUP), self.eyes, 1)}

    def settle(self) -> int:
        """See `Sorter.settle`: every triangle is drawn for every panel that faces an eye."""
        self._counts()
        return self.triangle_count * int(sum(view.facing.sum() for view in self._views))

    def read_pairs(self) -> NDArray[np.uint32]:
        """All triangles with all panels that face an eye, shape (n, 2)."""
        facing = np.flatnonzero(np.concatenate([view.facing for view in self._views])).astype(np.uint32)
        number, view = np.meshgrid(np.arange(self.triangle_count, dtype=np.uint32), facing)
        return np.stack([number.ravel(), view.ravel()], axis=1)

    def record(self, render_pass: Any, windows: QuiltPanels) -> None:
        """One draw a panel."""
        render_pass.set_index_buffer(self.buffers["triangles"].buffer, wgpu.IndexFormat.uint32)
        facing = np.concatenate([view.facing for view in self._views])
        if self._boxes is None or self._boxes[0] is not windows:
            self._boxes = windows, _boxes_px(windows)
        for number in np.flatnonzero(facing).tolist():
            render_pass.set_scissor_rect(*self._boxes[1][number])
            render_pass.draw_indexed(self.triangle_count * 3, 1, 0, 0, number)


def _boxes_px(windows: QuiltPanels) -> list[tuple[int, ...]]:
    """Left, top, width and height in the quilt of every panel of every eye, with its guard."""
    quilt, display = windows.quilt, windows.display
    maps = quilt.quilt_from_panel(display)
    width, height = quilt.size_px
    boxes = []
    for index, affine in zip(quilt.panels, maps, strict=True):
        corners = display.panels[index].lit_outline_px + np.array(display.panels[index].nudge_px)
        places = corners @ affine[:, :2].T + affine[:, 2]
        low = np.floor(places.min(axis=0) - windows.guard_px * 2).astype(int).clip(0, (width - 1, height - 1))
        high = np.ceil(places.max(axis=0) + windows.guard_px * 2).astype(int).clip(1, (width, height))
        boxes.append((*low.tolist(), *(high - low).tolist()))
    return [(left + eye * width, *rest) for eye in range(windows.copies) for left, *rest in boxes]
