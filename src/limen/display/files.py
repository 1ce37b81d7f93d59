"""Display files: TOML, checked field by field, with a JSON Schema that editors can use."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files as resource_files
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tomli_w
from msgspec import Meta, field

from limen.display.grid import (
    WHITE_CD_M2,
    Falloff,
    Gain,
    Grid,
    Luminance,
    NotNegative,
    Side,
    panel_of_corners,
    panels_of_grid,
)
from limen.display.panel import Panel
from limen.errors import DisplayError, FormatError, MissingFileError

__all__ = ["DisplayFile", "preset_names", "preset_path", "read", "schema", "write"]


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


class DisplayFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A display for limen: panels in one room frame (metres, right-handed, y up)."""

    name: Annotated[str, Meta(min_length=1)]
    description: str = ""
    grids: list[Grid] = field(default_factory=list, name="grid")
    panels: list[PanelEntry] = field(default_factory=list, name="panel")
    adjustments: list[Adjustment] = field(default_factory=list, name="adjust")
    luminance_cd_m2: Annotated[
        float, Meta(description="Luminance of white, cd/m2, of all panels that say nothing else.")
    ] = WHITE_CD_M2


def read(path: Path) -> tuple[str, tuple[Panel, ...], str]:
    """Name, panels and description from a display file.

    Raises
    ------
    MissingFileError, FormatError, DisplayError
        See `limen.Display.load`.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such display file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as a text file: {error}") from None
    content = _parse(path, text)
    try:
        panels = _panels(content)
    except DisplayError as error:
        raise DisplayError(f"{path}: {error}") from None
    return content.name, panels, content.description


def write(name: str, panels: tuple[Panel, ...], description: str = "") -> str:
    """A display file with every panel written out."""
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
    content = DisplayFile(name=name, description=description, panels=entries)
    return tomli_w.dumps(msgspec.to_builtins(content))


def schema() -> dict[str, Any]:
    """JSON Schema of a display file; ``display.schema.json`` beside this module is this, written out."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(DisplayFile)}


@cache
def preset_names() -> tuple[str, ...]:
    """Names of the displays that limen brings along."""
    folder = resource_files("limen.display") / "presets"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def preset_path(name: str) -> Path:
    return Path(str(resource_files("limen.display") / "presets" / f"{name}.toml"))


def _tuple3(values: list[float]) -> tuple[float, float, float]:
    return (values[0], values[1], values[2])


def _parse(path: Path, text: str) -> DisplayFile:
    try:
        return msgspec.convert(tomllib.loads(text), DisplayFile)
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"{path}: not valid TOML: {error}") from None
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `")
        where = where.rstrip("`")
        line = _line_of(text, where, message)
        raise FormatError(
            f"{path}:{line}: {message}" + (f" (field {where.removeprefix('$.')})" if where else "")
        ) from None


def _line_of(text: str, where: str, message: str) -> int:
    """The line that msgspec's path (``$.grid[1].size_px[0]``) points at; of its table, if the key is missing."""
    parts = re.findall(r"\.(\w+)|\[(\d+)\]", where)
    unknown = re.search(r"unknown field `(\w+)`", message)
    keys = [name for name, _ in parts if name] + ([unknown[1]] if unknown else [])
    index = next((int(number) for _, number in parts if number), 0)
    lines = text.splitlines()
    start, end = 0, len(lines)
    if keys and keys[0] in ("grid", "panel", "adjust"):
        tables = [number for number, line in enumerate(lines) if re.match(rf"\s*\[\[\s*{keys[0]}\s*\]\]", line)]
        if index < len(tables):
            start = tables[index]
            end = next((n for n in range(start + 1, end) if lines[n].lstrip().startswith("[[")), end)
            keys = keys[1:]
    for key in keys[:1]:
        for number in range(start, end):
            if re.match(rf"\s*{key}\s*=", lines[number]):
                return number + 1
    return start + 1


def _panels(content: DisplayFile) -> tuple[Panel, ...]:
    if not (content.grids or content.panels):
        raise DisplayError("no panels: add a [[grid]] or a [[panel]]")
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
