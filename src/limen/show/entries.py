"""What a person writes in a show file: its tables, field by field."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta, field

from limen.layers.terrain.look import Colours
from limen.layers.terrain.look_at import Flight
from limen.typed_toml import schema_of
from limen.viewing.choices import CameraKind, Depth, Mode, Stereo
from limen.viewing.lens import DropOff
from limen.viewing.panel_demands import Rule
from limen.viewing.placement import Fit
from limen.viewing.tessellation import LensMode

__all__ = [
    "AnyEntry",
    "CameraEntry",
    "ImageEntry",
    "LensEntry",
    "ModelEntry",
    "PointsEntry",
    "RoomEntry",
    "ShowFile",
    "SurfaceEntry",
    "TerrainEntry",
    "schema",
]

Content = Annotated[str, Meta(min_length=1, description="The file, seen from the show file's folder.")]
PolicyName = Annotated[str, Meta(description="How viewers decide about its detail. Default: that of its kind.")]
Acuity = Annotated[str, Meta(description="Arcminutes, human or snellen: for policies that go by one.")]
Overlay = Annotated[str, Meta(description="What is shown over it.")]
Place3: TypeAlias = tuple[float, float, float]


class LensEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A lens on an image; measures are its texels."""

    radius_px: float
    centre_px: Annotated[tuple[float, float] | None, Meta(description="Default: where pointers point.")] = None
    magnification: float = 4.0
    focus: float = 0.4
    drop_off: DropOff = "cosine"
    shape: Literal["radial", "rectangular"] = "radial"


class SurfaceEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How an image lies on the unrolled surface."""

    fit: Fit = "contain"
    zoom: float = 1.0
    centre: Annotated[tuple[float, float], Meta(description="Of the image, what lies in the middle: 0 to 1.")] = (
        0.5,
        0.5,
    )
    lenses: tuple[LensEntry, ...] = field(default=(), name="lens")
    lens_mode: LensMode = "exact"


class RoomEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a mesh or points stand in the room."""

    size_m: Annotated[float | None, Meta(description="Its largest extent. Default: fitted to the display.")] = None
    at_m: Annotated[Place3 | None, Meta(description="Its middle. Default: inside or behind the display.")] = None
    up: Annotated[Literal["y", "z"] | None, Meta(description="Which of its axes points up.")] = None
    turn_deg: float = 0.0
    tilt_deg: float | None = None
    turning: Annotated[bool, Meta(description="Whether it turns as time passes.")] = False
    matrix: Annotated[
        list[list[float]] | None, Meta(description="In place of all else: (3, 4) or (4, 4), from it to the room.")
    ] = None


class CameraEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """From where a terrain is looked at."""

    target: tuple[float, float] = (0.5, 0.5)
    heading_deg: float = 0.0
    pitch_deg: float = 40.0
    range_m: float | None = None
    exaggeration: float = 1.0
    flight: Flight = "none"


class MeshStyle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a mesh looks."""

    depth: Depth = "panel"
    rippling: Annotated[bool, Meta(description="Whether it is deformed as time passes.")] = False


class PointsStyle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How points look."""

    lit: bool | None = None
    splats: Literal["round", "square"] = "round"


class TerrainStyle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a terrain looks, and how its detail is chosen."""

    colours: Colours | None = None
    drape: Annotated[str, Meta(description="An image that lies on it.")] = ""
    contour_interval_m: float | Literal["auto"] = 0.0
    sun_azimuth_deg: float = 315.0
    sun_altitude_deg: float = 45.0
    cut: Mode = "adaptive"
    rule: Rule = "exact"
    field_deg: float | None = None
    max_triangles: int | None = None


class ImageEntry(msgspec.Struct, tag="image", tag_field="kind", frozen=True, forbid_unknown_fields=True):
    """An image."""

    content: Content
    placement: SurfaceEntry = SurfaceEntry()
    policy: PolicyName = ""
    acuity_arcmin: Acuity = "human"
    overlay: Overlay = ""


class ModelEntry(msgspec.Struct, tag="mesh", tag_field="kind", frozen=True, forbid_unknown_fields=True):
    """A mesh."""

    content: Content
    placement: RoomEntry = RoomEntry()
    policy: PolicyName = ""
    acuity_arcmin: Acuity = "human"
    overlay: Overlay = ""
    style: MeshStyle = MeshStyle()


class PointsEntry(msgspec.Struct, tag="points", tag_field="kind", frozen=True, forbid_unknown_fields=True):
    """A cloud of points."""

    content: Content
    placement: RoomEntry = RoomEntry()
    policy: PolicyName = ""
    acuity_arcmin: Acuity = "human"
    overlay: Overlay = ""
    style: PointsStyle = PointsStyle()


class TerrainEntry(msgspec.Struct, tag="terrain", tag_field="kind", frozen=True, forbid_unknown_fields=True):
    """A terrain."""

    content: Content
    placement: CameraEntry = CameraEntry()
    policy: PolicyName = ""
    acuity_arcmin: Acuity = "human"
    overlay: Overlay = ""
    style: TerrainStyle = TerrainStyle()


AnyEntry: TypeAlias = ImageEntry | ModelEntry | PointsEntry | TerrainEntry


class ShowFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is shown, on whatever display."""

    layers: Annotated[
        list[AnyEntry], Meta(min_length=1, description="In the order in which images lie over each other.")
    ] = field(name="layer")
    title: str = ""
    stereo: Stereo = "none"
    background: Annotated[str, Meta(pattern="^(#[0-9a-fA-F]{6})?$", description="As #rrggbb.")] = ""
    camera: Annotated[
        CameraKind,
        Meta(description="window: for the first viewer's eye. fixed: for whom stands before the display."),
    ] = "window"


def schema() -> dict[str, Any]:
    """JSON Schema of a show file; ``show.schema.json`` beside this module is this, written out."""
    return schema_of(ShowFile)
