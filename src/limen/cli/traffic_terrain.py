"""``limen traffic`` for terrains: triangles, patches and pages a frame."""

from __future__ import annotations

from collections.abc import Sequence

from limen.cli.content import opened_content
from limen.cli.options.terrain import TerrainOptions
from limen.cli.output import Output
from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.layers.common.page_detail import plain_detail
from limen.study.terrain_traffic import CountedDrape, TerrainTraffic, TerrainTrafficRow, count_terrain_traffic
from limen.study.traffic import detail_of, frames_of, page_bytes_of
from limen.track.session import Session
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer

__all__ = ["terrain_traffic"]


def terrain_traffic(
    out: Output,
    content: str,
    whole: Display,
    part: Display,
    sessions: Sequence[Session],
    policies: Sequence[Policy],
    options: TerrainOptions,
    max_triangles: int | None,
    rate_hz: float,
) -> None:
    """Count and print."""
    terrain = opened_content(out, content)
    assert isinstance(terrain, Terrain)
    reference_m = standing_viewer(whole).position_m
    drape = _drape(out, terrain, part, options, faint=any(policy.name == "contrast" for policy in policies))
    with out.progress("counting triangles", frames_of(sessions, rate_hz)) as step:
        traffic = count_terrain_traffic(
            terrain, part, sessions, policies, options.settings(max_triangles), whole=whole, drape=drape,
            reference_m=reference_m, eye_m=reference_m if options.camera == "fixed" else None, rate_hz=rate_hz,
            advance=lambda: step(1),
        )  # fmt: skip
    out.result(traffic)
    _print(out, traffic)


def _drape(
    out: Output, terrain: Terrain, display: Display, options: TerrainOptions, *, faint: bool
) -> CountedDrape | None:
    """The image that lies on the terrain; ``faint``: with what is too faint to be seen in it."""
    with options.draped(terrain) as draped:
        if draped is None:
            return None
        image, detail = draped.image, plain_detail(draped.image.pyramid)
        if faint:
            with out.progress("looking for contrast", 1000) as step:
                detail = detail_of(image, display, progress=lambda done: step.to(round(1000 * done)))
        return CountedDrape(image.pyramid, draped.texel_from_post, detail, page_bytes_of(image))


def _print(out: Output, traffic: TerrainTraffic) -> None:
    where = f"{traffic.display}, {traffic.panels} panels, {traffic.total_px / 1e6:.3g} megapixels"
    columns = ("", "policy", "panels", "triangles", "99 %", "patches", "pages", "MB", "MB/s", "saved")
    rows = [
        _line(session.name if number == 0 else "", row)
        for session in traffic.sessions
        for number, row in enumerate(session.rows)
    ]
    out.table(f"{traffic.content} on {where}: a frame needs", columns, rows)
    out.line()
    for session in traffic.sessions:
        people = "1 viewer" if session.viewers == 1 else f"{session.viewers} viewers"
        out.line(
            f"{session.name}: {session.frames:,} frames, {session.duration_s:g} s, {people}; human eyes resolve "
            f"{session.floor_samples_mean / 1e6:.1f} million samples a frame"
        )
    drape = "" if traffic.drape_page_bytes is None else f", one of the drape {traffic.drape_page_bytes / 1000:.3g} kB"
    out.line(
        f"A page (relief and heights) is 256 x 256 texels, {traffic.page_bytes / 1000:.3g} kB{drape}; a vertex is 8 "
        "bytes, a triangle 6;\nnothing is kept from frame to frame; MB/s at 30 frames/s. Triangles are drawn once for "
        "every panel that shows them."
    )


def _line(name: str, row: TerrainTrafficRow) -> Sequence[object]:
    return (
        name,
        row.policy if row.acuity_arcmin is None else f"{row.policy} {row.acuity_arcmin:g}'",
        f"{row.panels_active_mean:.1f}",
        f"{row.triangles_mean:,.0f}",
        f"{row.triangles_p99:,.0f}",
        f"{row.patches_mean:,.0f}",
        f"{row.pages_mean:,.0f}",
        f"{row.bytes_mean / 1e6:,.2f}",
        f"{row.bytes_per_s / 1e6:,.0f}",
        "-" if row.policy == "full" else f"{row.saving * 100:.1f} %",
    )
