"""From what a person writes in a display file (a grid of equal panels, a panel's corners) to panels."""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from limen.display.panel import Panel
from limen.errors import DisplayError
from limen.geometry import Vec3, as_vec3, cross, normalised
from limen.units import inch_to_m

__all__ = [
    "WHITE_CD_M2",
    "Falloff",
    "Gain",
    "Grid",
    "Luminance",
    "NotNegative",
    "Positive",
    "Side",
    "panel_of_corners",
    "panels_of_grid",
]

WHITE_CD_M2 = 100.0
"""Luminance of white where a display file says nothing: the condition of Ashraf, Chapiro, Mantiuk 2025."""

Side = Annotated[int, Meta(ge=1, le=65_535)]
Luminance = Annotated[float | None, Meta(description="Luminance of white, cd/m2. Default: the display's.")]
Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Gain = Annotated[
    float, Meta(gt=0, le=1, description="Linear factor on the light of a panel, to match panels with each other.")
]
Falloff = Annotated[
    float,
    Meta(ge=0, description="Luminance falls as cos(angle from the normal) to this power; 0 is Lambertian."),
]


class Grid(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A flat wall of equal panels, named ``name/column,row``; column 0 is leftmost, row 0 topmost as seen."""

    name: Annotated[str, Meta(min_length=1)]
    size_px: Annotated[tuple[Side, Side], Meta(description="Width and height of one panel.")]
    centre_m: Annotated[tuple[float, float, float], Meta(description="Middle of the whole grid in the room.")]
    columns: Side = 1
    rows: Side = 1
    diagonal_in: Annotated[
        Positive | None, Meta(description="Diagonal of one panel's lit area, inches. Give this, pitch_mm or size_m.")
    ] = None
    pitch_mm: Annotated[Positive | None, Meta(description="Distance from one pixel to the next.")] = None
    size_m: Annotated[
        tuple[Positive, Positive] | None, Meta(description="Width and height of one panel's lit area.")
    ] = None
    bezel_mm: Annotated[
        tuple[NotNegative, NotNegative],
        Meta(
            description="Dark gap between the lit areas of neighbours: between columns, between rows. Each panel's "
            "frame is half as wide as the narrower gap."
        ),
    ] = (0.0, 0.0)
    facing: Annotated[tuple[float, float, float], Meta(description="The wall's normal, toward the viewers.")] = (
        0.0,
        0.0,
        1.0,
    )
    up: Annotated[tuple[float, float, float], Meta(description="Upward along the wall's columns.")] = (0.0, 1.0, 0.0)
    first_column: Annotated[
        int, Meta(ge=0, description="Number of the leftmost column, for a wall written in two parts.")
    ] = 0
    nodes: Annotated[
        list[str], Meta(description="The machine that draws each column, from the left; one name for all is enough.")
    ] = []
    surface_m: Annotated[
        tuple[float, float] | None,
        Meta(description="Place of its top left corner on the unrolled surface. Default: right of what came before."),
    ] = None
    luminance_cd_m2: Luminance = None
    gain: Gain = 1.0
    falloff: Falloff = 0.0


def panels_of_grid(grid: Grid, surface_left_m: float, luminance_cd_m2: float = WHITE_CD_M2) -> list[Panel]:
    """The panels of a wall, row by row from the top left.

    Raises
    ------
    DisplayError
        If the panels' size is not given exactly once, the directions do not make a frame, or ``nodes`` does not fit.
    """
    pitch = _pitch_m(grid)
    right, down = _frame(grid)
    step = (grid.size_px[0] * pitch[0] + grid.bezel_mm[0] / 1000, grid.size_px[1] * pitch[1] + grid.bezel_mm[1] / 1000)
    across = np.array(
        [(grid.columns * step[0] - grid.bezel_mm[0] / 1000) / 2, (grid.rows * step[1] - grid.bezel_mm[1] / 1000) / 2]
    )
    frame = np.array([right, down])
    corner = np.array(as_vec3(grid.centre_m, f"grid '{grid.name}': centre_m")) - across @ frame
    surface = grid.surface_m or (surface_left_m, 0.0)
    white = luminance_cd_m2 if grid.luminance_cd_m2 is None else grid.luminance_cd_m2
    return [
        Panel(
            name=f"{grid.name}/{grid.first_column + column},{row}",
            size_px=grid.size_px,
            origin_m=as_vec3(corner + np.array([column * step[0], row * step[1]]) @ frame, "origin"),
            right=right,
            down=down,
            pitch_m=pitch,
            surface_m=(surface[0] + column * step[0], surface[1] + row * step[1]),
            node=_node(grid, column),
            luminance_cd_m2=white,
            gain=grid.gain,
            falloff=grid.falloff,
            bezel_m=min(grid.bezel_mm) / 2000,
        )
        for row in range(grid.rows)
        for column in range(grid.columns)
    ]


def panel_of_corners(
    name: str,
    size_px: tuple[int, int],
    corners_m: list[Vec3],
    **fields: Any,
) -> Panel:
    """A panel from the room positions of its top left, top right, bottom right (and bottom left) corners.

    ``fields`` are those of `Panel` that the corners do not tell.

    Raises
    ------
    DisplayError
        If the corners do not make a rectangle to within 1 % of its longer side.
    """
    corners = np.array(corners_m, dtype=float)
    if not np.isfinite(corners).all():
        raise DisplayError(f"panel '{name}': corners_m holds a number that is not finite")
    along, downward = corners[1] - corners[0], corners[2] - corners[1]
    width, height = float(np.linalg.norm(along)), float(np.linalg.norm(downward))
    if min(width, height) < 1e-6:
        raise DisplayError(f"panel '{name}': corners_m has two corners in one place")
    fourth = corners[0] + downward
    skew = abs(float(along @ downward)) / max(width, height)
    gap = float(np.linalg.norm(corners[3] - fourth)) if len(corners) == 4 else 0.0
    if max(skew, gap) > 0.01 * max(width, height):
        raise DisplayError(
            f"panel '{name}': corners_m is not a rectangle (off by {max(skew, gap) * 1000:.1f} mm); "
            "the order is top left, top right, bottom right, bottom left"
        )
    right = along / width
    down = downward - (downward @ right) * right
    return Panel(
        name=name,
        size_px=size_px,
        origin_m=as_vec3(corners[0], "corners_m"),
        right=as_vec3(right, "right"),
        down=normalised(as_vec3(down, "down"), "down"),
        pitch_m=(width / size_px[0], height / size_px[1]),
        **fields,
    )


def _pitch_m(grid: Grid) -> tuple[float, float]:
    given = [value for value in (grid.diagonal_in, grid.pitch_mm, grid.size_m) if value is not None]
    if len(given) != 1:
        raise DisplayError(f"grid '{grid.name}': give exactly one of diagonal_in, pitch_mm and size_m")
    if grid.size_m is not None:
        return (grid.size_m[0] / grid.size_px[0], grid.size_m[1] / grid.size_px[1])
    if grid.diagonal_in is not None:
        pitch = inch_to_m(grid.diagonal_in) / math.hypot(*grid.size_px)
    else:
        assert grid.pitch_mm is not None
        pitch = grid.pitch_mm / 1000
    return (pitch, pitch)


def _frame(grid: Grid) -> tuple[Vec3, Vec3]:
    """Unit vectors to the right and down, as a viewer in front of the wall sees them."""
    try:
        facing = normalised(as_vec3(grid.facing, "facing"), "facing")
        right = normalised(cross(as_vec3(grid.up, "up"), facing), "up x facing")
    except ValueError as error:
        raise DisplayError(f"grid '{grid.name}': {error}; 'up' must not be parallel to 'facing'") from None
    return right, cross(right, facing)


def _node(grid: Grid, column: int) -> str:
    if len(grid.nodes) not in (0, 1, grid.columns):
        raise DisplayError(
            f"grid '{grid.name}': nodes has {len(grid.nodes)} names for {grid.columns} columns; "
            "give one for each, or one for all"
        )
    if not grid.nodes:
        return ""
    return grid.nodes[column if len(grid.nodes) > 1 else 0]
