"""A mesh's vertices as a tree: every inner node can stand for all vertices below it, with a proxy of its own.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 5 (vertex tree, proxies,
regions of support, normal masks).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["MASK_WORDS", "VertexTree"]

MASK_WORDS = 6
"""64-bit words of a normal mask: one for each face of a cube around the Gauss sphere, 8 x 8 cells a face."""


class VertexTree(NamedTuple):
    """The nodes of a mesh of ``V`` vertices: the first ``V`` are the vertices, then inner nodes, children first.

    A parent's number is larger than its children's, so one pass from the last node to the first meets parents first.
    When a node is **folded**, all vertices below it are replaced by its proxy; triangles that then have two corners in
    one place are gone. The **region of support** of a node are the triangles with a corner below it that vanish or
    change when it is folded. Its ``displacement`` bounds how far the surface moves if what is around it is folded as
    far as it was when the node was made; a cut of another shape exceeds it at one place in a thousand.
    """

    triangles: NDArray[np.uint32]  # (T, 3): the mesh's own, corners below V
    parent: NDArray[np.int32]  # (N,): -1 of a root
    position: NDArray[np.float32]  # (N, 3): proxies; of a vertex its own place
    normal: NDArray[np.float32]  # (N, 3), unit
    colour: NDArray[np.uint8]  # (N, 4): sRGB and opacity
    middle: NDArray[np.float32]  # (N - V, 3): of a sphere around the region of support, original and folded
    radius: NDArray[np.float32]  # (N - V,)
    displacement: NDArray[np.float32]  # (N - V,): how far folding moves the surface, below the node included; see above
    contrast: NDArray[np.uint8]  # (N - V,): code of the luminances folded against those of the region (vision.grades)
    mask: NDArray[
        np.uint64
    ]  # (N - V, 6): cells of the Gauss sphere that normals of the region lie in; all ones on rims

    @property
    def vertices(self) -> int:
        return len(self.position) - len(self.radius)

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self)
