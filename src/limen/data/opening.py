"""One door for every kind of content."""

from __future__ import annotations

from pathlib import Path

from limen.data.image import Image, existing_file, open_image
from limen.data.mesh import Mesh
from limen.data.mesh_file import mesh_type, open_mesh

__all__ = ["open_content"]


def open_content(path: str | Path) -> Image | Mesh:
    """Open a file as what it is: an image or a mesh.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is neither, cut short, or so large that it wants ``limen ingest`` first.
    """
    path = existing_file(path)
    return open_image(path) if mesh_type(path) is None else open_mesh(path)
