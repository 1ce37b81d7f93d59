"""``build_vertex_tree``: a mesh's vertices joined two by two, in the order in which joining them changes the surface.

Edges are collapsed as Garland and Heckbert do, and every collapse is a node of the tree; so a cut through the tree by
error is about the mesh that they would draw with as many triangles. What stays when no edge may be collapsed any more
(a tetrahedron of a closed surface, the rims of an open one, all of one that is no manifold) is joined by place.

References
----------
Garland, Heckbert 1997, *Surface Simplification Using Quadric Error Metrics*.
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from limen.data.mesh import collapse_kernels as tree_kernels
from limen.data.mesh import node_kernels as tree_node_kernels
from limen.data.mesh import record_kernels as tree_record_kernels
from limen.data.mesh import start_kernels as tree_start_kernels
from limen.data.mesh.mesh import NO_TEXTURE, Mesh
from limen.data.mesh.vertex_tree import MASK_WORDS, VertexTree
from limen.data.store.resample import linear_of_srgb, srgb_of_linear
from limen.geometry import Floats
from limen.vision.contrast_codes import FULL_CODE, code_of_luminances
from limen.vision.luminance import Photometry

__all__ = ["build_vertex_tree"]

Ints = NDArray[np.int32]

ALL_CELLS = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
_VERTICES_A_TILE = 2048
"""Or about half as many: what a core's own cache holds of triangles and nodes."""

_EDGES_A_TRIANGLE = 6
"""That the queue has room for; it holds three at most at first."""

_CUT_OUT = 128
"""Opacity below which nothing is drawn."""


class _Forest(NamedTuple):
    """Nodes as collapses make them, in arrays with room for all; places from the mesh's middle, in units of its size.

    There are never more than two nodes a vertex, for every inner one has at least two children.
    """

    numbers: Ints  # (V,): the node that stands for a vertex and all at its place
    triangles: Ints  # (T, 8): `tree_kernels.CORNERS`
    parent: Ints  # (2 V,)
    kind: NDArray[np.int8]  # (2 V,)
    records: NDArray[np.float32]  # (2 V, 32): `tree_record_kernels.SLOTS`

    @property
    def place(self) -> NDArray[np.float32]:
        return self.records[:, tree_record_kernels.PLACE : tree_record_kernels.PLACE + 3]

    @property
    def moved(self) -> NDArray[np.float32]:
        return self.records[:, tree_record_kernels.MOVED]

    def weight(self, nodes: Ints) -> Floats:
        """Areas around nodes, about."""
        return np.asarray(self.records[nodes][:, [0, 3, 5]].sum(axis=1), float)


def build_vertex_tree(mesh: Mesh, photometry: Photometry | None = None) -> VertexTree:
    """Join the vertices of a mesh to a forest, one root for each connected part.

    Vertices of one place are joined first. Where textures meet, a place has several vertices, and each keeps it: others
    may be joined to one of them, but never two of them. Vertices of no triangle are roots.

    Parameters
    ----------
    mesh
        Any: open, no manifold, in many parts, with triangles of no area.
    photometry
        Of the display that shows it, for the contrast of colours; sRGB without it.
    """
    low, high = mesh.bounds.astype(float)
    middle, size = (low + high) / 2, float((high - low).max()) or 1.0
    forest = _rooted(mesh, middle, size)
    collapsed = _collapse(forest)
    nodes = _join_parts(forest, collapsed)
    vertices, parent = len(mesh.positions), forest.parent[:nodes]
    position = np.empty((nodes, 3), np.float32)
    position[:vertices] = mesh.positions
    stays = forest.kind[:collapsed] >= tree_record_kernels.FIXED
    tree_node_kernels.places(forest.records, forest.numbers, parent, stays, middle, size, position)
    regions = _regions(mesh, parent, position, forest.kind[:nodes], forest.kind[forest.numbers])
    normal, colour = _means(mesh, parent, regions.area)
    displacement = np.minimum(forest.moved[vertices:nodes] * size, regions.way)
    tree_node_kernels.rise(parent, vertices, displacement)
    return VertexTree(
        triangles=mesh.triangles,
        parent=parent.copy(),
        position=position,
        normal=normal,
        colour=colour,
        middle=regions.middle,
        radius=regions.radius,
        displacement=displacement.astype(np.float32),
        contrast=_contrasts(mesh, parent, colour, photometry or Photometry.srgb()),
        mask=regions.mask,
    )


def _rooted(mesh: Mesh, middle: Floats, size: float) -> _Forest:
    """A forest of the vertices, and of the nodes that join those of one place."""
    first, apart = _welds(mesh)
    vertices = len(first)
    numbers = np.arange(vertices, dtype=np.int32)
    parent, kind = np.full(2 * vertices, -1, np.int32), np.zeros(2 * vertices, np.int8)
    if (first != numbers).any():
        shared = np.flatnonzero(np.bincount(first, minlength=vertices) > 1)
        numbers[shared] = vertices + np.arange(len(shared))
        numbers = numbers[first]
        below = numbers >= vertices
        parent[:vertices][below] = numbers[below]
    kind[:vertices][apart] = tree_record_kernels.APART
    forest = _Forest(
        numbers, np.empty((mesh.size, tree_kernels.CORNERS), np.int32), parent, kind,
        np.zeros((2 * vertices, tree_record_kernels.SLOTS), np.float32),
    )  # fmt: skip
    tree_start_kernels.fill(mesh.positions, middle, size, mesh.triangles, numbers, forest.records, forest.triangles)
    tree_start_kernels.sum_bends(mesh.triangles, numbers, mesh.normals, forest.records.ravel())
    return forest


