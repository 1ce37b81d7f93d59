"""Whether a file holds a mesh, without reading it."""

from __future__ import annotations

from pathlib import Path

from limen.data.store.file_type import existing_file

__all__ = ["MESH_SUFFIXES", "is_mesh", "is_mesh_folder", "mesh_type"]

_MAGIC = {b"ply\n": "ply", b"ply\r": "ply", b"glTF": "glb", b"OFF\n": "off", b"OFF\r": "off", b"OFF ": "off"}
MESH_SUFFIXES = {
    ".ply": "ply", ".obj": "obj", ".stl": "stl", ".off": "off", ".gltf": "gltf", ".glb": "glb", ".3mf": "3mf",
    ".dae": "dae", ".zae": "zae", ".xaml": "xaml", ".3dxml": "3dxml",
}  # fmt: skip


def is_mesh_folder(path: str | Path) -> bool:
    """Whether it is to be opened as a mesh that was made ready."""
    return Path(path).suffix.lower() == ".mesh" and Path(path).is_dir()


def is_mesh(path: str | Path) -> bool:
    """Whether it is to be opened as a mesh, made ready or not.

    Raises
    ------
    MissingFileError
        If there is no such file.
    """
    return is_mesh_folder(path) or mesh_type(existing_file(path)) is not None


def mesh_type(path: Path) -> str | None:
    """Which kind of mesh (``ply``, ``obj``, ...), by the file's first bytes, else by its name; None if it is none."""
    with path.open("rb") as file:
        head = file.read(84)
    if (found := _MAGIC.get(head[:4])) is not None:
        return found
    triangles = int.from_bytes(head[80:84], "little")
    if len(head) == 84 and triangles and path.stat().st_size == 84 + 50 * triangles:
        return "stl"
    return MESH_SUFFIXES.get(path.suffix.lower())
