"""One door for every kind of content."""

from __future__ import annotations

from pathlib import Path

from limen.data.image import CACHE_BYTES, Image, existing_file, open_image
from limen.data.mesh import Mesh
from limen.data.mesh_file import mesh_type, open_mesh

__all__ = ["open_content"]


def open_content(path: str | Path, *, cache_bytes: int = CACHE_BYTES) -> Image | Mesh:
    """Open a file as what it is: an image, with ``cache_bytes`` for its decoded tiles, or a mesh.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is neither, cut short, or so large that it wants ``limen ingest`` first.
    """
    path = existing_file(path)
    return open_image(path, cache_bytes=cache_bytes) if mesh_type(path) is None else open_mesh(path)
