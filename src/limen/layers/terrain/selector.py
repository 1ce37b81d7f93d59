"""What a frame of a terrain is to be made of: demands of viewers -> a cut for every panel -> pages. No GPU here."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.terrain.model import Nodes, PatchTable
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.layers.common.page_detail import Detail
from limen.layers.terrain.look_at import Flight, check_stands, fitted_range_m, in_flight, room_from_posts
from limen.layers.terrain.pages import Faint, NeededPages, pages_for_terrain
from limen.layers.terrain.select import TerrainCut, select_terrain
from limen.viewing.choices import CAMERAS, CameraKind, Mode
from limen.viewing.panel_demands import PanelDemands, Rule, panel_demands
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.projection import PanelProjections, QuiltPanels, guard_of
from limen.viewing.viewer import Pointer, Viewer

__all__ = ["Choice", "Scenery", "TerrainSelector", "TerrainSettings", "merged"]


@dataclass(frozen=True, slots=True)
class TerrainSettings:
    """From where a terrain is looked at, and how its detail is chosen.

    Parameters
    ----------
    look_at, flight
        From where it is looked at, and how that changes over time.
    camera
        ``window``: the panels are windows, seen through by the first viewer. ``fixed``: one picture for the whole
        display, that of the reference eye, whoever stands where; viewers decide about its detail alone.
    cut
        See `limen.layers.terrain.select.select_terrain`.
    rule, field_deg
        See `limen.viewing.panel_demands.panel_demands`.
    max_triangles
        Budget of every quilt: where more would be wanted, all errors allowed grow.
    """

    look_at: LookAt = field(default_factory=LookAt)
    flight: Flight = "none"
    camera: CameraKind = "window"
    cut: Mode = "adaptive"
    rule: Rule = "exact"
    field_deg: float | None = None
    max_triangles: int | None = None

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(f"no camera is named '{self.camera}': there are {', '.join(CAMERAS)}")
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
    """One quilt, and what its panels want."""

    quilt: Quilt
    windows: QuiltPanels
    views: PanelProjections
    allowed_px: Floats
    cut: TerrainCut
    pages: NeededPages
    drape_pages: NeededPages
    select_s: float


class TerrainSelector:
    """A terrain as the panels of a display show it.

    Parameters
    ----------
    display
        What is drawn on, in ``quilts``.
    whole
        The installation that ``display`` is a part of, which says where the terrain stands.
    reference_m
        The reference eye; see `limen.layers.terrain.look_at`.
    """

    def __init__(
        self, scenery: Scenery, display: Display, quilts: Sequence[Quilt], settings: TerrainSettings, *,
        whole: Display, reference_m: Vec3,
    ) -> None:  # fmt: skip
        check_stands(whole, settings.look_at, settings.flight)
        self.scenery, self.display, self.settings = scenery, display, settings
        self._whole, self._reference_m = whole, reference_m
        self.guard_px = min(guard_of(display, quilt) for quilt in quilts)
        self._windows = {quilt: QuiltPanels(display, quilt, 1, self.guard_px) for quilt in quilts}
        self._earlier: PanelDemands | None = None
        self.pose(0.0)

    @property
    def range_m(self) -> float:
        """From how far all of the terrain is seen, metres."""
        return fitted_range_m(self.scenery, self._whole, self._reference_m, self.settings.look_at)

    def pose(self, time_s: float, look_at: LookAt | None = None) -> None:
        """Put the terrain where the flight has it at a time, looked at as in the settings or from elsewhere."""
        look = in_flight(look_at or self.settings.look_at, self.settings.flight, self.scenery, time_s)
        self.room_from_posts = room_from_posts(self.scenery, self._whole, self._reference_m, look)

    def demands(
        self, viewers: Sequence[Viewer], policy: Policy, pointers: Sequence[Pointer], *, live: bool = False
    ) -> PanelDemands:
        """What is demanded of every panel.

        ``live``: what was demanded by the live frame before is held on to, so that panels do not flicker.
        """
        demands = panel_demands(
            self.display, viewers, policy, rule=self.settings.rule, field_deg=self.settings.field_deg,
            pointers=pointers, earlier=self._earlier if live else None,
        )  # fmt: skip
        if live:
            self._earlier = demands
        return demands

    def choose(self, quilt: Quilt, viewers: Sequence[Viewer], demands: PanelDemands) -> Choice:
        """The cut and the pages of one quilt."""
        begin = time.perf_counter()
        windows = self._windows.get(quilt)
        if windows is None:
            windows = self._windows[quilt] = QuiltPanels(self.display, quilt, 1, guard_of(self.display, quilt))
        views = windows.seen_from(self._eye(viewers))
        allowed_px = demands.allowed_px[list(quilt.panels)]
        cut = self.select(quilt, views, allowed_px)
        pages = self._pages(cut, quilt, views, allowed_px, demands.hides_faint[list(quilt.panels)])
        return Choice(quilt, windows, views, allowed_px, cut, *pages, time.perf_counter() - begin)

    def _eye(self, viewers: Sequence[Viewer]) -> Floats:
        """The eye that the picture is drawn for."""
        fixed = self.settings.camera == "fixed" or not viewers
        return np.array(self._reference_m if fixed else viewers[0].position_m)

    def select(
        self, quilt: Quilt, views: PanelProjections, allowed_px: Floats, available: NDArray[np.bool_] | None = None
    ) -> TerrainCut:
        """The cut of one quilt, of all patches or of those that are available."""
        return select_terrain(
            self.scenery.nodes, self.scenery.patches, views, quilt.size_px, self.room_from_posts, allowed_px,
            mode=self.settings.cut, available=available, max_triangles=self.settings.max_triangles,
        )  # fmt: skip

    def _pages(
        self, cut: TerrainCut, quilt: Quilt, views: PanelProjections, allowed_px: Floats, hides_faint: NDArray[np.bool_]
    ) -> tuple[NeededPages, NeededPages]:
        """Pages of relief and heights, and of the drape.

        The drape alone is hidden where it is faint: what contrast relief and heights show is for light and colours to
        say, which change from frame to frame. Shading scales the drape's levels alike, so their contrast stays.
        """
        scenery, place = self.scenery, self.room_from_posts
        nodes, patches, pyramid = scenery.nodes, scenery.patches, scenery.pyramid
        pages = pages_for_terrain(cut, nodes, patches, pyramid, views, quilt.size_px, place, allowed_px)
        if scenery.drape_pyramid is None or scenery.texel_from_post is None:
            return pages, NeededPages(pages.pages[:0], pages.importance[:0])
        hidden = None
        if scenery.drape_detail is not None and hides_faint.any():
            hidden = Faint(scenery.drape_detail(), hides_faint)
        draped = pages_for_terrain(
            cut, nodes, patches, scenery.drape_pyramid, views, quilt.size_px, place, allowed_px,
            texel_from_post=scenery.texel_from_post, faint=hidden,
        )  # fmt: skip
        return pages, draped


def merged(parts: Sequence[tuple[NDArray[np.int64], Floats]]) -> NDArray[np.int64]:
    """Distinct numbers of several lists, the most important first."""
    numbers, importance = (np.concatenate([part[which] for part in parts]) for which in (0, 1))
    ordered = numbers[np.argsort(-importance, kind="stable")].astype(np.int64)
    _, first = np.unique(ordered, return_index=True)
    return np.asarray(ordered[np.sort(first)])
