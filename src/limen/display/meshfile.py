"""Reads meshes with their polygons whole: OBJ, PLY, OFF, and what else trimesh reads, as triangles.

trimesh and the like cut polygons into triangles when they read, and panels would be cut with them. For PLY there is
plyfile. No library that is kept up reads polygons from OBJ and OFF, so these two formats of plain text are read here:
corners and faces, nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from limen.display.mesh import PolygonMesh
from limen.errors import FormatError, MissingFileError
from limen.system import interrupts_later

__all__ = ["INSTALL_3MF", "MESH_SUFFIXES", "read_mesh"]

MESH_SUFFIXES = (".obj", ".ply", ".off", ".stl", ".glb", ".gltf", ".3mf")
"""What the command line takes for a mesh."""

INSTALL_3MF = 'install what reads it with: pip install "limen[3mf]"'
"""The cure where trimesh lacks lxml or networkx."""

_Faces = list[tuple[int, ...]]
_Lines = Iterator[tuple[int, list[str]]]


def read_mesh(path: Path) -> PolygonMesh:
    """A mesh's corners and polygons.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be read as what its name says.
    DisplayError
        If it has no faces, or a face names a corner that is not there or not finite.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: no such mesh file")
    readers = {".obj": _read_obj, ".off": _read_off, ".ply": _read_ply}
    try:
        corners, faces = readers.get(path.suffix.lower(), _read_triangles)(path)
    except UnicodeDecodeError:
        raise FormatError(f"{path}: is not a text file; binary {path.suffix} files are not read: write PLY") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    return PolygonMesh(np.array(corners, dtype=float).reshape(-1, 3), tuple(faces), str(path))


def _read_obj(path: Path) -> tuple[list[list[float]], _Faces]:
    corners: list[list[float]] = []
    faces: _Faces = []
    for line, words in _lines(path):
        try:
            if words[0] == "v":
                corners.append([float(word) for word in words[1:4]])
                if len(corners[-1]) < 3:
                    raise ValueError("a corner needs three numbers")
            elif words[0] == "f":
                numbers = [int(word.split("/", 1)[0]) for word in words[1:]]
                # Numbers count from 1, negative ones back from the last corner so far.
                faces.append(tuple(n - 1 if n > 0 else len(corners) + n for n in numbers))
        except ValueError as error:
            raise FormatError(f"{path}:{line}: not OBJ: {error}") from None
    return corners, faces


def _read_off(path: Path) -> tuple[list[list[float]], _Faces]:
    lines = _lines(path)
    line, words = next(lines, (1, [""]))
    try:
        if not words[0].endswith("OFF") or "BINARY" in words:
            raise ValueError("it must begin with OFF, and be text")
        line, words = (line, words[1:]) if len(words) > 1 else next(lines)
        corner_count, face_count = int(words[0]), int(words[1])
        corners: list[list[float]] = []
        faces: _Faces = []
        for _ in range(corner_count):
            line, words = next(lines)
            corners.append([float(word) for word in words[:3]])
            if len(corners[-1]) < 3:
                raise ValueError("a corner needs three numbers")
        for _ in range(face_count):
            line, words = next(lines)
            size = int(words[0])
            faces.append(tuple(int(word) for word in words[1 : size + 1]))  # colours may follow
            if len(faces[-1]) < size:
                raise ValueError(f"a face of {size} corners names {len(faces[-1])}")
    except StopIteration:
        raise FormatError(f"{path}: ends after line {line}, before its last face") from None
    except (ValueError, IndexError) as error:
        raise FormatError(f"{path}:{line}: not OFF: {error}") from None
    return corners, faces


def _read_ply(path: Path) -> tuple[list[list[float]], _Faces]:
    from plyfile import PlyData, PlyParseError

    try:
        ply = PlyData.read(str(path))
        vertex, face = ply["vertex"], ply["face"]
        corners = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(float).tolist()
        names = [prop.name for prop in face.properties if prop.name in ("vertex_indices", "vertex_index")]
        faces = [tuple(int(index) for index in indices) for indices in face[names[0]]]
    except PlyParseError as error:
        raise FormatError(f"{path}: not PLY: {error}") from None
    except (KeyError, IndexError, ValueError):
        raise FormatError(f"{path}: has no element 'vertex' with x, y, z and 'face' with vertex_indices") from None
    return corners, faces


def _read_triangles(path: Path) -> tuple[list[list[float]], _Faces]:
    with interrupts_later():
        import trimesh

    try:
        mesh = trimesh.load_mesh(path)
        corners, triangles = mesh.vertices.tolist(), mesh.faces.tolist()
    except ImportError as error:
        raise FormatError(f"{path}: cannot be read here ({error}); {INSTALL_3MF}") from None
    except Exception as error:  # whatever trimesh and its many readers raise for a file that is none
        raise FormatError(f"{path}: cannot be read as a mesh: {type(error).__name__}: {error}") from None
    return corners, [tuple(triangle) for triangle in triangles]


def _lines(path: Path) -> _Lines:
    """Numbered lines as words, without comments; lines that end in a backslash are joined."""
    begun: list[str] = []
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, start=1):
            words = begun + line.split("#", 1)[0].split()
            begun = words[:-1] if words and words[-1] == "\\" else []
            if words and not begun:
                yield number, words
