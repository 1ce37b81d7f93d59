"""A cloud of points as a layer: where it stands, how it looks, and which of its splats are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.display.display import Display
from limen.geometry import Floats
from limen.layers.base import STILL, Cut, CutCounts, Residents, Turn
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.common.room_placement import RoomPlacement, about_middle
from limen.layers.points.select import PointCut, PointsRequest, PointTree, ResidentNodes, select_points
from limen.stream.chunks import Index, Streaming, Update
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import NEAR_M, QuiltView
from limen.viewing.state import FrameState, LayerState
from limen.viewing.tolerance import tolerance_of

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.layers.points.draw.drawer import Shape, SplatMethod

__all__ = ["PointsLayer", "PointsPart", "PointsSelector"]

_PER_FRAME = 128


@dataclass(frozen=True, slots=True, eq=False)
class PointsLayer:
    """A cloud of points and how it is shown.

    Parameters
    ----------
    stands
        Where it stands; by default with the file's own axes up.
    policy
        How viewers decide about detail.
    lit
        Whether splats that have normals are lit; by default where the file has no colours.
    shape, method
        See `limen.layers.points.draw.drawer.PointsDrawer`.
    overlay
        ``panels`` tints every panel, ``simplified`` shows what stands for much.
    """

    kind: ClassVar[str] = "points"
    points: Points
    stands: RoomPlacement | None = None
    policy: Policy = field(default_factory=Policy)
    lit: bool | None = None
    shape: Shape = "round"
    method: SplatMethod | None = None
    overlay: str = ""

    @classmethod
    def of(cls, points: Points, policy: Policy | None, placement: Any, overlay: str) -> PointsLayer:
        """A cloud that stands where `limen.layers.common.room_placement.mesh_in_room` puts it, unless it is placed."""
        stands = RoomPlacement.by(placement, "a cloud of points")
        return cls(points, stands, policy or Policy(), overlay=overlay)

    @property
    def name(self) -> str:
        return self.points.name

    @property
    def is_lit(self) -> bool:
        """Whether splats with normals are lit."""
        return self.points.header.colours == "none" if self.lit is None else self.lit

    @property
    def alone_because(self) -> str:
        return ""

    @property
    def overlay_word(self) -> str:
        return self.overlay or "simplified"

    def state(self, time_s: float, display: Display) -> LayerState:
        stands = self.stands or RoomPlacement(up=self.points.up, tilt_deg=self.points.tilt_deg)
        placement, motion = stands.state(self.points.bounds, display, time_s)
        return LayerState(placement=placement, policy=self.policy, overlay=self.overlay, motion=motion)

    def turned(self, state: LayerState, turn: Turn, display: Display) -> LayerState:
        if turn == STILL:
            return state
        assert isinstance(state.placement, InRoom)
        placement = InRoom.of(about_middle(state.placement.matrix, self.points.bounds, **turn._asdict()))
        return msgspec.structs.replace(state, placement=placement)

    def selector(self, display: Display, whole: Display) -> PointsSelector:
        return PointsSelector(self, display)


class PointsPart(NamedTuple):
    """What is drawn of a cloud in one quilt."""

    request: PointsRequest
    cut: PointCut


class PointsSelector:
    """Which splats of a cloud are drawn, by the nodes of its chunks that are in memory."""

    def __init__(self, layer: PointsLayer, display: Display) -> None:
        self._layer, self._tree = layer, PointTree.of(layer.points)
        self._whites = [panel.luminance_cd_m2 for panel in display.panels]
        self._nodes = np.zeros((0, CHUNK_NODES), NODE)
        self.sources = (Streaming(_Chunks(layer.points), per_frame=_PER_FRAME, kept=4 * _PER_FRAME),)
        self._generation = 0

    def complete(self, state: LayerState) -> None:
        """All that a choice goes by lies in the cloud itself."""

    def select(
        self, views: Sequence[QuiltView], state: LayerState, frame: FrameState, resident: Residents, *, live: bool
    ) -> Cut[PointsPart]:
        assert isinstance(state.placement, InRoom)
        tolerance = tolerance_of(frame.viewers, state.policy.eyesight, state.motion_matrix)
        stands, shares = self._room_from_cloud(state.placement.matrix), acuity_scale(state.policy, self._whites)
        lit = self._layer.is_lit
        requests = [PointsRequest(view.eyes[0], stands, tolerance, state.policy, shares, lit) for view in views]
        return self._chosen(requests, resident)

    def take(self, source: int, update: Update[NDArray[Any]]) -> None:
        for _, (slot,), nodes in update.arrived:  # in slots that a frame was chosen for, which made room for all
            self._nodes[slot] = nodes

    def resolve(self, cut: Cut[PointsPart], resident: Residents) -> Cut[PointsPart]:
        """What was chosen before this frame's chunks came may lie in slots that they took: chosen anew."""
        if resident[0].generation == self._generation:
            return cut
        return self._chosen([part.request for part in cut.parts], resident)

    def close(self) -> None:
        """Nothing is held that has to be given back."""

    def _chosen(self, requests: Sequence[PointsRequest], resident: Residents) -> Cut[PointsPart]:
        self._generation = resident[0].generation
        if len(self._nodes) < resident[0].capacity:
            self._nodes = np.zeros((resident[0].capacity, CHUNK_NODES), NODE)
        words = self._nodes.view(np.uint32).reshape(len(self._nodes), CHUNK_NODES, 4)
        nodes = ResidentNodes(words, resident[0].place[:, 0].astype(np.int32))
        cuts = [select_points(self._tree, nodes, request) for request in requests]
        counts = CutCounts(
            items=max(len(cut) for cut in cuts),
            drawn=sum(len(cut) for cut in cuts),
            panels_active=sum(int(request.views.facing.sum()) for request in requests),
            error_px=max((cut.largest_px for cut in cuts), default=0.0),
            distance_factor=max((cut.reached for cut in cuts), default=0.0),
        )
        parts = tuple(PointsPart(request, cut) for request, cut in zip(requests, cuts, strict=True))
        return Cut(parts, counts, (_distinct([cut.wanted for cut in cuts]),), near_m=(NEAR_M,) * len(parts))

    def _room_from_cloud(self, room_from_file: Floats) -> Floats:
        """From coordinates relative to the cloud's origin: those of the file may be millions of metres."""
        moved = np.array(room_from_file)
        moved[:3, 3] += moved[:3, :3] @ self._layer.points.origin
        return moved


class _Chunks:
    """Chunks that have nothing else to stand in for them than their tops, which are always there."""

    def __init__(self, points: Points) -> None:
        self.count, self.read = points.chunks, points.read_chunk
        self.pinned = np.zeros(0, np.int64)

    def parents(self, chunks: Index) -> Index:
        return np.full(len(chunks), -1)


def _distinct(lists: Sequence[Index]) -> Index:
    """All numbers, each where it stands first."""
    numbers = np.concatenate([np.zeros(0, np.int64), *lists])
    return np.asarray(numbers[np.sort(np.unique(numbers, return_index=True)[1])])
