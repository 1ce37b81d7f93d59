"""Which nodes of a vertex tree are folded: as many as nobody can tell from none, or all but what a budget buys.

A node is folded where its change to the picture is invisible. Inside the surface it changes light and colours: all
normals of its region lie within an angle of the proxy's, so the contrast is bounded, and nothing larger than the region
changes. On the silhouette, anything may appear behind: the contrast is the largest there is, and what changes is as
large as the region (the paper), or only as wide as the surface moves (the paper's section 8.2 asks for it: a strip
along the outline). What faces away from the eye may move as far as on a silhouette, in case it sticks out.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 5, and 8.2.
Cohen, Olano, Manocha 1998, *Appearance-Preserving Simplification*, SIGGRAPH (deviation of the surface, in pixels).
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.node_kernels import add_up
from limen.data.mesh.normal_masks import ALL_CELLS
from limen.data.mesh.vertex_tree import VertexTree
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.common.budget import budget_limit, eye_rows, panel_rows
from limen.layers.common.contrast_scale import acuity_scale_of_contrast
from limen.layers.common.lighting import AMBIENT, TOWARD_LIGHT
from limen.layers.common.sphere_kernels import BINS
from limen.layers.mesh.bend_kernels import MOMENTS, nest, ripples, star_moments
from limen.layers.mesh.facing import SPREAD_SINES, facing_masks
from limen.layers.mesh.fold_kernels import CREST, count_left, deaths, emit, fold, spreads
from limen.layers.mesh.holes import HoleCovers, covers_of, visible_holes
from limen.system import worker_count
from limen.viewing.policy import COUNTED, Policy
from limen.viewing.projection import PanelProjections
from limen.viewing.tolerance import Tolerance
from limen.vision.contrast_codes import CONTRAST_OF_CODE

__all__ = ["Extent", "FoldRequest", "FoldTree", "MeshCut", "select_mesh"]

Extent: TypeAlias = Literal["support", "displacement"]
"""What a silhouette's change is as wide as: the region of support, or twice what the surface moves."""

_USUALLY_STEEP = 0.5 * CREST

_SLICE = 1 << 16  # triangles that a thread takes at a time

Index = NDArray[np.int64]


class FoldTree:
    """A vertex tree, and what has to be known of it once.

    Parameters
    ----------
    tree
        Of `limen.data.mesh.tree_build.build_vertex_tree`.
    """

    def __init__(self, tree: VertexTree) -> None:
        self.tree = tree
        nodes, inner = len(tree.position), len(tree.radius)
        self.dies_at = np.empty(len(tree.triangles), np.int32)
        self.lost = np.zeros(nodes + 1, np.int64)
        deaths(tree.triangles, tree.parent, self.dies_at, self.lost)
        cosine = np.ones(inner)
        spreads(tree.triangles, tree.parent, tree.vertices, tree.position, tree.normal, cosine)
        # On rims and where there is no surface, anything may be seen from anywhere.
        bare = (tree.mask == ALL_CELLS).all(axis=1)
        self.spread = np.where(bare | (cosine < 0), math.pi, np.arccos(np.clip(cosine, -1, 1)))
        self.ripple = _ripples(tree)

    @cached_property
    def covers(self) -> HoleCovers | None:
        """What would close its holes, see `limen.layers.mesh.holes`."""
        return covers_of(self.tree)


@dataclass(frozen=True, slots=True, eq=False)
class FoldRequest:
    """How a mesh is seen; see `limen.layers.points.select.PointsRequest`.

    Parameters
    ----------
    room_from_mesh
        A rotation, one scale and a move, (4, 4).
    lit
        Whether light falls on it as `limen.layers.common.lighting` says.
    """

    views: tuple[PanelProjections, ...]
    room_from_mesh: Floats
    tolerance: Tolerance
    policy: Policy
    shares: Floats
    extent: Extent = "displacement"
    lit: bool = True

    def __post_init__(self) -> None:
        linear = np.asarray(self.room_from_mesh, dtype=float)[:3, :3]
        squared = linear.T @ linear
        size = float(np.trace(squared)) / 3
        if not (size > 0 and np.allclose(squared, size * np.eye(3), atol=1e-5 * size)):
            raise InputError("a mesh that is simplified is turned, moved and scaled by one number, not stretched")


@dataclass(frozen=True, slots=True, eq=False)
class MeshCut:
    """A mesh with some nodes folded.

    Parameters
    ----------
    triangles
        (T, 3) uint32: numbers of nodes.
    state
        (N + 1,): the node that stands for each; -1 for inner nodes that are not folded.
    limit
        Nodes are folded up to this ``k``: 1, or what a budget leads to.
    reached
        The largest ``k`` folded: how many times farther away viewers would have to be for nobody to see it.
    largest_px
        Diameter of the largest region folded, pixels of its panel.
    asked
        How many nodes were looked at.
    faces
        (N - V,): of each node that was asked whether it is hidden, inside or on the silhouette.
    """

    triangles: NDArray[np.uint32]
    state: NDArray[np.int32]
    limit: float
    reached: float
    largest_px: float
    asked: int
    faces: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.triangles)


