"""Points, directions and rays in the room frame: metres, right-handed, y up."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Floats", "Vec3", "as_vec3", "cross", "dot", "length", "normalised", "signed_area"]

Vec3: TypeAlias = tuple[float, float, float]
Floats: TypeAlias = NDArray[np.float64]

_UNIT = 4 * 2.0**-52
"""A vector that was divided by its length is no further from 1 than by rounding."""


def as_vec3(values: Iterable[float], what: str) -> Vec3:
    """Three finite numbers as a tuple.

    Raises
    ------
    ValueError
        If there are not three, or one of them is not finite; ``what`` names the quantity.
    """
    vector = tuple(float(value) for value in values)
    if len(vector) != 3 or not all(math.isfinite(value) for value in vector):
        raise ValueError(f"{what} must be three finite numbers, got {vector}")
    return vector


def dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a: Vec3) -> float:
    return math.sqrt(dot(a, a))


def normalised(a: Vec3, what: str) -> Vec3:
    """The unit vector along ``a``; one that is a unit vector stays what it is to the last bit.

    Raises
    ------
    ValueError
        If ``a`` has no length; ``what`` names the quantity.
    """
    size = length(a)
    if size < 1e-12:
        raise ValueError(f"{what} must not be the zero vector")
    if abs(size - 1) < _UNIT:  # what was sent as a message must come back equal
        return a
    return (a[0] / size, a[1] / size, a[2] / size)


def signed_area(corners: Floats) -> float:
    """Area of a plane polygon, shape (K, 2): positive where x turns toward y (clockwise if y points down).

    >>> signed_area(np.array([[0, 0], [2, 0], [2, 1], [0, 1]]))
    2.0
    """
    x, y = np.asarray(corners, dtype=float).T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1] + x[-1] * y[0] - x[0] * y[-1]) / 2
