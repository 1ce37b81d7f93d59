"""Pages of a terrain: relief and coded heights, level 0 from the posts block by block, then halved level by level."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.pages import GUTTER, PAGE, Level, Pyramid
from limen.data.terrain.page_kernels import halve, texels_of_posts
from limen.data.terrain.store import BLOCK, EDGE, KINDS, create_pages

__all__ = ["MARGIN", "PageWriter", "Scale"]

MARGIN = GUTTER + 1
"""Posts beyond a block that its pages ask for: gutters, and one more for their normals."""

_PAGES = BLOCK // PAGE
_WHOLE = {"relief": False, "heights": True}
"""Whether the three bytes of a texel are one number."""

Texels = NDArray[np.uint8]


class Scale(NamedTuple):
    """What posts and codes are in metres."""

    spacing_m: tuple[float, float]
    low_m: float
    high_m: float


class PageWriter:
    """Takes a terrain block by block and writes both pyramids; a context manager.

    Texels of the levels above the finest lie in nameless files in ``folder`` until all their pages are written.
    """

    def __init__(self, group: zarr.Group, pyramid: Pyramid, scale: Scale, folder: Path) -> None:
        self._pyramid, self._scale = pyramid, scale
        self._arrays = {kind: create_pages(group, kind, pyramid) for kind in KINDS}
        self._coarse = {kind: [_texels(level, folder) for level in pyramid.levels[1:]] for kind in KINDS}

    def add_block(
        self, column: int, row: int, heights_m: NDArray[np.float32], void: NDArray[np.bool_], first: tuple[int, int]
    ) -> None:
        """Pages of level 0 of the block that begins at post (column, row).

        ``heights_m`` and ``void`` begin at post ``first`` and reach `MARGIN` beyond the block, or to the terrain's
        edge.
        """
        size = min(BLOCK, self._pyramid.size_px[0] - column), min(BLOCK, self._pyramid.size_px[1] - row)
        texels = {kind: np.empty((*heights_m.shape, 4), np.uint8) for kind in KINDS}
        spacing, low_m, high_m = self._scale
        texels_of_posts(heights_m, void, *spacing, low_m, high_m, texels["relief"], texels["heights"])
        for kind in KINDS:
            self._write_shard(kind, 0, column // BLOCK, row // BLOCK, texels[kind], first)
            if self._coarse[kind]:
                own = texels[kind][row - first[1] :, column - first[0] :][: size[1], : size[0]]
                top, left = row // 2, column // 2
                coarse = self._coarse[kind][0][top:, left:][: -(-size[1] // 2), : -(-size[0] // 2)]
                halve(own, coarse, _WHOLE[kind])
            texels[kind] = np.empty((0, 0, 4), np.uint8)

    def finish(self, done: Callable[[float], None]) -> None:
        """All blocks have come: the coarser levels. ``done`` is told the fraction."""
        shards = [(n, *shard) for n, level in enumerate(self._pyramid.levels[1:]) for shard in _shards(level)]
        for count, (number, column, row) in enumerate(shards):
            for kind in KINDS:
                levels = self._coarse[kind]
                if column == row == 0 and number > 0:
                    _halve_bands(kind, levels[number - 1], levels[number])
                self._write_shard(kind, number + 1, column, row, levels[number], (0, 0))
            done((count + 1) / len(shards))

    def _write_shard(
        self, kind: str, number: int, column: int, row: int, texels: Texels, first: tuple[int, int]
    ) -> None:
        """The pages of one shard, from texels that begin at ``first`` and hold what its gutters ask for."""
        level = self._pyramid.levels[number]
        columns = range(column * _PAGES, min((column + 1) * _PAGES, level.columns))
        rows = range(row * _PAGES, min((row + 1) * _PAGES, level.rows))
        pages = np.empty((len(rows), len(columns), EDGE, EDGE, 4), np.uint8)
        for (j, y), (i, x) in itertools.product(enumerate(rows), enumerate(columns)):
            across = _reach(x, level.size_px[0]) - first[0]
            down = _reach(y, level.size_px[1]) - first[1]
            pages[j, i] = texels[down[0] : down[-1] + 1, across[0] : across[-1] + 1][down - down[0]][
                :, across - across[0]
            ]
        self._arrays[kind][number][rows.start : rows.stop, columns.start : columns.stop] = pages


def _reach(page: int, size: int) -> NDArray[np.int64]:
    """The texels along a page and its gutters; those beyond the edge are the edge's again."""
    begin = page * PAGE - GUTTER
    return np.clip(np.arange(begin, begin + EDGE), 0, size - 1)


def _shards(level: Level) -> Iterator[tuple[int, int]]:
    """Column and row of every shard of a level."""
    for row in range(-(-level.rows // _PAGES)):
        for column in range(-(-level.columns // _PAGES)):
            yield column, row


def _halve_bands(kind: str, fine: Texels, coarse: Texels) -> None:
    for top in range(0, coarse.shape[0], PAGE):
        halve(fine[2 * top : 2 * (top + PAGE)], coarse[top : top + PAGE], _WHOLE[kind])


def _texels(level: Level, folder: Path) -> Any:
    width, height = level.size_px
    with tempfile.TemporaryFile(dir=folder) as file:
        return np.memmap(file, dtype=np.uint8, mode="w+", shape=(height, width, 4))