def _welds(mesh: Mesh) -> tuple[Ints, NDArray[np.bool_]]:
    """The first vertex at each one's place, (V,), and where textures meet; there every vertex is its own first."""
    first = tree_node_kernels.first_at_places(mesh.positions)
    apart = np.zeros(len(first), bool)
    if len(mesh.textures):
        other = (mesh.uv != mesh.uv[first]).any(axis=1) & (mesh.layers != NO_TEXTURE)
        apart[first[other | (mesh.layers != mesh.layers[first])]] = True
        apart = apart[first]
        first[apart] = np.flatnonzero(apart)
    return first, apart


def _collapse(forest: _Forest) -> int:
    """Collapse edges until none may be; returns the number of nodes."""
    vertices = len(forest.numbers)
    begin = int(max(forest.numbers.max() + 1, vertices))
    triangles, records = forest.triangles.ravel(), forest.records.ravel()
    words = records.view(np.int32)
    tree_start_kernels.link_corners(triangles, words, np.full(begin, -1, np.int32))
    tree_start_kernels.sum_quadrics(triangles, records)
    tree_start_kernels.classify(triangles, records, words, forest.kind[:begin])
    tile = np.zeros(len(forest.parent), np.int32)
    tiles = tree_start_kernels.tile(records, begin, max(1, int(math.sqrt(vertices / _VERTICES_A_TILE))), tile)
    bins = np.empty((2, tree_kernels.ROUNDS * tree_kernels.STEPS * tiles), np.int32)
    queue = np.empty(3 * (_EDGES_A_TRIANGLE * len(forest.triangles) + 1024), np.int32)
    nodes, mark, before, full = begin, 0, -1, True
    while full and nodes > before:  # where the queue is full, it is begun anew with the edges that are left
        before = nodes
        bins.fill(-1)
        nodes, mark, full = tree_kernels.collapse(
            triangles, records, words, forest.kind, tile, forest.parent, nodes, mark, queue, bins
        )
    return int(nodes)


def _join_parts(forest: _Forest, nodes: int) -> int:
    """Join what is left of every connected part, neighbours in the order of a curve two by two; number of nodes."""
    left = forest.triangles[forest.triangles[:, 0] >= 0, :3]
    roots = np.unique(left)
    if not len(roots):
        return nodes
    edges = np.searchsorted(roots, left)
    links = coo_array((np.ones(2 * len(left)), (edges[:, [0, 0]].ravel(), edges[:, 1:].ravel())), (len(roots),) * 2)
    part = connected_components(links, directed=False)[1]
    free = forest.kind[roots] != tree_record_kernels.APART
    roots, part = roots[free], part[free]
    order = np.lexsort((_along_curve(forest.place[roots]), part))
    roots, part = roots[order], part[order]
    while True:
        place = np.arange(len(part)) - np.searchsorted(part, part)
        one = np.flatnonzero((place % 2 == 0) & np.append(part[1:] == part[:-1], False))
        if not len(one):
            return nodes
        new = nodes + np.arange(len(one), dtype=np.int32)
        _join_pairs(forest, roots[one], roots[one + 1], new)
        nodes += len(one)
        roots[one] = new
        roots, part = np.delete(roots, one + 1), np.delete(part, one + 1)


def _join_pairs(forest: _Forest, one: Ints, other: Ints, new: Ints) -> None:
    place, moved = forest.place, forest.moved
    heavy, rest = forest.weight(one), forest.weight(other)
    share = np.divide(heavy, heavy + rest, out=np.full(len(one), 0.5), where=heavy + rest > 0)[:, None]
    place[new] = share * place[one] + (1 - share) * place[other]
    for child in (one, other):
        forest.parent[child] = new
        way = np.linalg.norm(place[child].astype(float) - place[new], axis=1)
        moved[new] = np.maximum(moved[new], moved[child] + way)
    forest.records[new, :6] = forest.records[one, :6] + forest.records[other, :6]
    forest.kind[new] = tree_record_kernels.FIXED


def _along_curve(place: NDArray[np.float32]) -> NDArray[np.int64]:
    """Numbers of places (n, 3) from -0.5 to 0.5 in Morton order, 20 bits an axis."""
    steps = np.clip((place.astype(float) + 0.5) * (1 << 20), 0, (1 << 20) - 1).astype(np.int64)
    numbers = np.zeros(len(place), np.int64)
    for bit in range(20):
        for axis in range(3):
            numbers |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return numbers


