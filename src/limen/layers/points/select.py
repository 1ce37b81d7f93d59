"""Which nodes of a cloud of points are drawn as splats: as few as nobody can tell from all of them.

From the root down, the first nodes are drawn whose change to the picture is invisible: their sphere's diameter, times
the share of detail that an eye sees of their contrast, is no more than the tolerance at the nearest place of the
sphere; nor is anything finer drawn than a pixel. A node that is neither all front nor all back, by the cone of its
normals, may be on a silhouette, behind which anything may be: its contrast is the largest there is.

References
----------
Rusinkiewicz, Levoy 2000, *QSplat: A Multiresolution Point Rendering System for Large Meshes*, SIGGRAPH (the spheres,
and the policy ``full``: down to a pixel).
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 4 (frequency and contrast
of a splat), section 5.3 (a budget spent by the distance from which a simplification is seen).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.nodes import radius_of_code
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.common.budget import budget_limit, eye_rows, panel_rows
from limen.layers.common.lighting import AMBIENT, TOWARD_LIGHT
from limen.layers.common.sphere_kernels import BINS
from limen.layers.points.kernels import cut_chunks, cut_tops
from limen.system import worker_count
from limen.viewing.policy import COUNTED, Policy
from limen.viewing.projection import PanelProjections
from limen.viewing.tolerance import Tolerance

if TYPE_CHECKING:
    from limen.data.points.file import Points  # Zarr takes half a second

__all__ = ["TOP_ITEM", "PointCut", "PointTree", "PointsRequest", "ResidentNodes", "select_points"]

TOP_ITEM = 1 << 31
"""Set in the number of an item that is a top (its row among all tops); without it, it is ``slot * 4681 + node``."""

_SLICE = 64  # chunks that a thread takes at a time
_FIRST_ROOM = 256  # splats a chunk that room is made for at first

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class PointTree:
    """What has to be known of a cloud to choose from it: the nodes above chunks, one after the other."""

    points: int
    two_sided: bool
    level_first: Index
    level_count: Index
    places: NDArray[np.float32]  # (K, 3)
    radii: NDArray[np.float32]  # (K,)
    small: NDArray[np.uint8]  # (K, 6): normal, cone, contrast, 0, 0
    origins: NDArray[np.float32]  # (C, 3)
    steps: NDArray[np.float32]  # (C,)
    largest_radii: NDArray[np.float32]  # (C,)

    @classmethod
    def of(cls, points: Points) -> PointTree:
        tops = np.concatenate(points.tops)
        counts = np.array([len(level) for level in points.tops], np.int64)
        small = np.zeros((len(tops), 6), np.uint8)
        small[:, :2], small[:, 2], small[:, 3] = tops["normal"].view(np.uint8), tops["cone"], tops["contrast"]
        origin, step, radius = (np.ascontiguousarray(each) for each in points.frames)
        return cls(
            points.size, points.two_sided, np.cumsum(counts) - counts, counts, np.ascontiguousarray(tops["place"]),
            np.ascontiguousarray(tops["radius"]), small, origin, step, radius,
        )  # fmt: skip

    @property
    def chunks(self) -> int:
        return len(self.steps)


class ResidentNodes(NamedTuple):
    """Chunks in memory."""

    words: NDArray[np.uint32]  # (S, 4681, 4): their nodes, as shaders read them
    slots: NDArray[np.int32]  # (C,): where each chunk is, -1 where it is not


@dataclass(frozen=True, slots=True, eq=False)
class PointsRequest:
    """How a cloud is seen.

    Parameters
    ----------
    views
        The panels, from the eye that is drawn for.
    room_from_cloud
        Rotation, one scale and translation, from coordinates relative to the cloud's origin to the room: (4, 4).
    tolerance
        Of all viewers: of the policy's `Policy.eyesight`.
    policy
        ``full`` and ``size`` know pixels alone.
    shares
        Of `limen.layers.common.contrast_scale.acuity_scale_of_contrast`, (256,); of ``acuity``, ones.
    lit
        Whether splats with normals are lit: then normals that differ make contrast.
    """

    views: PanelProjections
    room_from_cloud: Floats
    tolerance: Tolerance
    policy: Policy
    shares: Floats
    lit: bool = True

    def __post_init__(self) -> None:
        linear = np.asarray(self.room_from_cloud, dtype=float)[:3, :3]
        squared = linear.T @ linear
        size = float(np.trace(squared)) / 3
        if not (size > 0 and np.allclose(squared, size * np.eye(3), atol=1e-5 * size)):
            raise InputError("a cloud of points is turned, moved and scaled by one number, not sheared or stretched")

    @property
    def size(self) -> float:
        """Metres of the cloud's unit."""
        return math.sqrt(float(np.square(self.room_from_cloud[:3, :3]).sum()) / 3)

    @property
    def way_from_cloud(self) -> Floats:
        """(3, 4): from the cloud's coordinates to the way from the eye."""
        way = np.array(self.room_from_cloud, dtype=float)[:3]
        way[:, 3] -= self.views.eye_m
        return way


