"""What a frame of a terrain is to be made of: demands of viewers -> a cut for every panel -> pages. No GPU here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.terrain.model import Nodes, PatchTable
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.layers.base import Cut, CutCounts, Residents, in_order
from limen.layers.common.known_contrast import KnownContrast
from limen.layers.common.page_detail import Detail
from limen.layers.terrain.borders import BorderPool, Fans
from limen.layers.terrain.look_at import Flight, check_stands, room_from_posts
from limen.layers.terrain.pages import Faint, NeededPages, pages_for_terrain
from limen.layers.terrain.patches import PatchPlaces
from limen.layers.terrain.select import TerrainCut, select_terrain
from limen.stream.chunks import Streaming, Update
from limen.stream.pages import KeptTable, PageTable
from limen.viewing.choices import Mode
from limen.viewing.panel_demands import PanelDemands, Rule, panel_demands
from limen.viewing.placement import LookAt
from limen.viewing.projection import NEAR_M, PanelProjections, QuiltView
from limen.viewing.state import FrameState, LayerState

__all__ = ["Choice", "Scenery", "TerrainPart", "TerrainSelector", "TerrainSettings", "nearest_m"]


@dataclass(frozen=True, slots=True)
class TerrainSettings:
    """From where a terrain is looked at, and how its detail is chosen.

    Parameters
    ----------
    look_at, flight
        From where it is looked at, and how that changes over time.
    cut
        See `limen.layers.terrain.select.select_terrain`.
    rule, field_deg
        See `limen.viewing.panel_demands.panel_demands`.
    max_triangles
        Budget of every quilt: where more would be wanted, all errors allowed grow.
    """

    look_at: LookAt = field(default_factory=LookAt)
    flight: Flight = "none"
    cut: Mode = "adaptive"
    rule: Rule = "exact"
    field_deg: float | None = None
    max_triangles: int | None = None

    def __post_init__(self) -> None:
        if self.flight == "traverse" and self.look_at.target != LookAt().target:
            raise InputError("the flight traverse goes over all of a terrain: leave out the target, or take orbit")
        if self.max_triangles is not None and self.max_triangles < 1:
            raise InputError(f"max_triangles must be at least 1, got {self.max_triangles}")


class Scenery(NamedTuple):
    """What has to be known of a terrain and its drape to choose from them."""

    size_posts: tuple[int, int]
    spacing_m: tuple[float, float]
    nodes: Nodes
    patches: PatchTable
    pyramid: Pyramid
    drape_pyramid: Pyramid | None = None
    texel_from_post: Floats | None = None
    drape_detail: Callable[[], Detail] | None = None
    """Where the drape's finer detail is seen, as far as its contrast is known."""

    def draped(self, pyramid: Pyramid, texel_from_post: Floats, detail: Callable[[], Detail]) -> Scenery:
        """The same with an image laid over it."""
        return self._replace(drape_pyramid=pyramid, texel_from_post=texel_from_post, drape_detail=detail)


class Choice(NamedTuple):
    """What the panels of one quilt want."""

    view: QuiltView
    room_from_posts: Floats
    allowed_px: Floats
    seen: NDArray[np.int8]
    """How each panel is seen, see `limen.viewing.panel_demands.PanelDemands`."""
    cut: TerrainCut
    pages: NeededPages
    drape_pages: NeededPages


class TerrainPart(NamedTuple):
    """What is drawn of a terrain in one quilt; all but ``choice`` when it is known what is there."""

    choice: Choice
    cut: TerrainCut
    places: PatchPlaces | None = None
    fans: Fans | None = None
    tables: tuple[PageTable, ...] = ()