class _Regions(NamedTuple):
    """What the triangles around all vertices below a node reach."""

    middle: NDArray[np.float32]
    radius: NDArray[np.float32]
    mask: NDArray[np.uint64]
    area: Floats
    way: Floats
    """The longest from a vertex to the proxy: whatever is folded, no part of the surface moves farther."""


def _regions(
    mesh: Mesh, parent: Ints, position: NDArray[np.float32], kind: NDArray[np.int8], kind_of_vertex: NDArray[np.int8]
) -> _Regions:
    vertices, nodes = len(mesh.positions), len(parent)
    box = np.tile(np.array([np.inf] * 3 + [-np.inf] * 3, np.float32), (nodes, 1))
    ring2, area = np.full(vertices, -1.0), np.zeros(nodes)
    leaf_mask = np.zeros((vertices, MASK_WORDS), np.uint64)
    mask = np.zeros((nodes - vertices, MASK_WORDS), np.uint64)
    tree_node_kernels.leaf_regions(mesh.triangles, position, mesh.normals, box, ring2, leaf_mask, area)
    leaf_mask[(kind_of_vertex == tree_record_kernels.RIM) | (kind_of_vertex == tree_record_kernels.FIXED)] = ALL_CELLS
    tree_node_kernels.merge_regions(parent, position, box, leaf_mask, mask)
    low, high = box[vertices:, :3].astype(float), box[vertices:, 3:].astype(float)
    middle = ((low + high) / 2).astype(np.float32)
    radius = np.linalg.norm(position[vertices:] - middle.astype(float), axis=1)
    ring = np.where(ring2 < 0, -1.0, np.sqrt(np.maximum(ring2, 0)))
    way2 = np.zeros(nodes - vertices)
    tree_node_kernels.reach_up(parent, position, ring, middle, radius, way2)
    radius = np.minimum(radius, np.linalg.norm(np.maximum(high - middle, middle - low), axis=1))
    return _Regions(middle, np.nextafter(radius.astype(np.float32), np.float32(np.inf)), mask, area, np.sqrt(way2))


def _means(mesh: Mesh, parent: Ints, area: Floats) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Normals and colours of nodes: means over the vertices below, weighted by the areas around them."""
    vertices, nodes = len(mesh.positions), len(parent)
    weight = area[:vertices, None] + max(float(area.sum()), 1e-30) * 1e-12  # where nothing has an area, all count alike
    varied = (mesh.colours != mesh.colours[0]).any()
    sums = np.zeros((nodes, 8 if varied else 3))
    sums[:vertices, :3] = mesh.normals * weight
    if varied:
        sums[:vertices, 3:6] = linear_of_srgb(mesh.colours[:, :3] / 255.0) * weight
        sums[:vertices, 6:] = np.concatenate([mesh.colours[:, 3:] * weight, weight], axis=1)
    tree_node_kernels.add_up(parent, sums)
    normal, colour = np.empty((nodes, 3), np.float32), np.tile(mesh.colours[0], (nodes, 1))
    normal[:vertices], colour[:vertices] = mesh.normals, mesh.colours
    length = np.linalg.norm(sums[vertices:, :3], axis=1, keepdims=True)
    upward = np.broadcast_to([0.0, 0.0, 1.0], (nodes - vertices, 3))
    normal[vertices:] = np.divide(sums[vertices:, :3], length, out=upward.copy(), where=length > 0)
    if varied:
        mean = sums[vertices:, 3:7] / sums[vertices:, 7:]
        colour[vertices:, :3] = np.rint(255 * srgb_of_linear(np.clip(mean[:, :3], 0, 1)))
        colour[vertices:, 3] = np.rint(mean[:, 3])
    return normal, colour


def _contrasts(mesh: Mesh, parent: Ints, colour: NDArray[np.uint8], photometry: Photometry) -> NDArray[np.uint8]:
    """Codes of the proxies' luminances against the range in their regions; the largest where what is cut out changes,
    and where a texture says what the colours are.
    """
    vertices = len(mesh.positions)
    inner = len(parent) - vertices
    codes = np.zeros(inner, np.uint8)
    if (mesh.colours != mesh.colours[0]).any():
        low, high = _range(mesh, parent, photometry.luminance_cd_m2(mesh.colours[:, :3]))
        codes = code_of_luminances(photometry.luminance_cd_m2(colour[vertices:, :3]), low, high)
        low, high = _range(mesh, parent, (mesh.colours[:, 3] >= _CUT_OUT).astype(float))
        shown = colour[vertices:, 3] >= _CUT_OUT
        codes[(low != shown) | (high != shown)] = FULL_CODE
    if len(mesh.textures):
        codes[_range(mesh, parent, (mesh.layers != NO_TEXTURE).astype(float))[1] > 0] = FULL_CODE
    return codes


def _range(mesh: Mesh, parent: Ints, value: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest value of vertices in the region of each inner node, (N - V,) each."""
    low, high = np.full(len(parent), np.inf), np.full(len(parent), -np.inf)
    low[: len(value)] = high[: len(value)] = value
    tree_node_kernels.widen_up(mesh.triangles, parent, value, low, high)
    return low[len(value) :], high[len(value) :]
