"""Terrains: from the demands of viewers to pictures, drapes, and memory and budgets that are too small for all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image as Picture

import limen
from limen.data.image.file import open_image
from limen.data.mesh.mesh import NO_TEXTURE, Mesh
from limen.data.terrain.drape import texel_from_post
from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import pieces
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.frame.report import LayerReport
from limen.gpu.buffers import TextureReader
from limen.layers.base import Turn
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.mesh.layer import MeshLayer
from limen.layers.terrain.layer import Draped, TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.look_at import fitted_range_m, room_from_posts
from limen.layers.terrain.patches import patch_ranges
from limen.layers.terrain.selector import TerrainSettings
from limen.stream.allocators import Slots
from limen.stream.chunks import Resident, completed
from limen.stream.pages import FADE_S
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState
from limen.viewing.viewer import Pointer, Viewer
from support.frames import Rgb, drawn, frame_of, row_of
from support.ground import SIZE, hills

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

WALL = Display.named("rostock").scaled(1 / 16)
PART = Display.named("rostock").select(["wall/2,1", "wall/3,2"]).scaled(1 / 2)
MONITOR = Display.named("desktop").scaled(1 / 8)
EYE = (0.0, 1.5, 0.0)
SEAT = (0.0, 1.2, 0.0)
VIEWER = Viewer(EYE, direction=(0, 0, -1))
CLOSE = LookAt((0.55, 0.5), 30, 35, 5_000)
FAR = LookAt(range_m=60_000)


@pytest.fixture
def renderer(device: Any, terrain: Terrain) -> Iterator[Any]:
    """Makes renderers with other settings; ``fixed``: for the reference eye, whoever stands where."""
    made: list[Renderer] = []

    def make(display: Display = WALL, reference_m: Any = EYE, fixed: bool = False, **fields: Any) -> Renderer:
        extra = {name: fields.pop(name) for name in ("draped", "look") if name in fields}
        gpu_bytes = fields.pop("gpu_bytes", 64 << 20)
        settings = TerrainSettings(**({"look_at": CLOSE} | fields))
        layer = TerrainLayer(terrain, settings=settings, reference_m=reference_m, **extra)
        made.append(Renderer(device, display, [layer], eye_m=reference_m if fixed else None, gpu_bytes=gpu_bytes))
        return made[-1]

    yield make
    for each in made:
        each.close()


def shown(
    renderer: Renderer, viewers: Any = (VIEWER,), policy: str = "acuity", pointers: Any = ()
) -> tuple[dict[str, Rgb], LayerReport]:
    """Finished pictures of all panels, and what is told of the terrain in all of them."""
    frame = frame_of(renderer, *viewers, pointers=pointers, policy=Policy.parse(policy))
    pictures, report = drawn(renderer, frame)
    return pictures, row_of(report)


def allowed_of(row: LayerReport) -> tuple[float, float]:
    """The smallest and the largest error that active panels may have."""
    assert row.allowed_px is not None
    return row.allowed_px


def wall_of(pictures: dict[str, Rgb]) -> Rgb:
    """The pictures of the wall side by side, columns from the left and rows from the top."""
    rows = [np.concatenate([pictures[f"wall/{x},{y}"] for x in range(6)], axis=1) for y in range(4)]
    return np.concatenate(rows)


def test_the_land_stands_where_a_mesh_of_all_its_posts_stands(device: Any, renderer: Any, terrain: Terrain) -> None:
    """Against another way of drawing: every post a vertex, sorted to panels as meshes are."""
    pictures, report = shown(renderer(), policy="full")
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    posts = np.stack([columns, rows, hills()], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (columns + SIZE[0] * rows)[:-1, :-1].reshape(-1, 1)
    triangles = (first + np.array([[0, SIZE[0], SIZE[0] + 1, 0, SIZE[0] + 1, 1]])).reshape(-1, 3).astype(np.uint32)
    count = len(posts)
    up = np.tile(np.array([0, 0, 1], np.float32), (count, 1))
    mesh = Mesh(
        None, posts, triangles, up, np.full((count, 4), 255, np.uint8),
        np.zeros((count, 2), np.float32), np.full(count, NO_TEXTURE), np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip
    matrix = room_from_posts(terrain, WALL, EYE, CLOSE)
    with Renderer(device, WALL, [MeshLayer(mesh, RoomPlacement(matrix=matrix))]) as scene:
        others, _ = drawn(scene, frame_of(scene, VIEWER))
    land, other = (wall_of(each).max(axis=-1) > 40 for each in (pictures, others))
    assert 0.3 < land.mean() < 0.95
    assert (land != other).mean() < 0.002
    assert report.error_px <= allowed_of(report)[1] == 0.5


@pytest.mark.parametrize("policy", ["full", "acuity", "acuity+gaze", "scheel"])
@pytest.mark.parametrize("cut", ["adaptive", "level"])
def test_no_panel_errs_by_more_than_it_may(renderer: Any, policy: str, cut: str) -> None:
    _, report = shown(renderer(display=PART, cut=cut, look_at=FAR), policy=policy)
    assert report.panels_active == 2
    assert report.missing == 0
    assert 0 < report.error_px <= allowed_of(report)[1]


def test_policies_that_allow_more_draw_less_and_it_is_hardly_seen(renderer: Any) -> None:
    made = renderer(display=PART, look_at=FAR)
    seen = [shown(made, policy=policy) for policy in ("acuity", "snellen", "scheel")]
    triangles = [report.drawn for _, report in seen]
    assert triangles[0] > triangles[1] >= triangles[2]
    fine, acute, _ = (np.stack([pictures[name] for name in sorted(pictures)]).astype(int) for pictures, _ in seen)
    assert (np.abs(fine - acute).max(axis=-1) > 24).mean() < 0.01


def test_one_level_a_panel_takes_no_fewer_triangles_than_a_cut_that_adapts(renderer: Any) -> None:
    adaptive = shown(renderer(cut="adaptive"), policy="scheel")[1]
    level = shown(renderer(cut="level"), policy="scheel")[1]
    assert level.drawn >= adaptive.drawn


def test_a_fixed_camera_shows_the_same_from_anywhere_and_a_window_does_not(renderer: Any) -> None:
    aside = replace(VIEWER, position_m=(0.8, 1.2, -0.4))
    fixed, window = renderer(fixed=True), renderer()
    here, there = (wall_of(shown(fixed, [who], "full")[0]) for who in (VIEWER, aside))
    np.testing.assert_array_equal(here, there)
    here, there = (wall_of(shown(window, [who], "full")[0]) for who in (VIEWER, aside))
    assert (here != there).mean() > 0.3


def test_panels_that_nobody_sees_are_dark_until_somebody_points_there(renderer: Any) -> None:
    made = renderer(fixed=True, look_at=LookAt(pitch_deg=90, range_m=5_000))
    left = Viewer((-1.5, 1.5, -1.0), direction=(-1, 0, -0.3))
    pictures, report = shown(made, [left], "scheel")
    far = pictures["wall/5,3"]
    assert report.panels_active < 24
    assert far.max() < 40
    pointer = Pointer((1.5, 0.9, -0.5), (0, 0, -1))
    pointed, more = shown(made, [left], "scheel", pointers=[pointer])
    assert more.panels_active > report.panels_active
    assert pointed["wall/5,3"].max() > 60
    np.testing.assert_array_equal(pointed["wall/5,3"], shown(made, [left], "full")[0]["wall/5,3"])


def test_more_viewers_see_no_less(renderer: Any) -> None:
    made = renderer(fixed=True)
    people = [Viewer((x, 1.6, z), direction=(0, 0, -1)) for x, z in [(-1.2, -0.6), (1.0, 0.5), (0.2, -1.1)]]
    reports = [shown(made, people[:count], "scheel")[1] for count in (1, 2, 3)]
    assert reports[0].drawn <= reports[1].drawn <= reports[2].drawn
    assert allowed_of(reports[0])[0] >= allowed_of(reports[2])[0]


def test_live_frames_never_wait_and_end_with_the_finished_picture(device: Any, renderer: Any) -> None:
    made = renderer(display=MONITOR, reference_m=SEAT)
    viewer = Viewer(SEAT)
    whole, _ = shown(renderer(display=MONITOR, reference_m=SEAT), [viewer])
    reader, frame = TextureReader(device), frame_of(made, viewer)
    first = made.frame(frame, now_s=0.0)
    assert first.missing > 0
    for number in range(300):
        textures, report = made.textures(frame, now_s=number * 0.01)
        reader.read(textures[0])  # or frames are submitted faster than drawn
        if not report.missing:
            break
    textures, report = made.textures(frame, now_s=number * 0.01 + FADE_S)
    assert report.missing == 0
    live = pieces(MONITOR, made.quilts[0], reader.read(textures[0]))
    reader.destroy()
    for name, picture in live.items():
        apart = np.abs(picture[..., :3].astype(int) - whole[name].astype(int)).max(axis=-1)
        assert (apart > 2).mean() < 0.01


def test_pages_fade_in_to_the_end_however_slow_frames_are(terrain: Terrain) -> None:
    layer = TerrainLayer(terrain, settings=TerrainSettings(look_at=CLOSE), reference_m=SEAT)
    selector = layer.selector(MONITOR, MONITOR)
    places = [patch_ranges(terrain, 1 << 20, 1 << 20), Slots(1000), Slots(1000)]
    streams = [source.stream(place, 2) for source, place in zip(selector.sources, places, strict=True)]
    frame = FrameState(viewers=(Viewer(SEAT),), layers=(layer.state(0.0, MONITOR),))
    views = [QuiltView.of(QuiltPanels(MONITOR, quilt), [SEAT]) for quilt in pack_outlines(MONITOR)]
    pages = np.arange(terrain.relief.pyramid.page_count)

    def resident() -> list[Resident]:
        return [stream.resident for stream in streams]

    def tables(now_s: float) -> Any:
        """Those of a frame that takes all pages that have come."""
        cut = selector.select(views, frame.layers[0], frame, resident(), live=True)
        for source, update in completed([(streams[0], cut.wanted[0])]):
            selector.take(source, update)
        for stream in streams[1:]:
            while stream.update(pages, now_s=now_s).statistics.missing:
                stream.wait()
        return selector.resolve(cut, resident()).parts[0].tables

    relief, heights = tables(10.0)
    assert relief.fade[0] == heights.fade[0] == 0
    kept = tables(20.0)
    assert all((table.fade == 1).all() for table in kept)
    assert all(one is other for one, other in zip(tables(30.0), kept, strict=True)), (
        "copied to the GPU only when something changes"
    )
    for stream in streams:
        stream.close()
    selector.close()


def test_a_drape_lies_north_up_over_the_land(renderer: Any, tmp_path: Path, terrain: Terrain) -> None:
    picture = np.zeros((100, 200, 3), np.uint8)
    picture[:50, :, 0], picture[50:, :, 2] = 220, 220  # red in the north, blue in the south
    picture[:, :100, 1] = 160  # and green in the west
    path = tmp_path / "drape.png"
    Picture.fromarray(picture).save(path)
    with open_image(path) as image:
        draped = Draped(image, texel_from_post(terrain, path, image.size_px))
        made = renderer(draped=draped, look=TerrainLook("drape"), look_at=LookAt(pitch_deg=90), fixed=True)
        wall = wall_of(shown(made, policy="full")[0]).astype(int)
    covered = np.argwhere(wall.max(axis=-1) > 60)
    (top, left), (bottom, right) = covered.min(axis=0), covered.max(axis=0)

    def at(x: float, y: float) -> Any:
        return wall[round(top + y * (bottom - top)), round(left + x * (right - left))]

    assert at(0.8, 0.2)[0] > 2 * at(0.8, 0.2)[2]
    assert at(0.8, 0.8)[2] > 2 * at(0.8, 0.8)[0]
    assert at(0.2, 0.8)[1] > 2 * at(0.8, 0.8)[1]


def pages_of(renderer: Renderer, viewer: Viewer, policy: str, pointers: Any) -> int:
    """How many pages of relief and drape all quilts want."""
    frame = frame_of(renderer, viewer, pointers=pointers, policy=Policy.parse(policy))
    (piece,) = renderer.choose(frame).pieces
    choices = [part.choice for part in piece.cut.parts]
    return sum(len(choice.pages.pages) + len(choice.drape_pages.pages) for choice in choices)


def test_faint_pages_of_a_drape_are_left_out_and_stark_ones_drawn(
    renderer: Any, tmp_path: Path, terrain: Terrain
) -> None:
    """A drape half flat, half noise: with `contrast` only the noise is drawn from fine pages; a pointer wants all."""
    picture = np.full((512, 1024, 3), 128, np.uint8)
    picture[:, 600:] = np.random.default_rng(5).choice([20, 230], size=(512, 424, 1))
    path = tmp_path / "drape.png"
    Picture.fromarray(picture).save(path)
    viewer, pointer = Viewer((0.0, 1.5, -1.0), direction=(0, 0, -1)), Pointer((0.0, 1.5, 5.0), (0, 0, -1))
    with open_image(path) as image:
        draped = Draped(image, texel_from_post(terrain, path, image.size_px))
        made, pages = {}, {}
        for name, pointers in {"acuity": (), "contrast": (), "contrast selected": (pointer,)}.items():
            fresh = renderer(display=Display.named("rostock").scaled(1 / 8), draped=draped, look=TerrainLook("drape"),
                             look_at=LookAt(pitch_deg=90), fixed=True)  # fmt: skip
            pictures, report = shown(fresh, [viewer], name.split()[0], pointers=pointers)
            made[name] = wall_of(pictures).astype(int), report
            pages[name] = pages_of(fresh, viewer, name.split()[0], pointers)
    (plain, acuity), (faint, contrast), _ = made.values()
    assert contrast.missing == acuity.missing == 0
    assert contrast.drawn == acuity.drawn
    assert pages["acuity"] - 4 == pages["contrast"] < pages["contrast selected"] <= pages["acuity"]
    assert acuity.chunks - 4 == contrast.chunks
    assert np.abs(plain - faint).max() <= 1
    assert np.ptp(plain[:, plain.shape[1] // 2 :]) > 100


def test_little_memory_draws_coarser_and_says_so(renderer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # As if the land were larger: the least memory for pages is enough for all of its patches.
    monkeypatch.setattr(
        "limen.layers.terrain.draw.drawer.patch_ranges",
        lambda ground, vertices, indices: patch_ranges(ground, vertices // 4, indices // 4),
    )
    made = renderer(display=Display.named("desktop"), reference_m=SEAT, look_at=LookAt(), gpu_bytes=23 << 20)
    _, report = shown(made, [Viewer(SEAT)], "full")
    assert report.missing > 0
    assert report.error_px > 0.5


def test_a_budget_of_triangles_is_kept_and_costs_error(renderer: Any) -> None:
    free = shown(renderer(display=MONITOR, reference_m=SEAT), [Viewer(SEAT)], "full")[1]
    budget = free.drawn // 4
    made = renderer(display=MONITOR, reference_m=SEAT, max_triangles=budget)
    tight = shown(made, [Viewer(SEAT)], "full")[1]
    assert tight.drawn < 1.3 * budget  # before the fans along borders
    assert tight.error_px > free.error_px


def test_render_takes_a_terrain(device: Any, terrain: Terrain) -> None:
    pictures = limen.render(terrain, WALL, [VIEWER], policy="scheel", panels="wall/2,*", placement=CLOSE, device=device)
    assert sorted(pictures) == [f"wall/2,{row}" for row in range(4)]
    assert pictures["wall/2,2"].max() > 60
    wrongs: tuple[dict[str, Any], ...] = ({"overlay": "levels"}, {"placement": np.eye(4)})
    for wrong in wrongs:
        with pytest.raises(InputError, match="not for a terrain"):
            limen.render(terrain, WALL, [VIEWER], device=device, **wrong)
    with pytest.raises(InputError, match="give a viewer"):
        limen.render(terrain, WALL, device=device)


def test_a_terrain_that_was_dragged_is_looked_at_from_elsewhere(terrain: Terrain) -> None:
    layer = TerrainLayer(terrain, settings=TerrainSettings(look_at=CLOSE), reference_m=EYE)
    state = layer.state(0.0, WALL)
    assert layer.turned(state, Turn(), WALL) is state
    turned = layer.turned(state, Turn(50.0, 10.0, 2.0), WALL)
    looks = msgspec.structs.replace(CLOSE, heading_deg=-20, pitch_deg=45, range_m=10_000)
    assert turned == msgspec.structs.replace(state, placement=looks)
    steep, flat = (layer.turned(state, Turn(0, pitch_deg), WALL).placement for pitch_deg in (80, -80))
    assert isinstance(steep, LookAt)
    assert isinstance(flat, LookAt)
    assert (steep.pitch_deg, flat.pitch_deg) == (90, 1)
    fitted = TerrainLayer(terrain, reference_m=EYE)
    nearer = fitted.turned(fitted.state(0.0, WALL), Turn(nearer=0.5), WALL).placement
    assert isinstance(nearer, LookAt)
    assert nearer.range_m == pytest.approx(fitted_range_m(terrain, WALL, EYE, LookAt()) / 2)


def test_a_flight_is_where_it_is_at_a_time(terrain: Terrain) -> None:
    layer = TerrainLayer(terrain, settings=TerrainSettings(look_at=CLOSE, flight="orbit"))
    places = [layer.state(time_s, WALL).placement for time_s in (0.0, 10.0)]
    assert places == [CLOSE, msgspec.structs.replace(CLOSE, heading_deg=90)]
