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
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zarr

from limen.data.mesh.file import read_mesh
from limen.data.mesh.mesh import Mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.mesh.vertex_tree import MASK_WORDS, VertexTree
from limen.data.store.atomic import partial_folder
from limen.data.store.ingest import Progress, new_folder
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport
from limen.data.store.zarr_group import MadeOf, checked_header, create_table, opening, seal, table_of
from limen.errors import FormatError, MissingFileError
from limen.system import place_in_cache

__all__ = ["ingest_mesh", "open_mesh_folder", "tree_of"]

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

_READ, _BUILT = 0.1, 0.9
"""Of the time until a mesh is made ready, about, when it was read and when its tree is built."""

_WORTH_KEEPING = 150_000
"""Triangles from which on a tree is kept in the cache: below, it is made in less time than half a second."""


class MeshHeader(msgspec.Struct, frozen=True, kw_only=True):
    version: int = _VERSION
    triangles: int
    vertices: int
    nodes: int
    source: MadeOf | None = None


def ingest_mesh(src: str | Path, dst: str | Path, *, progress: Progress | None = None) -> IngestReport:
    """Make a mesh ready, with its vertex tree, in a folder ``dst`` that ends in ``.mesh``.

    ``progress`` is called with the fraction done, 0 ... 1. ``dst`` appears, or is replaced, only when all is written;
    on any error nothing is left behind. Raises MissingFileError, FormatError (``src`` is no mesh, or damaged),
    InputError (``dst`` is something else already), StorageError.
    """
    src, dst, tell = Path(src), Path(dst), progress or (lambda _: None)
    with Footprint() as used, new_folder(dst, ".mesh", "a mesh") as folder:
        mesh = read_mesh(src)
        tell(_READ)
        tree = build_vertex_tree(mesh)
        tell(_BUILT)
        size = _write(folder, mesh, tree, MadeOf.of(src))
    tell(1.0)
    nodes = len(tree.position)
    return IngestReport.of("mesh", dst, used, size=mesh.size, bytes=size, vertices=tree.vertices, nodes=nodes)


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
        made_of = _header(place).source
        if made_of and made_of.still(mesh.path) and (kept := _read_tree(place, mesh)) is not None:
            return kept
    except (FormatError, MissingFileError):
        pass
    tree = build_vertex_tree(mesh)
    with contextlib.suppress(OSError), partial_folder(place) as folder:
        _write(folder, mesh, tree, MadeOf.of(mesh.path))
    return tree


def _header(path: Path) -> MeshHeader:
    return checked_header(path, MeshHeader, _VERSION, "mesh made ready", "limen ingest MESH.ply NAME.mesh")


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


def _write(folder: Path, mesh: Mesh, tree: VertexTree, source: MadeOf) -> int:
    """Fill a folder; its bytes."""
    header = MeshHeader(triangles=mesh.size, vertices=tree.vertices, nodes=len(tree.position), source=source)
    group = zarr.open_group(folder, mode="w", zarr_format=3, attributes={"limen": msgspec.to_builtins(header)})
    tables = {f"mesh/{name}": getattr(mesh, name) for name in _MESH}
    tables |= {f"tree/{name}": getattr(tree, name) for name in _TREE}
    for name, table in tables.items():
        if table is not None and table.size:
            create_table(group, name, table)
    return seal(folder)
