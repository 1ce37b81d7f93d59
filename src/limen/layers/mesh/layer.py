"""A mesh as a layer: where it stands, how it moves, and which of its triangles are left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.base import STILL, Cut, CutCounts, Residents, Turn
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.common.room_placement import RoomPlacement, about_middle
from limen.layers.mesh.select import Extent, FoldRequest, FoldTree, MeshCut, select_mesh
from limen.stream.chunks import Streaming, Update
from limen.viewing.choices import Depth
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import NEAR_M, QuiltView
from limen.viewing.state import FrameState, LayerState
from limen.viewing.tolerance import tolerance_of

__all__ = ["MeshLayer", "MeshPart", "MeshSelector"]


@dataclass(frozen=True, slots=True, eq=False)
class MeshLayer:
    """A mesh and how it is shown.

    Parameters
    ----------
    stands
        Where it stands.
    policy
        How viewers decide about its detail; all but ``full`` need its tree.
    tree
        The mesh's vertex tree, where fewer triangles are to be drawn than it has: those that viewers can tell.
    extent
        See `limen.layers.mesh.select.FoldRequest`.
    deformed
        What it looks like at a time: the same triangles with other places and normals.
    depth
        ``panel``: along each panel's normal, made by the rasteriser. ``shared``: that of the viewer's camera,
        continuous over all panels, written for every fragment.
    clip
        Clip by distances where the adapter can; False cuts in the fragment stage, with the same picture.
    overlay
        ``panels`` tints every panel, ``simplified`` shows what stands for much.

    Raises
    ------
    InputError
        For a mesh that is deformed and has a tree, which is of the places that it was made for; and for a policy that
        needs a tree where there is none.
    """

    kind: ClassVar[str] = "mesh"
    mesh: Mesh
    stands: RoomPlacement = field(default_factory=RoomPlacement)
    policy: Policy = field(default_factory=lambda: Policy("full"))
    tree: FoldTree | None = None
    extent: Extent = "displacement"
    deformed: Callable[[float], Mesh] | None = None
    depth: Depth = "panel"
    clip: bool = True
    overlay: str = ""

    def __post_init__(self) -> None:
        if self.deformed is not None and self.tree is not None:
            raise InputError("a mesh that is deformed is drawn in full: leave out its tree, or what deforms it")
        _check_tree(self, self.policy)

    @classmethod
    def of(cls, mesh: Mesh, policy: Policy | None, placement: Any, overlay: str) -> MeshLayer:
        """A mesh that stands where `limen.layers.common.room_placement.mesh_in_room` puts it, unless it is placed.

        For all policies but ``full`` its vertices are joined to a tree first, two seconds for a million triangles.
        """
        policy, tree = policy or Policy("full"), None
        if policy.name != "full":
            from limen.data.mesh.store import tree_of  # Numba and SciPy take a second

            tree = FoldTree(tree_of(mesh))
        return cls(mesh, RoomPlacement.by(placement, "a mesh") or RoomPlacement(), policy, tree, overlay=overlay)

    @property
    def name(self) -> str:
        return self.mesh.path.name if self.mesh.path else "mesh"

    @property
    def alone_because(self) -> str:
        return "has the depth of each panel: leave out the depth 'shared'" if self.depth == "shared" else ""

    @property
    def overlay_word(self) -> str:
        return self.overlay or ("panels" if self.policy.name == "full" else "simplified")

    def state(self, time_s: float, display: Display) -> LayerState:
        placement, motion = self.stands.state(self.mesh.bounds, display, time_s)
        return LayerState(placement=placement, policy=self.policy, overlay=self.overlay, motion=motion)

    def turned(self, state: LayerState, turn: Turn, display: Display) -> LayerState:
        if turn == STILL:
            return state
        assert isinstance(state.placement, InRoom)
        placement = InRoom.of(about_middle(state.placement.matrix, self.mesh.bounds, **turn._asdict()))
        return msgspec.structs.replace(state, placement=placement)

    def selector(self, display: Display, whole: Display) -> MeshSelector:
        return MeshSelector(self, display)


class MeshPart(NamedTuple):
    """What is drawn of a mesh in one quilt."""

    room_from_mesh: Floats  # (4, 4)
    cut: MeshCut | None = None  # None where all triangles are drawn
    deformed: Mesh | None = None
    """Other places and normals of the same triangles, if it is deformed."""


class MeshSelector:
    """Which triangles of a mesh are left."""

    sources: tuple[Streaming, ...] = ()

    def __init__(self, layer: MeshLayer, display: Display) -> None:
        self._layer = layer
        self._whites = [panel.luminance_cd_m2 for panel in display.panels]
        # Of all nodes, where there is a tree: they may lie a little beside the mesh.
        self._bounds = _bounds_of(layer.mesh.positions if layer.tree is None else layer.tree.tree.position)
        self._kept: dict[int, tuple[Any, MeshCut]] = {}  # of each view of a frame

    def complete(self, state: LayerState) -> None:
        """All that a choice goes by lies in the tree."""

    def select(
        self, views: Sequence[QuiltView], state: LayerState, frame: FrameState, resident: Residents, *, live: bool
    ) -> Cut[MeshPart]:
        assert isinstance(state.placement, InRoom)
        layer, stands = self._layer, state.placement.matrix
        _check_tree(layer, state.policy)
        if state.overlay == "simplified" and layer.tree is None:
            raise InputError("the overlay 'simplified' shows what a policy leaves out: give one, as contrast+gaze")
        deformed = None if layer.deformed is None else layer.deformed(frame.time_s)
        cuts = [
            self._cut(layer.tree, number, view, state, frame) if layer.tree else None
            for number, view in enumerate(views)
        ]
        chosen = [cut for cut in cuts if cut is not None]
        counts = CutCounts(
            items=max(len(cut) for cut in chosen) if chosen else len(layer.mesh.triangles),
            panels_active=sum(int(view.facing.sum()) for view in views),
            error_px=max((cut.largest_px for cut in chosen), default=0.0),
            distance_factor=max((cut.reached for cut in chosen), default=0.0),
        )
        bounds = self._bounds if deformed is None else _bounds_of(deformed.positions)
        near_m = tuple(nearest_m(bounds, stands, view.eyes_m) for view in views)
        return Cut(tuple(MeshPart(stands, cut, deformed) for cut in cuts), counts, near_m=near_m)

    def take(self, source: int, update: Update[Any]) -> None:
        """Nothing is streamed."""

    def resolve(self, cut: Cut[MeshPart], resident: Residents) -> Cut[MeshPart]:
        """All is there."""
        return cut

    def close(self) -> None:
        """Nothing is held that has to be given back."""

    def _cut(self, tree: FoldTree, number: int, view: QuiltView, state: LayerState, frame: FrameState) -> MeshCut:
        """The cut of one quilt; while nothing moves, that of the frame before."""
        assert isinstance(state.placement, InRoom)
        policy = state.policy
        everybody = tuple(replace(each, time_s=0.0) for each in frame.viewers)
        moving = state.motion if policy.motion else None
        asked = (everybody, policy, state.placement, moving, view.quilt, view.eyes_m.tolist())
        kept = self._kept.get(number)
        if kept is not None and kept[0] == asked:
            return kept[1]
        request = FoldRequest(
            view.eyes, state.placement.matrix, tolerance_of(frame.viewers, policy.eyesight, state.motion_matrix),
            policy, acuity_scale(policy, self._whites), self._layer.extent,
        )  # fmt: skip
        cut = select_mesh(tree, request)
        self._kept[number] = asked, cut
        return cut


def nearest_m(bounds: NDArray[Any], room_from_mesh: Floats, eyes_m: Floats) -> float:
    """How far from the nearest eye a mesh begins: the distance of the ball around its bounding box, (2, 3)."""
    corners = np.array(np.meshgrid(*np.asarray(bounds, dtype=float).T)).reshape(3, -1).T
    placed = corners @ room_from_mesh[:3, :3].T + room_from_mesh[:3, 3]
    middle = placed.mean(axis=0)
    radius = float(np.linalg.norm(placed - middle, axis=1).max())
    away = np.linalg.norm(eyes_m - middle, axis=1)
    return max(float(away.min(initial=np.inf)) - radius, NEAR_M)


def _bounds_of(places: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.array([places.min(axis=0), places.max(axis=0)])


def _check_tree(layer: MeshLayer, policy: Policy) -> None:
    if layer.tree is None and policy.name != "full":
        if layer.deformed is not None:
            raise InputError("a mesh that is deformed is drawn in full: give the policy full, or leave it as it is")
        raise InputError(f"the policy {policy.title} leaves out triangles by the mesh's tree: give MeshLayer its tree")
