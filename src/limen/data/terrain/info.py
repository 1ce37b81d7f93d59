"""What there is to say about a terrain, made ready or not."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec

from limen.data.pages import PAGE, Pyramid
from limen.data.store.file_type import existing_file
from limen.data.store.report import Description, amount, crs_name
from limen.data.terrain.elevation import ElevationSource, PostRect

__all__ = ["TerrainInfo", "elevation_info"]

_READ_POSTS = 64_000_000
_ROWS = 512


class TerrainInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What ``limen info`` says about a terrain; sizes are [columns, rows].

    ``ready`` tells a terrain that was made ready from a raster of heights; what only the former has is empty for the
    latter. ``bounds`` is west, south, east, north in the units of ``crs``; None without georeference.
    ``height_range_m`` and ``void_share`` are None where a raster is too large to be read for them. ``triangles`` are
    those of the whole terrain at each vertical error of ``errors_m``.
    """

    kind: str = "terrain"
    path: str
    ready: bool
    size: tuple[int, int]
    levels: list[tuple[int, int]]
    page_px: int
    format: str
    crs: str
    bounds: tuple[float, ...] | None
    spacing_m: tuple[float, float]
    height_range_m: tuple[float, float] | None
    void_share: float | None
    nodes: int = 0
    patches: int = 0
    errors_m: tuple[float, ...] = ()
    triangles: tuple[int, ...] = ()
    bytes: int
    exact: bool
    notes: tuple[str, ...]

    def described(self) -> Description:
        (width, height), (across_m, along_m) = self.size, self.spacing_m
        kilometres = f"{width * across_m / 1000:.4g} x {height * along_m / 1000:.4g} km"
        facts = {
            "size": f"{width} x {height} posts, {across_m:.6g} x {along_m:.6g} m apart, {kilometres}",
            "coordinates": crs_name(self.crs),
        }
        if self.bounds is not None:
            west, south, east, north = (f"{edge:.8g}" for edge in self.bounds)
            facts["coordinates"] += f", {west} to {east} and {south} to {north}"
        if self.height_range_m is not None:
            low_m, high_m = self.height_range_m
            facts["heights"] = f"{low_m:.6g} to {high_m:.6g} m{'' if self.exact else ', rounded'}"
        if self.void_share:
            facts["without data"] = f"{100 * self.void_share:.3g} % of the posts"
        if self.ready:
            facts["made ready"] = f"{self.nodes:,} nodes, {self.patches:,} patches, {len(self.levels)} levels of pages"
        else:
            facts["not made ready yet"] = "limen ingest makes a .terrain of it"
        return Description(
            f"{self.format}, {amount(self.bytes)}",
            facts,
            self.notes,
            ("error in m", "triangles of the whole") if self.ready else (),
            [(f"{error_m:.4g}", f"{count:,}") for error_m, count in zip(self.errors_m, self.triangles, strict=True)],
        )


def elevation_info(
    path: str | Path, *, band: int | None = None, spacing_m: float | tuple[float, float] | None = None
) -> TerrainInfo:
    """What a raster of heights is; up to 64 million posts are read for the range of heights.

    Raises what `limen.data.terrain.elevation.ElevationSource` raises.
    """
    path = existing_file(path)
    with ElevationSource(path, band=band, spacing_m=spacing_m) as source:
        small = math.prod(source.size_posts) <= _READ_POSTS
        height_range_m, void_share = _heights(source) if small else (None, None)
        return TerrainInfo(
            path=str(path),
            ready=False,
            size=source.size_posts,
            levels=[level.size_px for level in Pyramid.of(source.size_posts).levels],
            page_px=PAGE,
            format=source.format,
            crs=source.crs,
            bounds=source.bounds,
            spacing_m=source.spacing_m,
            height_range_m=height_range_m,
            void_share=void_share,
            bytes=path.stat().st_size,
            exact=source.exact,
            notes=source.notes,
        )


def _heights(source: ElevationSource) -> tuple[tuple[float, float] | None, float]:
    """Lowest and highest post (None if there is none), and the share of posts without data."""
    width, height = source.size_posts
    low_m, high_m, voids = math.inf, -math.inf, 0
    for row in range(0, height, _ROWS):
        heights, void = source.read(PostRect(0, row, width, min(_ROWS, height - row)))
        known = heights[~void]
        voids += void.size - known.size
        if known.size:
            low_m, high_m = min(low_m, float(known.min())), max(high_m, float(known.max()))
    return (low_m, high_m) if low_m <= high_m else None, voids / (width * height)
