"""``limen ingest``: make an image, a terrain, points or a mesh ready."""

from __future__ import annotations

from pathlib import Path

from limen.cli.output import DEFAULT, Common, Output
from limen.data import opening

__all__ = ["ingest"]


def ingest(
    src: Path,
    dst: Path,
    *,
    quality: int | None = None,
    subsampling: str | None = None,
    band: int | None = None,
    spacing_m: float | None = None,
    common: Common = DEFAULT,
) -> None:
    """Make an image, a terrain, points or a mesh ready: a tiled TIFF with all reduced levels, or a folder of its own.

    Memory stays bounded for any size, but of a mesh. DST appears only when it is complete.

    Parameters
    ----------
    src
        Any image that can be read, a raster of heights (GeoTIFF, COG, VRT, HGT, ASC, ...), or a cloud of points (LAS,
        LAZ, COPC, E57, PLY without faces), or a mesh (PLY, OBJ, GLB, STL, ...).
    dst
        What to write: NAME.tif for an image, NAME.terrain for heights, NAME.points for points, NAME.mesh for a mesh.
    quality
        Of an image's JPEG tiles, 1 to 100 (90).
    subsampling
        Of their colours: 444, 422 or 420 (444).
    band
        Which band of the raster holds the heights, from 1.
    spacing_m
        Metres between its posts, where the file does not say it or is wrong.
    """
    out = Output(common)
    asked = {"quality": quality, "subsampling": subsampling, "band": band, "spacing_m": spacing_m}
    given = {name: value for name, value in asked.items() if value is not None}
    with out.progress(f"reading {src.name}", 1000) as step:
        report = opening.ingest(src, dst, progress=lambda done: step.to(round(1000 * done)), **given)
    for note in report.notes:
        out.say(f"{src}: {note}")
    out.report(report, opening.KINDS[report.kind].items)
