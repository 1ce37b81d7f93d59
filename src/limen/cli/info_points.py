"""What ``limen info`` says to people about points."""

from __future__ import annotations

import re

import limen.data
from limen.cli.output import Output

__all__ = ["tell_points"]

_NAME = re.compile(r'^[A-Z_]+\["([^"]+)"')


def tell_points(out: Output, found: limen.data.PointsInfo, amount: str) -> None:
    """``amount`` is the size on disk, for people."""
    out.result(found)
    out.line(f"{found.path}: {found.kind}, {found.format}, {amount}")
    out.line(f"  {found.size:,} points, {found.chunks:,} chunks, {len(found.levels)} levels")
    unit = f"units of {found.unit_m:g} m" if found.unit_m else "an unknown unit"
    for axis, low, high in zip("xyz", *found.bounds, strict=True):
        out.line(f"  {axis}: {low:.10g} to {high:.10g}, {high - low:.6g} in {unit}")
    name = _NAME.match(found.crs)
    out.line(f"  coordinates: {name[1] if name else 'none'}")
    out.line(
        f"  colours: {found.colours}; normals: {found.normals}; intensity: {'yes' if found.has_intensity else 'no'}"
    )
    for note in found.notes:
        out.line(f"  {note}")
    if not found.ready:
        out.line("  not made ready yet: limen ingest makes a .points of it")
