"""What would have to move for a terrain: triangles, patches and pages a frame, with nothing kept between frames."""

from __future__ import annotations

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
from limen.geometry import Floats, Vec3
from limen.layers.base import in_order
from limen.layers.common.page_detail import Detail
from limen.layers.terrain.look_at import in_flight
from limen.layers.terrain.selector import Scenery, TerrainSelector, TerrainSettings
from limen.study.resolvable import places_of, resolvable_samples
from limen.study.traffic import FRAMES_PER_S, one_to_one_view
from limen.track.session import Frame, Session
from limen.viewing.panel_demands import panel_demands
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView, guard_of
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
    eye_m: Vec3 | None = None,
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
        As for `limen.layers.terrain.layer.TerrainLayer`; a flight follows the session's clock.
    eye_m
        The eye that pictures are drawn for; by default the first viewer's, and ``reference_m`` while there is nobody.
    advance
        Called after every frame.
    """
    counter = _Counter.of(terrain, display, settings, whole or display, reference_m, eye_m, drape)
    every = tuple(dict.fromkeys((*policies, _FULL)))

    def look(frame: Frame) -> dict[Policy, _Counted]:
        views, stands = counter.views(frame), counter.stands(frame)
        return {policy: counter.counted(views, stands, frame, policy) for policy in every}

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
        terrain.name, display.name, len(display.panels), display.total_px, terrain.size_posts, rate_hz,
        counter.page_bytes, drape.page_bytes if drape else None, counted,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Counter:
    """A terrain before a display, and what its pages weigh."""

    sight: TerrainSelector
    panels: Sequence[QuiltPanels]
    reference_m: Vec3
    eye_m: Vec3 | None
    page_bytes: float
    drape_bytes: float

    @classmethod
    def of(
        cls,
        terrain: Terrain,
        display: Display,
        settings: TerrainSettings,
        whole: Display,
        reference_m: Vec3,
        eye_m: Vec3 | None,
        drape: CountedDrape | None,
    ) -> _Counter:
        scenery = Scenery(terrain.size_posts, terrain.spacing_m, terrain.nodes, terrain.patches, terrain.relief.pyramid)
        if drape is not None:
            scenery = scenery.draped(drape.pyramid, drape.texel_from_post, lambda: drape.detail)
        sight = TerrainSelector(scenery, display, settings, whole=whole, reference_m=reference_m)
        quilts = pack_outlines(display, max_size_px=1 << 16, max_px=1 << 31)
        guard_px = min(guard_of(display, quilt) for quilt in quilts)
        panels = [QuiltPanels(display, quilt, guard_px=guard_px) for quilt in quilts]
        drape_bytes = 0.0 if drape is None else drape.page_bytes
        return cls(sight, panels, reference_m, eye_m, terrain.mean_page_bytes, drape_bytes)

    def views(self, frame: Frame) -> list[QuiltView]:
        """All quilts as they are drawn in a frame."""
        seen_from_m = self.eye_m or (frame.viewers[0].position_m if frame.viewers else self.reference_m)
        return [QuiltView.of(each, [seen_from_m]) for each in self.panels]

    def stands(self, frame: Frame) -> Floats:
        """Where the flight has the terrain in a frame."""
        settings, scenery = self.sight.settings, self.sight.scenery
        return self.sight.room_from_posts(in_flight(settings.look_at, settings.flight, scenery, frame.time_s))

    def counted(self, views: Sequence[QuiltView], stands: Floats, frame: Frame, policy: Policy) -> _Counted:
        sight, settings = self.sight, self.sight.settings
        demands = panel_demands(
            sight.display, frame.viewers, policy, rule=settings.rule, field_deg=settings.field_deg,
            pointers=frame.pointers,
        )  # fmt: skip
        chosen = [sight.choose(view, stands, demands) for view in views]
        patches = np.unique(np.concatenate([each.cut.pair_patch for each in chosen]))
        table = sight.scenery.patches
        own = len(in_order([(each.pages.pages, each.pages.importance) for each in chosen]))
        draped = len(in_order([(each.drape_pages.pages, each.drape_pages.importance) for each in chosen]))
        moved = _VERTEX_BYTES * table.vertices[patches].sum() + _TRIANGLE_BYTES * table.triangles[patches].sum()
        return _Counted(
            panels=sum(int((each.view.facing & np.isfinite(each.allowed_px)).sum()) for each in chosen),
            triangles=sum(each.cut.triangles for each in chosen),
            patches=len(patches),
            pages=own + draped,
            bytes=float(moved) + own * self.page_bytes + draped * self.drape_bytes,
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
