"""Every pixel is drawn at the level that the formula gives, wherever panels and viewers stand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.display.panel import Panel
from limen.layers.common.page_detail import BLEND_LEVELS, KEPT, reduced_detail
from limen.layers.image.select import ImageOnDisplay, levels_at, shares_at, view_of
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import Tolerance, tolerance_of
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

_FULL = tolerance_of([], Policy("full"))


def _turned(seed: int) -> tuple[Any, Any]:
    """A random rotation's first two rows."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return tuple(q[0]), tuple(q[1])


def _wall(seed: int, panels: int = 3) -> Display:
    """Panels of odd sizes and pitches in random places and orientations."""
    rng = np.random.default_rng(seed)
    made = []
    for number in range(panels):
        right, down = _turned(100 * seed + number)
        width, height = (int(side) for side in rng.integers(90, 260, 2))
        pitch = float(rng.uniform(0.0008, 0.003))
        made.append(
            Panel(
                name=f"p{number}",
                size_px=(width, height),
                origin_m=tuple(rng.uniform(-2, 2, 3)),
                right=right,
                down=down,
                pitch_m=(pitch, pitch * 1.1),
                surface_m=(float(number), float(rng.uniform(0, 0.3))),
                nudge_px=(float(rng.uniform(-5, 5)), 2.5),
            )
        )
    return Display("random", tuple(made))


def _grid(panel: Panel) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.arange(panel.size_px[0]) + 0.5, np.arange(panel.size_px[1]) + 0.5)
    return np.stack([x, y], axis=-1)


def _undecided(view: ImageOnDisplay, index: int, tolerance: Tolerance) -> NDArray[np.bool_]:
    """Pixels where as much is finer as coarser, to 4e-3: rounding may decide there which level prevails."""
    finer = shares_at(view, tolerance, index, _grid(view.display.panels[index])).cumsum(axis=0)
    return (np.abs(finer - 0.5) < 4e-3).any(axis=0)


@pytest.fixture(scope="module")
def noise(memory_image: Any) -> Any:
    return memory_image(np.random.default_rng(5).integers(0, 256, (2100, 3300, 3), dtype=np.uint8))


@pytest.mark.parametrize("seed", range(6))
def test_levels_follow_the_formula_on_any_panel(seed: int, studio: Any, noise: Any) -> None:
    display = _wall(seed)
    rng = np.random.default_rng(seed)
    viewers = [
        Viewer(
            tuple(rng.uniform(-3, 3, 3)),
            direction=tuple(rng.normal(size=3)),
            gaze=tuple(rng.normal(size=3)) if number == 1 else None,
            acuity_arcmin=None if number else float(rng.uniform(1, 4)),
        )
        for number in range(1 + seed % 3)
    ]
    tolerance = tolerance_of(viewers, Policy("acuity", 2.0, gaze=seed % 2 == 1))
    placement = OnSurface("cover", zoom=0.6 + 0.3 * seed)
    # Half of the walls show an image of which many pages are faint.
    share = (
        rng.choice([0.0, 0.3, 0.9, 1.0], noise.pyramid.page_count) if seed > 2 else np.ones(noise.pyramid.page_count)
    )
    detail = reduced_detail(noise.pyramid, share)
    view = view_of(display, noise.pyramid, placement, detail)
    drawn = studio.draw(noise, display, placement, tolerance, overlay="exact", detail=detail)
    for index, panel in enumerate(display.panels):
        picture = drawn[panel.name]
        expected = levels_at(view, tolerance, index, _grid(panel))
        sure = ~_undecided(view, index, tolerance)
        assert (picture[..., 3] > 0)[sure].tolist() == (expected >= 0)[sure].tolist()
        shown = sure & (expected >= 0)
        assert (picture[..., 0] == expected)[shown].all()
        assert (picture[..., 1] == 0).all()  # nothing coarser than asked for
        assert sure.mean() > 0.99


def test_several_levels_are_tested_at_all(studio: Any, noise: Any) -> None:
    display = _wall(2)
    tolerance = tolerance_of([Viewer((0.0, 0.0, 0.0))], Policy("acuity", 2.0))
    drawn = studio.draw(noise, display, OnSurface("cover"), tolerance, overlay="exact")
    assert len({level for picture in drawn.values() for level in np.unique(picture[..., 0])}) >= 2


def test_nobody_or_policy_full_is_the_mip_level(studio: Any, noise: Any) -> None:
    drawn = studio.draw(noise, Display.window((300, 200)), OnSurface(), _FULL, overlay="exact")["window"]
    assert np.unique(drawn[drawn[..., 3] > 0][:, 0]).tolist() == [3]  # 3300 / 300 = 11 texels a pixel


def test_a_tight_budget_coarsens_every_pixel_alike(studio: Any, noise: Any) -> None:
    display = Display.window((300, 200))
    full = studio.draw(noise, display, OnSurface("one-to-one"), _FULL, overlay="exact")["window"]
    tight = studio.draw(noise, display, OnSurface("one-to-one"), _FULL, overlay="exact", budget=3)["window"]
    assert full[..., 0].max() == 0
    assert tight[..., 0].min() == tight[..., 0].max() > 0


SHAPES = {
    "plane": OnShape("plane", (-3, 2.5, -4), (6, 0.0, 0.7), (0.3, -4.0, 0)),
    "cylinder": OnShape("cylinder", (0, 0.1, 0), (0.4, 0, -5.0), (0, -6.0, 0)),
    "part of a cylinder": OnShape("cylinder", (0, 0.1, 0), (0.4, 0, -5.0), (0, -6.0, 0), turn_deg=170),
    "ellipsoid": OnShape("ellipsoid", (0, 0, 0), (0, 0, -5.0), (0, -4.0, 0), depth=(6.0, 0, 0)),
}


def _texel(placement: OnShape, pyramid: Pyramid, eye_m: Any, position_m: Any) -> Any:
    """The definition of the three mappings, in double precision; NaN where nothing is seen."""
    local = placement.local_from_room()
    eye = local[:3, :3] @ np.array(eye_m) + local[:3, 3]
    ray = position_m @ local[:3, :3].T + local[:3, 3] - eye
    if placement.kind == "plane":
        t = -eye[2] / ray[..., 2]
        u, v = eye[0] + t * ray[..., 0], eye[1] + t * ray[..., 1]
    else:
        round_axes = np.array([1.0, placement.kind == "ellipsoid", 1.0])
        a = (ray * ray * round_axes).sum(-1)
        b = (ray * eye * round_axes).sum(-1)
        root = b * b - a * ((eye * eye * round_axes).sum() - 1)
        with np.errstate(invalid="ignore"):
            near, far = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a
        t = np.where(near > 0, near, far)
        hit = eye + t[..., None] * ray
        u = 0.5 + np.arctan2(hit[..., 0], hit[..., 2]) / math.radians(placement.turn_deg)
        latitude = np.arcsin(np.clip(hit[..., 1], -1, 1))
        v = 0.5 + (0.5 * hit[..., 1] if placement.kind == "cylinder" else latitude / np.pi)
    texel = np.stack([u, v], -1) * np.array(pyramid.size_px)
    return np.where((t > 0)[..., None], texel, np.nan)


def _bent_mip(placement: OnShape, pyramid: Pyramid, eye_m: Any, panel: Panel) -> Any:
    """``log2 A`` of every pixel and whether it shows the image, by differences to the next pixel."""
    grid = _grid(panel)
    here, right, down = (
        _texel(placement, pyramid, eye_m, panel.position_m(grid + step)) for step in ((0, 0), (1, 0), (0, 1))
    )
    period = pyramid.size_px[0] if placement.kind != "plane" and placement.turn_deg == 360 else np.inf

    def size(step: Any) -> Any:
        x = step[..., 0] - (np.round(step[..., 0] / period) * period if np.isfinite(period) else 0)
        return np.hypot(x, step[..., 1])

    with np.errstate(invalid="ignore"):
        inside = ((here >= 0) & (here < np.array(pyramid.size_px))).all(-1)
        edge = (np.abs(here - np.array(pyramid.size_px)) < 0.01).any(-1) | (np.abs(here) < 0.01).any(-1)
        footprint = np.maximum(size(right - here), size(down - here))
    return np.log2(np.nan_to_num(footprint, nan=1.0)) + 1e-3, inside, edge


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("viewers", [0, 2])
def test_levels_follow_the_formula_on_shapes(shape: str, viewers: int, studio: Any, noise: Any) -> None:
    placement = SHAPES[shape]
    eye_m = (0.2, 0.3, -0.1)
    display = Display.preset("cave").scaled(0.12)
    people = [Viewer(eye_m, acuity_arcmin=30), Viewer((0.9, 0.5, 0.9), acuity_arcmin=50)][:viewers]
    tolerance = tolerance_of(people, Policy("acuity"))
    drawn = studio.draw(noise, display, placement, tolerance, overlay="exact", eye_m=eye_m)
    for panel in display.panels:
        picture = drawn[panel.name]
        mip, inside, edge = _bent_mip(placement, noise.pyramid, eye_m, panel)
        allowed = np.maximum(tolerance.allowed_px(panel.position_m(_grid(panel)), panel.pitch_m[0]), 1e-9)
        prevails = np.log2(KEPT * allowed) + mip + BLEND_LEVELS / 2
        expected = np.clip(np.floor(np.maximum(mip, prevails)), 0, len(noise.pyramid.levels) - 1)
        sure = (~inside | (np.abs(mip - np.round(mip)) > 2e-3)) & ~edge
        sure &= np.abs(prevails - np.round(prevails)) > 2e-3
        assert ((picture[..., 3] > 0) == inside)[sure].all()
        assert (picture[..., 0] == expected)[sure & inside].all()
        assert (picture[..., 1] == 0).all()
        assert sure.mean() > 0.95


def test_a_preview_is_tinted_by_the_levels_of_the_true_panels(studio: Any, memory_image: Any) -> None:
    """An eighth of the pixels, and the same rings of colour."""
    display = Display.window((640, 480), pitch_m=0.002, distance_m=1.0)
    tolerance = tolerance_of([Viewer((0.3, 0.1, -0.7))], Policy("acuity", 30.0))
    slope = np.linspace(40, 200, 1200)[None, :, None] + np.linspace(0, 40, 900)[:, None, None]
    image = memory_image(np.broadcast_to(slope, (900, 1200, 3)).astype(np.uint8))
    for placement in (OnSurface("cover"), OnShape("plane", (-2, 1.5, -1.5), (4, 0, 0), (0, -3, 0), eye_m=(0, 0, 0))):
        true, small = (
            studio.draw(image, shown, placement, tolerance, overlay="levels")["window"][..., :3].astype(float)
            for shown in (display, display.scaled(0.125))
        )
        plain = studio.draw(image, display.scaled(0.125), placement, _FULL)["window"][..., :3].astype(float)
        off = np.abs(true.reshape(60, 8, 80, 8, 3).mean((1, 3)) - small)
        assert np.median(off) < 5
        assert np.percentile(off, 95) < 40, "alike but for the rings' edges and fine detail"
        # The viewer's distance decides: places that differ in level differ in colour, whatever the preview's own mip.
        assert np.abs(small - plain).mean() > 15
        green = small[..., 1] - plain[..., 1]
        assert green.max() - green.min() > 40, "several rings"


@pytest.mark.parametrize("gaze", [False, True])
def test_a_preview_shows_the_true_levels_where_detail_is_faint_too(gaze: bool, studio: Any, memory_image: Any) -> None:
    """What is tinted is one grey, so that a preview differs from the true panels by its tints alone."""
    display = Display.window((640, 480), pitch_m=0.002, distance_m=1.0)
    viewer = Viewer((0.3, 0.1, -0.4), gaze=(-0.6, 0.2, -0.6))
    tolerance = tolerance_of([viewer], Policy("contrast", 14.0, gaze=gaze))
    image = memory_image(np.full((2400, 3200, 3), 120, np.uint8))
    share = np.random.default_rng(3).choice([0.0, 0.3, 0.9, 1.0], image.pyramid.page_count)
    detail = reduced_detail(image.pyramid, share)
    true, small, other = (
        studio.draw(image, shown, OnSurface("cover"), each, overlay="levels", detail=detail)["window"][..., :3].astype(
            float
        )
        for shown, each in ((display, tolerance), (display.scaled(0.25), tolerance), (display.scaled(0.25), _FULL))
    )
    sampled = linear_of_srgb(true / 255.0).reshape(120, 4, 160, 4, 3).mean((1, 3))
    off = np.abs(sampled - linear_of_srgb(small / 255.0)).max(axis=-1)
    assert np.percentile(off, 95) < 0.01, "but for the edges of pages"
    assert off.mean() < 0.003
    assert len(np.unique(small.reshape(-1, 3), axis=0)) > 3, "several levels"
    assert (small != other).any()
