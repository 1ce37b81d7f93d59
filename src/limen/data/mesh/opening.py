"""A mesh from a file, or from a folder that was made ready."""

from __future__ import annotations

from pathlib import Path

from limen.data.mesh.mesh import Mesh, MeshInfo
from limen.data.mesh.mesh_type import is_mesh_folder

__all__ = ["mesh_info", "open_mesh"]


def open_mesh(path: str | Path) -> Mesh:
    """Open a folder that was made ready, or read a mesh: PLY, OBJ with its materials, glTF, GLB, STL, OFF, 3MF, ...

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is no mesh, broken, a point cloud, or holds positions that are not finite; the message names the file.
    """
    if is_mesh_folder(path):
        from limen.data.mesh.store import open_mesh_folder  # and with it Numba, SciPy and Zarr

        return open_mesh_folder(path)
    from limen.data.mesh.file import read_mesh

    return read_mesh(path)


def mesh_info(path: str | Path) -> MeshInfo:
    """What a mesh is; it is read for that. Raises what `open_mesh` raises."""
    return open_mesh(path).info()
