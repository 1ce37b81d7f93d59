"""Other ways to a mesh of fewer triangles: one mesh for all views, made beforehand.

References
----------
Garland, Heckbert 1997, *Surface Simplification Using Quadric Error Metrics* (which all of them do).
Hoppe 1999, *New Quadric Metric for Simplifying Meshes with Appearance Attributes* (meshoptimizer, with normals).
"""

from __future__ import annotations

import ctypes
import importlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from limen.data.mesh.mesh import Mesh, smooth_normals

__all__ = ["PEERS"]

_NORMALS_WEIGH = 0.5  # of the attribute beside the place, as meshoptimizer's own example takes it
_ANY_ERROR = 1.0  # of the mesh's size: what counts is the number of triangles
_FLOATS, _COUNT = ctypes.POINTER(ctypes.c_float), ctypes.c_size_t
_CORNERS = ctypes.POINTER(ctypes.c_uint)
_WITH_ATTRIBUTES = [
    _CORNERS, _CORNERS, _COUNT, _FLOATS, _COUNT, _COUNT, _FLOATS, _COUNT, _FLOATS, _COUNT,
    ctypes.POINTER(ctypes.c_ubyte), _COUNT, ctypes.c_float, ctypes.c_uint, _FLOATS,
]  # fmt: skip
_AGREES = 0.5  # cosine between a triangle's own normal and one that it may borrow


def meshoptimizer(mesh: Mesh, most: int) -> Mesh:
    """A choice of the mesh's own vertices, by their places alone; they keep their normals and colours."""
    return _chosen(mesh, most, weigh_normals=False)


def meshoptimizer_with_normals(mesh: Mesh, most: int) -> Mesh:
    """A choice of the mesh's own vertices, by places and normals."""
    return _chosen(mesh, most, weigh_normals=True)


def _chosen(mesh: Mesh, most: int, *, weigh_normals: bool) -> Mesh:
    package: Any = importlib.import_module("meshoptimizer")
    corners = np.ascontiguousarray(mesh.triangles.ravel(), np.uint32)
    left = np.empty_like(corners)
    told = {"target_index_count": 3 * most, "target_error": _ANY_ERROR}
    if weigh_normals:
        # Version 0.2.30 does not declare what this function of C takes, and so hands it half of its numbers.
        package.simplifier.lib.meshopt_simplifyWithAttributes.argtypes = _WITH_ATTRIBUTES
        weights = np.full(3, _NORMALS_WEIGH, np.float32)
        count = package.simplify_with_attributes(left, corners, mesh.positions, mesh.normals, weights, **told)
    else:
        count = package.simplify(left, corners, mesh.positions, **told)
    return replace(mesh, triangles=left[:count].reshape(-1, 3))


def fast_simplification(mesh: Mesh, most: int) -> Mesh:
    """New vertices. It gives them neither normals nor colours: they get those of the mesh's nearest vertex.

    Where that one looks another way than the new surface, they get the normal of the new surface.
    """
    package: Any = importlib.import_module("fast_simplification")
    places, triangles = package.simplify(mesh.positions, mesh.triangles.astype(np.int64), target_count=most)
    places, triangles = places.astype(np.float32), triangles.astype(np.uint32)
    _, nearest = KDTree(mesh.positions).query(places)
    own = smooth_normals(places, triangles, np.arange(len(places), dtype=np.uint32))
    borrowed = mesh.normals[nearest]
    agrees = (own * borrowed).sum(axis=1, keepdims=True) > _AGREES
    return Mesh(
        mesh.path, places, triangles, np.where(agrees, borrowed, own).astype(np.float32), mesh.colours[nearest],
        mesh.uv[nearest], mesh.layers[nearest], mesh.textures,
    )  # fmt: skip


PEERS: dict[str, Callable[[Mesh, int], Mesh]] = {
    "meshoptimizer": meshoptimizer,
    "meshoptimizer, normals": meshoptimizer_with_normals,
    "fast-simplification": fast_simplification,
}
"""Each makes of a mesh one of so many triangles at most."""