class TerrainSelector:
    """Which patches and pages of a terrain the panels of a display show.

    Parameters
    ----------
    display
        What is drawn on.
    whole
        The installation that ``display`` is a part of, which says where the terrain stands.
    reference_m
        The reference eye; see `limen.layers.terrain.look_at`.
    sources
        Patches, relief, heights and, where there is one, a drape.
    contrast
        What is known of the drape's contrast.
    """

    def __init__(
        self,
        scenery: Scenery,
        display: Display,
        settings: TerrainSettings,
        *,
        whole: Display,
        reference_m: Vec3,
        sources: tuple[Streaming, ...] = (),
        contrast: KnownContrast | None = None,
    ) -> None:
        check_stands(whole, settings.look_at, settings.flight)
        self.scenery, self.display, self.settings, self.sources = scenery, display, settings, sources
        self._whole, self._reference_m, self._contrast = whole, reference_m, contrast
        self._earlier: PanelDemands | None = None
        pyramids = [scenery.pyramid, scenery.pyramid, scenery.drape_pyramid]
        self._tables = [KeptTable(pyramid) for pyramid in pyramids if pyramid is not None]
        self._borders = BorderPool()

    # ------------------------------------------------------------------ a `limen.layers.base.Selector`

    def complete(self, state: LayerState) -> None:
        if self._contrast is not None and state.policy.name == "contrast":
            self._contrast.complete()

    def select(
        self, views: Sequence[QuiltView], state: LayerState, frame: FrameState, resident: Residents, *, live: bool
    ) -> Cut[TerrainPart]:
        """``live``: what the frame before demanded is held on to, so that panels do not flicker."""
        assert isinstance(state.placement, LookAt)
        demands = panel_demands(
            self.display, frame.viewers, state.policy, rule=self.settings.rule, field_deg=self.settings.field_deg,
            pointers=frame.pointers, earlier=self._earlier if live else None,
        )  # fmt: skip
        if live:
            self._earlier = demands
        stands = self.room_from_posts(state.placement)
        choices = [self.choose(view, stands, demands) for view in views]
        cut = self._cut([TerrainPart(choice, choice.cut) for choice in choices])
        pages = in_order([(each.pages.pages, each.pages.importance) for each in choices])
        drape = in_order([(each.drape_pages.pages, each.drape_pages.importance) for each in choices])
        patches = in_order([(each.cut.patches, each.cut.importance) for each in choices])
        wanted = (patches, pages, pages, drape)[: max(len(self.sources), 1)]
        return replace(cut, wanted=wanted)

    def take(self, source: int, update: Update[Any]) -> None:
        if source == 0:
            for gone in update.evicted:
                self._borders.remove(gone)
            for patch, (first_vertex, *_), content in update.arrived:
                self._borders.add(patch, content, first_vertex)

    def resolve(self, cut: Cut[TerrainPart], resident: Residents) -> Cut[TerrainPart]:
        places = PatchPlaces.of(resident[0])
        tables = tuple(table.of(pages) for table, pages in zip(self._tables, resident[1:], strict=True))
        parts = [self._resolved(part.choice, places, tables) for part in cut.parts]
        drawn = np.unique(np.concatenate([part.cut.pair_patch for part in parts]))
        return replace(self._cut(parts), wanted=cut.wanted, drawn=(drawn,))

    def close(self) -> None:
        if self._contrast is not None:
            self._contrast.close()

    # ------------------------------------------------------------------ its steps

    def room_from_posts(self, look_at: LookAt) -> Floats:
        """Where the terrain stands, looked at like this: (4, 4)."""
        return room_from_posts(self.scenery, self._whole, self._reference_m, look_at)

    def choose(self, view: QuiltView, stands: Floats, demands: PanelDemands) -> Choice:
        """The cut and the pages of one quilt, of a terrain that stands by a map (4, 4) from posts to the room."""
        chosen = list(view.quilt.panels)
        allowed_px, (eye, *_) = demands.allowed_px[chosen], view.eyes
        cut = self._select(view.quilt, eye, stands, allowed_px)
        pages = self._pages(cut, view.quilt, eye, stands, allowed_px, demands.hides_faint[chosen])
        return Choice(view, stands, allowed_px, demands.seen[chosen], cut, *pages)

    def _resolved(self, choice: Choice, places: PatchPlaces, tables: tuple[PageTable, ...]) -> TerrainPart:
        """A choice as it can be drawn by what is there."""
        cut, quilt = choice.cut, choice.view.quilt
        if not places.resident[cut.pair_patch].all():
            cut = self._select(quilt, choice.view.eyes[0], choice.room_from_posts, choice.allowed_px, places.resident)
        fans = self._borders.fans(cut.pair_panel, cut.pair_patch, len(quilt.panels))
        return TerrainPart(choice, cut, places, fans, tables)

    def _cut(self, parts: Sequence[TerrainPart]) -> Cut[TerrainPart]:
        """What is told of parts, and where they begin."""
        low, high, active_count = np.inf, 0.0, 0
        for part in parts:
            active = part.choice.view.facing & np.isfinite(part.choice.allowed_px)
            allowed = part.choice.allowed_px[active]
            low, high = min(low, float(allowed.min(initial=np.inf))), max(high, float(allowed.max(initial=0.0)))
            active_count += int(active.sum())
        triangles = sum(
            int(part.places.core_indices[part.cut.pair_patch].sum()) // 3 + len(part.fans.triangles)
            for part in parts
            if part.places is not None and part.fans is not None
        )
        counts = CutCounts(
            items=max(len(part.cut) for part in parts), drawn=triangles, panels_active=active_count,
            error_px=max(float(part.cut.panel_error_px.max(initial=0.0)) for part in parts),
            allowed_px=(low, high) if active_count else (0.0, 0.0),
        )  # fmt: skip
        return Cut(tuple(parts), counts, near_m=tuple(self._nearest_m(part) for part in parts))

    def _nearest_m(self, part: TerrainPart) -> float:
        """How far from the nearest eye the chosen nodes begin."""
        nodes = np.unique(self.scenery.patches.node[part.cut.pair_patch]).astype(np.int64)
        view, stands = part.choice.view, part.choice.room_from_posts
        return min(nearest_m(self.scenery.nodes, nodes, stands, eye_m) for eye_m in view.eyes_m)

    def _select(
        self,
        quilt: Quilt,
        eye: PanelProjections,
        stands: Floats,
        allowed_px: Floats,
        available: NDArray[np.bool_] | None = None,
    ) -> TerrainCut:
        """The cut of one quilt, of all patches or of those that are available."""
        return select_terrain(
            self.scenery.nodes, self.scenery.patches, eye, quilt.size_px, stands, allowed_px,
            mode=self.settings.cut, available=available, max_triangles=self.settings.max_triangles,
        )  # fmt: skip

    def _pages(
        self,
        cut: TerrainCut,
        quilt: Quilt,
        eye: PanelProjections,
        stands: Floats,
        allowed_px: Floats,
        hides_faint: NDArray[np.bool_],
    ) -> tuple[NeededPages, NeededPages]:
        """Pages of relief and heights, and of the drape.

        The drape alone is hidden where it is faint: what contrast relief and heights show is for light and colours to
        say, which change from frame to frame. Shading scales the drape's levels alike, so their contrast stays.
        """
        scenery = self.scenery
        nodes, patches, pyramid = scenery.nodes, scenery.patches, scenery.pyramid
        pages = pages_for_terrain(cut, nodes, patches, pyramid, eye, quilt.size_px, stands, allowed_px)
        if scenery.drape_pyramid is None or scenery.texel_from_post is None:
            return pages, NeededPages(pages.pages[:0], pages.importance[:0])
        hidden = None
        if scenery.drape_detail is not None and hides_faint.any():
            hidden = Faint(scenery.drape_detail(), hides_faint)
        draped = pages_for_terrain(
            cut, nodes, patches, scenery.drape_pyramid, eye, quilt.size_px, stands, allowed_px,
            texel_from_post=scenery.texel_from_post, faint=hidden,
        )  # fmt: skip
        return pages, draped


def nearest_m(nodes: Nodes, chosen: NDArray[np.int64], room_from_posts: Floats, eye_m: Floats) -> float:
    """How far from an eye the chosen nodes begin: less than the distance to the nearest of their boxes, metres."""
    if not len(chosen):
        return NEAR_M
    rect, low_high = nodes.rect[chosen].astype(float), nodes.low_high_m[chosen].astype(float)
    middle = np.stack([rect[:, [0, 2]].mean(axis=1), rect[:, [1, 3]].mean(axis=1), low_high.mean(axis=1)], axis=1)
    half = (
        np.stack([np.ptp(rect[:, [0, 2]], axis=1), np.ptp(rect[:, [1, 3]], axis=1), np.ptp(low_high, axis=1)], axis=1)
        / 2
    )
    placed = middle @ room_from_posts[:3, :3].T + room_from_posts[:3, 3] - eye_m
    reach = half @ np.abs(room_from_posts[:3, :3]).T
    gap = np.maximum(np.abs(placed) - reach, 0)
    return max(float(np.linalg.norm(gap, axis=1).min()), NEAR_M)
