"""limen: images of any size on displays of flat panels, drawn to the threshold of what a viewer can see.

Names are imported when first used, so ``import limen`` costs milliseconds and touches no GPU module.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limen.data import open as open
    from limen.data.image import Image as Image
    from limen.data.mesh import Mesh as Mesh
    from limen.data.points_file import Points as Points
    from limen.data.terrain_file import Terrain as Terrain
    from limen.display.display import Display as Display
    from limen.display.panel import Panel as Panel
    from limen.errors import LimenError as LimenError
    from limen.lens import Lens as Lens
    from limen.look_at import LookAt as LookAt
    from limen.rendering import render as render
    from limen.tessellation import Tessellation as Tessellation
    from limen.tolerance import Tolerance as Tolerance
    from limen.viewer import Pointer as Pointer
    from limen.viewer import Viewer as Viewer
    from limen.vision.acuity import optimal_distance_m as optimal_distance_m
    from limen.vision.contrast import sensitivity as sensitivity
    from limen.vision.resolution import resolution_cpd as resolution_cpd
    from limen.vision.visible import visible_cpd as visible_cpd

_HOMES = {
    "Display": "limen.display.display",
    "Image": "limen.data.image",
    "Lens": "limen.lens",
    "LimenError": "limen.errors",
    "LookAt": "limen.look_at",
    "Mesh": "limen.data.mesh",
    "Panel": "limen.display.panel",
    "Pointer": "limen.viewer",
    "Points": "limen.data.points_file",
    "Terrain": "limen.data.terrain_file",
    "Tessellation": "limen.tessellation",
    "Tolerance": "limen.tolerance",
    "Viewer": "limen.viewer",
    "open": "limen.data",
    "optimal_distance_m": "limen.vision.acuity",
    "render": "limen.rendering",
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
