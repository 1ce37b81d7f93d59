"""``limen info``: what a file is."""

from __future__ import annotations

from pathlib import Path

from limen.cli.output import DEFAULT, Common, Output
from limen.data import opening

__all__ = ["info"]


def info(file: Path, *, common: Common = DEFAULT) -> None:
    """What a file is: kind, size, and what it holds.

    Parameters
    ----------
    file
        An image (pyramidal TIFF, slide, Deep Zoom, or any picture), a mesh (PLY, OBJ, GLB, STL, ...), a raster of
        heights (GeoTIFF, COG, VRT, HGT, ASC, ...), a cloud of points (LAS, LAZ, COPC, E57, PLY without faces), or the
        folder of a terrain, points or a mesh that were made ready.
    """
    out = Output(common)
    found = opening.info(file)
    out.result(found)
    told = found.described()
    out.line(f"{found.path or file}: {found.kind}, {told.summary}")
    out.facts(told.facts)
    for note in told.notes:
        out.line(f"  {note}")
    if told.columns:
        out.table("", told.columns, told.rows)
