"""Triangulations of a rectangle of posts, from coarse to fine (Garland, Heckbert 1995), with borders that join."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain import border_kernels, delaunay_kernels, tin_kernels
from limen.data.terrain.border_kernels import Border
from limen.data.terrain.delaunay_kernels import TRIANGLES, VERTICES, DelaunayMesh
from limen.errors import InputError

__all__ = ["LARGEST", "Growth", "Tin", "grow"]

LARGEST = 8192
"""Posts along a side at most: up to here every geometric predicate is exact."""

_FIRST_ROOM = 1 << 14


class Tin(NamedTuple):
    """One step: a triangulation of all posts, counter-clockwise from above; see `limen.data.terrain.model.Patch`."""

    posts: NDArray[np.int32]  # (V, 2): column and row, from 0
    core: NDArray[np.int32]  # (T, 3)
    rims: NDArray[np.int32]  # (R, 3): apex, and the ends of its edge on the border
    rim_side: NDArray[np.uint8]  # (R,)
    sides: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
    error_m: float


class Growth(NamedTuple):
    """What a greedy run came to: a triangulation for every step done, and all vertices that it had chosen by then."""

    tins: list[Tin]
    posts: NDArray[np.int32]  # (V, 2)


def _check_heights(heights_m: NDArray[np.float32], void: NDArray[np.bool_] | None) -> None:
    """Raises InputError where heights cannot be triangulated."""
    if heights_m.ndim != 2 or min(heights_m.shape) < 2 or max(heights_m.shape) > LARGEST:
        raise InputError(f"heights_m: shape {heights_m.shape}; give 2 to {LARGEST} rows and columns of posts")
    if heights_m.dtype != np.float32:
        raise InputError(f"heights_m: {heights_m.dtype}; give float32")
    if not np.isfinite(heights_m).all():
        raise InputError("heights_m: not all finite; fill the posts without data and name them in void")
    if void is not None and void.shape != heights_m.shape:
        raise InputError(f"void: shape {void.shape}; give that of heights_m, {heights_m.shape}")


def _checked_errors(errors_m: Sequence[float]) -> list[float]:
    """A ladder of errors; raises InputError where it does not descend."""
    errors = [float(error_m) for error_m in errors_m]
    if not errors or not all(np.isfinite(errors)) or errors[-1] < 0.0:
        raise InputError("errors_m: give at least one error in metres, and none below 0")
    if any(finer > coarser for coarser, finer in pairwise(errors)):
        raise InputError("errors_m: give the errors in descending order")
    return errors


def _new_mesh(triangles: int, vertices: int, taken: NDArray[np.bool_]) -> DelaunayMesh:
    return DelaunayMesh(
        np.empty((vertices, 3), np.int32),
        np.empty((3 * triangles, 2), np.int32),
        np.empty(triangles),
        np.empty(triangles, np.bool_),
        np.empty((triangles, 2), np.int32),
        np.empty(triangles, np.int32),
        np.empty(triangles + 4, np.int32),
        taken,
        np.zeros(3, np.int64),
    )


def _grown(mesh: DelaunayMesh, triangles: int, vertices: int) -> DelaunayMesh:
    """The same with more room; what is unused may be anything."""
    bigger = _new_mesh(triangles, vertices, mesh.taken)
    for name in DelaunayMesh._fields:
        old: NDArray[np.generic] = getattr(mesh, name)
        getattr(bigger, name)[: len(old)] = old
    return bigger


def _new_border(heights_m: NDArray[np.float32]) -> Border:
    sides = (heights_m[0], heights_m[:, -1], heights_m[-1], heights_m[:, 0])
    shape = 4, max(heights_m.shape)
    profiles = np.zeros(shape)
    for profile, side in zip(profiles, sides, strict=True):
        profile[: len(side)] = side
    border = Border(
        np.array([len(side) for side in sides]),
        profiles,
        np.zeros(shape),
        np.zeros(shape),
        np.zeros(shape),
        np.full(shape, -1, np.int32),
    )
    border_kernels.begin_border(border)
    return border


class _Run:
    """The state of one greedy run."""

    def __init__(self, heights_m: NDArray[np.float32], void: NDArray[np.bool_] | None) -> None:
        self.heights_m = heights_m
        # A distance from NaN is larger than nothing: posts without data are never the worst.
        self.truth_m = np.where(void, np.float32(np.nan), heights_m) if void is not None and void.any() else heights_m
        self.border = _new_border(heights_m)
        rows, columns = heights_m.shape
        self.limits = 2 * (rows - 1) * (columns - 1), rows * columns
        triangles, vertices = (min(_FIRST_ROOM, limit) + 4 for limit in self.limits)
        self.mesh = _new_mesh(triangles, vertices, np.zeros(heights_m.shape, np.bool_))
        delaunay_kernels.start(self.mesh, columns, rows)

    def _make_room(self, vertices: int) -> None:
        """For this many more vertices, and at least half as much again."""
        triangles, points = len(self.mesh.worst), len(self.mesh.points)
        max_triangles, most_points = (limit + 4 for limit in self.limits)
        triangles = max(triangles * 3 // 2, int(self.mesh.counts[TRIANGLES]) + 2 * vertices + 2)
        points = max(points * 3 // 2, int(self.mesh.counts[VERTICES]) + vertices)
        self.mesh = _grown(self.mesh, min(triangles, max_triangles), min(points, most_points))

    def seed(self, posts: NDArray[np.int32]) -> None:
        done = 0
        while done < len(posts):
            done = tin_kernels.seed(self.mesh, posts, done)
            if done < len(posts):
                self._make_room(len(posts) - done)

    def split_borders(self, error_m: float) -> None:
        for side in range(4):
            border_kernels.split_side(self.border, side, error_m)
            chosen = int(np.count_nonzero(self.border.vertex[side] < -1))
            vertices, triangles = self.mesh.counts[VERTICES] + chosen, self.mesh.counts[TRIANGLES] + chosen
            if triangles > len(self.mesh.worst) or vertices > len(self.mesh.points):
                self._make_room(chosen)
            border_kernels.insert_chosen(self.mesh, self.border, side)

    def improve(self, error_m: float, max_triangles: int) -> bool:
        """Whether no place is worse than ``error_m``; False if that takes more triangles than allowed."""
        while True:
            end = tin_kernels.improve(self.mesh, self.border, self.heights_m, self.truth_m, error_m, max_triangles)
            if end != tin_kernels.FULL:
                return bool(end == tin_kernels.DONE)
            self._make_room(1)

    @property
    def posts(self) -> NDArray[np.int32]:
        return self.mesh.points[: self.mesh.counts[VERTICES], :2].copy()

    def tin(self) -> Tin:
        triangles = int(self.mesh.counts[TRIANGLES])
        core, rims = np.empty((2, triangles, 3), np.int32)
        rim_side = np.empty(triangles, np.uint8)
        inner, outer = tin_kernels.extract(self.mesh, core, rims, rim_side)
        top, right, bottom, left = (side[side >= 0] for side in self.border.vertex)
        error_m = max(tin_kernels.worst_of_all(self.mesh), border_kernels.thickest(self.border))
        return Tin(
            self.posts,
            core[:inner].copy(),
            rims[:outer].copy(),
            rim_side[:outer].copy(),
            (top, right, bottom, left),
            error_m,
        )


def grow(
    heights_m: NDArray[np.float32],
    void: NDArray[np.bool_] | None,
    errors_m: Sequence[float],
    max_triangles: int | None = None,
    seeds: NDArray[np.int32] | None = None,
) -> Growth:
    """Triangulate a rectangle of posts at descending errors, by one greedy run (Garland, Heckbert 1995, algorithm IV).

    Every step keeps the vertices of the one before and inserts the post that is farthest off until none is too far, and
    then posts beside the worst places between posts until all of the surface is near enough. The surface is that of all
    posts, see `limen.data.terrain.model`; the triangulation is Delaunay's. Borders are simplified on their own, from
    their posts alone, until triangles beside them need more.

    Parameters
    ----------
    heights_m
        Posts (rows, columns), at least 2 x 2 and at most `LARGEST` a side, voids filled.
    void
        True where a post has no data: it counts as no error, and nor do places between it and its neighbours. None if
        all have.
    errors_m
        Vertical errors in metres, descending, at least one.
    max_triangles
        Stop before the first step that would have more; the first step is always kept.
    seeds
        Inner posts (S, 2) to begin with as vertices.

    Returns
    -------
    Growth
        A triangulation for each step done; a step that needs no more vertices than the one before is the same object.
        The ``error_m`` of a step is at most its entry in ``errors_m``, and exceeded nowhere, at posts or between them,
        whatever posts are added to borders.

    Raises
    ------
    InputError
        For heights or errors that cannot be worked with.
    """
    _check_heights(heights_m, void)
    errors_m = _checked_errors(errors_m)
    run = _Run(heights_m, void)
    if seeds is not None:
        run.seed(seeds)
    tins: list[Tin] = []
    for error_m in errors_m:
        if tins and tins[-1].error_m <= error_m:
            tins.append(tins[-1])
            continue
        run.split_borders(error_m)
        most = max_triangles if max_triangles is not None and tins else run.limits[0]
        if not run.improve(error_m, most):
            break
        tins.append(run.tin())
    return Growth(tins, run.posts)
