"""Meshes from files: whatever trimesh reads, as one value.

A scene's parts are moved to where its graph puts them and joined. Colours of materials, vertices and faces become
colours of vertices; pictures become layers of one array. Normals are the file's where it has them; else vertices at
one place share the area-weighted mean of the triangles around.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import NO_TEXTURE, Mesh, smooth_normals, weld_numbers
from limen.data.mesh.mesh_type import MESH_SUFFIXES, mesh_type
from limen.data.mesh.textures import Texels, as_layers, rgba_of
from limen.data.store.file_type import existing_file
from limen.data.store.report import one_line
from limen.data.store.resample import linear_of_srgb, srgb_of_linear
from limen.display.meshfile import INSTALL_3MF
from limen.errors import FormatError
from limen.system import interrupts_later

__all__ = ["read_mesh"]

Floats = NDArray[np.float64]

_NEUTRAL = np.array([204, 204, 204, 255], np.uint8)
"""Where a file says nothing about colour."""

_WHITE = np.array([255, 255, 255, 255], np.uint8)

_OF_EXTRA = ("3mf", "3dxml", "xaml")
"""What trimesh reads with lxml or networkx."""
_LINEAR_COLOURS = ("gltf", "glb")
"""glTF 2.0, sections 3.7.2.1 and 3.9.2: colours of vertices and factors of materials are linear light."""


@dataclass(frozen=True, slots=True)
class _Part:
    """One geometry of a scene, where the scene puts it."""

    positions: Floats  # (V, 3)
    triangles: NDArray[np.int64]  # (T, 3)
    normals: Floats | None  # (V, 3), of any length
    colours: NDArray[np.uint8]  # (V, 4)
    uv: Floats | None  # (V, 2), v up
    picture: Any  # of Pillow
    opaque: bool


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh: what `limen.data.mesh.opening.open_mesh` opens but for a folder, raising what it does."""
    path = existing_file(path)
    kind = mesh_type(path)
    if kind is None:
        raise FormatError(f"{path}: is no mesh; name a file that ends in {', '.join(MESH_SUFFIXES)}")
    parts = _read(path, kind)
    if not parts:
        raise FormatError(f"{path}: has no triangles: a point cloud or lines are no mesh; make a surface of it first")
    mesh = _joined(path, parts)
    if not (mesh.bounds[1] > mesh.bounds[0]).any():
        raise FormatError(
            f"{path}: all its triangles lie in one point; if it is compressed (Draco, meshopt), export it uncompressed"
        )
    return mesh


def _read(path: Path, kind: str) -> list[_Part]:
    """What trimesh makes of a file; whatever a damaged one makes it raise, or hand over, becomes one line."""
    with interrupts_later():
        import trimesh

    _check_length(path, kind)
    try:
        with path.open("rb") as file:
            resolver = trimesh.resolvers.FilePathResolver(str(path))
            scene = trimesh.load_scene(file, file_type=kind, resolver=resolver, process=False)
        return list(_parts(scene, linear=kind in _LINEAR_COLOURS))
    except (ImportError, NotImplementedError) as error:
        missing = getattr(error, "name", None)
        cure = f"install the package {missing}" if missing else "convert it to PLY or GLB"
        if kind in _OF_EXTRA:  # trimesh raises a copy of the error that names no package
            cure = INSTALL_3MF
        raise FormatError(f"{path}: {kind} files cannot be read here; {cure}") from error
    except Exception as error:  # trimesh promises nothing about what its readers raise
        raise FormatError(
            f"{path}: cannot be read as {kind}: {one_line(error)[:200]}; export or copy it again"
        ) from error


def _check_length(path: Path, kind: str) -> None:
    """GLB, binary STL and 3MF tell how long they are; of a cut one, trimesh may make anything."""
    with path.open("rb") as file:
        head = file.read(84)
    stated = 0
    if kind == "glb":
        stated = int.from_bytes(head[8:12], "little")
    elif kind == "stl" and not head.startswith(b"solid"):
        stated = 84 + 50 * int.from_bytes(head[80:], "little")
    if path.stat().st_size < stated:
        raise FormatError(f"{path}: ends after {path.stat().st_size} of {stated} bytes; copy it again")
    if kind == "3mf" and not zipfile.is_zipfile(path):
        raise FormatError(f"{path}: is no 3MF (or is cut short); copy it again")


def _parts(scene: Any, *, linear: bool) -> Iterator[_Part]:
    """The scene graph flattened; what is no surface is left out."""
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if len(getattr(geometry, "faces", ())):
            yield _moved(_part(geometry, linear=linear), np.asarray(matrix, float))


def _moved(part: _Part, matrix: Floats) -> _Part:
    """Normals go by the cofactors of the matrix; one that mirrors would turn triangles inside out."""
    linear = matrix[:3, :3]
    cofactors = np.stack([np.cross(linear[(i + 1) % 3], linear[(i + 2) % 3]) for i in range(3)])
    mirrored = np.linalg.det(linear) < 0
    return _Part(
        part.positions @ linear.T + matrix[:3, 3],
        part.triangles[:, ::-1] if mirrored else part.triangles,
        None if part.normals is None else part.normals @ cofactors.T * (-1.0 if mirrored else 1.0),
        part.colours,
        part.uv,
        part.picture,
        part.opaque,
    )


