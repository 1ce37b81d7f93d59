"""Triangles with normals, colours and textures: what a three-dimensional scene is made of.

Arrays are as a graphics adapter reads them; a mesh that moves is one :meth:`Mesh.deformed` a frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data.store.report import Description, amount, spans
from limen.errors import FormatError

__all__ = ["NO_TEXTURE", "Mesh", "MeshInfo", "smooth_normals", "weld_numbers"]

NO_TEXTURE = 0xFFFF_FFFF
"""Layer of a vertex that has a colour alone."""

_UNIT_WITHIN = 1e-3

_LAYOUT: dict[str, tuple[Any, tuple[str | int, ...]]] = {
    "positions": (np.float32, ("V", 3)),
    "triangles": (np.uint32, ("T", 3)),
    "normals": (np.float32, ("V", 3)),
    "colours": (np.uint8, ("V", 4)),
    "uv": (np.float32, ("V", 2)),
    "layers": (np.uint32, ("V",)),
    "textures": (np.uint8, ("L", "H", "W", 4)),
    "welds": (np.uint32, ("V",)),
}


class MeshInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What ``limen info`` says about a mesh; lengths are in the file's own unit."""

    kind: str = "mesh"
    path: str
    size: int
    """Triangles."""
    levels: list[int]
    """Triangles of each level of detail: one."""
    vertices: int
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    """Smallest and largest coordinates."""
    textures: int
    texture_px: tuple[int, int] | None
    """Width and height, the same of all."""
    bytes: int
    """Of the arrays in memory."""

    def described(self) -> Description:
        width, height = self.texture_px or (0, 0)
        textures = (
            f"{self.textures}, kept as {width} x {height} texels" if self.textures else "none; colours of vertices"
        )
        return Description(
            f"{amount(self.bytes)} in memory",
            {"size": f"{self.size:,} triangles, {self.vertices:,} vertices"}
            | spans(self.bounds, 6, "the file's unit")
            | {"textures": textures},
        )


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with smooth normals, colours and textures.

    Triangles of no area are kept: they cover no pixel, and a deformation may open them.

    Parameters
    ----------
    path
        The file it came from; None if it was made.
    positions
        float32 (V, 3), in the file's own unit and axes.
    triangles
        uint32 (T, 3), corners as indices of vertices, counter-clockwise seen from outside.
    normals
        float32 (V, 3), unit vectors.
    colours
        uint8 (V, 4), sRGB and opacity; multiplies the texture in linear light where there is one.
    uv
        float32 (V, 2), place in the texture: right and down, 0 is the outer edge of its first column and row.
    layers
        uint32 (V,), which texture, or `NO_TEXTURE`; the same at the three corners of a triangle.
    textures
        uint8 (L, H, W, 4), sRGB and opacity, all of one size; L may be 0.
    welds
        uint32 (V,), the number of a vertex; those with the same number share their normal when the mesh is deformed,
        as where a texture's seam cuts one place apart. None finds those that share place and normal.

    Raises
    ------
    FormatError
        If the arrays do not fit together, hold numbers that are not finite, or a corner or layer that is not there;
        the message names the array, how many there are and the first.
    """

    path: Path | None
    positions: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    uv: NDArray[np.float32]
    layers: NDArray[np.uint32]
    textures: NDArray[np.uint8]
    welds: NDArray[np.uint32] | None = None

    kind: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        try:
            self._check()
        except ValueError as error:
            raise FormatError(f"{self.path or 'mesh'}: {error}") from None

    def _check(self) -> None:
        sizes: dict[str, int] = {}
        for name, (dtype, shape) in _LAYOUT.items():
            if name == "welds" and self.welds is None:
                continue
            array = np.ascontiguousarray(getattr(self, name), dtype)
            _check_shape(name, array, shape, sizes)
            if array.dtype.kind == "f":
                _check_finite(name, array)
            object.__setattr__(self, name, array)
        if not len(self.triangles):
            raise ValueError("it has no triangles: a point cloud is no mesh; make a surface of it first")
        _check_below("triangles", self.triangles, len(self.positions), "vertices")
        if self.welds is not None:
            _check_below("welds", self.welds, len(self.positions), "vertices")
        _check_below("layers", self.layers[self.layers != NO_TEXTURE], len(self.textures), "textures")
        corners = self.layers[self.triangles]
        if (corners != corners[:, :1]).any():
            first = int(np.argmax((corners != corners[:, :1]).any(axis=1)))
            raise ValueError(f"triangle {first} has corners of several textures; split its vertices")
        squared = np.einsum("ij,ij->i", self.normals, self.normals)
        off = np.abs(squared - 1.0) > _UNIT_WITHIN
        if off.any():
            raise ValueError(f"{int(off.sum())} of its normals have no unit length, the first is {int(np.argmax(off))}")

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Smallest and largest coordinates of the vertices that triangles use, shape (2, 3)."""
        used = self.positions[self.triangles.ravel()]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def size(self) -> int:
        """Triangles."""
        return len(self.triangles)

    @property
    def nbytes(self) -> int:
        return sum(getattr(self, name).nbytes for name in _LAYOUT if getattr(self, name) is not None)

    def deformed(self, positions: NDArray[np.float32]) -> Mesh:
        """The same mesh with its vertices elsewhere, (V, 3), and normals computed anew.

        About 2 ms for 70,000 triangles; what does not change is shared, not copied.

        Raises
        ------
        FormatError
            If a position is not finite or their number is another.
        """
        positions = np.ascontiguousarray(positions, np.float32)
        if positions.shape != self.positions.shape:
            raise FormatError(f"{self.path or 'mesh'}: {positions.shape} positions cannot move {self.positions.shape}")
        welds = weld_numbers(self.positions, self.normals) if self.welds is None else self.welds
        normals = smooth_normals(positions, self.triangles, welds)
        return replace(self, positions=positions, normals=normals, welds=welds)

    def info(self) -> MeshInfo:
        low, high = self.bounds.astype(float).tolist()
        layers, height, width, _ = self.textures.shape
        return MeshInfo(
            path=str(self.path or ""),
            size=self.size,
            levels=[self.size],
            vertices=len(self.positions),
            bounds=(tuple(low), tuple(high)),
            textures=layers,
            texture_px=(width, height) if layers else None,
            bytes=self.nbytes,
        )


