"""Other ways to triangulate a terrain at a wanted error: Delatin, Martini, and chunks of decimated grids.

References
----------
Garland, Heckbert 1995, *Fast Polygonal Approximation of Terrains and Height Fields* (Delatin, greedy insertion).
Evans, Kirkpatrick, Townsend 2001, *Right-Triangulated Irregular Networks* (Martini).
Ulrich 2002, *Rendering Massive Terrains using Chunked Level of Detail Control* (chunks).
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from limen.errors import InputError
from limen.geometry import Floats
from limen.study.triangulations import Posts, Triangles, residuals_m, true_error_m

__all__ = ["PEERS", "Made", "grid_triangles"]

_CHUNKS = (16, 32, 64, 128)
"""Posts from border to border of a chunk: what serves the grid best is taken."""

_EXACTLY = 0.005
_TRIES = 20


class Made(NamedTuple):
    triangles: int
    true_error_m: float
    build_s: float


def delatin(posts: Posts) -> Callable[[float], Made]:
    """Pydelatin, told the error that is wanted; its errors are bounds."""
    package: Any = importlib.import_module("pydelatin")
    rows, columns = posts.heights_m.shape

    def make(error_m: float) -> Made:
        begin = time.process_time()
        mesh = package.Delatin(posts.heights_m, max_error=error_m)
        build_s = time.process_time() - begin
        vertices = np.asarray(mesh.vertices).reshape(-1, 3)
        column, row = vertices[:, 0].astype(np.int32), rows - 1 - vertices[:, 1].astype(np.int32)  # its y goes up
        triangles = (row * np.int32(columns) + column)[np.asarray(mesh.triangles).reshape(-1, 3)]
        return Made(len(triangles), true_error_m(posts, triangles), build_s)

    return make


def martini(posts: Posts) -> Callable[[float], Made]:
    """Pymartini with the largest parameter that leads to the true error wanted: its own errors are no bounds.

    Raises
    ------
    InputError
        If there are not 2^n + 1 rows and as many columns.
    """
    rows, columns = posts.heights_m.shape
    if rows != columns or (rows - 1) & (rows - 2):
        raise InputError(f"martini takes 2^n + 1 rows and columns, and not {rows} and {columns}")
    package: Any = importlib.import_module("pymartini")
    begin = time.process_time()
    tile = package.Martini(columns).create_tile(posts.heights_m)
    map_s = time.process_time() - begin

    def mesh(parameter_m: float) -> Made:
        begin = time.process_time()
        vertices, indices = tile.get_mesh(parameter_m)
        build_s = map_s + time.process_time() - begin
        at = np.asarray(vertices).reshape(-1, 2).astype(np.int32)
        triangles = (at[:, 1] * np.int32(columns) + at[:, 0])[np.asarray(indices).reshape(-1, 3)]
        return Made(len(triangles), true_error_m(posts, triangles), build_s)

    return lambda error_m: _largest_parameter(mesh, error_m)


def _largest_parameter(mesh: Callable[[float], Made], error_m: float) -> Made:
    """The coarsest that was found to keep a true error, by bisection of a parameter that is about that error."""
    low_m, high_m = 0.0, error_m
    kept = mesh(high_m)
    if kept.true_error_m <= error_m:
        return kept  # it stays on the safe side: what it was told would have been enough
    best: Made | None = None
    for _ in range(_TRIES):
        middle_m = (low_m + high_m) / 2
        made = mesh(middle_m)
        if made.true_error_m <= error_m:
            low_m = middle_m
            best = made if best is None or made.triangles < best.triangles else best
        else:
            high_m = middle_m
        if best and (high_m - low_m <= _EXACTLY * error_m or best.true_error_m >= (1 - _EXACTLY) * error_m):
            break
    return best or mesh(0.0)


def grid(posts: Posts) -> Callable[[float], Made]:
    """Chunks of one size, each with every 2^k-th post, as few as keep the error; the size that serves best.

    Neighbours of different fineness leave cracks, which skirts or stitches would have to close: these are not counted.
    """
    begin = time.process_time()
    found = {chunk: list(_steps(posts, chunk)) for chunk in _CHUNKS}
    build_s = (time.process_time() - begin) / len(found)

    def make(error_m: float) -> Made:
        return min((_coarsest(found[chunk], error_m, build_s) for chunk in found), key=lambda made: made.triangles)

    return make


class _Step(NamedTuple):
    """Every chunk with every 2^k-th post."""

    errors_m: Floats  # (rows, columns) of chunks
    triangles: Floats  # likewise


def _steps(posts: Posts, chunk: int) -> Iterator[_Step]:
    size = posts.heights_m.shape
    step = 1
    while step <= chunk:
        triangles, per_chunk = grid_triangles(size, step, chunk)
        if step == 1:
            errors_m = np.zeros(per_chunk.shape)
        else:
            errors_m = _largest_in_chunks(np.abs(residuals_m(posts, triangles)), chunk)
        yield _Step(errors_m, per_chunk)
        step *= 2


def grid_triangles(size: tuple[int, int], step: int, chunk: int) -> tuple[Triangles, Floats]:
    """Two triangles for every four of each step-th post (and the last), and how many each chunk has.

    Parameters
    ----------
    size
        Rows and columns of posts.
    """
    row, column = (np.unique(np.append(np.arange(0, count - 1, step), count - 1)).astype(np.int32) for count in size)
    number = row[:, None] * np.int32(size[1]) + column
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.stack([a, d, c, a, c, b], axis=-1).reshape(-1, 3)
    rows, columns = (np.bincount(at[:-1] // chunk).astype(np.float64) for at in (row, column))
    return np.asarray(triangles, np.int32), 2 * rows[:, None] * columns


def _largest_in_chunks(values: Floats, chunk: int) -> Floats:
    """The largest value of every chunk, the posts that it shares with its neighbours included."""
    for axis in (0, 1):
        count = values.shape[axis]
        firsts = np.arange(0, count - 1, chunk)
        inner = np.maximum.reduceat(values, firsts, axis=axis)
        shared = values.take(np.minimum(firsts + chunk, count - 1), axis=axis)
        values = np.maximum(inner, shared)
    return values


def _coarsest(steps: list[_Step], error_m: float, build_s: float) -> Made:
    """Every chunk's fewest triangles that keep an error."""
    chosen = steps[0]
    for step in steps[1:]:
        keeps = (step.errors_m <= error_m) & (step.triangles < chosen.triangles)
        chosen = _Step(
            np.where(keeps, step.errors_m, chosen.errors_m), np.where(keeps, step.triangles, chosen.triangles)
        )
    return Made(int(chosen.triangles.sum()), float(chosen.errors_m.max()), build_s)


PEERS: dict[str, Callable[[Posts], Callable[[float], Made]]] = {"delatin": delatin, "martini": martini, "grid": grid}
"""What is compared with limen: each is told the terrain once, and the errors wanted one by one."""
