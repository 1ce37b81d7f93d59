"""``limen info``: what a file is."""

from __future__ import annotations

from pathlib import Path

import limen.data
from limen.cli.info_points import tell_points
from limen.cli.info_terrain import tell_terrain
from limen.cli.output import DEFAULT, Common, Output
from limen.data.points.cloud_type import is_points
from limen.data.terrain.elevation_type import is_terrain

__all__ = ["info"]


def info(file: Path, *, common: Common = DEFAULT) -> None:
    """What a file is: kind, size, and what it holds.

    Parameters
    ----------
    file
        An image (pyramidal TIFF, slide, Deep Zoom, or any picture), a mesh (PLY, OBJ, GLB, STL, ...), a raster of
        heights (GeoTIFF, COG, VRT, HGT, ASC, ...), a cloud of points (LAS, LAZ, COPC, E57, PLY without faces), or the
        folder of a terrain or of points that were made ready.
    """
    out = Output(common)
    if is_terrain(file):
        folder = file.suffix.lower() == ".terrain"
        described = limen.data.Terrain.open(file).info() if folder else limen.data.elevation_info(file)
        tell_terrain(out, described, _amount(described.bytes))
        return
    if is_points(file):
        cloud = limen.data.cloud_info(file)
        tell_points(out, cloud, _amount(cloud.bytes))
        return
    content = limen.data.open(file)
    if isinstance(content, limen.data.Mesh):
        _tell_mesh(out, content.info())
        return
    if isinstance(content, limen.data.Image):
        with content as image:
            _tell_image(out, image.info())


def _tell_mesh(out: Output, found: limen.data.MeshInfo) -> None:
    out.result(found)
    out.line(f"{found.path}: {found.kind}, {found.size:,} triangles, {found.vertices:,} vertices")
    for axis, low, high in zip("xyz", *found.bounds, strict=True):
        out.line(f"  {axis}: {low:.6g} to {high:.6g}, {high - low:.6g} in the file's unit")
    if found.texture_px is None:
        out.line("  no textures; colours of vertices")
    else:
        out.line(f"  textures: {found.textures}, kept as {found.texture_px[0]} x {found.texture_px[1]} texels")
    out.line(f"  {_amount(found.bytes)} in memory")


def _tell_image(out: Output, found: limen.data.ImageInfo) -> None:
    out.result(found)
    width, height = found.size
    stored = f"{found.format} ({found.compression}, {found.bits} bits), {_amount(found.bytes)}"
    out.line(f"{found.path}: {found.kind}, {stored}")
    gigapixels = width * height / 1e9
    out.line(f"  {width} x {height} texels, {gigapixels:.3f} gigapixels, {found.pages} pages of {found.page_px}")
    out.line(f"  colour: {found.colour}")
    where = "read in place" if found.in_place else "decoded into memory"
    tile = f"{found.tile_px[0]} x {found.tile_px[1]}"
    out.line(f"  tiles of {tile}, {where}; levels in the file: {len(found.file_levels)}")
    if found.mean_page_bytes is not None:
        out.line(f"  {_amount(found.mean_page_bytes)} a page at full resolution")
    out.line(f"  contrast that finer levels add, over 32 x 32 texels: {found.contrast}")
    edge = found.page_px
    rows = [(level, f"{w} x {h}", -(-w // edge) * -(-h // edge)) for level, (w, h) in enumerate(found.levels)]
    if found.faint_share is None:
        out.table("", ("level", "texels", "pages"), rows)
        return
    shares = ["", *(f"{100 * share:.1f} %" for share in found.faint_share)]
    table = [(*row, share) for row, share in zip(rows, shares, strict=True)]
    out.table("", ("level", "texels", "pages", "finer adds < 1 %"), table)


def _amount(size_bytes: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if size_bytes < 1000:
            return f"{size_bytes:.3g} {unit}"
        size_bytes /= 1000
    return f"{size_bytes:.3g} GB"
