"""``limen display``: check, list, draw and convert a display."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from limen.cli.output import DEFAULT, Common, Output
from limen.data.store.atomic import write_bytes
from limen.display.display import Display
from limen.display.packing import lit_fill, pack_outlines
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.pictures.files import write_picture
from limen.pictures.quilts import draw_quilts
from limen.pictures.room import draw_room
from limen.vision.acuity import HUMAN_ARCMIN, SNELLEN_ARCMIN, optimal_distance_m

__all__ = ["display"]


class PanelRow(msgspec.Struct):
    name: str
    size_px: tuple[int, int]
    size_m: tuple[float, float]
    pitch_m: float
    optimal_distance_m: float  # at one arcminute, as in the papers
    optimal_distance_human_m: float
    centre_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    node: str
    luminance_cd_m2: float  # of white


class QuiltRow(msgspec.Struct):
    size_px: tuple[int, int]
    panels: int
    fill: float  # share that lies inside lit outlines
    output: str


class DisplayReport(msgspec.Struct):
    name: str
    description: str
    panels: list[PanelRow]
    total_px: int
    surface_m: tuple[float, float]
    nodes: int
    picture: str | None = None
    toml: str | None = None
    quilts: list[QuiltRow] | None = None


def display(
    display: Annotated[str, Parameter(help="A preset's name, a display file (TOML), or a mesh (OBJ, PLY, OFF, STL).")],
    /,
    *,
    ppi: Annotated[float | None, Parameter(help="Pixels per inch of a mesh's panels.")] = None,
    scale: Annotated[float | None, Parameter(help="Metres per unit of a mesh.")] = None,
    inside: Annotated[bool, Parameter(negative="", help="Look at a mesh's panels from the other side.")] = False,
    quilt: Annotated[
        bool,
        Parameter(
            negative="",
            help="The display's quilts, or the panels of each node packed; --picture draws them, --to-toml keeps them.",
        ),
    ] = False,
    picture: Annotated[Path | None, Parameter(help="Draw the room to this file (.png, .jpg).")] = None,
    to_toml: Annotated[Path | None, Parameter(help="Write the display with every panel spelled out.")] = None,
    common: Common = DEFAULT,
) -> None:
    """Check, list, draw or convert a display."""
    out = Output(common)
    chosen = Display.named(display, ppi=ppi, scale=scale, inward=inside)
    report = _report(chosen)
    packed = _quilts(chosen) if quilt else []
    if quilt:
        report.quilts = [
            QuiltRow(each.size_px, len(each.panels), lit_fill(chosen, each), each.output) for each in packed
        ]
    if picture is not None:
        write_picture(picture, draw_quilts(chosen, packed) if quilt else draw_room(chosen))
        report.picture = str(picture)
    if to_toml is not None:
        write_bytes(to_toml, chosen.to_toml(packed or None).encode())
        report.toml = str(to_toml)
    _print(out, chosen, report)
    out.result(report)


def _quilts(chosen: Display) -> list[Quilt]:
    """Those that the display's file names, or else of every node, within what the smallest common GPUs draw."""
    if chosen.quilts:
        return list(chosen.quilts)
    index = {panel.name: number for number, panel in enumerate(chosen.panels)}
    nodes = chosen.nodes.values()
    return [
        each
        for names in nodes
        for each in pack_outlines(chosen, max_size_px=16_384, max_px=1 << 27, panels=[index[n] for n in names])
    ]


def _report(chosen: Display) -> DisplayReport:
    surface = chosen.surface
    return DisplayReport(
        name=chosen.name,
        description=chosen.description,
        panels=[_row(panel) for panel in chosen.panels],
        total_px=chosen.total_px,
        surface_m=(surface.width, surface.height),
        nodes=len(chosen.nodes),
    )


def _row(panel: Panel) -> PanelRow:
    centre = panel.centre_m
    pitch = panel.pitch_m[0]
    return PanelRow(
        name=panel.name,
        size_px=panel.size_px,
        size_m=panel.size_m,
        pitch_m=pitch,
        optimal_distance_m=optimal_distance_m(pitch, SNELLEN_ARCMIN),
        optimal_distance_human_m=optimal_distance_m(pitch, HUMAN_ARCMIN),
        centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
        normal=panel.normal,
        node=panel.node,
        luminance_cd_m2=panel.luminance_cd_m2,
    )


def _span(values: list[float]) -> str:
    least, most = min(values), max(values)
    return f"{least:g}" if least == most else f"{least:g}..{most:g}"


def _print(out: Output, chosen: Display, report: DisplayReport) -> None:
    columns = ["panel", "pixels", "size m", "pitch mm", "Dopt m", "white cd/m2", "node"]
    rows = []
    for grid, panels in chosen.grids().items():
        # A wall of equal panels is one line; -v shows them all.
        listed = panels if out.common.verbose else panels[:1]
        for panel in listed:
            row = _row(panel)
            name = panel.name if out.common.verbose or len(panels) == 1 else f"{grid}/*  x {len(panels)}"
            nodes = sorted({each.node for each in panels} - {""})
            node = (
                panel.node if out.common.verbose else (f"{nodes[0]}..{nodes[-1]}" if len(nodes) > 1 else "".join(nodes))
            )
            rows.append(
                (
                    name,
                    f"{row.size_px[0]} x {row.size_px[1]}",
                    f"{row.size_m[0]:.3f} x {row.size_m[1]:.3f}",
                    f"{row.pitch_m * 1000:.4f}",
                    f"{row.optimal_distance_m:.2f} {row.optimal_distance_human_m:.2f}",
                    _span([each.luminance_cd_m2 for each in (panels if len(listed) == 1 else [panel])]),
                    node,
                )
            )
    out.line(f"{report.name}: {report.description}" if report.description else report.name)
    out.table("", columns, rows)
    if report.quilts is not None:
        quilts = [
            (q.output or f"{n}", f"{q.size_px[0]} x {q.size_px[1]}", q.panels, f"{q.fill:.1%}")
            for n, q in enumerate(report.quilts)
        ]
        out.table("", ["quilt", "pixels", "panels", "fill"], quilts)
    width, height = report.surface_m
    out.line(
        f"{len(chosen.panels)} panels, {report.total_px / 1e6:,.1f} megapixels, "
        f"unrolled surface {width:.2f} x {height:.2f} m"
    )
    out.line(f"Dopt: where one pixel subtends {SNELLEN_ARCMIN:g} and {HUMAN_ARCMIN:g} arcminutes")
    for label, path in (("picture", report.picture), ("display file", report.toml)):
        if path:
            out.line(f"{label}: {path}")
