"""Display files: TOML, checked field by field, with a JSON Schema that editors can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files as resource_files
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec
import tomli_w

from limen.display import shapes
from limen.display.entries import Adjustment, DisplayFile, MeshEntry, PanelEntry, QuiltEntry, QuiltPanel, schema
from limen.display.grid import panel_of_corners, panels_of_grid
from limen.display.mesh import panels_of_mesh, room_from_mesh
from limen.display.meshfile import read_mesh
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import DisplayError
from limen.typed_toml import read_text, typed
from limen.units import inch_to_m

__all__ = ["DisplayFields", "DisplayFile", "mesh_panels", "preset_names", "preset_path", "read", "schema", "write"]


class DisplayFields(NamedTuple):
    """What a display file says: the fields of a `limen.Display`."""

    name: str
    panels: tuple[Panel, ...]
    description: str
    quilts: tuple[Quilt, ...]


def read(path: Path) -> DisplayFields:
    """What a display file says.

    Raises
    ------
    MissingFileError, FormatError, DisplayError
        See `limen.Display.load`.
    """
    content = typed(path, read_text(path, "display file"), DisplayFile)
    try:
        panels = _panels(content, path.parent)
        quilts = _quilts(content, panels)
    except DisplayError as error:
        raise DisplayError(f"{path}: {error}") from None
    return DisplayFields(content.name, panels, content.description, quilts)


def write(name: str, panels: tuple[Panel, ...], description: str = "", quilts: Sequence[Quilt] = ()) -> str:
    """A display file with every panel written out, and where each lies in quilts."""
    entries = [
        PanelEntry(
            name=panel.name,
            size_px=panel.size_px,
            corners_m=[_tuple3(corner) for corner in panel.corners_m.tolist()],
            surface_m=panel.surface_m,
            outline_px=list(panel.outline_px),
            nudge_px=panel.nudge_px,
            node=panel.node,
            luminance_cd_m2=panel.luminance_cd_m2,
            gain=panel.gain,
            falloff=panel.falloff,
            bezel_mm=panel.bezel_m * 1000,
        )
        for panel in panels
    ]
    mapping = [
        QuiltEntry(
            size_px=quilt.size_px,
            panels=[
                QuiltPanel(panels[index].name, offset, _degrees(turn))
                for index, offset, turn in zip(quilt.panels, quilt.offsets_px, quilt.quarter_turns, strict=True)
            ],
            output=quilt.output,
        )
        for quilt in quilts
    ]
    content = DisplayFile(name=name, description=description, panels=entries, quilts=mapping)
    return tomli_w.dumps(msgspec.to_builtins(content))


@cache
def preset_names() -> tuple[str, ...]:
    """Names of the displays that limen brings along."""
    folder = resource_files("limen.display") / "presets"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def preset_path(name: str) -> Path:
    return Path(str(resource_files("limen.display") / "presets" / f"{name}.toml"))


def _tuple3(values: list[float]) -> tuple[float, float, float]:
    return (values[0], values[1], values[2])


def _panels(content: DisplayFile, folder: Path = Path()) -> tuple[Panel, ...]:
    if not (content.grids or content.panels or content.meshes):
        raise DisplayError("no panels: add a [[grid]], a [[panel]] or a [[mesh]]")
    panels: list[Panel] = []
    edge = 0.0  # where the next wall begins on the unrolled surface
    for grid in content.grids:
        panels += panels_of_grid(grid, edge, content.luminance_cd_m2)
        edge = max(panel.surface_m[0] + panel.size_m[0] for panel in panels)
    for entry in content.panels:
        white = content.luminance_cd_m2 if entry.luminance_cd_m2 is None else entry.luminance_cd_m2
        panels.append(
            panel_of_corners(
                entry.name,
                entry.size_px,
                entry.corners_m,
                surface_m=entry.surface_m or (edge, 0.0),
                outline_px=tuple(entry.outline_px),
                nudge_px=entry.nudge_px,
                node=entry.node,
                luminance_cd_m2=white,
                gain=entry.gain,
                falloff=entry.falloff,
                bezel_m=entry.bezel_mm / 1000,
            )
        )
        edge = max(edge, panels[-1].surface_m[0] + panels[-1].size_m[0])
    for mesh in content.meshes:
        panels += mesh_panels(mesh, folder, surface_left_m=edge, luminance_cd_m2=content.luminance_cd_m2)
        edge = max(panel.surface_m[0] + panel.size_m[0] for panel in panels)
    for adjustment in content.adjustments:
        if not any(fnmatchcase(panel.name, adjustment.panels) for panel in panels):
            raise DisplayError(
                f"[[adjust]] panels = '{adjustment.panels}' matches no panel; a name looks like '{panels[0].name}'"
            )
    return tuple(_adjusted(panel, content.adjustments) for panel in panels)


def _adjusted(panel: Panel, adjustments: list[Adjustment]) -> Panel:
    for adjustment in adjustments:
        if fnmatchcase(panel.name, adjustment.panels):
            fields = ("nudge_px", "node", "luminance_cd_m2", "gain", "falloff")
            given = {name: getattr(adjustment, name) for name in fields if getattr(adjustment, name) is not None}
            if adjustment.bezel_mm is not None:
                given["bezel_m"] = adjustment.bezel_mm / 1000
            panel = replace(panel, **given)
    return panel


def mesh_panels(
    entry: MeshEntry, folder: Path, *, surface_left_m: float = 0.0, luminance_cd_m2: float = 100.0
) -> list[Panel]:
    """The panels of a mesh; ``folder`` is where its file is looked for.

    Raises
    ------
    MissingFileError, FormatError
        If its file is not there or cannot be read.
    DisplayError
        If it does not say what to show and how finely, exactly once, or a face cannot be a panel.
    """
    what = f"mesh '{entry.name}'"
    if bool(entry.file) == bool(entry.shape):
        raise DisplayError(f"{what}: give a file or a shape, and not both")
    if (entry.ppi is None) == (entry.pitch_mm is None):
        raise DisplayError(f"{what}: give its resolution, as exactly one of ppi and pitch_mm")
    pitch_m = inch_to_m(1) / entry.ppi if entry.ppi is not None else (entry.pitch_mm or 0.0) / 1000
    if entry.parameters and not entry.shape:
        raise DisplayError(f"{what}: parameters are those of a shape, and this is a file")
    mesh = shapes.shape(entry.shape, **entry.parameters) if entry.shape else read_mesh(folder / entry.file)
    return panels_of_mesh(
        room_from_mesh(mesh, scale=entry.scale, up=entry.up, centre_m=entry.centre_m),
        entry.name,
        pitch_m,
        inward=entry.facing == "in",
        bezel_m=entry.bezel_mm / 1000,
        surface_left_m=surface_left_m,
        node=entry.node,
        luminance_cd_m2=luminance_cd_m2 if entry.luminance_cd_m2 is None else entry.luminance_cd_m2,
        gain=entry.gain,
        falloff=entry.falloff,
    )


def _quilts(content: DisplayFile, panels: tuple[Panel, ...]) -> tuple[Quilt, ...]:
    index = {panel.name: number for number, panel in enumerate(panels)}
    quilts = []
    for number, entry in enumerate(content.quilts):
        for each in entry.panels:
            if each.name not in index:
                raise DisplayError(f"[[quilt]] {number + 1} holds '{each.name}', and no panel has that name")
        quilts.append(
            Quilt(
                size_px=entry.size_px,
                panels=tuple(index[each.name] for each in entry.panels),
                offsets_px=tuple(each.offset_px for each in entry.panels),
                turns=tuple(each.turn_deg // 90 for each in entry.panels),
                output=entry.output,
            )
        )
    return tuple(quilts)


def _degrees(turn: int) -> Literal[0, 90, 180, 270]:
    degrees: tuple[Literal[0], Literal[90], Literal[180], Literal[270]] = (0, 90, 180, 270)
    return degrees[turn]
