"""What would have to move for a terrain: triangles, patches and pages a frame, with nothing kept between frames."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from limen.data.pages import Pyramid
from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt
from limen.geometry import Floats, Vec3
from limen.layers.common.page_detail import Detail
from limen.layers.terrain.selector import Scenery, TerrainSelector, TerrainSettings, merged
from limen.study.resolvable import places_of, resolvable_samples
from limen.study.traffic import FRAMES_PER_S, one_to_one_view
from limen.track.session import Frame, Session
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of

__all__ = ["CountedDrape", "TerrainSession", "TerrainTraffic", "TerrainTrafficRow", "count_terrain_traffic"]

_FULL = Policy("full")
_VERTEX_BYTES, _TRIANGLE_BYTES = 8, 6
"""Column and row of 16 bits and a height of 32; three vertices of 16."""


class TerrainTrafficRow(msgspec.Struct, frozen=True):
    """One policy in one session."""

    policy: str
    acuity_arcmin: float | None
    panels_active_mean: float
    triangles_mean: float
    """Drawn, over all panels: a patch counts on every panel that shows it."""
    triangles_p99: float
    patches_mean: float
    """Distinct, over all panels."""
    pages_mean: float
    """Those of relief and heights, which come as one, and those of the drape."""
    pages_p99: float
    bytes_mean: float
    bytes_per_s: float
    """At 30 frames a second, whatever rate was sampled."""
    saving: float
    """Share of the bytes of ``full`` that need not move, 0 to 1."""


class TerrainSession(msgspec.Struct, frozen=True):
    """One session: all its policies."""

    name: str
    frames: int
    duration_s: float
    viewers: int
    rows: list[TerrainTrafficRow]
    floor_samples_mean: float
    """Samples a frame that human eyes could resolve on the whole display."""


class TerrainTraffic(msgspec.Struct, frozen=True):
    """What ``limen traffic --json`` prints for a terrain."""

    content: str
    display: str
    panels: int
    total_px: int
    size_posts: tuple[int, int]
    rate_hz: float
    page_bytes: float
    drape_page_bytes: float | None
    """None without a drape."""
    sessions: list[TerrainSession]


class CountedDrape(NamedTuple):
    """What is counted of an image that lies on the terrain."""

    pyramid: Pyramid
    texel_from_post: Floats
    detail: Detail  # for the policy `contrast`
    page_bytes: float


@dataclass(frozen=True, slots=True)
class _Counted:
    """One frame under one policy."""

    panels: int
    triangles: int
    patches: int
    pages: int
    bytes: float


def count_terrain_traffic(
    terrain: Terrain,
    display: Display,
    sessions: Sequence[Session],
    policies: Sequence[Policy],
    settings: TerrainSettings,
    *,
    whole: Display | None = None,
    reference_m: Vec3,
    drape: CountedDrape | None = None,
    rate_hz: float = FRAMES_PER_S,
    threads: int = 2,
    advance: Callable[[], None] | None = None,
) -> TerrainTraffic:
    """Patches and pages that every frame of some sessions needs, as if nothing were left from the frame before.

    Parameters
    ----------
    display
        The panels that count; parts of the installation ``whole``.
    settings, reference_m
        As for `limen.layers.terrain.renderer.TerrainRenderer`; a flight follows the session's clock.
    advance
        Called after every frame.
    """
    quilts = pack_outlines(display, max_size_px=1 << 16, max_px=1 << 31)
    scenery = Scenery(terrain.size_posts, terrain.spacing_m, terrain.nodes, terrain.patches, terrain.relief.pyramid)
    if drape is not None:
        scenery = scenery.draped(drape.pyramid, drape.texel_from_post, lambda: drape.detail)
    sight = TerrainSelector(scenery, display, quilts, settings, whole=whole or display, reference_m=reference_m)
    every = tuple(dict.fromkeys((*policies, _FULL)))

    def look(frame: Frame) -> dict[Policy, _Counted]:
        own = copy.copy(sight)  # every thread poses its own
        own.pose(frame.time_s)
        return {policy: _counted(own, quilts, frame, policy, page_bytes, drape_bytes) for policy in every}

    page_bytes, drape_bytes = terrain.mean_page_bytes, 0.0 if drape is None else drape.page_bytes
    places = places_of(one_to_one_view(display))
    counted = []
    with ThreadPoolExecutor(threads) as pool:
        for session in sessions:
            frames = list(session.frames(rate_hz))
            seen = []
            for each in pool.map(look, frames):
                seen.append(each)
                if advance is not None:
                    advance()
            floor = [resolvable_samples(places, [tolerance_of(frame.viewers, Policy())])[0] for frame in frames]
            full = np.array([each[_FULL].bytes for each in seen])
            rows = [_row(policy, [each[policy] for each in seen], full) for policy in policies]
            counted.append(
                TerrainSession(
                    session.name, len(frames), session.duration_s, len(session.tracks), rows, float(np.mean(floor))
                )
            )
    return TerrainTraffic(
        terrain.name, display.name, len(display.panels), display.total_px, terrain.size_posts, rate_hz, page_bytes,
        drape.page_bytes if drape else None, counted,
    )  # fmt: skip


def _counted(
    sight: TerrainSelector, quilts: Sequence[Quilt], frame: Frame, policy: Policy, page_bytes: float, drape_bytes: float
) -> _Counted:
    demands = sight.demands(frame.viewers, policy, frame.pointers)
    chosen = [sight.choose(quilt, frame.viewers, demands) for quilt in quilts]
    patches = np.unique(np.concatenate([each.cut.pair_patch for each in chosen]))
    table = sight.scenery.patches
    own = len(merged([(each.pages.pages, each.pages.importance) for each in chosen]))
    draped = len(merged([(each.drape_pages.pages, each.drape_pages.importance) for each in chosen]))
    moved = _VERTEX_BYTES * table.vertices[patches].sum() + _TRIANGLE_BYTES * table.triangles[patches].sum()
    return _Counted(
        panels=sum(int((each.views.facing & np.isfinite(each.allowed_px)).sum()) for each in chosen),
        triangles=sum(each.cut.triangles for each in chosen),
        patches=len(patches),
        pages=own + draped,
        bytes=float(moved) + own * page_bytes + draped * drape_bytes,
    )


def _row(policy: Policy, counted: Sequence[_Counted], full_bytes: Floats) -> TerrainTrafficRow:
    moved, triangles, pages = (
        np.array([getattr(each, part) for each in counted]) for part in ("bytes", "triangles", "pages")
    )
    return TerrainTrafficRow(
        policy=policy.title,
        acuity_arcmin=None if policy.name in ("full", "scheel") else policy.acuity_arcmin,
        panels_active_mean=float(np.mean([each.panels for each in counted])),
        triangles_mean=float(triangles.mean()),
        triangles_p99=float(np.percentile(triangles, 99)),
        patches_mean=float(np.mean([each.patches for each in counted])),
        pages_mean=float(pages.mean()),
        pages_p99=float(np.percentile(pages, 99)),
        bytes_mean=float(moved.mean()),
        bytes_per_s=float(moved.mean()) * FRAMES_PER_S,
        saving=1 - float(moved.mean() / full_bytes.mean()) if full_bytes.mean() else 0.0,
    )
