"""Reading and making data: images as pages of a pyramid, meshes as triangles, terrains as both, points as a tree.

What is slow to import (Numba for ``ingest`` and ``sample_image``, the image codecs for ``open``) is imported when it
is first asked for, so that ``import limen.data`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data.image.contrast import CONTRAST_OF_BYTE, ContrastSurvey, page_contrast
    from limen.data.image.file import Image, ImageInfo
    from limen.data.image.ingest import IngestReport, ingest
    from limen.data.mesh.file import open_mesh
    from limen.data.mesh.mesh import NO_TEXTURE, Mesh, MeshInfo
    from limen.data.mesh.store import MeshReport, ingest_mesh
    from limen.data.opening import open_content as open
    from limen.data.pages import GUTTER, PAGE, Level, Pyramid
    from limen.data.points.build import build_points
    from limen.data.points.file import Points
    from limen.data.points.info import PointsInfo, cloud_info
    from limen.data.points.ingest import PointsIngest, ingest_points
    from limen.data.points.opening import open_points
    from limen.data.samples.image import SampleReport, sample_image
    from limen.data.samples.mesh import KNOT_TRIANGLES, MeshSampleReport, ripple, sample_mesh, torus_knot
    from limen.data.samples.points import HALL_POINTS, PointsSampleReport, sample_points
    from limen.data.samples.terrain import TerrainSampleReport, sample_terrain
    from limen.data.terrain.file import Terrain
    from limen.data.terrain.info import TerrainInfo, elevation_info
    from limen.data.terrain.ingest import TerrainIngest, ingest_terrain
    from limen.data.terrain.opening import open_terrain

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
    "PointsIngest",
    "PointsSampleReport",
    "Pyramid",
    "SampleReport",
    "Terrain",
    "TerrainInfo",
    "TerrainIngest",
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
    "CONTRAST_OF_BYTE": ("image.contrast_file", "CONTRAST_OF_BYTE"),
    "ContrastSurvey": ("image.contrast", "ContrastSurvey"),
    "GUTTER": ("pages", "GUTTER"),
    "HALL_POINTS": ("samples.points", "HALL_POINTS"),
    "Image": ("image.file", "Image"),
    "ImageInfo": ("image.file", "ImageInfo"),
    "IngestReport": ("image.ingest", "IngestReport"),
    "KNOT_TRIANGLES": ("samples.mesh", "KNOT_TRIANGLES"),
    "Level": ("pages", "Level"),
    "Mesh": ("mesh.mesh", "Mesh"),
    "MeshInfo": ("mesh.mesh", "MeshInfo"),
    "MeshSampleReport": ("samples.mesh", "MeshSampleReport"),
    "NO_TEXTURE": ("mesh.mesh", "NO_TEXTURE"),
    "PAGE": ("pages", "PAGE"),
    "Points": ("points.file", "Points"),
    "PointsInfo": ("points.info", "PointsInfo"),
    "MeshReport": ("mesh.store", "MeshReport"),
    "PointsIngest": ("points.ingest", "PointsIngest"),
    "PointsSampleReport": ("samples.points", "PointsSampleReport"),
    "Pyramid": ("pages", "Pyramid"),
    "SampleReport": ("samples.image", "SampleReport"),
    "Terrain": ("terrain.file", "Terrain"),
    "TerrainInfo": ("terrain.info", "TerrainInfo"),
    "TerrainIngest": ("terrain.ingest", "TerrainIngest"),
    "TerrainSampleReport": ("samples.terrain", "TerrainSampleReport"),
    "build_points": ("points.build", "build_points"),
    "cloud_info": ("points.info", "cloud_info"),
    "elevation_info": ("terrain.info", "elevation_info"),
    "ingest": ("image.ingest", "ingest"),
    "ingest_mesh": ("mesh.store", "ingest_mesh"),
    "ingest_points": ("points.ingest", "ingest_points"),
    "ingest_terrain": ("terrain.ingest", "ingest_terrain"),
    "open": ("opening", "open_content"),
    "open_mesh": ("mesh.file", "open_mesh"),
    "open_points": ("points.opening", "open_points"),
    "open_terrain": ("terrain.opening", "open_terrain"),
    "page_contrast": ("image.contrast", "page_contrast"),
    "ripple": ("samples.mesh", "ripple"),
    "sample_image": ("samples.image", "sample_image"),
    "sample_mesh": ("samples.mesh", "sample_mesh"),
    "sample_points": ("samples.points", "sample_points"),
    "sample_terrain": ("samples.terrain", "sample_terrain"),
    "torus_knot": ("samples.mesh", "torus_knot"),
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
