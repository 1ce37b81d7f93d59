"""WGSL structs from NumPy dtypes, so that a layout is written down once.

A field of shape (2,), (3,) or (4,) is a vector, a field of shape (n, 4) an array of vectors. The rules
(WGSL 13.4, *Memory layout*) that matter here: a scalar is aligned to 4 bytes, ``vec2`` to 8, ``vec3`` and
``vec4`` to 16, a struct and its size to its largest member.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["check_layout", "wgsl_struct"]

_SCALARS = {"f4": "f32", "i4": "i32", "u4": "u32"}
_ALIGNMENT = {1: 4, 2: 8, 3: 16, 4: 16}


def wgsl_struct(name: str, dtype: np.dtype[np.void]) -> str:
    """The struct as it must stand in a WGSL file.

    >>> print(wgsl_struct("Spot", np.dtype([("place_px", "<f4", 2), ("level", "<i4"), ("slot", "<u4")])))
    struct Spot {
        place_px: vec2<f32>,
        level: i32,
        slot: u32,
    }
    """
    check_layout(dtype)
    lines = [f"    {field}: {_type_of(dtype[field])}," for field in dtype.names or ()]
    return "\n".join([f"struct {name} {{", *lines, "}"])


def check_layout(dtype: np.dtype[np.void]) -> None:
    """Raises
    ------
    ValueError
        If WGSL would place a field elsewhere than NumPy does; the message names it and the padding to add.
    """
    largest = 4
    end = 0
    for name in dtype.names or ():
        assert dtype.fields is not None
        field, offset = dtype.fields[name][:2]
        alignment = _ALIGNMENT[field.shape[-1] if field.shape else 1]
        expected = -(-end // alignment) * alignment
        if offset != expected:
            raise ValueError(f"field '{name}' is at byte {offset}; WGSL places it at {expected}: add padding fields")
        end = offset + field.itemsize
        largest = max(largest, alignment)
    if dtype.itemsize % largest or dtype.itemsize != end:
        raise ValueError(
            f"the struct has {dtype.itemsize} bytes; WGSL wants a multiple of {largest}: add padding fields"
        )


def _type_of(field: np.dtype[Any]) -> str:
    scalar = _SCALARS[field.base.str.lstrip("<>|=")]
    match field.shape:
        case ():
            return scalar
        case (count,):
            return f"vec{count}<{scalar}>"
        case (length, 4):
            return f"array<vec4<{scalar}>, {length}>"
    raise ValueError(f"no WGSL type for a field of shape {field.shape}")
