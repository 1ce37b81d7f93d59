"""``ingest_terrain``: a raster of heights becomes a folder that is drawn from, block by block.

Three passes, each over blocks of 4096 x 4096 posts: the source is read once and its heights are stored as they are;
posts without data are filled; pages and patches are made of what is stored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.store.file_type import existing_file
from limen.data.store.ingest import Progress, new_folder
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport
from limen.data.store.zarr_group import create_table, seal
from limen.data.terrain.elevation import ElevationSource, PostRect
from limen.data.terrain.page_kernels import MOST_CODE
from limen.data.terrain.page_writer import MARGIN, PageWriter, Scale
from limen.data.terrain.patch_writer import TABLES, PatchWriter, Tables, triangles_at
from limen.data.terrain.store import BLOCK, Header, Source, create_posts
from limen.data.terrain.tin_tree import grow_tree
from limen.data.terrain.voids import CELL, REACH, complete, fill, pull
from limen.errors import FormatError
from limen.system import worker_count

__all__ = ["code_range_m", "error_ladder_m", "ingest_terrain"]

Rect = tuple[int, int, int, int]

_READ, _FILLED, _PAGED, _GROWN = 0.06, 0.08, 0.2, 0.97
"""Of the time until all is done, about, when each pass ends."""


def ingest_terrain(
    src: str | Path,
    dst: str | Path,
    *,
    band: int | None = None,
    spacing_m: float | tuple[float, float] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> IngestReport:
    """Make a terrain of a raster of heights, in a folder ``dst`` that ends in ``.terrain``.

    ``band`` and ``spacing_m`` are those of `limen.data.terrain.elevation.ElevationSource`. ``progress`` is called with
    the fraction done, 0 ... 1. ``dst`` appears, or is replaced, only when all is written; on any error nothing is left
    behind. Raises MissingFileError, FormatError (``src`` cannot be used, or read only in part), InputError (``dst`` is
    something else already, or a wrong band), StorageError.
    """
    src, dst = existing_file(src), Path(dst)
    with (
        Footprint() as used,
        ElevationSource(src, band=band, spacing_m=spacing_m) as source,
        new_folder(dst, ".terrain", "a terrain") as folder,
    ):
        header, tables = _Ingest(source, folder, threads or worker_count(), progress or (lambda _: None)).run()
        size = seal(folder)
    return IngestReport.of(
        "terrain",
        dst,
        used,
        size=header.size_posts,
        bytes=size,
        notes=source.notes,
        posts=math.prod(header.size_posts),
        void_share=header.void_share,
        error_m=header.errors_m[-1],
        triangles=triangles_at(tables.nodes, tables.patches, header.errors_m[-1]),
    )


def error_ladder_m(height_range_m: float, spacing_m: float) -> tuple[float, ...]:
    """Powers of the square root of 2 from half the height range down to an eighth of the spacing, at least one.

    >>> [round(error_m, 2) for error_m in error_ladder_m(70.0, 30.0)]
    [32.0, 22.63, 16.0, 11.31, 8.0, 5.66, 4.0]
    """
    finest = math.ceil(2.0 * math.log2(spacing_m / 8.0))
    coarsest = math.floor(2.0 * math.log2(height_range_m / 2.0)) if height_range_m > 0.0 else finest
    return tuple(math.sqrt(2.0**step) for step in range(max(coarsest, finest), finest - 1, -1))


def code_range_m(low_m: float, high_m: float, whole: bool) -> tuple[float, float]:
    """What the lowest and the highest of 2^24 codes stand for, to hold heights from ``low_m`` to ``high_m``.

    Whole metres are multiples of 256 codes where that widens the range by little: their last byte is always 0, and
    takes no space.

    >>> code_range_m(0.0, 4400.0, whole=True)
    (0.0, 4681.142578125)
    """
    high_m = max(high_m, low_m + 1.0)
    codes_a_metre = int(MOST_CODE / (high_m - low_m)) // 256 * 256
    if whole and codes_a_metre and MOST_CODE / codes_a_metre < 1.15 * (high_m - low_m):
        return low_m, low_m + MOST_CODE / codes_a_metre
    return low_m, high_m


class _Survey(NamedTuple):
    """What the first pass finds."""

    low_m: float
    high_m: float
    voids: int
    grid: NDArray[np.float32]  # means over cells of `CELL` posts, completed
    filled: set[tuple[int, int]]  # blocks that have voids


@dataclass(slots=True)
class _Ingest:
    source: ElevationSource
    folder: Path
    threads: int
    progress: Progress
    heights: Any = None
    void: Any = None

    def run(self) -> tuple[Header, Tables]:
        group = zarr.open_group(self.folder, mode="w", zarr_format=3)
        size = self.source.size_posts
        self.heights = create_posts(group, size, self.source.dtype)
        survey = self._copy(group)
        self._fill(survey)
        whole = self.source.dtype == np.int16
        scale = Scale(self.source.spacing_m, *code_range_m(survey.low_m, survey.high_m, whole))
        self._write_pages(PageWriter(group, Pyramid.of(size), scale, self.folder))
        errors_m = error_ladder_m(survey.high_m - survey.low_m, min(self.source.spacing_m))
        tables = self._grow(PatchWriter(group, self.source.dtype), errors_m)
        for name, fields in TABLES.items():
            columns: Any = getattr(tables, name)
            for field in fields:
                create_table(group, f"{name}/{field}", getattr(columns, field))
        header = self._header(survey, scale, errors_m, tables)
        group.attrs["limen"] = msgspec.to_builtins(header)
        self.progress(1.0)
        return header, tables

    def _copy(self, group: zarr.Group) -> _Survey:
        """The only pass over the source."""
        width, height = self.source.size_posts
        grid = np.zeros((-(-height // CELL), -(-width // CELL)), np.float32)
        known = np.zeros(grid.shape, np.bool_)
        low_m, high_m, voids, blocks = math.inf, -math.inf, 0, set()
        for left, top, right, bottom in self._blocks(0.0, _READ):
            heights, void = self.source.read(PostRect(left, top, right - left, bottom - top))
            missing = int(void.sum())
            if missing and self.void is None:
                self.void = create_posts(group, (width, height), np.dtype(np.bool_), "posts/void")
            if missing:
                self.void[top:bottom, left:right] = void
                blocks.add((left, top))
                voids += missing
            self.heights[top:bottom, left:right] = heights
            if missing < void.size:
                low_m = min(
                    low_m, float(heights.min(where=~void, initial=np.inf if heights.dtype.kind == "f" else 32767))
                )
                high_m = max(
                    high_m, float(heights.max(where=~void, initial=-np.inf if heights.dtype.kind == "f" else -32768))
                )
            cells = np.s_[top // CELL : -(-bottom // CELL), left // CELL : -(-right // CELL)]
            grid[cells], known[cells] = pull(heights.astype(np.float32), ~void)
        if not known.any():
            raise FormatError(f"{self.source.path}: no post has a height, all are marked as without data")
        return _Survey(low_m, high_m, voids, complete(grid, known), blocks)

    def _fill(self, survey: _Survey) -> None:
        """Heights where there are none. Neighbours of a block still look only at those that were there."""
        for left, top, right, bottom in self._blocks(_READ, _FILLED):
            if (left, top) not in survey.filled:
                continue
            x0, y0, x1, y1 = self._wider((left, top, right, bottom), REACH)
            stored, void = self._stored((x0, y0, x1, y1))
            cells = survey.grid[y0 // CELL : -(-y1 // CELL), x0 // CELL : -(-x1 // CELL)]
            filled = fill(stored, ~void, cells)[top - y0 : bottom - y0, left - x0 : right - x0]
            np.clip(filled, survey.low_m, survey.high_m, out=filled)
            kept = np.rint(filled) if self.source.dtype == np.int16 else filled
            self.heights[top:bottom, left:right] = kept.astype(self.source.dtype)

    def _write_pages(self, writer: PageWriter) -> None:
        end = _FILLED + 0.8 * (_PAGED - _FILLED)
        for left, top, right, bottom in self._blocks(_FILLED, end):
            x0, y0, x1, y1 = self._wider((left, top, right, bottom), MARGIN)
            writer.add_block(left, top, *self._stored((x0, y0, x1, y1)), (x0, y0))
        writer.finish(lambda done: self.progress(end + (_PAGED - end) * done))

    def _grow(self, writer: PatchWriter, errors_m: tuple[float, ...]) -> Tables:
        """Roots share their border posts, so they begin at multiples of `BLOCK` and hold one post more."""
        width, height = self.source.size_posts
        roots = [(x, y) for y in range(0, height - 1, BLOCK) for x in range(0, width - 1, BLOCK)]
        levels = 1 + max(0, math.ceil(math.log2(min(BLOCK, max(width, height) - 1) / 128)))
        posts = 0
        for left, top in roots:
            right, bottom = min(left + BLOCK, width - 1), min(top + BLOCK, height - 1)
            heights_m, void = self._stored((left, top, right + 1, bottom + 1))
            marked = void if void.any() else None
            nodes = grow_tree(heights_m, marked, errors_m, origin=(left, top), threads=self.threads)
            for x0, y0, x1, y1 in writer.add_root(nodes):
                posts += (x1 - x0) * (y1 - y0)
                share = min(1.0, posts / (levels * (width - 1) * (height - 1)))
                self.progress(_PAGED + (_GROWN - _PAGED) * share)
        return writer.finish()

    def _blocks(self, begin: float, end: float) -> Iterator[Rect]:
        """First and last column and row (not included) of every block; tells the progress after each."""
        width, height = self.source.size_posts
        corners = [(x, y) for y in range(0, height, BLOCK) for x in range(0, width, BLOCK)]
        for count, (x, y) in enumerate(corners):
            yield x, y, min(x + BLOCK, width), min(y + BLOCK, height)
            self.progress(begin + (end - begin) * (count + 1) / len(corners))

    def _wider(self, rect: Rect, margin: int) -> Rect:
        width, height = self.source.size_posts
        left, top, right, bottom = rect
        return max(left - margin, 0), max(top - margin, 0), min(right + margin, width), min(bottom + margin, height)

    def _stored(self, rect: Rect) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        left, top, right, bottom = rect
        place = np.s_[top:bottom, left:right]
        heights = np.asarray(self.heights[place]).astype(np.float32)
        void = np.zeros(heights.shape, np.bool_) if self.void is None else np.asarray(self.void[place])
        return heights, void

    def _header(self, survey: _Survey, scale: Scale, errors_m: tuple[float, ...], tables: Tables) -> Header:
        source = self.source
        return Header(
            size_posts=source.size_posts,
            spacing_m=source.spacing_m,
            crs=source.crs,
            transform=source.transform,
            low_m=scale.low_m,
            high_m=scale.high_m,
            height_range_m=(survey.low_m, survey.high_m),
            void_share=survey.voids / math.prod(source.size_posts),
            errors_m=errors_m,
            roots=tables.nodes.roots,
            source=Source.of(
                source.path, format=source.format, band=source.band, exact=source.exact, notes=source.notes
            ),
        )
