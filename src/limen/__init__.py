"""limen: images of any size on displays of flat panels, drawn to the threshold of what a viewer can see.

Names are imported when first used, so ``import limen`` costs milliseconds and touches no GPU module.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data import open as open
    from limen.data.image.file import Image as Image
    from limen.data.mesh.mesh import Mesh as Mesh
    from limen.data.points.file import Points as Points
    from limen.data.terrain.file import Terrain as Terrain
    from limen.display.display import Display as Display
    from limen.display.panel import Panel as Panel
    from limen.errors import LimenError as LimenError
    from limen.frame.render import render as render
    from limen.gpu.device import open_device as open_device
    from limen.layers.common.room_placement import RoomPlacement as RoomPlacement
    from limen.layers.image.layer import ImageLayer as ImageLayer
    from limen.layers.mesh.layer import MeshLayer as MeshLayer
    from limen.layers.points.layer import PointsLayer as PointsLayer
    from limen.layers.terrain.layer import TerrainLayer as TerrainLayer
    from limen.show.show import Show as Show
    from limen.viewing.lens import Lens as Lens
    from limen.viewing.placement import LookAt as LookAt
    from limen.viewing.tessellation import Tessellation as Tessellation
    from limen.viewing.tolerance import Tolerance as Tolerance
    from limen.viewing.viewer import Pointer as Pointer
    from limen.viewing.viewer import Viewer as Viewer
    from limen.vision.acuity import optimal_distance_m as optimal_distance_m
    from limen.vision.contrast import sensitivity as sensitivity
    from limen.vision.resolution import resolution_cpd as resolution_cpd
    from limen.vision.visible import visible_cpd as visible_cpd

_HOMES = {
    "Display": "limen.display.display",
    "Image": "limen.data.image.file",
    "ImageLayer": "limen.layers.image.layer",
    "Lens": "limen.viewing.lens",
    "LimenError": "limen.errors",
    "LookAt": "limen.viewing.placement",
    "Mesh": "limen.data.mesh.mesh",
    "MeshLayer": "limen.layers.mesh.layer",
    "Panel": "limen.display.panel",
    "Pointer": "limen.viewing.viewer",
    "Points": "limen.data.points.file",
    "PointsLayer": "limen.layers.points.layer",
    "RoomPlacement": "limen.layers.common.room_placement",
    "Show": "limen.show.show",
    "Terrain": "limen.data.terrain.file",
    "TerrainLayer": "limen.layers.terrain.layer",
    "Tessellation": "limen.viewing.tessellation",
    "Tolerance": "limen.viewing.tolerance",
    "Viewer": "limen.viewing.viewer",
    "open": "limen.data",
    "open_device": "limen.gpu.device",
    "optimal_distance_m": "limen.vision.acuity",
    "render": "limen.frame.render",
    "resolution_cpd": "limen.vision.resolution",
    "sensitivity": "limen.vision.contrast",
    "visible_cpd": "limen.vision.visible",
}

__all__ = [
    "Display",
    "Image",
    "ImageLayer",
    "Lens",
    "LimenError",
    "LookAt",
    "Mesh",
    "MeshLayer",
    "Panel",
    "Pointer",
    "Points",
    "PointsLayer",
    "RoomPlacement",
    "Show",
    "Terrain",
    "TerrainLayer",
    "Tessellation",
    "Tolerance",
    "Viewer",
    "open",
    "open_device",
    "optimal_distance_m",
    "render",
    "resolution_cpd",
    "sensitivity",
    "visible_cpd",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'limen' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
