"""The triangles along the borders of a terrain's patches, so that patches of any fineness meet without a crack.

A rim is a triangle with one edge on its patch's border. Where the patch on the other side has vertices on that edge,
the rim is cut into a fan about its apex; both sides do so, and the border has the vertices of both. The patches were
built so that they keep their error with any such vertices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import SIDES, Patch
from limen.errors import InputError
from limen.layers.terrain import border_kernels as kernels
from limen.stream.ranges import RangeAllocator

__all__ = ["BorderPool", "Fans"]


class Fans(NamedTuple):
    """Triangles along borders. Those of panel ``p`` are ``panel_first[p]`` up to ``panel_first[p + 1]``."""

    triangles: NDArray[np.uint32]  # (T, 3): vertex numbers, turning as the rims do
    panel_first: NDArray[np.int64]  # (N + 1,)


class BorderPool:
    """What is known of the borders of all resident patches, ready to be met with any of the others.

    Rims lie side by side, six numbers each: apex, the end that comes first along the border, the other end, how far
    along both are, and whether the triangle turns from the second to the first. Border vertices: how far along, and
    which vertex. ``first_vertex`` is added to every vertex, so that all refer to one large buffer.
    """

    def __init__(self) -> None:
        self._slot_of = np.full(0, -1, dtype=np.int32)
        self._slots, self._rims, self._border = _Rows(kernels.SLOT_COLUMNS), _Rows(6), _Rows(2)

    def __contains__(self, patch_number: int) -> bool:
        return 0 <= patch_number < len(self._slot_of) and bool(self._slot_of[patch_number] >= 0)

    def __len__(self) -> int:
        return int((self._slot_of >= 0).sum())

    @property
    def nbytes(self) -> int:
        """Memory of the pool's arrays."""
        return self._slot_of.nbytes + sum(kept.rows.nbytes for kept in (self._slots, self._rims, self._border))

    def add(self, patch_number: int, patch: Patch, first_vertex: int) -> None:
        """A patch has become resident; its vertices begin at ``first_vertex`` of the vertex buffer.

        Raises
        ------
        InputError
            If it is in the pool already.
        """
        if patch_number in self:
            raise InputError(f"patch {patch_number} is in the pool already: remove it before it is added again")
        rims, rim_counts = _rims_of(patch, first_vertex)
        border, border_counts = _border_of(patch, first_vertex)
        self._slot_of = _grown(self._slot_of, patch_number + 1, -1)
        row = np.concatenate([
            self._rims.put(rims) + np.concatenate([[0], np.cumsum(rim_counts)]),
            self._border.put(border) + np.concatenate([[0], np.cumsum(border_counts)]),
            [patch.posts[side[0], 1 - number % 2] for number, side in enumerate(patch.sides)],
        ])  # fmt: skip
        self._slot_of[patch_number] = self._slots.put(row[None])

    def remove(self, patch_number: int) -> None:
        """A patch is no longer resident; KeyError if it never was."""
        if patch_number not in self:
            raise KeyError(patch_number)
        slot = int(self._slot_of[patch_number])
        row = self._slots.rows[slot]
        self._rims.drop(int(row[kernels.RIM_FIRST]))
        self._border.drop(int(row[kernels.BORDER_FIRST]))
        self._slots.drop(slot)
        self._slot_of[patch_number] = -1

    def fans(self, pair_panel: NDArray[np.int64], pair_patch: NDArray[np.int64], panels: int) -> Fans:
        """The rims of every panel's patches, each cut up by the vertices of those that it meets on the same panel.

        Parameters
        ----------
        pair_panel, pair_patch
            Which patch is drawn on which panel, sorted by panel, shape (M,) each; those of one panel do not overlap.
        panels
            How many panels there are.

        Raises
        ------
        KeyError
            If a patch is not in the pool.
        """
        known = np.append(self._slot_of, -1)[np.minimum(pair_patch, len(self._slot_of))]
        if (known < 0).any():
            raise KeyError(int(pair_patch[np.flatnonzero(known < 0)[0]]))
        triangles = np.empty((_most(self._slots.rows[known]), 3), dtype=np.uint32)
        panel_first = np.zeros(panels + 1, dtype=np.int64)
        pair_first = np.searchsorted(pair_panel, np.arange(panels + 1))
        pools = self._slots.rows, self._rims.rows, self._border.rows
        count = kernels.fan_rims(pair_first, known, *pools, triangles, panel_first)
        return Fans(triangles[:count], panel_first)


class _Rows:
    """Rows of whole numbers that come and go in one array, which grows where no free range is long enough."""

    def __init__(self, columns: int) -> None:
        self._arena = RangeAllocator(256)
        self.rows = np.zeros((self._arena.capacity, columns), dtype=np.int32)

    @property
    def free(self) -> bool:
        """Whether nothing is kept."""
        return self._arena.free == self._arena.capacity

    def put(self, rows: NDArray[np.int64]) -> int:
        """Where the rows begin; no rows have a place of their own too, so that every place can be given back."""
        size = max(len(rows), 1)
        begin = self._arena.take(size)
        if begin is None:
            self._arena.grow(2 * self._arena.capacity + size)
            self.rows = _grown(self.rows, self._arena.capacity)
            begin = self._arena.take(size)
            assert begin is not None
        self.rows[begin : begin + len(rows)] = rows
        return begin

    def drop(self, begin: int) -> None:
        self._arena.give_back(begin)


def _most(rows: NDArray[np.int32]) -> int:
    """How many triangles there can be: a border vertex cuts at most one rim, on the other side of its border."""
    rims = rows[:, kernels.BORDER_FIRST - 1] - rows[:, kernels.RIM_FIRST]
    border = rows[:, kernels.LINE - 1] - rows[:, kernels.BORDER_FIRST]
    return int(rims.sum(dtype=np.int64) + border.sum(dtype=np.int64))


def _rims_of(patch: Patch, first_vertex: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """A patch's rims as the pool keeps them, side by side and in order along each; how many each side has."""
    side = patch.rim_side.astype(np.int64)
    corner = patch.rims.astype(np.int64)
    along = patch.posts[corner[:, 1:], (side % 2)[:, None]].astype(np.int64)
    turned = along[:, 0] > along[:, 1]
    ends = np.where(turned[:, None], corner[:, :0:-1], corner[:, 1:])
    along = np.sort(along, axis=1)
    rims = np.column_stack([corner[:, 0] + first_vertex, ends + first_vertex, along, turned])
    return rims[np.lexsort((along[:, 0], side))], np.bincount(side, minlength=len(SIDES))


def _border_of(patch: Patch, first_vertex: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """A patch's border vertices as the pool keeps them, side by side; how many each side has."""
    parts = [
        np.column_stack([patch.posts[side, number % 2], side.astype(np.int64) + first_vertex])
        for number, side in enumerate(patch.sides)
    ]
    return np.concatenate(parts), np.array([len(part) for part in parts])


def _grown(values: NDArray[np.int32], length: int, fill: int = 0) -> NDArray[np.int32]:
    """The same array, or a copy at least twice as long if it is too short."""
    if length <= len(values):
        return values
    grown = np.full((max(length, 2 * len(values)), *values.shape[1:]), fill, dtype=np.int32)
    grown[: len(values)] = values
    return grown