def smooth_normals(
    positions: NDArray[np.float32], triangles: NDArray[np.uint32], welds: NDArray[np.uint32]
) -> NDArray[np.float32]:
    """Unit normals (V, 3): the mean of the triangles around a vertex, weighted by their area.

    Vertices that ``welds`` (V,) gives the same number count as one. Where no triangle has an area, +z.
    """
    from limen.data.mesh.normal_kernels import sum_normals

    normals = np.empty_like(positions)
    sum_normals(positions, triangles, welds, normals)
    return normals


def weld_numbers(*keys: NDArray[Any]) -> NDArray[np.uint32]:
    """For each row the number of one row that equals it in all ``keys``, each (V, n): shape (V,)."""
    columns = np.concatenate([np.asarray(key, np.float32) + np.float32(0) for key in keys], axis=1)  # -0 becomes 0
    order = np.lexsort(columns.T)
    ordered = columns[order]
    starts = np.ones(len(order), bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    firsts = order[starts]
    numbers = np.empty(len(order), np.uint32)
    numbers[order] = firsts[np.cumsum(starts) - 1]
    return numbers


def _check_shape(name: str, array: NDArray[Any], shape: tuple[str | int, ...], sizes: dict[str, int]) -> None:
    """Letters stand for sizes that must agree between arrays; ``sizes`` collects them."""
    fits = array.ndim == len(shape)
    if fits:
        wanted = [sizes.setdefault(n, m) if isinstance(n, str) else n for n, m in zip(shape, array.shape, strict=True)]
        fits = list(array.shape) == wanted
    if not fits:
        stated = tuple(sizes.get(n, n) if isinstance(n, str) else n for n in shape)
        raise ValueError(f"{name} must have the shape {stated}, got {array.shape}")


def _check_finite(name: str, array: NDArray[Any]) -> None:
    if not np.isfinite(array).all():
        bad = ~np.isfinite(array).all(axis=1)
        raise ValueError(
            f"{int(bad.sum())} of its {len(bad)} {name} hold numbers that are not finite, the first is vertex "
            f"{int(np.argmax(bad))}; repair the file"
        )


def _check_below(name: str, numbers: NDArray[np.uint32], count: int, what: str) -> None:
    if numbers.size and int(numbers.max()) >= count:
        rows = numbers.reshape(len(numbers), -1)
        first = int(np.argmax((rows >= count).any(axis=1)))
        raise ValueError(f"row {first} of its {name} names {int(rows[first].max())}, but there are {count} {what}")