@dataclass(frozen=True, slots=True, eq=False)
class PointCut:
    """The splats of one frame.

    Parameters
    ----------
    pairs
        (N, 2) uint32: an item (see `TOP_ITEM`) and the panel that it is drawn on, panel by panel.
    wanted
        Chunks whose insides are wanted, the most important first, whether resident or not.
    limit
        Nodes are drawn up to this ``k``: 1, or what a budget leads to.
    reached
        The largest ``k`` of what is drawn in the place of something finer: below 1 it is invisible; more than `limit`
        while chunks are missing.
    largest_px
        Diameter of the largest node drawn in the place of something finer, pixels of its panel.
    judged
        How many nodes were looked at.
    """

    pairs: NDArray[np.uint32]
    wanted: Index
    limit: float
    reached: float
    largest_px: float
    judged: int

    def __len__(self) -> int:
        return len(self.pairs)


def select_points(
    tree: PointTree,
    resident: ResidentNodes,
    sight: PointsRequest,
    *,
    active: Sequence[int] | None = None,
    threads: int | None = None,
) -> PointCut:
    """The cut of a cloud for all panels that face the eye.

    Where a chunk is not resident, its top is drawn. The same whatever the number of threads.

    Parameters
    ----------
    active
        Panels to choose for, by default all that face the eye.
    """
    panels = np.flatnonzero(sight.views.facing) if active is None else np.asarray(active, np.int64)
    rows = panel_rows(sight.views)
    told = _KernelInputs(tree, resident, sight)
    workers = worker_count() if threads is None else threads
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        limit = 1.0
        if sight.policy.name in COUNTED:
            assert sight.policy.max_items is not None
            limit = _limit_of_budget(told, pool, rows[panels], sight.policy.max_items)
        wanted_k = np.zeros(tree.chunks)
        parts, reached, largest_px, judged = [], 0.0, 0.0, 0
        for panel in panels:
            items, largest, widest, visits = told.cut(pool, rows[panel], limit, wanted_k)
            parts.append(np.stack([items, np.full(len(items), panel, np.uint32)], axis=1))
            reached, largest_px, judged = max(reached, largest), max(largest_px, widest), judged + visits
    pairs = np.concatenate(parts) if parts else np.zeros((0, 2), np.uint32)
    wanted = np.flatnonzero(wanted_k > 0)
    return PointCut(pairs, wanted[np.argsort(-wanted_k[wanted], kind="stable")], limit, reached, largest_px, judged)


