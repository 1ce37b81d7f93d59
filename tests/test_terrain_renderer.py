"""A terrain on a display, from the demands of viewers to pictures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Picture

import limen
from ground import SIZE, hills, write_dem
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.errors import InputError
from limen.layers.terrain import resources as terrain_stock
from limen.layers.terrain.look_at import room_from_posts
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.viewer import Pointer, Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

WALL = Display.named("rostock").scaled(1 / 16)
PART = Display.named("rostock").select(["wall/2,1", "wall/3,2"]).scaled(1 / 2)
MONITOR = Display.named("desktop").scaled(1 / 8)
EYE = (0.0, 1.5, 0.0)
VIEWER = Viewer(EYE, direction=(0, 0, -1))
CLOSE = LookAt((0.55, 0.5), 30, 35, 5_000)
FAR = LookAt(range_m=60_000)
Image = NDArray[np.uint8]


@pytest.fixture(scope="module")
def terrain(tmp_path_factory: pytest.TempPathFactory) -> Terrain:
    folder = tmp_path_factory.mktemp("terrain")
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    return Terrain.open(folder / "hills.terrain")


@pytest.fixture
def renderer(device: Any, terrain: Terrain) -> Iterator[Any]:
    """Makes renderers with other settings."""
    from limen.layers.terrain.renderer import TerrainRenderer
    from limen.layers.terrain.selector import TerrainSettings

    made: list[TerrainRenderer] = []

    def make(display: Display = WALL, reference_m: Any = EYE, **fields: Any) -> TerrainRenderer:
        extra = {name: fields.pop(name) for name in ("draped", "look", "gpu_bytes") if name in fields}
        settings = TerrainSettings(**({"look_at": CLOSE} | fields))
        made.append(
            TerrainRenderer(
                device,
                display,
                terrain,
                settings=settings,
                reference_m=reference_m,
                **({"gpu_bytes": 64 << 20} | extra),
            )
        )
        return made[-1]

    yield make
    for each in made:
        each.close()


def drawn(
    renderer: Any, viewers: Any = (VIEWER,), policy: str = "acuity", **options: Any
) -> tuple[dict[str, Image], Any]:
    from limen.layers.terrain.renderer import TerrainReport

    pictures, reports = {}, {}
    for name, picture, report in renderer.pictures(list(viewers), Policy.parse(policy), **options):
        pictures[name] = picture[..., :3].copy()
        reports[id(report)] = report
    return pictures, TerrainReport.of(list(reports.values()))


def wall_of(pictures: dict[str, Image]) -> Image:
    """The pictures of the wall side by side, columns from the left and rows from the top."""
    rows = [np.concatenate([pictures[f"wall/{x},{y}"] for x in range(6)], axis=1) for y in range(4)]
    return np.concatenate(rows)


def test_the_land_stands_where_a_mesh_of_all_its_posts_stands(device: Any, renderer: Any, terrain: Terrain) -> None:
    """Against another way of drawing: every post a vertex, sorted to panels as meshes are."""
    from limen.data.mesh.mesh import NO_TEXTURE, Mesh
    from limen.layers.mesh.renderer import SceneRenderer

    pictures, report = drawn(renderer(), policy="full")
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    posts = np.stack([columns, rows, hills()], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (columns + SIZE[0] * rows)[:-1, :-1].reshape(-1, 1)
    triangles = (first + np.array([[0, SIZE[0], SIZE[0] + 1, 0, SIZE[0] + 1, 1]])).reshape(-1, 3).astype(np.uint32)
    count = len(posts)
    mesh = Mesh(
        None, posts, triangles, np.tile(np.float32([0, 0, 1]), (count, 1)), np.full((count, 4), 255, np.uint8),
        np.zeros((count, 2), np.float32), np.full(count, NO_TEXTURE), np.zeros((0, 1, 1, 4), np.uint8),
    )  # fmt: skip
    matrix = room_from_posts(terrain, WALL, EYE, CLOSE)
    with SceneRenderer(device, WALL, mesh, room_from_mesh=matrix) as scene:
        others = {name: picture[..., :3].copy() for name, picture, _ in scene.pictures(VIEWER)}
    land, other = (wall_of(each).max(axis=-1) > 40 for each in (pictures, others))
    assert 0.3 < land.mean() < 0.95
    assert (land != other).mean() < 0.002
    assert report.max_error_px <= report.max_allowed_px == 0.5


@pytest.mark.parametrize("policy", ["full", "acuity", "acuity+gaze", "scheel"])
@pytest.mark.parametrize("cut", ["adaptive", "level"])
def test_no_panel_errs_by_more_than_it_may(renderer: Any, policy: str, cut: str) -> None:
    _, report = drawn(renderer(display=PART, cut=cut, look_at=FAR), policy=policy)
    assert report.panels_active == 2
    assert report.missing == 0
    assert 0 < report.max_error_px <= report.max_allowed_px


def test_policies_that_allow_more_draw_less_and_it_is_hardly_seen(renderer: Any) -> None:
    made = renderer(display=PART, look_at=FAR)
    seen = [drawn(made, policy=policy) for policy in ("acuity", "snellen", "scheel")]
    triangles = [report.triangles for _, report in seen]
    assert triangles[0] > triangles[1] >= triangles[2]
    fine, acute, _ = (np.stack([pictures[name] for name in sorted(pictures)]).astype(int) for pictures, _ in seen)
    assert (np.abs(fine - acute).max(axis=-1) > 24).mean() < 0.01


def test_one_level_a_panel_takes_no_fewer_triangles_than_a_cut_that_adapts(renderer: Any) -> None:
    adaptive = drawn(renderer(cut="adaptive"), policy="scheel")[1]
    level = drawn(renderer(cut="level"), policy="scheel")[1]
    assert level.triangles >= adaptive.triangles


def test_a_fixed_camera_shows_the_same_from_anywhere_and_a_window_does_not(renderer: Any) -> None:
    aside = replace(VIEWER, position_m=(0.8, 1.2, -0.4))
    fixed, window = renderer(camera="fixed"), renderer(camera="window")
    here, there = (wall_of(drawn(fixed, [who], "full")[0]) for who in (VIEWER, aside))
    np.testing.assert_array_equal(here, there)
    here, there = (wall_of(drawn(window, [who], "full")[0]) for who in (VIEWER, aside))
    assert (here != there).mean() > 0.3


def test_panels_that_nobody_sees_are_dark_until_somebody_points_there(renderer: Any) -> None:
    made = renderer(camera="fixed", look_at=LookAt(pitch_deg=90, range_m=5_000))
    left = Viewer((-1.5, 1.5, -1.0), direction=(-1, 0, -0.3))
    pictures, report = drawn(made, [left], "scheel")
    far = pictures["wall/5,3"]
    assert report.panels_active < 24
    assert far.max() < 40
    pointer = Pointer((1.5, 0.9, -0.5), (0, 0, -1))
    pointed, more = drawn(made, [left], "scheel", pointers=[pointer])
    assert more.panels_active > report.panels_active
    assert pointed["wall/5,3"].max() > 60
    np.testing.assert_array_equal(pointed["wall/5,3"], drawn(made, [left], "full")[0]["wall/5,3"])


def test_more_viewers_see_no_less(renderer: Any) -> None:
    made = renderer(camera="fixed")
    people = [Viewer((x, 1.6, z), direction=(0, 0, -1)) for x, z in [(-1.2, -0.6), (1.0, 0.5), (0.2, -1.1)]]
    reports = [drawn(made, people[:count], "scheel")[1] for count in (1, 2, 3)]
    assert reports[0].triangles <= reports[1].triangles <= reports[2].triangles
    assert reports[0].min_allowed_px >= reports[2].min_allowed_px


def test_live_frames_never_wait_and_end_with_the_finished_picture(device: Any, renderer: Any) -> None:
    from limen.gpu.buffers import TextureReader
    from limen.stream.pages import FADE_S

    made = renderer(display=MONITOR, reference_m=(0.0, 1.2, 0.0))
    viewer = Viewer((0.0, 1.2, 0.0))
    whole, _ = drawn(renderer(display=MONITOR, reference_m=(0.0, 1.2, 0.0)), [viewer])
    reader = TextureReader(device)
    first = made.frame([viewer], Policy(), now_s=0.0)
    assert first.missing > 0
    for number in range(300):
        textures, report = made.textures([viewer], Policy(), now_s=number * 0.01)
        reader.read(textures[0])  # or frames are submitted faster than drawn
        if not report.missing:
            break
    textures, report = made.textures([viewer], Policy(), now_s=number * 0.01 + FADE_S)
    assert report.missing == 0
    quilt = made.quilts[0]
    from limen.display.quilt import pieces

    live = pieces(MONITOR, quilt, reader.read(textures[0]))
    reader.destroy()
    for name, picture in live.items():
        apart = np.abs(picture[..., :3].astype(int) - whole[name].astype(int)).max(axis=-1)
        assert (apart > 2).mean() < 0.01


def test_pages_fade_in_to_the_end_however_slow_frames_are(renderer: Any, terrain: Terrain) -> None:
    from limen.layers.terrain.resources import Wishes

    stock = renderer(display=MONITOR, reference_m=(0.0, 1.2, 0.0))._stock
    none, pages = np.zeros(0, np.int64), np.arange(terrain.relief.pyramid.page_count)
    while stock.update(Wishes(none, none, pages, none), now_s=10.0):
        time.sleep(0.01)
    assert stock.tables.relief.fade[0] == 0
    stock.update(Wishes(none, none, pages, none), now_s=20.0)
    assert (stock.tables.relief.fade == 1).all()
    kept = stock.tables
    stock.update(Wishes(none, none, pages, none), now_s=30.0)
    assert stock.tables is kept, "copied to the GPU only when something changes"


def test_a_drape_lies_north_up_over_the_land(renderer: Any, tmp_path: Path, terrain: Terrain) -> None:
    from limen.data.terrain.drape import texel_from_post
    from limen.layers.terrain.look import TerrainLook
    from limen.layers.terrain.resources import Draped

    picture = np.zeros((100, 200, 3), np.uint8)
    picture[:50, :, 0], picture[50:, :, 2] = 220, 220  # red in the north, blue in the south
    picture[:, :100, 1] = 160  # and green in the west
    path = tmp_path / "drape.png"
    Picture.fromarray(picture).save(path)
    with limen.open(path) as image:
        draped = Draped(image, texel_from_post(terrain, path, image.size_px))
        made = renderer(draped=draped, look=TerrainLook("drape"), look_at=LookAt(pitch_deg=90), camera="fixed")
        wall = wall_of(drawn(made, policy="full")[0]).astype(int)
    covered = np.argwhere(wall.max(axis=-1) > 60)
    (top, left), (bottom, right) = covered.min(axis=0), covered.max(axis=0)

    def at(x: float, y: float) -> Any:
        return wall[round(top + y * (bottom - top)), round(left + x * (right - left))]

    assert at(0.8, 0.2)[0] > 2 * at(0.8, 0.2)[2]
    assert at(0.8, 0.8)[2] > 2 * at(0.8, 0.8)[0]
    assert at(0.2, 0.8)[1] > 2 * at(0.8, 0.8)[1]


def test_faint_pages_of_a_drape_are_left_out_and_stark_ones_drawn(
    renderer: Any, tmp_path: Path, terrain: Terrain
) -> None:
    """A drape half flat, half noise: with `contrast` only the noise is drawn from fine pages; a pointer wants all."""
    from limen.data.terrain.drape import texel_from_post
    from limen.layers.terrain.look import TerrainLook
    from limen.layers.terrain.resources import Draped

    picture = np.full((512, 1024, 3), 128, np.uint8)
    picture[:, 600:] = np.random.default_rng(5).choice([20, 230], size=(512, 424, 1))
    path = tmp_path / "drape.png"
    Picture.fromarray(picture).save(path)
    viewer, pointer = Viewer((0.0, 1.5, -1.0), direction=(0, 0, -1)), Pointer((0.0, 1.5, 5.0), (0, 0, -1))
    with limen.open(path) as image:
        draped = Draped(image, texel_from_post(terrain, path, image.size_px))
        made = {}
        for name, pointers in {"acuity": (), "contrast": (), "contrast selected": (pointer,)}.items():
            fresh = renderer(display=Display.named("rostock").scaled(1 / 8), draped=draped, look=TerrainLook("drape"),
                             look_at=LookAt(pitch_deg=90), camera="fixed")  # fmt: skip
            pictures, report = drawn(fresh, [viewer], name.split()[0], pointers=pointers)
            made[name] = wall_of(pictures).astype(int), report
    (plain, acuity), (faint, contrast), (_, selected) = made.values()
    assert contrast.missing == acuity.missing == 0
    assert contrast.triangles == acuity.triangles
    assert acuity.pages - 4 == contrast.pages < selected.pages <= acuity.pages
    assert np.abs(plain - faint).max() <= 1
    assert np.ptp(plain[:, plain.shape[1] // 2 :]) > 100


def test_little_memory_draws_coarser_and_says_so(renderer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # As if the land were larger: the least memory for pages is enough for all of its patches.
    for part in ("_VERTEX_BYTES", "_INDEX_BYTES"):
        monkeypatch.setattr(f"limen.layers.terrain.resources.{part}", 4 * getattr(terrain_stock, part))
    made = renderer(display=Display.named("desktop"), reference_m=(0.0, 1.2, 0.0), look_at=LookAt(), gpu_bytes=23 << 20)
    _, report = drawn(made, [Viewer((0.0, 1.2, 0.0))], "full")
    assert report.missing > 0
    assert report.max_error_px > 0.5


def test_a_budget_of_triangles_is_kept_and_costs_error(renderer: Any) -> None:
    free = drawn(renderer(display=MONITOR, reference_m=(0.0, 1.2, 0.0)), [Viewer((0.0, 1.2, 0.0))], "full")[1]
    budget = free.triangles // 4
    made = renderer(display=MONITOR, reference_m=(0.0, 1.2, 0.0), max_triangles=budget)
    tight = drawn(made, [Viewer((0.0, 1.2, 0.0))], "full")[1]
    assert tight.triangles < 1.3 * budget  # before the fans along borders
    assert tight.max_error_px > free.max_error_px


def test_render_takes_a_terrain(device: Any, terrain: Terrain) -> None:
    pictures = limen.render(terrain, WALL, [VIEWER], policy="scheel", panels="wall/2,*", placement=CLOSE, device=device)
    assert sorted(pictures) == [f"wall/2,{row}" for row in range(4)]
    assert pictures["wall/2,2"].max() > 60
    for wrong in ({"overlay": "levels"}, {"placement": np.eye(4)}, {"stereo": "anaglyph"}):
        with pytest.raises(InputError, match="terrain"):
            limen.render(terrain, WALL, [VIEWER], device=device, **wrong)
    with pytest.raises(InputError, match="give a viewer"):
        limen.render(terrain, WALL, device=device)
