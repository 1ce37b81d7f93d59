"""What a person writes in a display file: its tables, field by field."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, field

from limen.display.grid import WHITE_CD_M2, Falloff, Gain, Grid, Luminance, NotNegative, Positive, Side
from limen.typed_toml import schema_of

__all__ = [
    "Adjustment",
    "DisplayFile",
    "MeshEntry",
    "PanelEntry",
    "QuiltEntry",
    "QuiltPanel",
    "schema",
]

Bezel = Annotated[NotNegative, Meta(description="Width of the dark frame around a panel's lit outline.")]


class PanelEntry(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """One panel by the room positions of its corners."""

    name: Annotated[str, Meta(min_length=1)]
    size_px: Annotated[tuple[Side, Side], Meta(description="Width and height of the pixel grid.")]
    corners_m: Annotated[
        list[tuple[float, float, float]],
        Meta(
            description="Top left, top right, bottom right (and bottom left) corner of the pixel grid as seen.",
            min_length=3,
            max_length=4,
        ),
    ]
    surface_m: Annotated[
        tuple[float, float] | None,
        Meta(description="Place of its top left corner on the unrolled surface. Default: right of what came before."),
    ] = None
    outline_px: Annotated[
        list[tuple[float, float]],
        Meta(
            description="Corners of the lit polygon on the pixel grid: convex, at most eight. Default: the whole grid."
        ),
    ] = []
    nudge_px: Annotated[tuple[float, float], Meta(description="Moves the picture on this panel (right, down).")] = (
        0.0,
        0.0,
    )
    node: Annotated[str, Meta(description="The machine that draws this panel.")] = ""
    luminance_cd_m2: Luminance = None
    gain: Gain = 1.0
    falloff: Falloff = 0.0
    bezel_mm: Bezel = 0.0


class Adjustment(msgspec.Struct, forbid_unknown_fields=True):
    """Corrections for panels by name."""

    panels: Annotated[str, Meta(description="Shell-style pattern of panel names, e.g. 'front/3,*'.")]
    nudge_px: tuple[float, float] | None = None
    node: str | None = None
    luminance_cd_m2: float | None = None
    gain: Gain | None = None
    falloff: Falloff | None = None
    bezel_mm: Bezel | None = None


class MeshEntry(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A mesh whose faces are panels, named ``name/face``; give ``file`` or ``shape``, and ``ppi`` or ``pitch_mm``."""

    name: Annotated[str, Meta(min_length=1)]
    file: Annotated[str, Meta(description="OBJ, PLY, OFF, STL ...; relative to the display file.")] = ""
    shape: Annotated[str, Meta(description="A shape that limen makes itself: 'sphere', 'teapot' ...")] = ""
    parameters: Annotated[dict[str, float], Meta(description="Of the shape, e.g. { columns = 40, rows = 21 }.")] = {}
    ppi: Annotated[Positive | None, Meta(description="Pixels per inch. Give this or pitch_mm.")] = None
    pitch_mm: Annotated[Positive | None, Meta(description="Distance from one pixel to the next.")] = None
    scale: Annotated[Positive, Meta(description="Metres per unit of the mesh.")] = 1.0
    up: Annotated[
        tuple[float, float, float], Meta(description="The mesh's upward direction; [0, 0, 1] where z points up.")
    ] = (0.0, 1.0, 0.0)
    centre_m: Annotated[
        tuple[float, float, float] | None,
        Meta(description="Where the middle of the mesh's bounding box goes. Default: where it is."),
    ] = None
    facing: Annotated[
        Literal["out", "in"],
        Meta(description="Panels are seen from where their corners run counter-clockwise ('out'), or from behind."),
    ] = "out"
    node: Annotated[str, Meta(description="The machine that draws these panels.")] = ""
    luminance_cd_m2: Luminance = None
    gain: Gain = 1.0
    falloff: Falloff = 0.0
    bezel_mm: Annotated[
        NotNegative, Meta(description="Width of the dark frame inside of every face: the lit polygon is smaller by it.")
    ] = 0.0


class QuiltPanel(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """Where a panel's picture lies in a quilt."""

    name: str
    offset_px: Annotated[tuple[int, int], Meta(description="Of the picture's top left pixel, after turning.")]
    turn_deg: Annotated[Literal[0, 90, 180, 270], Meta(description="How far the picture is turned clockwise.")] = 0


class QuiltEntry(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """An image that some panels share, as their hardware wants it. Where there is one, all panels must be in one."""

    size_px: tuple[Side, Side]
    panels: list[QuiltPanel] = field(name="panel")
    output: Annotated[str, Meta(description="The video output that shows it.")] = ""


class DisplayFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A display for limen: panels in one room frame (metres, right-handed, y up)."""

    name: Annotated[str, Meta(min_length=1)]
    description: str = ""
    grids: list[Grid] = field(default_factory=list, name="grid")
    panels: list[PanelEntry] = field(default_factory=list, name="panel")
    meshes: list[MeshEntry] = field(default_factory=list, name="mesh")
    adjustments: list[Adjustment] = field(default_factory=list, name="adjust")
    luminance_cd_m2: Annotated[
        float, Meta(description="Luminance of white, cd/m2, of all panels that say nothing else.")
    ] = WHITE_CD_M2
    quilts: list[QuiltEntry] = field(default_factory=list, name="quilt")


def schema() -> dict[str, Any]:
    """JSON Schema of a display file; ``display.schema.json`` beside this module is this, written out."""
    return schema_of(DisplayFile)
