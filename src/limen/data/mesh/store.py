"""Meshes with their vertex trees, made ready: a folder ``NAME.mesh``, a Zarr v3 group that other programs can read too.

===============  ======================================================================
``mesh/*``       the arrays of `limen.data.mesh.mesh.Mesh`, by their names
``tree/*``       those of `limen.data.mesh.vertex_tree.VertexTree`, but the mesh's triangles
===============  ======================================================================

The group's attribute ``limen`` is a `MeshHeader`; ``files.json`` lists all other files with their sizes. Every array
ends with a checksum (CRC-32C).
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zarr

from limen.data.mesh.file import open_mesh
from limen.data.mesh.mesh import Mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.mesh.vertex_tree import MASK_WORDS, VertexTree
from limen.data.store.atomic import PartialFolder, is_disk_full
from limen.data.store.memory import Footprint
from limen.data.store.zarr_group import (
    checked_header,
    create_table,
    is_group_folder,
    is_made_of,
    opening,
    seal,
    table_of,
)
from limen.errors import FormatError, InputError, MissingFileError, StorageError
from limen.system import place_in_cache

__all__ = ["MeshReport", "ingest_mesh", "open_mesh_folder", "tree_of"]

_VERSION = 1
_DECIDES = ("positions", "triangles", "normals", "colours", "uv", "layers", "textures")
"""Arrays of a mesh that its tree, and how it is drawn, depend on."""

_MESH = (*_DECIDES, "welds")
_TREE = tuple(name for name in VertexTree._fields if name != "triangles")
_NO_INNER_NODES: dict[str, Any] = {
    "middle": np.zeros((0, 3), np.float32),
    "radius": np.zeros(0, np.float32),
    "displacement": np.zeros(0, np.float32),
    "contrast": np.zeros(0, np.uint8),
    "mask": np.zeros((0, MASK_WORDS), np.uint64),
}
"""Arrays of no length are not stored."""

_WORTH_KEEPING = 150_000
"""Triangles from which on a tree is kept in the cache: below, it is made in less time than half a second."""


class MeshSource(msgspec.Struct, frozen=True, kw_only=True):
    """The file that the mesh was read from."""

    name: str
    bytes: int
    mtime_ns: int


class MeshHeader(msgspec.Struct, frozen=True, kw_only=True):
    version: int = _VERSION
    triangles: int
    vertices: int
    nodes: int
    source: MeshSource | None = None


class MeshReport(msgspec.Struct, frozen=True, kw_only=True):
    """What ``ingest_mesh`` did; ``size`` is the number of triangles.

    ``peak_rss_mib`` is the process's peak of anonymous resident memory: mapped files are not its own.
    """

    path: str
    seconds: float
    peak_rss_mib: float
    size: int
    vertices: int
    nodes: int
    bytes: int


def ingest_mesh(src: str | Path, dst: str | Path) -> MeshReport:
    """Make a mesh ready, with its vertex tree, in a folder ``dst`` that ends in ``.mesh``.

    ``dst`` appears, or is replaced, only when all is written; on any error nothing is left behind. Raises
    MissingFileError, FormatError (``src`` is no mesh, or damaged), InputError (``dst`` is something else already),
    StorageError.
    """
    src, dst = Path(src), Path(dst)
    if dst.suffix.lower() != ".mesh":
        raise InputError(f"{dst}: the result is a folder of a mesh; give it a name that ends in .mesh")
    if dst.exists() and not is_group_folder(dst):
        raise InputError(f"{dst}: is there already, and no mesh made ready; remove it, or name another")
    begin = time.perf_counter()
    with Footprint() as footprint:
        mesh = open_mesh(src)
        tree = build_vertex_tree(mesh)
        size = _write(dst, mesh, tree, _source_of(src))
    return MeshReport(
        path=str(dst), seconds=round(time.perf_counter() - begin, 3), peak_rss_mib=round(footprint.peak_mib, 1),
        size=mesh.size, vertices=tree.vertices, nodes=len(tree.position), bytes=size,
    )  # fmt: skip


def open_mesh_folder(path: str | Path) -> Mesh:
    """The mesh in a folder that `ingest_mesh` wrote.

    Raises MissingFileError, or FormatError if it is none, damaged, or copied in part.
    """
    path = Path(path)
    _header(path)
    with opening(path):
        group = zarr.open_group(path, mode="r", zarr_format=3)
        held: dict[str, Any] = {name: table_of(group, f"mesh/{name}") for name in _MESH if f"mesh/{name}" in group}
        return Mesh(path, **{"textures": np.zeros((0, 1, 1, 4), np.uint8), **held})


def tree_of(mesh: Mesh) -> VertexTree:
    """The vertex tree of a mesh: of the folder that it was opened from, of the cache, or built.

    Trees of large meshes that were read from files are kept in the cache, which is written quietly or not at all: where
    there is no room, the tree is simply built again.

    Raises FormatError where the folder is damaged.
    """
    if mesh.path is not None and mesh.path.suffix.lower() == ".mesh":
        tree = _read_tree(mesh.path, mesh)
        return build_vertex_tree(mesh) if tree is None else tree
    if mesh.path is None or mesh.size < _WORTH_KEEPING or not mesh.path.is_file():
        return build_vertex_tree(mesh)
    place = place_in_cache(mesh.path.stem, str(mesh.path.resolve()), ".mesh")
    try:
        if is_made_of(_header(place).source, mesh.path) and (kept := _read_tree(place, mesh)) is not None:
            return kept
    except (FormatError, MissingFileError):
        pass
    tree = build_vertex_tree(mesh)
    with contextlib.suppress(StorageError, MissingFileError):
        _write(place, mesh, tree, _source_of(mesh.path))
    return tree


def _header(path: Path) -> MeshHeader:
    return checked_header(path, MeshHeader, _VERSION, "mesh made ready", "limen ingest MESH.ply NAME.mesh")


def _source_of(path: Path) -> MeshSource:
    state = path.stat()
    return MeshSource(name=path.name, bytes=state.st_size, mtime_ns=state.st_mtime_ns)


def _read_tree(path: Path, mesh: Mesh) -> VertexTree | None:
    """The tree in a folder; None if it is of another mesh, as of one that was deformed or painted since."""
    with opening(path):
        group = zarr.open_group(path, mode="r", zarr_format=3)
        for name in _DECIDES:
            own = getattr(mesh, name)
            if own.size and not np.array_equal(table_of(group, f"mesh/{name}"), own):
                return None
        held = {name: table_of(group, f"tree/{name}") for name in _TREE if f"tree/{name}" in group}
    return VertexTree(triangles=mesh.triangles, **{**_NO_INNER_NODES, **held})


def _write(path: Path, mesh: Mesh, tree: VertexTree, source: MeshSource) -> int:
    """Write all or nothing; bytes."""
    header = MeshHeader(triangles=mesh.size, vertices=tree.vertices, nodes=len(tree.position), source=source)
    with PartialFolder(path) as folder:
        try:
            group = zarr.open_group(folder, mode="w", zarr_format=3, attributes={"limen": msgspec.to_builtins(header)})
            tables = {f"mesh/{name}": getattr(mesh, name) for name in _MESH}
            tables |= {f"tree/{name}": getattr(tree, name) for name in _TREE}
            for name, table in tables.items():
                if table is not None and table.size:
                    create_table(group, name, table)
        except OSError as error:
            cure = "free some space" if is_disk_full(error) else "choose another place"
            raise StorageError(f"{path}: cannot be written: {error.strerror or error}; {cure}") from error
        return seal(folder)
