"""Clouds of points made ready: in memory, or from a file of any size into a folder."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limen.data.points.contrast import Neighbourhood, ranges_of
from limen.data.points.file import Points
from limen.data.points.nodes import CHUNK_LEVEL, LEVEL_BEGIN
from limen.data.points.store import PointsHeader
from limen.data.points.tree import NEUTRAL, Chunks, Lattice, arranged, chunks_of, hilbert_order, pack_points
from limen.data.points.upper_nodes import tops_of
from limen.errors import InputError
from limen.vision.luminance import Photometry

__all__ = ["build_points", "fill_contrasts"]


def build_points(
    positions: ArrayLike,
    rgb: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    intensity: ArrayLike | None = None,
    *,
    estimate_normals: bool = True,
    unit_m: float | None = 1.0,
    photometry: Photometry | None = None,
) -> Points:
    """A cloud of points in memory.

    Parameters
    ----------
    positions
        (N, 3), at least one point.
    rgb
        (N, 3) sRGB, 0 ... 255; grey without.
    normals
        (N, 3), pointing outwards, of any length; zero where one is unknown.
    intensity
        (N,), 0 ... 255.
    estimate_normals
        Where none are given, make them of neighbours; which side is the front is then unknown (``two_sided``).
    photometry
        Of the display that contrasts are meant for; one of 100 cd/m2 that follows sRGB if not given.
    unit_m
        Metres of the positions' unit; None if nobody knows.

    Raises
    ------
    InputError
        If there are no points, positions are not finite, or the shapes do not fit.
    """
    places = np.asarray(positions, dtype=float)
    if places.ndim != 2 or places.shape[1] != 3 or not len(places):
        raise InputError(f"positions must be of shape (N, 3) with at least one point, got {places.shape}")
    if not np.isfinite(places).all():
        raise InputError(f"{(~np.isfinite(places).all(axis=1)).sum()} of {len(places)} positions are not finite")
    count = len(places)
    colours = np.full((count, 3), NEUTRAL, np.uint8) if rgb is None else _bytes("rgb", rgb, (count, 3))
    grey = None if intensity is None else _bytes("intensity", intensity, (count,))
    given = None if normals is None else np.asarray(normals, dtype=float)
    if given is not None and given.shape != places.shape:
        raise InputError(f"normals must be of shape {places.shape}, got {given.shape}")
    lattice, (least, most) = Lattice.holding(places)
    origin = (least + most) / 2
    packed = pack_points(lattice, places, colours, grey, given)
    order = hilbert_order(packed["place"])
    points, radii = arranged(packed, order, lattice.step, estimate=given is None and estimate_normals)
    two_sided = given is None
    chunks = chunks_of(points, radii, lattice, origin, two_sided)
    tops = tops_of(chunks.nodes[:, LEVEL_BEGIN[CHUNK_LEVEL]], chunks.frames, count, two_sided)
    header = PointsHeader(
        points=count,
        bounds=(_triple(least), _triple(most)),
        origin=_triple(origin),
        two_sided=two_sided,
        colours="none" if rgb is None else "given",
        normals="given" if given is not None else "estimated" if estimate_normals else "none",
        has_intensity=intensity is not None,
        unit_m=unit_m,
    )
    fill_contrasts(chunks, tops, count, photometry or Photometry.srgb())
    return Points(None, header, tops, chunks.frames, chunks.stored)


def fill_contrasts(chunks: Chunks, tops: tuple[NDArray[Any], ...], points: int, photometry: Photometry) -> None:
    """Contrasts of all inner nodes of a whole cloud of ``points`` points."""
    stored = chunks.stored
    near = Neighbourhood(
        stored, ranges_of(stored, points, photometry), chunks.frames, tops, points, photometry
    ).reader()
    chunks.nodes["contrast"][:, : LEVEL_BEGIN[0]] = near.of(0, len(stored))
    tops[0]["contrast"] = chunks.nodes["contrast"][:, LEVEL_BEGIN[CHUNK_LEVEL]]


def _bytes(name: str, given: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    values = np.asarray(given)
    if values.shape != shape or values.dtype.kind not in "iu":
        raise InputError(f"{name} must be whole numbers of shape {shape}, got {values.dtype} {values.shape}")
    if values.min() < 0 or values.max() > 255:
        raise InputError(f"{name} must lie in 0 ... 255, got {values.min()} ... {values.max()}")
    return values.astype(np.uint8)


def _triple(values: NDArray[Any]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
