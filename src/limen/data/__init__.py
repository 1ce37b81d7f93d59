"""Reading and making data: images as pages of a pyramid, meshes as triangles, terrains as both, points as a tree.

What is slow to import (Numba for ``ingest`` and ``sample``, the image codecs for ``open``) is imported when it is first
asked for, so that ``import limen.data`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data.image.contrast import ContrastSurvey as ContrastSurvey
    from limen.data.image.contrast import page_contrast as page_contrast
    from limen.data.image.contrast_file import CONTRAST_OF_BYTE as CONTRAST_OF_BYTE
    from limen.data.image.file import Image as Image
    from limen.data.image.ingest import ingest_image as ingest_image
    from limen.data.mesh.mesh import NO_TEXTURE as NO_TEXTURE
    from limen.data.mesh.mesh import Mesh as Mesh
    from limen.data.mesh.opening import open_mesh as open_mesh
    from limen.data.mesh.store import ingest_mesh as ingest_mesh
    from limen.data.opening import info as info
    from limen.data.opening import ingest as ingest
    from limen.data.opening import open_content
    from limen.data.opening import sample as sample
    from limen.data.pages import GUTTER as GUTTER
    from limen.data.pages import PAGE as PAGE
    from limen.data.pages import Pyramid as Pyramid
    from limen.data.points.build import build_points as build_points
    from limen.data.points.file import Points as Points
    from limen.data.points.ingest import ingest_points as ingest_points
    from limen.data.points.opening import open_points as open_points
    from limen.data.samples.image import sample_image as sample_image
    from limen.data.samples.mesh import ripple as ripple
    from limen.data.samples.mesh import sample_mesh as sample_mesh
    from limen.data.samples.mesh import torus_knot as torus_knot
    from limen.data.samples.points import sample_points as sample_points
    from limen.data.samples.terrain import sample_terrain as sample_terrain
    from limen.data.store.report import IngestReport as IngestReport
    from limen.data.terrain.file import Terrain as Terrain
    from limen.data.terrain.ingest import ingest_terrain as ingest_terrain
    from limen.data.terrain.opening import open_terrain as open_terrain

    open = open_content

_HOMES = {
    "image.contrast": ("ContrastSurvey", "page_contrast"),
    "image.contrast_file": ("CONTRAST_OF_BYTE",),
    "image.file": ("Image",),
    "image.ingest": ("ingest_image",),
    "mesh.mesh": ("NO_TEXTURE", "Mesh"),
    "mesh.opening": ("open_mesh",),
    "mesh.store": ("ingest_mesh",),
    "opening": ("info", "ingest", "open_content", "sample"),
    "pages": ("GUTTER", "PAGE", "Pyramid"),
    "points.build": ("build_points",),
    "points.file": ("Points",),
    "points.ingest": ("ingest_points",),
    "points.opening": ("open_points",),
    "samples.image": ("sample_image",),
    "samples.mesh": ("ripple", "sample_mesh", "torus_knot"),
    "samples.points": ("sample_points",),
    "samples.terrain": ("sample_terrain",),
    "store.report": ("IngestReport",),
    "terrain.file": ("Terrain",),
    "terrain.ingest": ("ingest_terrain",),
    "terrain.opening": ("open_terrain",),
}
_NAMES = {name: (module, name) for module, names in _HOMES.items() for name in names}
_NAMES["open"] = _NAMES.pop("open_content")


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _NAMES[name]
    value = getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(_NAMES)
