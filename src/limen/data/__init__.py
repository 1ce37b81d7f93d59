"""Reading and making data: images as pages of a pyramid, meshes as triangles, terrains as both, points as a tree.

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
    from limen.data.mesh_folder import MeshReport, ingest_mesh
    from limen.data.mesh_sample import KNOT_TRIANGLES, MeshSampleReport, ripple, sample_mesh, torus_knot
    from limen.data.opening import open_content as open
    from limen.data.pages import GUTTER, PAGE, Level, Pyramid
    from limen.data.points_build import build_points
    from limen.data.points_file import Points
    from limen.data.points_info import PointsInfo, cloud_info
    from limen.data.points_ingest import PointsReport, ingest_points
    from limen.data.points_opening import open_points
    from limen.data.points_sample import HALL_POINTS, PointsSampleReport, sample_points
    from limen.data.sample import SampleReport, sample_image
    from limen.data.terrain_build import TerrainReport, ingest_terrain
    from limen.data.terrain_file import Terrain
    from limen.data.terrain_info import TerrainInfo, elevation_info
    from limen.data.terrain_opening import open_terrain
    from limen.data.terrain_sample import TerrainSampleReport, sample_terrain

__all__ = [
    "CONTRAST_OF_BYTE",
    "GUTTER",
    "HALL_POINTS",
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
    "MeshReport",
    "MeshSampleReport",
    "Points",
    "PointsInfo",
    "PointsReport",
    "PointsSampleReport",
    "Pyramid",
    "SampleReport",
    "Terrain",
    "TerrainInfo",
    "TerrainReport",
    "TerrainSampleReport",
    "build_points",
    "cloud_info",
    "elevation_info",
    "ingest",
    "ingest_mesh",
    "ingest_points",
    "ingest_terrain",
    "open",
    "open_mesh",
    "open_points",
    "open_terrain",
    "page_contrast",
    "ripple",
    "sample_image",
    "sample_mesh",
    "sample_points",
    "sample_terrain",
    "torus_knot",
]

_HOMES = {
    "CONTRAST_OF_BYTE": ("contrast_file", "CONTRAST_OF_BYTE"),
    "ContrastSurvey": ("contrast", "ContrastSurvey"),
    "GUTTER": ("pages", "GUTTER"),
    "HALL_POINTS": ("points_sample", "HALL_POINTS"),
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
    "PointsInfo": ("points_info", "PointsInfo"),
    "MeshReport": ("mesh_folder", "MeshReport"),
    "PointsReport": ("points_ingest", "PointsReport"),
    "PointsSampleReport": ("points_sample", "PointsSampleReport"),
    "Pyramid": ("pages", "Pyramid"),
    "SampleReport": ("sample", "SampleReport"),
    "Terrain": ("terrain_file", "Terrain"),
    "TerrainInfo": ("terrain_info", "TerrainInfo"),
    "TerrainReport": ("terrain_build", "TerrainReport"),
    "TerrainSampleReport": ("terrain_sample", "TerrainSampleReport"),
    "build_points": ("points_build", "build_points"),
    "cloud_info": ("points_info", "cloud_info"),
    "elevation_info": ("terrain_info", "elevation_info"),
    "ingest": ("build", "ingest"),
    "ingest_mesh": ("mesh_folder", "ingest_mesh"),
    "ingest_points": ("points_ingest", "ingest_points"),
    "ingest_terrain": ("terrain_build", "ingest_terrain"),
    "open": ("opening", "open_content"),
    "open_mesh": ("mesh_file", "open_mesh"),
    "open_points": ("points_opening", "open_points"),
    "open_terrain": ("terrain_opening", "open_terrain"),
    "page_contrast": ("contrast", "page_contrast"),
    "ripple": ("mesh_sample", "ripple"),
    "sample_image": ("sample", "sample_image"),
    "sample_mesh": ("mesh_sample", "sample_mesh"),
    "sample_points": ("points_sample", "sample_points"),
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