def select_mesh(mesh: FoldTree, sight: FoldRequest, *, threads: int | None = None) -> MeshCut:
    """The cut of a mesh for all views of one eye each (two for stereo); the same whatever the number of threads."""
    tree, policy = mesh.tree, sight.policy
    state = np.empty(len(tree.position) + 1, np.int32)
    faces = np.zeros(len(tree.radius), np.int8)
    if policy.name == "full":
        state[:-1] = np.where(np.arange(len(tree.position)) < tree.vertices, np.arange(len(tree.position)), -1)
        state[-1] = -1
        return MeshCut(_emitted(mesh, state, threads), state, 0.0, 0.0, 0.0, 0, faces)
    limit = 1.0
    if policy.name in COUNTED:
        assert policy.max_items is not None
        histogram = np.zeros(BINS, np.int64)
        _folded(mesh, sight, 0.0, state, faces, histogram)
        limit = budget_limit(histogram, int(mesh.lost[-1]), policy.max_items)
    _, asked, largest, widest = _folded(mesh, sight, limit, state, faces, np.zeros(0, np.int64))
    return MeshCut(_emitted(mesh, state, threads), state, limit, largest, widest, asked, faces)


def _folded(
    mesh: FoldTree,
    sight: FoldRequest,
    limit: float,
    state: NDArray[np.int32],
    faces: NDArray[np.int8],
    histogram: Index,
) -> tuple[int, int, float, float]:
    tree = mesh.tree
    eye_m = np.mean([view.eye_m for view in sight.views], axis=0)
    room = np.asarray(sight.room_from_mesh, dtype=float)
    way = room[:3].copy()
    way[:, 3] -= eye_m
    size = math.sqrt(float(np.square(way[:, :3]).sum()) / 3)
    in_mesh = np.linalg.inv(room) @ np.append(eye_m, 1.0)
    light = np.array([*TOWARD_LIGHT, AMBIENT, float(sight.lit)])
    masks = facing_masks()
    panels = np.concatenate([panel_rows(view)[view.facing] for view in sight.views])
    mode = int(len(sight.tolerance.tan_angle) > 0 and sight.policy.name != "size")
    found: Any = fold(
        tree.parent, tree.vertices, tree.normal, tree.middle, tree.radius, tree.displacement, tree.contrast,
        mesh.spread, mesh.ripple, tree.mask, mesh.lost, masks.front, masks.back, SPREAD_SINES, panels,
        eye_rows(sight.tolerance, eye_m), way, size, way[:, :3] / size, light, np.asarray(sight.shares, dtype=float),
        mode, sight.extent == "displacement", visible_holes(mesh.covers, in_mesh[:3]), limit, state,
        np.full(len(tree.radius), -1.0), faces, histogram,
    )  # fmt: skip
    left, asked, largest, widest = found
    return int(left), int(asked), float(largest), float(widest)


def _emitted(mesh: FoldTree, state: NDArray[np.int32], threads: int | None) -> NDArray[np.uint32]:
    """The triangles that are left, in their order: counted in slices, so that every slice knows where to write."""
    triangles = mesh.tree.triangles
    spans = [(begin, min(begin + _SLICE, len(triangles))) for begin in range(0, len(triangles), _SLICE)]
    with ThreadPoolExecutor(max(worker_count() if threads is None else threads, 1)) as pool:
        counts = list(pool.map(lambda span: count_left(mesh.dies_at, state, *span), spans))
        firsts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        out = np.empty((int(firsts[-1]), 3), np.uint32)
        list(pool.map(lambda n: emit(triangles, mesh.dies_at, state, *spans[n], firsts[n], out), range(len(spans))))
    return out


def _ripples(tree: VertexTree) -> Floats:
    """How far the normals below each node are from a steady bend, (N - V,) radians: root of the mean square.

    What is folded still bends as its surroundings do, for what Gouraud shading draws between proxies is linear.
    """
    vertices, nodes = tree.vertices, len(tree.position)
    place = tree.position[:vertices].astype(float)
    low, high = place.min(axis=0), place.max(axis=0)
    place = (place - (low + high) / 2) / max(float((high - low).max()), 1e-30)
    normal = tree.normal[:vertices].astype(float)
    region, own = np.zeros((nodes, MOMENTS)), np.zeros((nodes, 7))
    star_moments(tree.triangles, place, normal, region)
    area = region[:vertices, :1] + max(float(region[:vertices, 0].sum()), 1e-30) * 1e-12  # vertices of no triangle
    own[:vertices] = np.concatenate([area, area * place, area * normal], axis=1)
    add_up(tree.parent, region)
    add_up(tree.parent, own)
    ripple2 = np.zeros(nodes)
    ripples(tree.parent, region, own, ripple2)
    ripple = np.sqrt(ripple2[vertices:])
    nest(tree.parent, vertices, tree.radius, ripple, _USUALLY_STEEP, acuity_scale_of_contrast(100.0), CONTRAST_OF_CODE)
    return ripple
