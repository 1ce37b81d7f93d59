"""An image as a layer: how it lies on panels or on a shape, through which lenses, and which of its pages are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np

from limen.data.image.file import Image
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.geometry import Vec3, as_vec3
from limen.layers.base import Cut, CutCounts, Residents, Turn
from limen.layers.common.known_contrast import KnownContrast
from limen.layers.common.page_detail import Detail
from limen.layers.image.cut import PageCut
from limen.layers.image.select import ImageOnDisplay, select, view_of
from limen.stream.chunks import Index, Resident, Update
from limen.stream.pages import Drawable, KeptTable, PageTable, drawable_pages, page_streaming
from limen.viewing.lens import Lens
from limen.viewing.placement import OnShape, OnSurface, Placement
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltView
from limen.viewing.state import FrameState, LayerState
from limen.viewing.tolerance import Tolerance, tolerance_of
from limen.viewing.viewer import Viewer

__all__ = [
    "LOOKAHEAD_S",
    "ImageLayer",
    "ImagePart",
    "ImageSelector",
    "PlacedPages",
    "Sampling",
    "placed_pages",
    "select_ahead",
]

LOOKAHEAD_S = 0.4
"""How far ahead pages are fetched. Levels change in bursts, when a ring of distance sweeps over many pages at once;
fetching early spreads a burst over the frames before it."""

Sampling: TypeAlias = Literal["sharp", "fast"]

_NOWHERE_M = math.inf
"""Where an image begins, which is drawn without depth."""


_ON_SURFACE = OnSurface()


@dataclass(frozen=True, slots=True, eq=False)
class ImageLayer:
    """An image and how it is shown.

    Parameters
    ----------
    placement
        How it lies on the display.
    policy
        How viewers decide about detail.
    moving
        Lenses over those of the placement that are elsewhere, or others, from time to time.
    sampling
        ``sharp``: a cubic kernel as wide as the pixel's footprint. ``fast``: bilinear, for live windows without a
        GPU; it aliases where a pixel covers nearly two texels.
    overlay
        ``levels`` tints every pixel by the level drawn, ``error`` by how far lenses draw it from where it belongs.
    """

    kind: ClassVar[str] = "image"
    image: Image
    placement: Placement = _ON_SURFACE
    policy: Policy = field(default_factory=Policy)
    moving: Callable[[float], tuple[Lens, ...]] | None = None
    sampling: Sampling = "sharp"
    overlay: str = ""

    @classmethod
    def of(cls, image: Image, policy: Policy | None, placement: Any, overlay: str) -> ImageLayer:
        """An image on the display's surface, unless it is placed elsewhere."""
        if not isinstance(placement, OnSurface | OnShape | None):
            raise InputError(
                "(4, 4) placements are for meshes, not for images, and a LookAt is for terrains: give OnSurface"
            )
        return cls(image, placement or OnSurface(), policy or Policy(), overlay=overlay)

    @property
    def name(self) -> str:
        return self.image.path.name

    @property
    def alone_because(self) -> str:
        if isinstance(self.placement, OnShape):
            return "lies on the surface: on a shape it has no depth that others could be in front of, or behind"
        return ""

    @property
    def overlay_word(self) -> str:
        return self.overlay or "levels"

    def state(self, time_s: float, display: Display) -> LayerState:
        placement, lenses = self.placement, self.moving(time_s) if self.moving else ()
        if lenses and isinstance(placement, OnSurface):
            placement = msgspec.structs.replace(placement, lenses=placement.lenses + lenses)
        return LayerState(placement=placement, policy=self.policy, overlay=self.overlay)

    def turned(self, state: LayerState, turn: Turn, display: Display) -> LayerState:
        """It lies on the panels, and does not turn."""
        return state

    def selector(self, display: Display, whole: Display) -> ImageSelector:
        return ImageSelector(self, display, whole)


class PlacedPages(NamedTuple):
    """Where the pages are that a frame draws."""

    pairs: Drawable | None  # of `PageCut.pair_page`
    table: PageTable | None  # for pixels that look pages up


class ImagePart(NamedTuple):
    """What is drawn of an image in one quilt."""

    view: ImageOnDisplay  # of the whole display, by whose panels the cut is numbered
    cut: PageCut
    tolerance: Tolerance
    eye_m: Vec3 | None
    pages: PlacedPages = PlacedPages(None, None)


