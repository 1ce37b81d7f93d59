"""Displays whose panels stand in every direction, each with a place to see it from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.panel import Panel
from limen.geometry import as_vec3

__all__ = ["DISPLAYS", "stairs"]


def polygons(vertices: NDArray[Any], faces: Any, pixels_per_m: float, name: str = "face") -> Display:
    """A display of flat polygons, counter-clockwise from the front."""
    panels = []
    for number, face in enumerate(faces):
        corners = vertices[list(face)].astype(float)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        normal /= np.linalg.norm(normal)
        right = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
        down = np.cross(right, normal)
        place = np.stack([(corners - corners[0]) @ right, (corners - corners[0]) @ down], axis=1)
        origin = corners[0] + place.min(axis=0) @ np.array([right, down])
        outline = (place - place.min(axis=0)) * pixels_per_m
        width, height = (int(side) for side in np.maximum(np.ceil(outline.max(axis=0)), 1))
        panels.append(
            Panel(
                f"{name}/{number},0", (width, height), as_vec3(origin, "origin"), as_vec3(right, "right"),
                as_vec3(down, "down"), (1 / pixels_per_m,) * 2, outline_px=tuple((x, y) for x, y in outline),
            )
        )  # fmt: skip
    return Display(name, tuple(panels))


def icosahedron(pixels_per_m: float = 300.0) -> Display:
    g = (1 + 5**0.5) / 2
    vertices = np.array(
        [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g), (g, 0, -1),
         (g, 0, 1), (-g, 0, -1), (-g, 0, 1)], dtype=float,
    )  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
             (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
             (8, 6, 7), (9, 8, 1)]  # fmt: skip
    return polygons(vertices * 0.4 + [0, 1.2, 0], faces, pixels_per_m)


def stairs() -> Display:
    """Panels behind each other as seen from the front: overlapping in view, none of them flat to it."""
    rng = np.random.default_rng(5)
    faces, vertices = [], []
    for number in range(24):
        middle = rng.uniform([-0.6, 0.8, -1.0], [0.6, 1.6, 0.2])
        normal = np.array([0, 0, 1.0]) + rng.normal(0, 0.4, 3)
        right = np.cross([0, 1.0, 0], normal)
        right /= np.linalg.norm(right)
        up = np.cross(normal, right) / np.linalg.norm(normal)
        angles = np.linspace(0, 2 * np.pi, 3 + number % 6, endpoint=False) + rng.uniform(0, 6)
        vertices.append(middle + 0.25 * (np.cos(angles)[:, None] * right + np.sin(angles)[:, None] * up))
        faces.append(range(len(faces) and faces[-1].stop, (len(faces) and faces[-1].stop) + len(angles)))
    return polygons(np.concatenate(vertices), faces, 250.0)


DISPLAYS = {
    "cube": (Display.preset("cube").scaled(0.25), (0.7, 1.8, 0.9)),
    "cave": (Display.preset("cave").scaled(0.1), (0.3, 1.6, 0.2)),
    "icosahedron": (icosahedron(), (0.9, 1.5, 1.8)),
    "stairs": (stairs(), (0.1, 1.3, 2.0)),
}
