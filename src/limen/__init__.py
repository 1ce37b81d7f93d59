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
    from limen.show.rendering import render as render
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
    "Lens": "limen.viewing.lens",
    "LimenError": "limen.errors",
    "LookAt": "limen.viewing.placement",
    "Mesh": "limen.data.mesh.mesh",
    "Panel": "limen.display.panel",
    "Pointer": "limen.viewing.viewer",
    "Points": "limen.data.points.file",
    "Terrain": "limen.data.terrain.file",
    "Tessellation": "limen.viewing.tessellation",
    "Tolerance": "limen.viewing.tolerance",
    "Viewer": "limen.viewing.viewer",
    "open": "limen.data",
    "optimal_distance_m": "limen.vision.acuity",
    "render": "limen.show.rendering",
    "resolution_cpd": "limen.vision.resolution",
    "sensitivity": "limen.vision.contrast",
    "visible_cpd": "limen.vision.visible",
}

__all__ = [
    "Display",
    "Image",
    "Lens",
    "LimenError",
    "LookAt",
    "Mesh",
    "Panel",
    "Pointer",
    "Points",
    "Terrain",
    "Tessellation",
    "Tolerance",
    "Viewer",
    "open",
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
