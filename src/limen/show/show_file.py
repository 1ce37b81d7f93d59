"""Show files: TOML with a table for each layer, checked field by field, with a JSON Schema that editors can use."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from limen.data.opening import open_content, open_picture
from limen.data.samples.mesh import ripple
from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.errors import FormatError, InputError, LimenError
from limen.gpu.targets import Rgb
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import FoldTree
from limen.layers.points.layer import PointsLayer
from limen.layers.registry import KINDS, check_state
from limen.layers.terrain.layer import Draped, TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.selector import TerrainSettings
from limen.show.entries import (
    AnyEntry,
    ImageEntry,
    LensEntry,
    ModelEntry,
    PointsEntry,
    RoomEntry,
    ShowFile,
    TerrainEntry,
)
from limen.show.show import Show
from limen.typed_toml import line_of, read_text, typed
from limen.viewing.lens import Lens
from limen.viewing.placement import InRoom, LookAt, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.tessellation import Tessellation

__all__ = ["is_show_file", "light_of", "open_show"]

_ORIGIN = (0.0, 0.0, 0.0)


def is_show_file(path: Path) -> bool:
    """Whether a path is named as show files are."""
    return path.suffix.lower() == ".toml"


def open_show(
    path: Path, whole: Display | None, stack: ExitStack, progress: Callable[[Path, float], None] = lambda *_: None
) -> Show:
    """The show of a file, with all its contents opened.

    Parameters
    ----------
    whole
        The installation that it is shown on; None where a window is the display.
    stack
        Closes what has been opened.
    progress
        Told of contents that are made ready: the file, and how much of it is done, 0 to 1.

    Raises
    ------
    MissingFileError, FormatError
        If there is no such file, or it is no show file: with line and field.
    InputError
        For what cannot be shown, with the line of its layer.
    """
    text = read_text(path, "show file")
    file = typed(path, text, ShowFile)
    reference_m = standing_viewer(whole).position_m if whole else _ORIGIN
    layers = []
    for number, entry in enumerate(file.layers):
        maker = _Maker(path.parent, reference_m, stack, progress)
        try:
            layers.append(maker.layer(entry))
        except LimenError as error:
            raise type(error)(f"{path}:{line_of(text, f'$.layer[{number}].content')}: {error}") from None
    fixed = reference_m if file.camera == "fixed" else None
    light = light_of(file.background) if file.background else None
    return Show(layers, whole, stereo=file.stereo, background=light, eye_m=fixed, title=file.title)


def light_of(colour: str) -> Rgb:
    """Linear light of a colour as ``#rrggbb``.

    >>> light_of("#ffffff")
    (1.0, 1.0, 1.0)

    Raises
    ------
    InputError
        If it is none.
    """
    digits = colour.removeprefix("#")
    try:
        codes = np.array(list(bytes.fromhex(digits))) / 255.0
    except ValueError:
        codes = np.zeros(0)
    if len(digits) != 6 or len(codes) != 3:
        raise InputError(f"a colour is written as #rrggbb, got '{colour}'")
    red, green, blue = (float(light) for light in linear_of_srgb(codes))
    return (red, green, blue)


@dataclass(frozen=True, slots=True)
class _Maker:
    """Makes layers of a show file's tables."""

    folder: Path
    reference_m: tuple[float, float, float]
    stack: ExitStack
    progress: Callable[[Path, float], None]

    def layer(self, entry: AnyEntry) -> Layer:
        """Raises LimenError for what cannot be opened or shown."""
        path = self.folder / entry.content
        content: Any = open_content(path, progress=partial(self.progress, path))
        if hasattr(content, "close"):
            self.stack.callback(content.close)
        kind = type(entry).__struct_config__.tag
        if content.kind != kind:
            raise FormatError(f'{path} is {KINDS[content.kind].noun}: write kind = "{content.kind}"')
        policy = Policy.parse(entry.policy or KINDS[content.kind].default_policy, entry.acuity_arcmin)
        match entry:
            case ImageEntry():
                layer: Layer = self._image(entry, content, policy)
            case ModelEntry():
                layer = self._mesh(entry, content, policy)
            case PointsEntry():
                stands = _stands(entry.placement, content.up, content.tilt_deg)
                layer = PointsLayer(content, stands, policy, entry.style.lit, entry.style.splats, overlay=entry.overlay)
            case TerrainEntry():
                layer = self._terrain(entry, content, policy)
        check_state(KINDS[content.kind], layer.state(0.0, _ANY_DISPLAY))
        return layer

    def _image(self, entry: ImageEntry, image: Any, policy: Policy) -> ImageLayer:
        placed = entry.placement
        still = tuple(_lens(lens) for lens in placed.lenses if lens.centre_px is not None)
        carried = tuple(_lens(lens) for lens in placed.lenses if lens.centre_px is None)
        placement = OnSurface(placed.fit, placed.zoom, placed.centre, still, Tessellation(placed.lens_mode), carried)
        return ImageLayer(image, placement, policy, overlay=entry.overlay)

    def _mesh(self, entry: ModelEntry, mesh: Any, policy: Policy) -> MeshLayer:
        tree = None
        if policy.name != "full":
            from limen.data.mesh.store import tree_of  # Numba and SciPy take a second

            tree = FoldTree(tree_of(mesh))
        stands, deformed = _stands(entry.placement), partial(ripple, mesh) if entry.style.rippling else None
        return MeshLayer(mesh, stands, policy, tree, deformed=deformed, depth=entry.style.depth, overlay=entry.overlay)

    def _terrain(self, entry: TerrainEntry, terrain: Any, policy: Policy) -> TerrainLayer:
        seen, style = entry.placement, entry.style
        look_at = LookAt(seen.target, seen.heading_deg, seen.pitch_deg, seen.range_m, seen.exaggeration)
        settings = TerrainSettings(look_at, seen.flight, style.cut, style.rule, style.field_deg, style.max_triangles)
        colours = style.colours or ("drape" if style.drape else "hypsometric")
        if (colours == "drape") != bool(style.drape):
            raise InputError('a drape is seen with colours = "drape", and these need one: give both, or neither')
        look = TerrainLook(
            colours, style.sun_azimuth_deg, style.sun_altitude_deg, contour_interval_m=style.contour_interval_m
        )
        draped = self._draped(style.drape, terrain) if style.drape else None
        return TerrainLayer(terrain, look, settings, policy, self.reference_m, draped, entry.overlay)

    def _draped(self, name: str, terrain: Any) -> Draped:
        from limen.data.terrain.drape import texel_from_post  # GDAL takes a quarter of a second

        path = self.folder / name
        image = self.stack.enter_context(open_picture(path))
        return Draped(image, texel_from_post(terrain, path, image.size_px))


_ANY_DISPLAY = Display.window((64, 64))


def _stands(entry: RoomEntry, up: Any = "y", tilt_deg: float = 0.0) -> RoomPlacement:
    """``up`` and ``tilt_deg`` are for where the entry does not say."""
    if entry.matrix is not None:
        others = RoomEntry(matrix=entry.matrix)
        if entry != others:
            raise InputError("a placement by matrix says all: leave out its other fields")
        return RoomPlacement(matrix=InRoom.of(entry.matrix).matrix)
    tilt_deg = tilt_deg if entry.tilt_deg is None else entry.tilt_deg
    return RoomPlacement(entry.size_m, entry.at_m, entry.up or up, entry.turn_deg, tilt_deg, entry.turning)


def _lens(entry: LensEntry) -> Lens:
    centre_px = entry.centre_px or (0.0, 0.0)
    return Lens(centre_px, entry.radius_px, entry.magnification, entry.focus, entry.drop_off, entry.shape)
