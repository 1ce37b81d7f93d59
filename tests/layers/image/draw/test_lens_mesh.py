"""Lenses in triangles: they tile what lenses reach, share their sides, and draw nothing farther off than they may."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from limen.data.pages import Pyramid
from limen.frame.renderer import Renderer
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.layers.image.draw import lens_mesh
from limen.layers.image.layer import ImageLayer
from limen.layers.image.lens_cells import NOBODY, LensCells
from limen.layers.image.select import ImageOnDisplay, view_of
from limen.study.bench.lens import DrawnLenses, drawn_lenses, measured
from limen.study.blank_source import Blank
from limen.viewing.lens import Lens, sharpest_bend, source_of
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tessellation import LENS_MODES, Tessellation
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer
from support.frames import frame_of
from support.lenses import LENSES, SIZE_PX, picture, wall, waves

pytestmark = pytest.mark.gpu

_FULL = Policy("full")
_MIDDLE = (0.063, 0.955)
CHAINS = {
    **LENSES,
    "strong": (Lens((900.0, 640.0), 380.0, 16.0, 0.3),),
    "creased": (Lens((980.0, 700.0), 300.0, 4.0, 0.3, "linear", "rectangular"),),
    "tiny": (Lens((940.0, 660.0), 300.0, 3.0), Lens((930.0, 655.0), 14.0, 3.0)),
}


@pytest.fixture(scope="module")
def renderer(device: Any) -> Iterator[Renderer]:
    with blank_wall(device) as made:
        yield made


def blank_wall(device: Any) -> Renderer:
    return Renderer(device, wall(), [ImageLayer(Blank(Pyramid.of(SIZE_PX)))], gpu_bytes=1 << 26)  # type: ignore[arg-type]


def drawn(renderer: Renderer, name: str, tessellation: Tessellation, viewers: tuple[Viewer, ...] = ()) -> DrawnLenses:
    placement = OnSurface("one-to-one", zoom=0.7, lenses=CHAINS[name], tessellation=tessellation)
    policy = Policy("acuity", 1.0) if viewers else _FULL
    return drawn_lenses(renderer, frame_of(renderer, *viewers, placement=placement, policy=policy))


def cells_of(seen: DrawnLenses) -> LensCells:
    """What lenses reach of the wall."""
    assert seen.view.cells is not None
    return seen.view.cells


def check_tiling(seen: DrawnLenses) -> None:
    """All cells are covered once, and no corner lies on another triangle's side."""
    cells, triangles = cells_of(seen), seen.triangles
    size = cells.rect_px[:, 2:] - cells.rect_px[:, :2]
    area = np.abs(np.linalg.det(np.diff(triangles.pixel, axis=1))) / 2
    assert area.min() > 0
    assert area.sum() == pytest.approx(size.prod(axis=1).sum(), rel=1e-6)
    ends = np.stack([triangles.pixel, np.roll(triangles.pixel, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    order = np.lexsort((ends[:, :, 1], ends[:, :, 0]), axis=1)
    sides = np.take_along_axis(ends, order[:, :, None], axis=1).reshape(-1, 4)
    named = np.column_stack([np.repeat(triangles.panel, 3), sides])
    found, counts = np.unique(named, axis=0, return_counts=True)
    assert counts.max() == 2
    lone = found[counts == 1]
    border = ((cells.beside == NOBODY) * size[:, [1, 0, 1, 0]]).sum()
    assert np.hypot(*(lone[:, 3:] - lone[:, 1:3]).T).sum() == pytest.approx(border, rel=1e-6), "a crack"


@pytest.mark.parametrize("mode", LENS_MODES[1:])
def test_triangles_tile_what_lenses_reach_without_cracks(mode: Any, renderer: Renderer) -> None:
    for name in ("overlapping", "tiny"):
        seen = drawn(renderer, name, Tessellation(mode, segments=5, error_px=2.0))
        check_tiling(seen)
        if mode == "uniform":
            assert len(seen.triangles.panel) == 2 * 5**2 * len(cells_of(seen).panel)
        if mode == "coarse":
            assert len(seen.triangles.panel) == 2 * len(cells_of(seen).panel)


@pytest.mark.parametrize("name", CHAINS)
def test_nothing_is_drawn_farther_from_where_it_belongs_than_it_may(name: str, renderer: Renderer) -> None:
    found = measured(drawn(renderer, name, Tessellation("error")), 4000)
    assert 0.1 < found.max_error_px <= 0.5, "and no more triangles than it takes"
    assert found.least_turn > 0, "nothing is folded over"


def test_farther_viewers_get_fewer_triangles_whose_errors_they_do_not_see(renderer: Renderer) -> None:
    counts = []
    for distance_m in (0.5, 2.0, 6.0):
        viewers = (Viewer((*_MIDDLE, distance_m)),)
        seen = drawn(renderer, "strong", Tessellation("error"), viewers)
        counts.append(len(seen.triangles.panel))
        view, tolerance = seen.view, tolerance_of(viewers, Policy("acuity", 1.0))
        corners = np.array([panel.position_m([(0, 0), panel.size_px]) for panel in view.display.panels])
        most_px = tolerance.allowed_px(corners, view.display.pitch_m).max()
        assert measured(seen, 4000).max_error_px <= 0.5 * max(most_px, 1.0)
    assert counts[0] > 1.5 * counts[1] > 2.25 * counts[2]


def test_who_sees_nothing_gets_two_triangles_a_cell(renderer: Renderer) -> None:
    seen = drawn(renderer, "one", Tessellation("error", error_px=1e4))
    check_tiling(seen)
    assert len(seen.triangles.panel) == 2 * len(cells_of(seen).panel)


def plain_factors(view: ImageOnDisplay, tessellation: Tessellation) -> Any:
    """The paper's factor for every cell and side, for nobody: shape (N, 4)."""
    assert view.maps is not None
    assert view.cells is not None
    factors = np.zeros((len(view.cells.panel), 4))
    for number, (panel, rect) in enumerate(zip(view.cells.panel, view.cells.rect_px, strict=True)):
        left, top, right, bottom = rect.astype(float)
        sides = [((left, top), (left, bottom)), ((left, top), (right, top)), ((right, top), (right, bottom)),
                 ((left, bottom), (right, bottom))]  # fmt: skip
        for side, ends in enumerate(sides):
            first, last = (np.array(end) * view.maps.scale[panel] + view.maps.offset[panel] for end in ends)
            places = first + np.linspace(0, 1, 17)[:, None] * (last - first)
            bend = 0.0
            for lens in reversed(view.placement.lenses):  # type: ignore[union-attr]
                slope = lens.raised(places)[1]
                turned = np.linalg.norm(slope[1:] - slope[0], axis=1)
                bend = max(bend, (turned / np.linalg.norm(places[1:] - places[0], axis=1)).max() / sharpest_bend(lens))
                places = source_of([lens], places)
            length_px = math.dist(*ends)
            factors[number, side] = min(bend, 1.0) * (min(length_px / tessellation.sub_edge_px, 64) - 1) + 1
    return factors


def test_the_papers_factor_is_what_the_paper_says(renderer: Renderer) -> None:
    tessellation = Tessellation("acuity")
    seen = drawn(renderer, "overlapping", tessellation)
    factors, cells, triangles = plain_factors(seen.view, tessellation), cells_of(seen), seen.triangles
    assert factors.max() > 8
    corners = np.unique(np.column_stack([np.repeat(triangles.panel, 3), triangles.pixel.reshape(-1, 2)]), axis=0)
    for panel, rect, wanted in zip(cells.panel, cells.rect_px, factors, strict=True):
        here = corners[corners[:, 0] == panel, 1:]
        for side in range(4):
            across, along = side % 2, 1 - side % 2
            on = (here[:, across] == rect[side]) & (here[:, along] >= rect[along]) & (
                here[:, along] <= rect[along + 2]
            )  # fmt: skip
            parts = int(on.sum()) - 1
            assert math.ceil(wanted[side] - 0.02) <= parts <= math.ceil(wanted[side] + 0.02)


@pytest.mark.parametrize("tessellation", [Tessellation("uniform", segments=64), Tessellation("error", error_px=0.02)])
def test_what_does_not_fit_is_cut_less(tessellation: Tessellation, device: Any) -> None:
    small = replace(device, max_binding_bytes=1 << 19)
    with blank_wall(small) as renderer:
        found = drawn(renderer, "strong", tessellation)
        count = len(found.triangles.panel)
        assert 2 * len(cells_of(found).panel) < count <= (1 << 19) // (3 * lens_mesh.CORNER.itemsize)
        check_tiling(found)


def test_no_background_is_seen_between_triangles(studio: Any, memory_image: Any) -> None:
    """Where sides are cut unlike each other; the picture of `error` is compared with the definition below."""
    magenta = np.full((SIZE_PX[1], SIZE_PX[0], 3), (255, 0, 255), np.uint8)
    placement = OnSurface("one-to-one", zoom=0.7, lenses=CHAINS["overlapping"], tessellation=Tessellation("acuity"))
    seen = studio.draw(memory_image(magenta), wall(), placement, tolerance_of([], _FULL))
    for name, pixels in seen.items():
        assert (pixels == (255, 0, 255, 255)).all(), name


def test_a_picture_in_triangles_is_that_of_every_pixel(studio: Any, memory_image: Any) -> None:
    display, lenses = wall(), CHAINS["overlapping"]
    placement = OnSurface("one-to-one", zoom=0.6, lenses=lenses, tessellation=Tessellation("error"))
    seen = studio.draw(memory_image(picture()), display, placement, tolerance_of([], _FULL))
    maps = view_of(display, Pyramid.of(SIZE_PX), placement).maps
    assert maps is not None
    for number, panel in enumerate(display.panels):
        x, y = np.meshgrid(np.arange(panel.size_px[0]) + 0.5, np.arange(panel.size_px[1]) + 0.5)
        shown = np.stack([x, y], axis=-1) * maps.scale[number] + maps.offset[number]
        away = np.abs(seen[panel.name][..., :3] - waves(source_of(lenses, shown)))
        assert away.max() < 6, panel.name
        assert away.mean() < 0.7, panel.name


def test_the_overlay_shows_where_what_is_seen_does_not_belong(studio: Any, memory_image: Any) -> None:
    grey = np.full((SIZE_PX[1], SIZE_PX[0], 3), 128, np.uint8)

    def shares(mode: Any) -> dict[str, float]:
        placement = OnSurface("one-to-one", zoom=0.7, lenses=CHAINS["strong"], tessellation=Tessellation(mode))
        seen = studio.draw(memory_image(grey), wall(), placement, tolerance_of([], _FULL), overlay="error")
        pixels = np.concatenate([each.reshape(-1, 4)[:, :3].astype(int) for each in seen.values()])
        largest, spread = pixels.argmax(axis=1), np.ptp(pixels, axis=1)
        return {name: float(((largest == k) & (spread > 40)).mean()) for k, name in enumerate(("red", "green", "blue"))}

    assert shares("coarse")["red"] > 0.05
    bounded = shares("error")
    assert bounded["red"] == bounded["green"] == 0.0
    assert bounded["blue"] > 0.01


def test_rows_are_laid_out_as_the_shader_reads_them() -> None:
    text = shader_text("limen.layers.image.draw", "lens_mesh.wgsl")
    plain = "\n".join(line for line in text.splitlines() if not line.strip().startswith("//"))
    assert wgsl_struct("LensCell", lens_mesh.LENS_CELL) in plain
    assert wgsl_struct("Corner", lens_mesh.CORNER) in plain
