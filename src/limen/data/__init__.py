"""Reading and making data: images as pages of a pyramid, meshes as triangles, terrains as both.

What is slow to import (Numba for ``ingest`` and ``sample_image``, the image codecs for ``open``) is imported when it
is first asked for, so that ``import limen.data`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data.build import IngestReport, ingest
    from limen.data.contrast import CONTRAST_OF_BYTE, ContrastSurvey, page_contrast
    from limen.data.image import Image, ImageInfo
    from limen.data.mesh import NO_TEXTURE, Mesh, MeshInfo
    from limen.data.mesh_file import open_mesh
    from limen.data.mesh_sample import KNOT_TRIANGLES, MeshSampleReport, ripple, sample_mesh, torus_knot
    from limen.data.opening import open_content as open
    from limen.data.pages import GUTTER, PAGE, Level, Pyramid
    from limen.data.points_build import build_points
    from limen.data.points_file import Points, PointsInfo
    from limen.data.sample import SampleReport, sample_image
    from limen.data.terrain_build import TerrainReport, ingest_terrain
    from limen.data.terrain_file import Terrain
    from limen.data.terrain_info import TerrainInfo, elevation_info
    from limen.data.terrain_opening import open_terrain
    from limen.data.terrain_sample import TerrainSampleReport, sample_terrain

__all__ = [
    "CONTRAST_OF_BYTE",
    "GUTTER",
    "KNOT_TRIANGLES",
    "NO_TEXTURE",
    "PAGE",
    "ContrastSurvey",
    "Image",
    "ImageInfo",
    "IngestReport",
    "Level",
    "Mesh",
    "MeshInfo",
    "MeshSampleReport",
    "Points",
    "PointsInfo",
    "Pyramid",
    "SampleReport",
    "Terrain",
    "TerrainInfo",
    "TerrainReport",
    "TerrainSampleReport",
    "build_points",
    "elevation_info",
    "ingest",
    "ingest_terrain",
    "open",
    "open_mesh",
    "open_terrain",
    "page_contrast",
    "ripple",
    "sample_image",
    "sample_mesh",
    "sample_terrain",
    "torus_knot",
]

_HOMES = {
    "CONTRAST_OF_BYTE": ("contrast_file", "CONTRAST_OF_BYTE"),
    "ContrastSurvey": ("contrast", "ContrastSurvey"),
    "GUTTER": ("pages", "GUTTER"),
    "Image": ("image", "Image"),
    "ImageInfo": ("image", "ImageInfo"),
    "IngestReport": ("build", "IngestReport"),
    "KNOT_TRIANGLES": ("mesh_sample", "KNOT_TRIANGLES"),
    "Level": ("pages", "Level"),
    "Mesh": ("mesh", "Mesh"),
    "MeshInfo": ("mesh", "MeshInfo"),
    "MeshSampleReport": ("mesh_sample", "MeshSampleReport"),
    "NO_TEXTURE": ("mesh", "NO_TEXTURE"),
    "PAGE": ("pages", "PAGE"),
    "Points": ("points_file", "Points"),
    "PointsInfo": ("points_file", "PointsInfo"),
    "Pyramid": ("pages", "Pyramid"),
    "SampleReport": ("sample", "SampleReport"),
    "Terrain": ("terrain_file", "Terrain"),
    "TerrainInfo": ("terrain_info", "TerrainInfo"),
    "TerrainReport": ("terrain_build", "TerrainReport"),
    "TerrainSampleReport": ("terrain_sample", "TerrainSampleReport"),
    "build_points": ("points_build", "build_points"),
    "elevation_info": ("terrain_info", "elevation_info"),
    "ingest": ("build", "ingest"),
    "ingest_terrain": ("terrain_build", "ingest_terrain"),
    "open": ("opening", "open_content"),
    "open_mesh": ("mesh_file", "open_mesh"),
    "open_terrain": ("terrain_opening", "open_terrain"),
    "page_contrast": ("contrast", "page_contrast"),
    "ripple": ("mesh_sample", "ripple"),
    "sample_image": ("sample", "sample_image"),
    "sample_mesh": ("mesh_sample", "sample_mesh"),
    "sample_terrain": ("terrain_sample", "sample_terrain"),
    "torus_knot": ("mesh_sample", "torus_knot"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    value = getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
