"""Options of content that is a terrain."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from limen.errors import InputError
from limen.layers.terrain.look import Colours, TerrainLook
from limen.layers.terrain.look_at import Flight
from limen.viewing.choices import CameraKind, Mode
from limen.viewing.panel_demands import Rule
from limen.viewing.placement import LookAt

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain
    from limen.layers.terrain.layer import Draped
    from limen.layers.terrain.selector import TerrainSettings

__all__ = ["TERRAIN_DEFAULT", "TerrainOptions"]


@Parameter(name="*", group=Group("Terrains"))
@dataclass(frozen=True, slots=True)
class TerrainOptions:
    """Options of content that is a terrain."""

    target: Annotated[
        str, Parameter(help="X,Y of the place in the middle: 0 to 1 from the west and from the north edge.")
    ] = "0.5,0.5"
    heading_deg: Annotated[
        float, Parameter(allow_leading_hyphen=True, help="Where the camera looks, clockwise from north.")
    ] = 0.0
    pitch_deg: Annotated[float, Parameter(help="How far it looks down: 90 is a map.")] = 40.0
    range_m: Annotated[float | None, Parameter(help="How far it is from the target; if not given, all is seen.")] = None
    exaggeration: Annotated[float, Parameter(help="Heights are multiplied by it.")] = 1.0
    flight: Annotated[Flight, Parameter(help="orbit: around the target. traverse: low over all of it.")] = "none"
    camera: Annotated[
        CameraKind,
        Parameter(
            help="window: panels are windows for the first viewer. fixed: one picture for the whole display, whose "
            "detail viewers decide about."
        ),
    ] = "window"
    cut: Annotated[
        Mode, Parameter(help="adaptive: the fewest triangles. level: one error in metres for each panel.")
    ] = "adaptive"
    rule: Annotated[
        Rule, Parameter(help="A panel's angle from the line of sight: the smallest of any place, or its middle's.")
    ] = "exact"
    field_deg: Annotated[
        float | None, Parameter(help="Panels beyond this angle are not drawn; if not given, the policy's own limit.")
    ] = None
    colours: Annotated[Colours | None, Parameter(help="By height unless there is a --drape.")] = None
    drape: Annotated[Path | None, Parameter(help="An image that lies on the terrain.")] = None
    contours: Annotated[str, Parameter(help="Metres between contour lines, 'auto', or 0 for none.")] = "0"
    sun_azimuth_deg: Annotated[float, Parameter(allow_leading_hyphen=True, help="Clockwise from north.")] = 315.0
    sun_altitude_deg: Annotated[float, Parameter(help="Above the horizon.")] = 45.0

    def settings(self, max_triangles: int | None) -> TerrainSettings:
        """From where it is looked at, and how detail is chosen; raises InputError for what cannot be."""
        from limen.layers.terrain.selector import TerrainSettings

        look_at = LookAt(_pair(self.target), self.heading_deg, self.pitch_deg, self.range_m, self.exaggeration)
        return TerrainSettings(look_at, self.flight, self.cut, self.rule, self.field_deg, max_triangles)

    def look(self) -> TerrainLook:
        """Its colours and light; raises InputError for what cannot be."""
        colours = self.colours or ("drape" if self.drape else "hypsometric")
        interval = _interval(self.contours)
        return TerrainLook(colours, self.sun_azimuth_deg, self.sun_altitude_deg, contour_interval_m=interval)

    @contextmanager
    def draped(self, terrain: Terrain) -> Iterator[Draped | None]:
        """The image that lies on a terrain, opened."""
        if self.drape is None:
            if self.colours == "drape":
                raise InputError("--colours drape needs --drape IMAGE")
            yield None
            return
        if self.colours not in (None, "drape"):
            raise InputError(f"--colours {self.colours} would hide the --drape: leave out one of them")
        from limen.data.opening import open_picture
        from limen.data.terrain.drape import texel_from_post  # GDAL takes a quarter of a second
        from limen.layers.terrain.layer import Draped

        with open_picture(self.drape) as image:
            yield Draped(image, texel_from_post(terrain, self.drape, image.size_px))


TERRAIN_DEFAULT = TerrainOptions()


def _interval(text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--contours takes metres, 'auto' or 0, got '{text}'") from None


def _pair(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--target takes two numbers from 0 to 1, X,Y, got '{text}'") from None
    return x, y
