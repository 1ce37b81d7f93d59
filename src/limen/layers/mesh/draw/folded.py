"""A mesh whose vertices are all nodes of its vertex tree, and the colours that show which of them are folded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import NO_TEXTURE, Mesh
from limen.data.mesh.node_kernels import add_up
from limen.data.mesh.vertex_tree import VertexTree
from limen.layers.mesh.fold_kernels import SILHOUETTE
from limen.layers.mesh.select import FoldTree, MeshCut

__all__ = ["fold_colours", "mesh_of_nodes"]

_INSIDE = np.array([[60, 90, 230], [40, 220, 90]])
"""sRGB of nodes that stand for two vertices, and of those that stand for a thousand and more."""
_RIM = np.array([[220, 40, 40], [250, 220, 60]])
_MUCH = 10.0  # octaves of vertices


def mesh_of_nodes(mesh: Mesh, tree: VertexTree) -> Mesh:
    """The mesh with a vertex for every node: triangles of any cut are numbers of these.

    Where there are textures, a node takes the mean place in them of all vertices below; they lie in one piece of one
    texture, since vertices where pieces meet are never joined with each other.
    """
    count, vertices = len(tree.position), tree.vertices
    uv, layers = np.zeros((count, 2), np.float32), np.full(count, NO_TEXTURE, np.uint32)
    uv[:vertices], layers[:vertices] = mesh.uv, mesh.layers
    if len(mesh.textures):
        sums = np.zeros((count, 4))
        sums[:vertices, :2], sums[:vertices, 2], sums[:vertices, 3] = mesh.uv, mesh.layers, 1.0
        add_up(tree.parent, sums)
        uv[vertices:] = sums[vertices:, :2] / sums[vertices:, 3:]
        layers[vertices:] = np.rint(sums[vertices:, 2] / sums[vertices:, 3]).astype(np.uint32)
    return Mesh(
        mesh.path, tree.position, tree.triangles, tree.normal, tree.colour, uv, layers, mesh.textures,
        np.arange(count, dtype=np.uint32),
    )  # fmt: skip


def fold_colours(foldable: FoldTree, cut: MeshCut) -> NDArray[np.uint8]:
    """Colours of all nodes, (N, 4) sRGB: folded ones from blue to green with what they stand for, on silhouettes from
    red to yellow; vertices that stand for themselves as they are.
    """
    tree = foldable.tree
    vertices = tree.vertices
    below = np.zeros((len(tree.position), 1))
    below[:vertices] = 1.0
    add_up(tree.parent, below)
    much = np.clip(np.log2(np.maximum(below[vertices:], 1.0)) / _MUCH, 0.0, 1.0)
    colours = tree.colour.copy()
    rim = (cut.faces == SILHOUETTE)[:, None]
    colours[vertices:, :3] = np.where(rim, _mixed(_RIM, much), _mixed(_INSIDE, much))
    return colours


def _mixed(ends: NDArray[np.int64], share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.rint(ends[0] * (1 - share) + ends[1] * share))
