"""Through which holes of a surface an eye sees its back.

Whoever looks into a closed surface has to look through its hull, so nobody sees it from behind. A surface with holes is
seen from behind only through those that the eye is before, and there only within the cone that holds the hole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.node_kernels import first_at_places
from limen.data.mesh.vertex_tree import VertexTree
from limen.geometry import Floats

__all__ = ["HoleCovers", "covers_of", "visible_holes"]

_EVERYWHERE: Floats = np.array([[0.0, 0.0, 1.0, np.pi]])


class HoleCovers(NamedTuple):
    """What would close the holes of a surface: fans of triangles around the middles of H loops of border edges."""

    planes: Floats  # (F, 4), of the fans' triangles, turned outwards
    hole: NDArray[np.int64]  # (F,), which hole each belongs to
    spheres: Floats  # (H, 4): middle and radius of what holds each loop


def visible_holes(covers: HoleCovers | None, eye_in_mesh: Floats) -> Floats:
    """Cones in which an eye may see a surface from behind, (K, 4): unit way from the eye, half angle in radians.

    An eye is before a hole if it is before any triangle of the fan that would close it.

    Parameters
    ----------
    covers
        Of `covers_of`.
    eye_in_mesh
        (3,), in the mesh's coordinates.
    """
    if covers is None:
        return _EVERYWHERE
    seen = np.unique(covers.hole[covers.planes @ np.append(eye_in_mesh, 1.0) > 0])
    way = covers.spheres[seen, :3] - eye_in_mesh
    radius, far = covers.spheres[seen, 3], np.linalg.norm(way, axis=1)
    if (far <= radius).any():
        return _EVERYWHERE
    return np.concatenate([way / far[:, None], np.arcsin(radius / far)[:, None]], axis=1)


def covers_of(tree: VertexTree) -> HoleCovers | None:
    """What would close the loops of a mesh's border edges; vertices of one place count as one.

    None where edges have more than two triangles or are turned against each other.
    """
    own = tree.position[: tree.vertices]
    corners = first_at_places(own)[tree.triangles].astype(np.int64)
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    begin, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    # An edge as one number, the last bit of which tells its direction: sorted, those of two triangles lie side by side.
    edges = 2 * (np.minimum(begin, end) * len(own) + np.maximum(begin, end)) + (begin > end)
    edges.sort()
    again = edges[1:] >> 1 == edges[:-1] >> 1
    if (again[1:] & again[:-1]).any() or (edges[1:] == edges[:-1]).any():
        return None
    border = edges[~(np.append(again, False) | np.insert(again, 0, False))]
    low, high = np.divmod(border >> 1, len(own))
    turned = border & 1 == 0  # a cover runs the other way around
    ways = np.stack([np.where(turned, high, low), np.where(turned, low, high)], axis=1)
    follows: dict[int, int] = dict(ways.tolist())
    if len(follows) < len(border):
        return None  # two loops touch
    loops, pending = [], set(follows)
    while pending:
        loop = [pending.pop()]
        while (after := follows[loop[-1]]) != loop[0]:
            if after not in pending:
                return None
            pending.remove(after)
            loop.append(after)
        loops.append(own[loop].astype(float))
    fans = [_fan(ring) for ring in loops]
    middles = [ring.mean(axis=0) for ring in loops]
    return HoleCovers(
        np.concatenate([np.zeros((0, 4)), *fans]),
        np.repeat(np.arange(len(fans)), [len(fan) for fan in fans]),
        np.array([[*m, np.linalg.norm(ring - m, axis=1).max()] for m, ring in zip(middles, loops, strict=True)])
        .reshape(-1, 4),
    )  # fmt: skip


def _fan(ring: Floats) -> Floats:
    """Planes of the triangles between a loop and its middle, less those that are turned against their sum."""
    middle = ring.mean(axis=0)
    normals = np.cross(ring - middle, np.roll(ring, -1, axis=0) - middle)
    outward = normals[normals @ normals.sum(axis=0) > 0]
    return np.concatenate([outward, -(outward @ middle)[:, None]], axis=1)
