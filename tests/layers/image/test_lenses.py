"""Pages chosen through lenses: those that the pixels need, finer in the focus and coarser where a lens compresses."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
import pytest

import limen
from limen.data.pages import Pyramid
from limen.display.quilt import Quilt
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import flat_pairs, select, view_of
from limen.stream.allocators import Slots
from limen.viewing.lens import Lens, jacobian_of, source_of
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState, decode, encode
from limen.viewing.tolerance import tolerance_of
from support.every_pixel import pages_drawn, pixels, small_room

PYRAMID = Pyramid.of((60_000, 24_000))
LENSES = {
    "one": (Lens((30_000.0, 12_000.0), 5_000.0, 16.0),),
    "small": (Lens((24_000.0, 9_000.0), 700.0, 30.0, 0.6),),
    "overlapping": (
        Lens((26_000.0, 12_000.0), 6_000.0, 8.0, 0.2, "gaussian"),
        Lens((33_000.0, 13_000.0), (7_000.0, 3_000.0), 3.0, 0.4, "quadratic", "rectangular"),
    ),
}


def needed(display, placement, tolerance, stride=1):
    """The pages of every pixel (of every ``stride``-th along both axes), by the lenses' own Jacobian."""
    view = view_of(display, PYRAMID, placement)
    wanted: set[int] = set()
    for number, panel in enumerate(display.panels):
        places = pixels(panel)[::stride, ::stride].reshape(-1, 2)
        shown = places * view.maps.scale[number] + view.maps.offset[number]
        texels = source_of(placement.lenses, shown)
        inside = ((texels >= 0) & (texels < PYRAMID.size_px)).all(axis=1)
        steps = jacobian_of(placement.lenses, shown) * view.maps.scale[number]
        footprint = np.linalg.norm(steps, axis=1).max(axis=1)
        allowed_px = tolerance.allowed_px(panel.position_m(places), panel.pitch_m[0])
        wanted |= pages_drawn(PYRAMID, texels[inside], footprint[inside], allowed_px[inside])
    return wanted


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("acuity", [None, 2.0, 15.0])
def test_selection_through_lenses_is_what_the_pixels_need(name, acuity):
    display, placement = small_room(pitch_mm=2.5), OnSurface("cover", lenses=LENSES[name])
    viewers = [limen.Viewer((0.4, 1.6, -1.2)), limen.Viewer((-0.8, 1.4, 0.5))]
    tolerance = tolerance_of(viewers, Policy("full") if acuity is None else Policy("acuity", acuity))
    chosen = set(select(view_of(display, PYRAMID, placement), tolerance).pages.tolist())
    wanted = needed(display, placement, tolerance)
    assert wanted <= chosen, f"{len(wanted - chosen)} of {len(wanted)} pages are missing"
    assert len(chosen) <= 1.5 * len(wanted) + 20


@pytest.mark.parametrize("drop_off", ["cosine", "linear"])
def test_large_cells_of_large_lenses_leave_nothing_out(drop_off):
    display = limen.Display.window((2600, 2400))
    placement = OnSurface("cover", lenses=(Lens((30_000.0, 12_000.0), 11_900.0, 8.0, drop_off=drop_off),))
    assert 11_900 / view_of(display, PYRAMID, placement).maps.scale[0, 0] > 1.1 * 1024, "cells may exceed 32 pixels"
    for tolerance in (tolerance_of([], Policy("full")), tolerance_of([limen.Viewer((0.3, 0.1, 1.5))], Policy())):
        chosen = set(select(view_of(display, PYRAMID, placement), tolerance).pages.tolist())
        wanted = needed(display, placement, tolerance, stride=3)
        assert wanted <= chosen, f"{len(wanted - chosen)} of {len(wanted)} pages are missing"


def test_the_focus_asks_for_finer_pages_and_the_rim_for_coarser_ones():
    display, tolerance = small_room(pitch_mm=2.5), tolerance_of([], Policy("full"))
    (lens,) = LENSES["one"]
    plain, lensed = (
        select(view_of(display, PYRAMID, OnSurface("cover", lenses=lenses)), tolerance).pages
        for lenses in ((), (lens,))
    )
    levels = PYRAMID.page_of(plain)[0]
    finer = PYRAMID.page_of(lensed)[0]
    assert finer.min() <= levels.min() - 3
    assert finer.max() > levels.max()


@pytest.mark.parametrize("name", LENSES)
def test_only_pages_that_are_seen_through_lenses_alone_are_left_out(name):
    """Cells and pages as masks of pixels: the definition."""
    display = small_room(pitch_mm=2.5)
    view = view_of(display, PYRAMID, OnSurface("cover", lenses=LENSES[name]))
    pairs = flat_pairs(view, tolerance_of([limen.Viewer((0.4, 1.6, -1.2))], Policy("acuity", 2.0)))
    kept = view.cells.without(PYRAMID, pairs.panel, pairs.page)
    assert kept.any()
    assert kept.all() == (name == "small"), "it reaches no whole page"
    level, column, row = PYRAMID.page_of(pairs.page)
    for number, panel in enumerate(display.panels):
        width, height = panel.size_px
        covered = np.zeros((height, width), dtype=int)
        for left, top, right, bottom in view.cells.rect_px[view.cells.panel == number]:
            covered[top:bottom, left:right] += 1
        assert covered.max() <= 1, "cells share no pixel"
        texels = pixels(panel).reshape(height, width, 2) * view.maps.scale[number] + view.maps.offset[number]
        inside = ((texels >= 0) & (texels < PYRAMID.size_px)).all(axis=2)
        for lens in LENSES[name]:
            reached = (np.abs(texels - lens.centre_px) < lens.radii_px).all(axis=2)
            assert covered[reached].all(), "cells hold all that a lens reaches"
        for pair in np.flatnonzero(pairs.panel == number):
            span = 256 * 2 ** level[pair]
            shown = inside & (texels // span == (column[pair], row[pair])).all(axis=2)
            assert kept[pair] == bool((covered[shown] == 0).any()) or not shown.any()


class Unread(NamedTuple):
    """An image of which only the size is asked."""

    pyramid: Pyramid = PYRAMID

    def read_page(self, page):
        raise AssertionError(f"page {page} is read")


@pytest.mark.parametrize("name", LENSES)
def test_what_lenses_reach_is_kept_while_messages_say_the_same(name):
    display, first = limen.Display.window((640, 400)), OnSurface("cover", lenses=LENSES[name])
    layer = ImageLayer(Unread(), first)
    selector = layer.selector(display, display)
    stream = selector.sources[0].stream(Slots(500), 2)
    views = [QuiltView.of(QuiltPanels(display, Quilt((640, 400), (0,), ((0, 0),))), [])]
    found = []
    for placement in (first, first, OnSurface("cover", lenses=LENSES[name][::-1], zoom=1.5)):
        state = msgspec.structs.replace(layer.state(0.0, display), placement=placement)
        frame = decode(encode(FrameState(layers=(state,))))
        cut = selector.select(views, frame.layers[0], frame, [stream.resident], live=True)
        found.append(cut.parts[0].view)
    stream.close()
    selector.close()
    assert found[0] is found[1]
    assert found[0] is not found[2]
    assert found[2].placement.zoom == 1.5