class _KernelInputs:
    """What the loops are told on every panel alike."""

    def __init__(self, tree: PointTree, resident: ResidentNodes, sight: PointsRequest) -> None:
        self.tree, self.resident = tree, resident
        eyes = eye_rows(sight.tolerance, sight.views.eye_m)
        light = np.array([*TOWARD_LIGHT, AMBIENT, float(sight.lit)])
        mode = int(len(eyes) > 0 and sight.policy.name not in ("full", "size"))
        self.seen = (
            eyes, sight.way_from_cloud, sight.size, light, np.asarray(sight.shares, dtype=float), mode, tree.two_sided
        )  # fmt: skip
        self.radius_of_code = radius_of_code(np.arange(256, dtype=np.uint8), 1.0)

    def tops(self, panel: Floats, limit: float, wanted_k: Floats, histogram: Index) -> tuple[Any, ...]:
        tree = self.tree
        drawn, opened, opened_k = (
            np.empty(len(tree.places), np.int64),
            np.empty(tree.chunks, np.int64),
            np.empty(tree.chunks),
        )
        root = len(tree.level_first) - 1
        draws, opens, visits, largest, widest = cut_tops(
            tree.level_first, tree.level_count, root, tree.places, tree.radii, tree.small, panel, *self.seen, limit,
            self.resident.slots, drawn, opened, opened_k, wanted_k, histogram,
        )  # fmt: skip
        return drawn[:draws], opened[:opens], opened_k[:opens], visits, largest, widest

    def chunks(
        self, panel: Floats, limit: float, opened: Index, opened_k: Floats, span: tuple[int, int], histogram: Index
    ) -> tuple[Index, int, float, float]:
        """Some of the opened chunks: items, nodes judged, largest ``k`` and diameter."""
        tree, resident = self.tree, self.resident
        room = 0 if len(histogram) else (span[1] - span[0]) * _FIRST_ROOM
        while True:
            drawn = np.empty(room, np.int64)
            draws, visits, largest, widest = cut_chunks(
                opened, opened_k, *span, resident.slots, tree.points, tree.origins, tree.steps, tree.largest_radii,
                self.radius_of_code, resident.words, panel, *self.seen, limit, drawn, histogram,
            )  # fmt: skip
            if draws <= room:
                return drawn[:draws], visits, largest, widest
            room = draws

    def cut(
        self, pool: ThreadPoolExecutor, panel: Floats, limit: float, wanted_k: Floats
    ) -> tuple[Any, float, float, int]:
        nothing = np.zeros(0, np.int64)
        tops, opened, opened_k, visits, largest, widest = self.tops(panel, limit, wanted_k, nothing)
        spans = _spans(len(opened))
        parts = list(pool.map(lambda span: self.chunks(panel, limit, opened, opened_k, span, nothing), spans))
        items = np.concatenate([tops + TOP_ITEM, *(part[0] for part in parts)]).astype(np.uint32)
        largest, widest = (max([top, *(part[n] for part in parts)]) for n, top in ((2, largest), (3, widest)))
        return items, largest, widest, visits + sum(part[1] for part in parts)

    def count(self, pool: ThreadPoolExecutor, panel: Floats) -> Index:
        """What opening nodes adds to the number of splats, by the bin of their ``k``: (256,)."""
        histogram = np.zeros(BINS, np.int64)
        _, opened, opened_k, *_ = self.tops(panel, 0.0, np.zeros(self.tree.chunks), histogram)

        def counted(span: tuple[int, int]) -> Index:
            own = np.zeros(BINS, np.int64)
            self.chunks(panel, 0.0, opened, opened_k, span, own)
            return own

        return histogram + sum(pool.map(counted, _spans(len(opened))), np.zeros(BINS, np.int64))


def _limit_of_budget(told: _KernelInputs, pool: ThreadPoolExecutor, panels: Floats, most: int) -> float:
    """The smallest ``k`` (a bin's edge) up to which nodes can be drawn with no more than ``most`` splats in all."""
    histogram = sum((told.count(pool, panel) for panel in panels), np.zeros(BINS, np.int64))
    return budget_limit(histogram, len(panels), most)


def _spans(count: int) -> list[tuple[int, int]]:
    return [(begin, min(begin + _SLICE, count)) for begin in range(0, count, _SLICE)]