class ImageSelector:
    """Which pages of an image the panels of a display show.

    Parameters
    ----------
    whole
        The installation that ``display`` is a part of: pointers carry lenses over all of it.
    """

    def __init__(self, layer: ImageLayer, display: Display, whole: Display) -> None:
        self._display, self._whole = display, whole
        self._pyramid = layer.image.pyramid
        self.sources = (page_streaming(layer.image),)
        self._contrast = KnownContrast(layer.image)
        self._table = KeptTable(self._pyramid)
        self._placement: Placement | None = None
        self._views: dict[tuple[int, ...], ImageOnDisplay] = {}
        self._earlier: tuple[Viewer, ...] = ()

    def complete(self, state: LayerState) -> None:
        if state.policy.name == "contrast":
            self._contrast.complete()

    def select(
        self, views: Sequence[QuiltView], state: LayerState, frame: FrameState, resident: Residents, *, live: bool
    ) -> Cut[ImagePart]:
        """The pages of all quilts together, which share one budget."""
        placement = state.placement
        assert isinstance(placement, OnSurface | OnShape)
        if isinstance(placement, OnSurface):
            placement = placement.carrying(self._whole, self._pyramid.size_px, frame.pointers)
        eyes_m = views[0].eyes_m
        eye_m = as_vec3(eyes_m[0], "eye") if len(eyes_m) else None
        tolerance = tolerance_of(frame.viewers, state.policy)
        every = tuple(range(len(self._display.panels)))
        panels = tuple(sorted({panel for view in views for panel in view.quilt.panels}))
        detail = self._contrast.detail(self._display) if state.policy.name == "contrast" else None
        view = self._view(placement, panels, detail)
        cut = select(view, tolerance, budget=resident[0].capacity - 1, eye_m=eye_m)
        whole = view
        if panels != every:
            whole = self._view(placement, every, detail)
            cut = replace(cut, pair_panel=np.array(panels, dtype=np.int64)[cut.pair_panel])
        soon = select_ahead(view, state.policy, frame.viewers, self._earlier) if live else None
        if live:
            self._earlier = frame.viewers
        parts = tuple(ImagePart(whole, cut, tolerance, eye_m) for _ in views)
        counts = CutCounts(
            items=len(cut), error_px=cut.error_px,
            panels_active=sum(_active_panels(cut, whole, view.quilt) for view in views),
        )  # fmt: skip
        return Cut(parts, counts, (cut.pages,), (soon,), near_m=(_NOWHERE_M,) * len(parts))

    def take(self, source: int, update: Update[Any]) -> None:
        """Nothing of a page is looked into."""

    def resolve(self, cut: Cut[ImagePart], resident: Residents) -> Cut[ImagePart]:
        """All parts are of one cut."""
        pages, drawn = placed_pages(cut.parts[0].view, cut.parts[0].cut, resident[0], self._table)
        return replace(cut, parts=tuple(part._replace(pages=pages) for part in cut.parts), drawn=(drawn,))

    def close(self) -> None:
        self._contrast.close()

    def _view(self, placement: Placement, panels: tuple[int, ...], detail: Detail | None) -> ImageOnDisplay:
        """The image on some panels; kept while it lies as it did."""
        if placement != self._placement:
            self._placement = placement
            self._views.clear()
        if panels not in self._views:
            part = self._display if len(panels) == len(self._display.panels) else self._display.part(panels)
            self._views[panels] = view_of(part, self._pyramid, placement)
        view = self._views[panels]
        return view if detail is None else view._replace(detail=detail)


def placed_pages(view: ImageOnDisplay, cut: PageCut, resident: Resident, table: KeptTable) -> tuple[PlacedPages, Index]:
    """What of a cut is there to be drawn, and all pages that these are."""
    pairs, drawn = None, np.zeros(0, np.int64)
    if view.maps is not None:
        pairs, drawn = drawable_pages(view.pyramid, resident, cut.pair_page)
    looked_up = view.maps is None or view.cells is not None
    return PlacedPages(pairs, table.of(resident) if looked_up else None), drawn


def select_ahead(
    view: ImageOnDisplay,
    policy: Policy,
    viewers: Sequence[Viewer],
    earlier: Sequence[Viewer],
    seconds: float = LOOKAHEAD_S,
) -> Index | None:
    """Pages for where the viewers will be if they walk on as since the frame before; ``None`` if nobody moves."""
    if len(viewers) != len(earlier):
        return None
    moved = [viewer.extrapolated(before, seconds) for viewer, before in zip(viewers, earlier, strict=True)]
    if moved == list(viewers):
        return None
    return select(view, tolerance_of(moved, policy), eye_m=moved[0].position_m).pages


def _active_panels(cut: PageCut, view: ImageOnDisplay, quilt: Quilt) -> int:
    """Panels of a quilt that show something of the image; of one on a shape, all may."""
    if view.maps is None:
        return len(quilt.panels)
    through_lenses = cut.pair_panel[:0] if view.cells is None else view.cells.panel
    return len(np.intersect1d(np.concatenate([cut.pair_panel, through_lenses]), quilt.panels))
