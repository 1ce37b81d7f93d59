"""What ``limen info`` and ``limen ingest`` say to people about terrains."""

from __future__ import annotations

import re

import limen.data
from limen.cli.output import Output

__all__ = ["tell_terrain"]

_NAME = re.compile(r'^[A-Z]+\["([^"]+)"')


def tell_terrain(out: Output, found: limen.data.TerrainInfo, amount: str) -> None:
    """``amount`` is the size on disk, for people."""
    out.result(found)
    width, height = found.size
    out.line(f"{found.path}: {found.kind}, {found.format}, {amount}")
    across, along = found.spacing_m
    kilometres = f"{width * across / 1000:.4g} x {height * along / 1000:.4g} km"
    out.line(f"  {width} x {height} posts, {across:.6g} x {along:.6g} m apart, {kilometres}")
    name = _NAME.match(found.crs)
    out.line(f"  coordinates: {name[1] if name else 'none'}{_bounds(found.bounds)}")
    if found.height_range_m is not None:
        low_m, high_m = found.height_range_m
        out.line(f"  heights: {low_m:.6g} to {high_m:.6g} m{'' if found.exact else ', rounded'}")
    if found.void_share:
        out.line(f"  without data: {100 * found.void_share:.3g} % of the posts")
    for note in found.notes:
        out.line(f"  {note}")
    if not found.ready:
        out.line("  not made ready yet: limen ingest makes a .terrain of it")
        return
    out.line(f"  {found.nodes:,} nodes, {found.patches:,} patches, {len(found.levels)} levels of pages")
    rows = [(f"{error_m:.4g}", f"{count:,}") for error_m, count in zip(found.errors_m, found.triangles, strict=True)]
    out.table("", ("error in m", "triangles of the whole"), rows)


def _bounds(bounds: tuple[float, ...] | None) -> str:
    if bounds is None:
        return ""
    west, south, east, north = (f"{edge:.8g}" for edge in bounds)
    return f", {west} to {east} and {south} to {north}"
