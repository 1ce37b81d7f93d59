"""One door for every kind of content.

What reads a kind takes up to a second to import, so it is imported where a file is of that kind.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from limen.data.mesh.mesh_type import is_mesh, is_mesh_folder, mesh_type
from limen.data.points.cloud_type import is_points
from limen.data.store.file_type import existing_file
from limen.data.store.tile_cache import CACHE_BYTES
from limen.data.terrain.elevation_type import is_terrain
from limen.errors import FormatError
from limen.extensions import extension

if TYPE_CHECKING:
    from limen.data.image.file import Image
    from limen.data.mesh.mesh import Mesh
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

__all__ = ["open_content", "open_picture"]


def open_content(
    path: str | Path, *, cache_bytes: int = CACHE_BYTES, progress: Callable[[float], None] | None = None
) -> Image | Mesh | Points | Terrain:
    """Open a file as what it is: an image, with ``cache_bytes`` for its decoded tiles, a mesh, points, or a terrain.

    A raster of heights of up to 64 million posts, or a cloud of up to 20 million points, is made ready in the cache
    when it is first opened; ``progress`` is called with the fraction done, 0 ... 1. Formats that other packages read
    are entry points of the group ``limen.readers``, named by the file's ending.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is none of these, cut short, or so large that it wants ``limen ingest`` first.
    """
    if is_terrain(path):
        from limen.data.terrain.opening import open_terrain

        return open_terrain(path, progress=progress)
    if is_points(path):
        from limen.data.points.opening import open_points

        return open_points(path, progress=progress)
    if is_mesh_folder(path):
        from limen.data.mesh.store import open_mesh_folder

        return open_mesh_folder(path)
    path = existing_file(path)
    if mesh_type(path) is not None:
        from limen.data.mesh.file import open_mesh

        return open_mesh(path)
    reader = extension("limen.readers", path.suffix.lower().removeprefix("."))
    if reader is not None:
        content: Image | Mesh | Points | Terrain = reader(path)
        return content
    from limen.data.image.file import open_image

    return open_image(path, cache_bytes=cache_bytes)


def open_picture(path: str | Path) -> Image:
    """An image, where nothing else will do; a FormatError says so of a mesh or a terrain, else as `open_content`."""
    kind = "a terrain" if is_terrain(path) else "a mesh" if is_mesh(path) else None
    if kind is not None:
        raise FormatError(f"{path}: is {kind}, and an image is wanted here; `limen show {path}` draws it")
    from limen.data.image.file import open_image

    return open_image(path)
