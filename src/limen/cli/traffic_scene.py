"""``limen traffic`` for meshes and points: triangles or splats a frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from limen.cli.output import Output, visible_from
from limen.data.mesh.mesh import Mesh
from limen.display.display import Display
from limen.layers.registry import layer_of
from limen.study.traffic import frames_of
from limen.track.session import Session
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.study.scene_traffic import SceneRow, SceneTraffic

__all__ = ["scene_traffic"]


def scene_traffic(
    out: Output,
    content: Mesh | Points,
    path: str,
    whole: Display,
    part: Display,
    sessions: Sequence[Session],
    policies: Sequence[Policy],
    rate_hz: float,
) -> None:
    """Count and print; the content stands where `limen show` puts it on the whole display."""
    from limen.study.scene_traffic import count_scene_traffic  # Zarr and SciPy take a second

    placement = layer_of(content).state(0.0, whole).placement
    assert isinstance(placement, InRoom)
    stands = placement.matrix
    with out.progress(f"counting {'triangles' if isinstance(content, Mesh) else 'splats'}",
                      frames_of(sessions, rate_hz)) as step:  # fmt: skip
        traffic = count_scene_traffic(
            content, Path(path).name, part, sessions, policies, stands, rate_hz=rate_hz, advance=lambda: step(1)
        )
    out.result(traffic)
    _print(out, traffic)


def _print(out: Output, traffic: SceneTraffic) -> None:
    where = f"{traffic.display}, {traffic.panels} panels, {traffic.total_px / 1e6:.3g} megapixels"
    columns = ("", "policy", traffic.items, "99 %", "MB", "MB/s", "saved", "seen from")
    rows = [
        _line(session.name if number == 0 else "", row)
        for session in traffic.sessions
        for number, row in enumerate(session.rows)
    ]
    out.table(f"{traffic.content} ({traffic.size:,}) on {where}: a frame needs", columns, rows)
    out.line()
    bytes_of = "a vertex is 32 bytes, a triangle 12" if traffic.items == "triangles" else "a splat is 16 bytes"
    out.line(f"Nothing is kept from frame to frame; {bytes_of}; MB/s at 30 frames/s.")


def _line(name: str, row: SceneRow) -> Sequence[object]:
    return (
        name,
        row.policy if row.acuity_arcmin is None else f"{row.policy} {row.acuity_arcmin:g}'",
        f"{row.items_mean:,.0f}",
        f"{row.items_p99:,.0f}",
        f"{row.bytes_mean / 1e6:,.2f}",
        f"{row.bytes_per_s / 1e6:,.0f}",
        "-" if row.policy == "full" else f"{row.saving * 100:.1f} %",
        visible_from(row.distance_factor),
    )
