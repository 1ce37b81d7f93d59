"""A terrain that was made ready: pages of relief and heights, and patches of its quadtree, read as they are wanted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import zarr
from numpy.typing import NDArray

from limen.data.pages import PAGE, Pyramid
from limen.data.store.tile_cache import TileCache
from limen.data.store.zarr_group import checked_header, list_files, opening, reading, table_of
from limen.data.terrain.georeference import bounds_of
from limen.data.terrain.info import TerrainInfo
from limen.data.terrain.model import Nodes, Patch, PatchTable
from limen.data.terrain.patch_writer import TABLES, PatchRecords, decode_patch, triangles_at
from limen.data.terrain.store import KINDS, POSTS_A_CHUNK, VERSION, Header
from limen.data.terrain.tin_tree import exact_patch
from limen.errors import InputError

__all__ = ["Terrain", "TerrainPages"]

_PATCH_CACHE_BYTES = 96 << 20
_POSTS_CACHE_BYTES = 32 << 20


@dataclass(frozen=True, slots=True, eq=False)
class TerrainPages:
    """Pages of one kind, a `limen.stream.pages.PageSource`; any number of threads may read at once."""

    path: Path
    kind: str
    pyramid: Pyramid
    levels: tuple[Any, ...]

    def read_page(self, page: int) -> NDArray[np.uint8]:
        """One page with its gutter, RGBA uint8 (264, 264, 4), the caller's own.

        Beyond the terrain's edge the edge texel is repeated. Raises InputError for a page that does not exist,
        PageError where it cannot be read.
        """
        level, column, row = self.pyramid.page_of(int(page))
        what = f"the page of {self.kind} at level {level}, column {column}, row {row}"
        with reading(self.path, what):
            return np.array(self.levels[level][row, column], dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Heights on a raster of posts, with everything that drawing them wants. Any number of threads may read at once.

    ``transform`` maps column and row of pixels' corners to coordinates in ``crs`` (WKT), so post (i, j) lies at
    (i + 0.5, j + 0.5). ``low_m`` and ``high_m`` are what the lowest and highest code of pages of ``heights`` stand for;
    all posts lie between them.
    """

    path: Path
    header: Header
    nodes: Nodes
    patches: PatchTable
    relief: TerrainPages
    heights: TerrainPages
    _places: PatchRecords
    _chunks: dict[str, Any]
    _posts: Any
    _void: Any
    _chunk_cache: TileCache
    _post_cache: TileCache

    @classmethod
    def open(cls, path: str | Path) -> Terrain:
        """Open a folder that `limen.data.ingest_terrain` wrote.

        Raises MissingFileError, or FormatError if it is none, damaged, or copied in part.
        """
        path = Path(path)
        header = checked_header(path, Header, VERSION, "terrain", "limen ingest DEM.tif NAME.terrain")
        pyramid = Pyramid.of(header.size_posts)
        with opening(path):
            group = zarr.open_group(path, mode="r", zarr_format=3)
            tables = {name: [table_of(group, f"{name}/{field}") for field in fields] for name, fields in TABLES.items()}
            relief, heights = (
                TerrainPages(
                    path, kind, pyramid, tuple(group[f"{kind}/{level}"] for level in range(len(pyramid.levels)))
                )
                for kind in KINDS
            )
            chunks = {name: group[f"chunks/{name}"] for name in ("posts", "heights", "triangles")}
            posts, void = group["posts/heights"], group["posts/void"] if header.void_share > 0.0 else None
        caches = TileCache(_PATCH_CACHE_BYTES), TileCache(_POSTS_CACHE_BYTES)
        nodes, patches = Nodes._make([*tables["nodes"], header.roots]), PatchTable._make(tables["patches"])
        places = PatchRecords._make(tables["places"])
        return cls(path, header, nodes, patches, relief, heights, places, chunks, posts, void, *caches)

    kind: ClassVar[str] = "terrain"

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def size_posts(self) -> tuple[int, int]:
        return self.header.size_posts

    @property
    def spacing_m(self) -> tuple[float, float]:
        return self.header.spacing_m

    @property
    def low_m(self) -> float:
        return self.header.low_m

    @property
    def high_m(self) -> float:
        return self.header.high_m

    @property
    def crs(self) -> str:
        return self.header.crs

    @property
    def transform(self) -> tuple[float, ...] | None:
        return self.header.transform

    @property
    def has_voids(self) -> bool:
        return self._void is not None

    @property
    def bounds(self) -> tuple[float, ...] | None:
        """West, south, east, north in the units of ``crs``, of pixels' outer borders."""
        return bounds_of(self.transform, self.size_posts)

    @property
    def mean_page_bytes(self) -> float:
        """Mean size of a page of relief and one of heights together, as they are stored."""
        files = list_files(self.path).items()
        stored = sum(size for name, size in files if name.split("/")[0] in KINDS)
        return stored / self.relief.pyramid.page_count

    def read_patch(self, patch: int) -> Patch:
        """One patch. Raises InputError for a number that does not exist, PageError where it cannot be read."""
        if not 0 <= patch < len(self.patches.node):
            raise InputError(f"patch {patch}: this terrain has patches 0 to {len(self.patches.node) - 1}")
        left, top, right, bottom = (int(edge) for edge in self.nodes.rect[self.patches.node[patch]])
        chunk = int(self._places.chunk[patch])
        if chunk < 0:
            heights_m, _ = self.read_posts(left, top, right - left + 1, bottom - top + 1)
            return exact_patch(heights_m, (left, top, right, bottom))
        first, begin = int(self._places.vertex[patch]), int(self._places.triangle[patch])
        end, rims = begin + int(self.patches.triangles[patch]), int(self._places.rims[patch])
        vertices = slice(first, first + int(self.patches.vertices[patch]))
        local = self._chunk("posts", chunk)[vertices]
        heights = self._chunk("heights", chunk)[vertices].astype(np.float32)
        triangles = self._chunk("triangles", chunk)
        core, rim = triangles[begin : end - rims], triangles[end - rims : end]
        return decode_patch(local, heights, core, rim, (left, top, right, bottom))

    def read_posts(
        self, column: int, row: int, columns: int, rows: int
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
        """Heights in metres (rows, columns), voids filled, and where they were; None if the terrain has no voids.

        Raises InputError for a rectangle that is not all inside, PageError where it cannot be read.
        """
        width, height = self.size_posts
        if min(column, row) < 0 or not (0 < columns <= width - column and 0 < rows <= height - row):
            raise InputError(
                f"{columns} x {rows} posts from column {column}, row {row} are not all among {width} x {height}"
            )
        place = column, row, columns, rows
        heights = self._assembled("heights", self._posts, place, np.dtype(np.float32))
        void = None if self._void is None else self._assembled("void", self._void, place, np.dtype(np.bool_))
        return heights, void

    def _assembled(self, name: str, array: Any, place: tuple[int, int, int, int], dtype: np.dtype[Any]) -> Any:
        column, row, columns, rows = place
        out = np.empty((rows, columns), dtype)
        edge = POSTS_A_CHUNK
        for j in range(row // edge, (row + rows - 1) // edge + 1):
            for i in range(column // edge, (column + columns - 1) // edge + 1):
                y, x = j * edge, i * edge
                tile = self._post_cache.get((name, j, i), lambda y=y, x=x: self._read(name, array, y, x))  # type: ignore[misc]
                top, left = max(y, row), max(x, column)
                bottom, right = min(y + edge, row + rows), min(x + edge, column + columns)
                out[top - row : bottom - row, left - column : right - column] = tile[
                    top - y : bottom - y, left - x : right - x
                ]
        return out

    def _read(self, name: str, array: Any, y: int, x: int) -> Any:
        with reading(self.path, f"the posts ({name}) from column {x}, row {y} on"):
            return np.asarray(array[y : y + POSTS_A_CHUNK, x : x + POSTS_A_CHUNK])

    def _chunk(self, name: str, chunk: int) -> Any:
        def decode() -> Any:
            with reading(self.path, f"chunk {chunk} of the patches' {name}"):
                return np.asarray(self._chunks[name][chunk])

        return self._chunk_cache.get((name, chunk), decode)

    def info(self) -> TerrainInfo:
        """What the terrain is."""
        header = self.header
        return TerrainInfo(
            path=str(self.path),
            ready=True,
            size=header.size_posts,
            levels=[level.size_px for level in self.relief.pyramid.levels],
            page_px=PAGE,
            format=f"made of {header.source.name} ({header.source.format})",
            crs=header.crs,
            bounds=self.bounds,
            spacing_m=header.spacing_m,
            height_range_m=header.height_range_m,
            void_share=header.void_share,
            nodes=len(self.nodes.rect),
            patches=len(self.patches.node),
            errors_m=header.errors_m,
            triangles=tuple(triangles_at(self.nodes, self.patches, error_m) for error_m in header.errors_m),
            bytes=sum(list_files(self.path).values()),
            exact=header.source.exact,
            notes=header.source.notes,
        )