def _part(geometry: Any, *, linear: bool) -> _Part:
    positions, triangles = np.asarray(geometry.vertices, float), np.asarray(geometry.faces, np.int64)
    # Asking for vertex_normals would compute them; those of the file are in the cache from the start.
    normals = np.asarray(geometry.vertex_normals, float) if "vertex_normals" in geometry._cache else None
    visual = geometry.visual
    if visual.kind == "texture":
        colours, picture, opaque = _material(visual, len(positions), linear=linear)
        uv = None if visual.uv is None else np.asarray(visual.uv, float)
        return _Part(positions, triangles, normals, colours, uv, picture, opaque)
    if visual.kind == "face":
        corners = triangles.ravel()
        colours = np.repeat(_codes(visual.face_colors, linear=linear), 3, axis=0)
        split = np.arange(len(corners)).reshape(-1, 3)
        return _Part(
            positions[corners], split, None if normals is None else normals[corners], colours, None, None, False
        )
    if visual.kind == "vertex":
        return _Part(positions, triangles, normals, _codes(visual.vertex_colors, linear=linear), None, None, False)
    return _Part(positions, triangles, normals, np.tile(_NEUTRAL, (len(positions), 1)), None, None, False)


def _material(visual: Any, count: int, *, linear: bool) -> tuple[NDArray[np.uint8], Any, bool]:
    """Colours (count, 4), picture and whether opacity is to be ignored."""
    material = visual.material
    picture = getattr(material, "baseColorTexture", getattr(material, "image", None))
    if hasattr(material, "baseColorFactor"):
        stated, opaque = material.baseColorFactor, material.alphaMode in (None, "OPAQUE")
    else:
        # An MTL without Kd would come out in trimesh's grey and dim its picture.
        stated, opaque = material.main_color if "kd" in getattr(material, "kwargs", {"kd": 0}) else None, False
    silent = _NEUTRAL if picture is None and not linear else _WHITE
    colours = np.tile(silent if stated is None else _codes(stated, linear=linear), (count, 1))
    own = visual.vertex_attributes.get("color")
    if own is not None and len(own) == count:
        light = linear_of_srgb(colours[:, :3] / 255) * linear_of_srgb(_codes(own, linear=linear)[:, :3] / 255)
        colours[:, :3] = np.rint(srgb_of_linear(light) * 255)
    if opaque:
        colours[:, 3] = 255
    return colours, picture, opaque


def _codes(colours: Any, *, linear: bool) -> NDArray[np.uint8]:
    """sRGB and opacity of one or many colours, uint8 (..., 4), from integers of any width or 0 ... 1."""
    values = np.atleast_1d(np.asarray(colours))
    scale = np.iinfo(values.dtype).max if values.dtype.kind in "ui" else 1.0
    share = np.clip(values / scale, 0.0, 1.0)
    if share.shape[-1] == 3:
        share = np.concatenate([share, np.ones((*share.shape[:-1], 1))], axis=-1)
    if linear:
        share[..., :3] = srgb_of_linear(share[..., :3])
    return np.rint(share * 255).astype(np.uint8)


def _joined(path: Path, parts: list[_Part]) -> Mesh:
    """All parts as one mesh; pictures that several parts use are stored once."""
    counts = np.array([len(part.positions) for part in parts])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    for part in parts:
        if part.triangles.min() < 0 or part.triangles.max() >= len(part.positions):
            raise FormatError(f"{path}: a triangle names a vertex that is not there; export it again")
    with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused
        positions = np.concatenate([part.positions for part in parts]).astype(np.float32)
    triangles = np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)])
    layers, textures = _layers(path, parts)
    uv = [np.zeros((len(part.positions), 2)) if part.uv is None else part.uv * [1, -1] + [0, 1] for part in parts]
    return Mesh(
        path=path,
        positions=positions,
        triangles=triangles.astype(np.uint32),
        normals=_normals(parts, positions, triangles.astype(np.uint32)),
        colours=np.concatenate([part.colours for part in parts]),
        uv=np.concatenate(uv).astype(np.float32),
        layers=np.repeat(layers, counts).astype(np.uint32),
        textures=textures,
    )


def _layers(path: Path, parts: list[_Part]) -> tuple[list[int], Texels]:
    """The layer of each part, and all layers."""
    pictures: dict[bytes, int] = {}
    stored: list[Texels] = []
    layers = []
    for part in parts:
        if part.picture is None or part.uv is None:
            layers.append(NO_TEXTURE)
            continue
        try:
            texels = rgba_of(part.picture, part.opaque)
        except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises for damaged pictures
            raise FormatError(f"{path}: a picture in it cannot be read: {error}; export it again") from error
        key = repr(texels.shape).encode() + texels.tobytes()
        if key not in pictures:
            pictures[key] = len(stored)
            stored.append(texels)
        layers.append(pictures[key])
    return layers, as_layers(stored)


def _normals(parts: list[_Part], positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """The file's, and smooth ones where it has none or they have no length."""
    stated: Floats = np.concatenate(
        [np.full_like(part.positions, math.nan) if part.normals is None else part.normals for part in parts]
    )
    length: Floats = np.linalg.norm(stated, axis=1, keepdims=True)
    good: NDArray[np.bool_] = ((length > 1e-12) & (length < math.inf)).ravel()
    if good.all():
        return np.asarray(stated / length, np.float32)
    safe = np.nan_to_num(positions, posinf=0, neginf=0)  # what is not finite is refused when the mesh is made
    smooth = smooth_normals(safe, triangles, weld_numbers(safe))
    smooth[good] = stated[good] / length[good]
    return smooth
