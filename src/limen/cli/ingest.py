"""``limen ingest``: make an image, a terrain, points or a mesh ready."""

from __future__ import annotations

from pathlib import Path

import limen.data
from limen.cli.heard import given_options
from limen.cli.output import DEFAULT, Common, Output
from limen.data.mesh.mesh_type import is_mesh
from limen.data.points.cloud_type import is_points
from limen.data.terrain.elevation_type import is_terrain
from limen.errors import InputError

__all__ = ["ingest"]

_QUALITY, _SUBSAMPLING = 90, "444"


def ingest(
    src: Path,
    dst: Path,
    *,
    quality: int = _QUALITY,
    subsampling: str = _SUBSAMPLING,
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
        Of an image's JPEG tiles, 1 to 100.
    subsampling
        Of their colours: 444, 422 or 420.
    band
        Which band of the raster holds the heights, from 1.
    spacing_m
        Metres between its posts, where the file does not say it or is wrong.
    """
    given = given_options(ingest, locals())
    out = Output(common)
    kind = dst.suffix.lower()
    of_images = [option for option in ("--quality", "--subsampling") if option in given]
    if of_images and kind in (".terrain", ".points", ".mesh"):
        raise InputError(f"{of_images[0]} is of images: leave it out, anything else is kept as it is")
    if kind == ".terrain":
        _terrain(out, src, dst, band, spacing_m)
        return
    of_terrains = [option for option in ("--band", "--spacing-m") if option in given]
    if of_terrains:
        raise InputError(f"{of_terrains[0]} is of terrains: name DST so: {dst.with_suffix('.terrain')}")
    if kind == ".points":
        _points(out, src, dst)
        return
    if kind == ".mesh":
        _mesh(out, src, dst)
        return
    if is_points(src):
        raise InputError(f"{src}: holds points; to make them ready, name DST so: {dst.with_suffix('.points')}")
    if is_terrain(src):
        raise InputError(f"{src}: holds heights; to make a terrain of it, name DST so: {dst.with_suffix('.terrain')}")
    if is_mesh(src):
        raise InputError(f"{src}: holds a mesh; to make it ready, name DST so: {dst.with_suffix('.mesh')}")
    with out.progress(f"reading {src.name}", 1000) as step:
        report = limen.data.ingest(
            src, dst, quality=quality, subsampling=subsampling, progress=lambda done: step.to(round(1000 * done))
        )
    out.result(report)
    out.line(
        f"{report.path}: {report.size[0]} x {report.size[1]} texels, {report.pages} pages, {report.bytes:,} bytes, "
        f"in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )


def _terrain(out: Output, src: Path, dst: Path, band: int | None, spacing_m: float | None) -> None:
    with out.progress(f"reading {src.name}", 1000) as step:
        report = limen.data.ingest_terrain(
            src, dst, band=band, spacing_m=spacing_m, progress=lambda done: step.to(round(1000 * done))
        )
    for note in report.notes:
        out.say(f"{src}: {note}")
    out.result(report)
    out.line(
        f"{report.path}: {report.size[0]} x {report.size[1]} posts, {report.triangles:,} triangles at an error of "
        f"{report.error_m:.3g} m, {report.bytes:,} bytes, in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )


def _points(out: Output, src: Path, dst: Path) -> None:
    with out.progress(f"reading {src.name}", 1000) as step:
        report = limen.data.ingest_points(src, dst, progress=lambda done: step.to(round(1000 * done)))
    for note in report.notes:
        out.say(f"{src}: {note}")
    out.result(report)
    out.line(
        f"{report.path}: {report.size:,} points in {report.chunks:,} chunks, {report.bytes:,} bytes, "
        f"in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )


def _mesh(out: Output, src: Path, dst: Path) -> None:
    with out.progress(f"reading {src.name}", 1) as step:
        report = limen.data.ingest_mesh(src, dst)
        step(1)
    out.result(report)
    out.line(
        f"{report.path}: {report.size:,} triangles, {report.vertices:,} vertices in a tree of {report.nodes:,} nodes, "
        f"{report.bytes:,} bytes, in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )
