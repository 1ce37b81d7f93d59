"""Gain and falloff hold for every pixel of a panel, whatever it shows: against a product in plain NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.points.file import Points
from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.panel import Panel
from limen.display.quilt import Quilt, pack, pieces
from limen.frame.matching import MATCHED, least_cosine, matched_rows
from limen.frame.renderer import Renderer
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.layers.image.select import select, view_of
from limen.layers.mesh.layer import MeshLayer, MeshPart
from limen.layers.terrain.look_at import room_from_posts
from limen.viewing.camera import Camera
from limen.viewing.lens import Lens
from limen.viewing.placement import InRoom, LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState, LayerState
from limen.viewing.tessellation import Tessellation
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer
from support.clouds import ball
from support.drawing import NOWHERE, Easel, eyes_view, mesh_view
from support.lands import GridLand
from support.meshes import plain, square
from support.splats import drawer_of, leaves_of, part_of
from support.terrain_stage import Stage, codes_of, hills, leaves

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

Pictures: TypeAlias = dict[str, NDArray[np.uint8]]


class Tools(NamedTuple):
    device: Any
    studio: Any
    image: Any


Draw: TypeAlias = Callable[[Tools, Display], Pictures]

EYE = np.array([0.15, 0.05, 0.55])
GAIN, FALLOFF = 0.6, 1.5
BACKGROUND = (0.4, 0.1, 0.2)


@cache
def cloud() -> Points:
    return ball(1500)


MOST_CODES_OFF = 1
"""A pixel is rounded before it is dimmed and once more after it."""


def pair(**fields: Any) -> Display:
    """A panel as it is, and one at an angle to it, hexagonal, that has these fields."""
    turned = (float(np.cos(0.7)), 0.0, float(np.sin(0.7)))
    cut = ((20, 0), (110, 0), (130, 40), (130, 100), (30, 100), (0, 50))
    return Display(
        "pair",
        (
            Panel("as it is", (120, 100), (-0.36, 0.15, 0.0), (1, 0, 0), (0, -1, 0), (0.003, 0.003)),
            Panel("dimmed", (130, 100), (0.02, 0.15, 0.0), turned, (0, -1, 0), (0.003, 0.003), outline_px=cut,
                  surface_m=(0.36, 0.0), **fields),
        ),
    )  # fmt: skip


@pytest.fixture
def tools(device: Any, studio: Any, memory_image: Any) -> Tools:
    return Tools(device, studio, memory_image)


UNMATCHED, MATCHED_PAIR = pair(), pair(gain=GAIN, falloff=FALLOFF)


def expected_shares(panel: Panel, eye_m: Any, gain: float, falloff: float) -> NDArray[np.float64]:
    """The factor on each pixel's light, from the panel's place in the room: shape (h, w)."""
    width, height = panel.size_px
    y, x = np.mgrid[:height, :width] + 0.5
    if eye_m is None:
        return np.full(x.shape, gain)

    def cosine(places_m: Any) -> Any:
        ways = eye_m - places_m
        return ways @ np.array(panel.normal) / np.linalg.norm(ways, axis=-1)

    corners = cosine(panel.position_m(panel.lit_outline_px))
    assert corners.min() > 0.35, "no corner is so oblique that it stays dimmer"
    at = cosine(panel.position_m(np.stack([x, y], axis=-1)))
    return np.asarray(gain * np.minimum(corners.min() / at, 1.0) ** falloff)


# ---------------------------------------------------------------- what is drawn


def image_pixels() -> NDArray[np.uint8]:
    y, x = np.mgrid[:300, :780]
    return np.stack([x * 255 // 780, y * 255 // 300, (x + y) % 256], axis=-1).astype(np.uint8)


def on_image(placement: Any, *, overlay: str = "", viewers: bool = True) -> Draw:
    def draw(tools: Tools, display: Display) -> Pictures:
        look = [Viewer(tuple(EYE.tolist()))] if viewers else []
        tolerance = tolerance_of(look, Policy("full"))
        eye = tuple(EYE.tolist()) if viewers else None
        image = tools.image(image_pixels())
        view = view_of(display, image.pyramid, placement)
        cut = select(view, tolerance, eye_m=eye)
        # Read one after the other, pages have the same slots in both pictures.
        with tools.studio.exhibit(image, matched=True) as exhibit:
            exhibit.settle(cut.pages)
            part = exhibit.part(view, cut, tolerance, eye)
            return {
                name: picture.copy()
                for quilt in pack(display)
                for name, picture in pieces(display, quilt, exhibit.draw(quilt, part, overlay)).items()
            }

    return draw


def pictures_of(display: Display, quilt: Quilt, drawn: NDArray[np.uint8]) -> Pictures:
    return {name: picture.copy() for name, picture in pieces(display, quilt, drawn).items()}


def terrain(tools: Tools, display: Display) -> Pictures:
    """Hills under a coloured sky."""
    land = GridLand(hills(65, 65), (2.0, 2.0), leaf=32)
    stage = Stage(tools.device, land, matched=True)
    room = room_from_posts(land, display, tuple(EYE.tolist()), LookAt(pitch_deg=15, range_m=90.0))
    stage.load(leaves(land))
    drawn = stage.draw(display, room, leaves(land), eyes=EYE)
    stage.close()
    return pictures_of(display, stage.view.quilt, drawn)


def mesh(tools: Tools, display: Display) -> Pictures:
    """A small square before a coloured background."""
    (quilt,) = pack_outlines(display)
    shown = square(-0.4, 0.25)
    return pictures_of(display, quilt, mesh_picture(tools.device, shown, mesh_view(display, quilt, shown, EYE)))


def mesh_picture(device: Any, shown: Any, view: QuiltView) -> NDArray[np.uint8]:
    from limen.layers.mesh.draw.drawer import MeshDrawer

    drawer = MeshDrawer(device, MeshLayer(shown))
    with Easel(device, background=BACKGROUND, matched=True) as easel:
        picture = easel.picture(drawer, view, MeshPart(NOWHERE)).copy()
    drawer.destroy()
    return picture


def points(tools: Tools, display: Display) -> Pictures:
    """A ball before a coloured background."""
    (quilt,) = pack_outlines(display)
    stands = np.diag([0.3, 0.3, 0.3, 1.0])
    stands[:3, 3] = (0.1, 0.0, -0.5)
    view, drawer = eyes_view(display, quilt, EYE), drawer_of(tools.device, cloud())
    with Easel(tools.device, background=BACKGROUND, matched=True) as easel:
        picture = easel.picture(drawer, view, part_of(view, stands, leaves_of(cloud(), 2))).copy()
    drawer.destroy()
    return pictures_of(display, quilt, picture)


LENS = (Lens((390.0, 150.0), 110.0, 3.0),)
SHAPE = OnShape("plane", (-0.6, 0.4, -0.3), (1.6, 0.0, 0.0), (0.0, -0.8, 0.0))
KINDS: dict[str, Draw] = {
    "image": on_image(OnSurface(fit="cover")),
    "image that fills a part": on_image(OnSurface(fit="contain", zoom=0.6)),
    "image on a shape": on_image(SHAPE),
    "image through a lens": on_image(OnSurface(fit="cover", lenses=LENS)),
    "image through triangles": on_image(OnSurface(fit="cover", lenses=LENS, tessellation=Tessellation("error"))),
    "levels of an image": on_image(OnSurface(fit="cover"), overlay="levels"),
    "terrain": terrain,
    "mesh": mesh,
    "points": points,
}


def check(before: Pictures, after: Pictures, shares: NDArray[np.float64]) -> None:
    """One panel is bit for bit what it was, the other one dimmed."""
    np.testing.assert_array_equal(after["as it is"], before["as it is"])
    light = linear_of_srgb(before["dimmed"][..., :3] / 255)
    assert light.max() > 0.1, "something is to be seen"
    expected = codes_of(light * shares[..., None]).astype(int)
    off = np.abs(after["dimmed"][..., :3].astype(int) - expected)
    assert off.max() <= MOST_CODES_OFF, (
        f"{(off > MOST_CODES_OFF).mean():.2%} of the codes are off, by up to {off.max()}"
    )
    assert np.abs(expected - before["dimmed"][..., :3]).max() > 20, "dimming is to be seen"
    np.testing.assert_array_equal(after["dimmed"][..., 3:], before["dimmed"][..., 3:])


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_content_and_background_is_dimmed_alike(tools: Tools, kind: str) -> None:
    shares = expected_shares(MATCHED_PAIR.panels[1], EYE, GAIN, FALLOFF)
    check(KINDS[kind](tools, UNMATCHED), KINDS[kind](tools, MATCHED_PAIR), shares)


def test_an_image_that_nobody_looks_at_has_its_gain_alone(tools: Tools) -> None:
    draw = on_image(OnSurface(fit="cover"), viewers=False)
    check(draw(tools, UNMATCHED), draw(tools, MATCHED_PAIR), expected_shares(MATCHED_PAIR.panels[1], None, GAIN, 0.0))


def test_both_eyes_side_by_side_are_dimmed_for_their_own_place(device: Any) -> None:
    eyes = EYE + np.array([[-0.05, 0.0, 0.0], [0.05, 0.0, 0.0]])
    pictures = {}
    for display in (UNMATCHED, MATCHED_PAIR):
        (quilt,) = pack_outlines(display)
        shown = square(-0.4, 2.0)
        drawn = mesh_picture(device, shown, mesh_view(display, quilt, shown, eyes))
        width = quilt.size_px[0]
        pictures[display] = [pictures_of(display, quilt, drawn[:, k * width :][:, :width]) for k in range(2)]
    panel = MATCHED_PAIR.panels[1]
    each = [expected_shares(panel, eye, 1.0, 1.0) for eye in eyes]
    at = [(eye - panel.position_m(panel.lit_outline_px)) for eye in eyes]
    least = min((ways @ np.array(panel.normal) / np.linalg.norm(ways, axis=-1)).min() for ways in at)
    for eye, own in enumerate(each):
        own_least = (at[eye] @ np.array(panel.normal) / np.linalg.norm(at[eye], axis=-1)).min()
        shares = GAIN * np.minimum(own * least / own_least, 1.0) ** FALLOFF  # both are matched to one least cosine
        check(pictures[UNMATCHED][eye], pictures[MATCHED_PAIR][eye], shares)


def test_a_simulated_display_shows_gain_once_and_falloff_as_the_viewer_gets_it(device: Any) -> None:
    """Seen from where it was drawn for, a white panel is evenly bright: gain times the light at its dimmest corner."""
    white = MeshLayer(plain([(-9, -9, -0.5), (9, -9, -0.5), (0, 18, -0.5)], [(0, 1, 2)]))
    away = np.eye(4)
    away[0, 3] = 99.0  # only the background is seen
    middle = MATCHED_PAIR.panels[1].outline_m.mean(axis=0)
    camera = Camera(tuple(EYE.tolist()), tuple((middle - EYE).tolist()), (64, 64), 8.0)
    with Renderer(device, MATCHED_PAIR, [white], background=(1.0, 1.0, 1.0)) as renderer:
        state = LayerState(placement=InRoom.of(away), policy=white.policy)
        frame = FrameState(viewers=(Viewer(tuple(EYE.tolist())),), layers=(state,))
        (picture,) = renderer.seen(frame, [camera])
    seen = linear_of_srgb(picture[..., :3] / 255)
    expected = GAIN * least_cosine(MATCHED_PAIR, EYE[None]) ** FALLOFF
    np.testing.assert_allclose(seen, expected, rtol=0.02)


def test_displays_of_alike_panels_have_no_such_pass() -> None:
    (quilt,) = pack_outlines(UNMATCHED)
    assert len(matched_rows(QuiltPanels(UNMATCHED, quilt), EYE[None])) == 0
    one = replace(UNMATCHED, panels=(UNMATCHED.panels[0], replace(UNMATCHED.panels[1], gain=0.5)))
    assert len(matched_rows(QuiltPanels(one, quilt), EYE[None])) == 1


def test_the_least_cosine_is_the_displays_whichever_panels_a_quilt_holds() -> None:
    whole = least_cosine(MATCHED_PAIR, EYE[None])
    assert 0.35 < whole < 0.9
    assert least_cosine(UNMATCHED, EYE[None]) == 1.0
    for panel in MATCHED_PAIR.panels:
        assert least_cosine(MATCHED_PAIR.select(panel.name), EYE[None]) == whole, "panels that are drawn apart match"
    assert least_cosine(MATCHED_PAIR.scaled(0.5), EYE[None]) == pytest.approx(whole)
    (quilt,) = pack_outlines(MATCHED_PAIR)
    assert matched_rows(QuiltPanels(MATCHED_PAIR, quilt), EYE[None])["least_cosine"] == pytest.approx(whole)
    beside = MATCHED_PAIR.panels[1].outline_m.mean(axis=0) + 0.05 * np.array(MATCHED_PAIR.panels[1].normal)
    assert least_cosine(MATCHED_PAIR, beside[None]) == 0.35, "somebody nearly in the plane does not darken all others"


def test_the_struct_is_what_the_shader_says() -> None:
    text = shader_text("limen.frame", "matching.wgsl")
    begin = text.index("struct Matched {")
    body = [line for line in text[begin : text.index("}", begin) + 1].splitlines() if "//" not in line]
    assert body == wgsl_struct("Matched", MATCHED).splitlines()
