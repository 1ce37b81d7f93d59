"""The displays that many panels are benchmarked on, each with its quilt and a walk around it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from limen.display import shapes
from limen.display.display import Display
from limen.display.mesh import PolygonMesh, panels_of_mesh
from limen.display.packing import pack_outlines
from limen.geometry import Floats
from limen.viewing.projection import QuiltPanels

__all__ = ["DISPLAYS", "PanelsScene", "stage"]

_FILL = 0.8  # of a packed quilt, about
_RADII = 3.0  # from the middle of a display to the eye, in radii of the display
_SCENE = 0.9  # of a display's radius

DISPLAYS: dict[str, tuple[str, dict[str, float]]] = {
    "icosahedron": ("icosahedron", {}),
    "120": ("disdyakis-triacontahedron", {}),
    "sphere-840": ("sphere", {"columns": 40, "rows": 21}),
    "spring": ("spring", {}),
    "teapot": ("teapot", {}),
    "knot": ("knot", {}),
    "icosphere": ("icosphere", {}),
    "sphere": ("sphere", {}),
}
"""Shapes and their parameters; the icosphere's 1,280 panels have aims of their own."""


@dataclass(frozen=True, slots=True)
class PanelsScene:
    """A display with its quilt, and the sizes of the scene and the walk around it, metres."""

    windows: QuiltPanels
    scene_m: float
    eye_m: float

    def eyes_m(self, frames: int) -> Iterator[Floats]:
        """Places on a walk around the display, up and down on the way: shape (1, 3) each."""
        for number in range(frames):
            turn = 0.3 + 2 * math.pi * number / max(frames, 1)
            up = 0.25 * math.sin(2 * turn)
            flat = math.sqrt(1 - up * up)
            yield self.eye_m * np.array([[flat * math.sin(turn), up, flat * math.cos(turn)]])


@cache
def stage(name: str, quilt_px: int) -> PanelsScene:
    """One of `DISPLAYS` around the room's origin, as finely as makes a quilt of about that many pixels."""
    kind, parameters = DISPLAYS[name]
    mesh = _icosphere() if kind == "icosphere" else shapes.shape(kind, **parameters)
    coarse = Display(name, tuple(panels_of_mesh(mesh, name, 0.01)))
    area_m2 = sum(_area_px2(panel.lit_outline_px) * math.prod(panel.pitch_m) for panel in coarse.panels)
    pitch_m = math.sqrt(area_m2 / (_FILL * quilt_px))
    display = Display(name, tuple(panels_of_mesh(mesh, name, pitch_m)))
    quilt = pack_outlines(display, max_size_px=16_384, max_px=2 * quilt_px)[0]
    half = (mesh.corners.max(axis=0) - mesh.corners.min(axis=0)) / 2
    return PanelsScene(
        QuiltPanels(display, quilt), _SCENE * float(np.prod(half) ** (1 / 3)), _RADII * float(half.max())
    )


def _area_px2(corners: Floats) -> float:
    x, y = corners.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def _icosphere(splits: int = 3, radius_m: float = 0.45) -> PolygonMesh:
    """An icosahedron whose faces were split into four several times: 1,280 triangles."""
    solid = shapes.icosahedron(radius_m=1.0)
    corners = list(solid.corners)
    faces = list(solid.faces)
    for _ in range(splits):
        middles: dict[tuple[int, int], int] = {}

        def middle(a: int, b: int, middles: dict[tuple[int, int], int] = middles) -> int:
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(corners)
                both = corners[a] + corners[b]
                corners.append(both / np.linalg.norm(both))
            return middles[key]

        split = [(a, b, c, middle(a, b), middle(b, c), middle(c, a)) for a, b, c in faces]
        faces = [
            face for a, b, c, ab, bc, ca in split for face in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        ]
    return PolygonMesh(np.array(corners) * radius_m, tuple(faces), "icosphere")
