"""A terrain drawn into quilts: what panels show is what rays from the eye meet, without a crack, wherever it lies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.display.panel import Panel
from limen.layers.terrain.borders import BorderPool
from limen.layers.terrain.look import SEA, TerrainLook, hypsometric_ramp, toward_sun
from limen.layers.terrain.look_at import room_from_posts
from limen.stream.pages import PageTable
from limen.viewing.placement import LookAt
from limen.viewing.projection import QuiltPanels, QuiltView
from support.lands import GridLand, TinLand, fans, normals_of
from support.terrain_stage import EYE, Stage, codes_of, hills, leaves

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

MAGENTA = (255, 0, 255)
_STEPS = 400


def one_panel(size_px: tuple[int, int] = (96, 64), width_m: float = 0.96) -> Display:
    pitch = width_m / size_px[0]
    corner = (-width_m / 2, size_px[1] * pitch / 2, 0.0)
    return Display("one", (Panel("only", size_px, corner, (1, 0, 0), (0, -1, 0), (pitch, pitch)),))


def bent_wall() -> Display:
    """Two panels that meet at an angle, and a triangular one above them."""
    turned = (float(np.cos(0.3)), 0.0, float(np.sin(0.3)))
    return Display(
        "bent",
        (
            Panel("left", (48, 40), (-0.48, 0.2, 0.0), (1, 0, 0), (0, -1, 0), (0.01, 0.01)),
            Panel("right", (48, 40), (0.0, 0.2, 0.0), turned, (0, -1, 0), (0.01, 0.01)),
            Panel("top", (48, 40), (-0.48, 0.6, 0.0), (1, 0, 0), (0, -1, 0), (0.01, 0.01),
                  outline_px=((24, 0), (48, 40), (0, 40))),
        ),
    )  # fmt: skip


def mixture(land: GridLand, rng: Any, leave: float = 0.75) -> Any:
    """A random cut: nodes are left for their children or not, patches of any of their steps."""
    chosen, pending = [], list(range(land.nodes.roots))
    while pending:
        node = pending.pop()
        children = land.nodes.children[node]
        if (children >= 0).any() and rng.random() < leave:
            pending += children[children >= 0].tolist()
        else:
            chosen.append(int(rng.integers(land.nodes.first_patch[node], land.nodes.first_patch[node + 1])))
    return np.array(sorted(chosen))


@pytest.fixture
def stage(device: Any) -> Any:
    """Makes stages, and clears them away."""
    made = []

    def make(land: GridLand, **options: Any) -> Stage:
        made.append(Stage(device, land, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


# ---------------------------------------------------------------- the plain picture


def bilinear(values: Any, place: Any) -> Any:
    """Values of a raster between posts; ``place``: column and row, shape (..., 2)."""
    most = np.array(values.shape[1::-1]) - 2
    first = np.clip(np.floor(place).astype(int), 0, most)
    x, y = np.moveaxis(place - first, -1, 0)
    column, row = np.moveaxis(first, -1, 0)
    if values.ndim == 3:
        x, y = x[..., None], y[..., None]
    above = values[row, column] * (1 - x) + values[row, column + 1] * x
    below = values[row + 1, column] * (1 - x) + values[row + 1, column + 1] * x
    return above * (1 - y) + below * y


def rays_of(display: Display, eye: Any) -> Any:
    """From an eye through every pixel of a display's one panel: shape (H, W, 3), metres on the panel at 1."""
    panel = display.panels[0]
    x, y = np.meshgrid(*(np.arange(size) + 0.5 for size in panel.size_px))
    right, down = np.array(panel.right) * panel.pitch_m[0], np.array(panel.down) * panel.pitch_m[1]
    return np.array(panel.origin_m) + x[..., None] * right + y[..., None] * down - np.array(eye)


def marched(land: GridLand, display: Display, room: Any, eye: Any = EYE) -> tuple[Any, Any]:
    """Where rays first meet the heights: place (column, row, height) and the ray's parameter, NaN where nowhere."""
    posts_from_room = np.linalg.inv(room)
    rays = rays_of(display, eye) @ posts_from_room[:3, :3].T
    begin = posts_from_room[:3, :3] @ np.array(eye) + posts_from_room[:3, 3]
    columns, rows = np.array(land.size_posts) - 1

    def above(t: Any) -> Any:
        place = begin + rays * t[..., None]
        inside = (place[..., :2] >= 0).all(-1) & (place[..., 0] <= columns) & (place[..., 1] <= rows)
        ground = bilinear(land.heights_m.astype(float), np.where(inside[..., None], place[..., :2], 0.0))
        return np.where(inside, place[..., 2] - ground, np.inf)

    hit, before = np.full(rays.shape[:2], np.nan), above(np.full(rays.shape[:2], 1.0))
    low = np.ones(rays.shape[:2])
    for t in np.linspace(1.0, 12.0, _STEPS)[1:]:
        now = above(np.full(rays.shape[:2], t))
        through = np.isnan(hit) & (before > 0) & np.isfinite(before) & (now <= 0)
        hit[through] = t
        low[through] = t - 11.0 / (_STEPS - 1)
        before = now
    high = hit.copy()
    for _ in range(20):
        middle = (low + high) / 2
        below = above(middle) <= 0
        high, low = np.where(below, middle, high), np.where(below, low, middle)
    return begin + rays * high[..., None], high


def plain_light(land: GridLand, place: Any, look: TerrainLook, exaggeration: float = 1.0) -> Any:
    """Lambert's law on the terrain's normals, and tints by height: linear light at places."""
    normal = bilinear(normals_of(land.heights_m * exaggeration, land.spacing_m), place[..., :2])
    shade = look.ambient + (1 - look.ambient) * np.maximum(normal @ toward_sun(look), 0)
    colour: Any = np.array([0.6, 0.58, 0.55])
    if look.colours == "hypsometric":
        share = (place[..., 2] - land.low_m) / (land.high_m - land.low_m)
        ramp = hypsometric_ramp()
        at = np.clip(share, 0, 1) * (len(ramp) - 1)
        colour = np.stack([np.interp(at, np.arange(len(ramp)), ramp[:, k]) for k in range(3)], axis=-1)
    return colour * shade[..., None]


def close_to(drawn: Any, expected: Any, codes: int, share: float) -> None:
    """All but a share of pixels differ by no more than so many 8-bit codes."""
    off = np.abs(drawn.astype(int) - expected.astype(int)).max(axis=-1)
    assert (off > codes).mean() <= share, f"{(off > codes).mean():.4f} of the pixels are off, by up to {off.max()}"


@pytest.mark.parametrize("clip", [True, False])
def test_panels_show_what_rays_from_the_eye_meet(stage: Any, clip: bool) -> None:
    """Depth, shading and tints; pixels on silhouettes may fall to either side."""
    land = GridLand(hills(129, 129), (2.0, 2.5), leaf=32)
    display, look = one_panel(), TerrainLook()
    room = room_from_posts(land, display, EYE, LookAt(heading_deg=30, pitch_deg=35, range_m=150.0, exaggeration=1.5))
    picture = stage(land, look=look, clip=clip)
    picture.load(leaves(land))
    drawn = picture.draw(display, room, leaves(land))
    place, t = marched(land, display, room)
    seen = np.isfinite(t)
    assert 0.5 < seen.mean() < 1, "the view has land and sky"
    assert ((drawn == MAGENTA).all(-1) == ~seen).mean() > 0.99
    both = seen & ~(drawn == MAGENTA).all(-1)
    expected = codes_of(plain_light(land, place[both], look, 1.5))
    close_to(drawn[both], expected, 3, 0.03)
    depth = picture.drawer.read_depth(picture.view).astype(float)
    near = depth[both] * (t[both] * EYE[2])  # depth is near / w, and w grows along the ray from the panel on
    assert np.ptp(np.quantile(near, [0.02, 0.98])) < 0.003 * near.mean()


def test_what_pixels_merge_keeps_its_mean_light(stage: Any) -> None:
    """Seen from above, many posts a pixel: the mean of normals is lit as the mean of their light."""
    rng = np.random.default_rng(5)
    land = GridLand(rng.normal(0, 0.35, (513, 513)), leaf=128)
    look = TerrainLook("plain", altitude_deg=60)
    display, eye = one_panel((64, 64)), (0.0, 0.0, 1.0)
    room = overhead(land, 0.0075 * 2, 0.0, (0.5, 0.5), 1.0)  # two posts a pixel
    picture = stage(land, look=look)
    picture.load(leaves(land, 8))
    posts = np.stack(np.meshgrid(np.arange(193.0, 321.0), np.arange(193.0, 321.0)), axis=-1)
    expected = plain_light(land, np.dstack([posts, np.zeros(posts.shape[:2])]), look).mean(axis=(0, 1))
    spread = []
    for allowed in (0.5, 6.0):
        drawn = picture.draw(display, room, leaves(land, 8), eyes=eye, allowed_px=allowed)
        light = linear_of_srgb(drawn / 255)
        np.testing.assert_allclose(light.mean(axis=(0, 1)), expected, rtol=0.02)
        spread.append(light[..., 1].std())
    assert spread[1] < 0.7 * spread[0], "where more error is allowed, coarser pages are drawn"


# ---------------------------------------------------------------- no cracks, no jitter


def rough(columns: int, rows: int, rng: Any) -> Any:
    """Heights from 0 to 12 that walk at random along rows and down columns."""
    walks = rng.normal(0, 1, (rows, columns)).cumsum(axis=1) + rng.normal(0, 1, (rows, columns)).cumsum(axis=0)
    return 12 * (walks - walks.min()) / np.ptp(walks)


def crack_views(picture: Stage, rng: Any, views: int, controls: int) -> int:
    """Random views down on land that fills the panels: fails where the background is seen.

    Returns how many of the first ``controls`` views would have had a crack without the fans.
    """
    land, display, cracked = picture.land, bent_wall(), 0
    for number in range(views):
        eye = np.array([rng.uniform(-0.25, 0.25), rng.uniform(-0.2, 0.4), rng.uniform(0.7, 1.2)])
        across = 256 / (land.size_posts[0] - 1) / land.spacing_m[0]
        turn, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.12, 0.3)
        target, far_m = rng.uniform([0.4, 0.4], [0.6, 0.6]), float(rng.uniform(0.3, 1.0))
        room = overhead(land, scale * across, turn, target, far_m)
        chosen = mixture(land, rng)
        drawn = picture.draw(display, room, chosen, eyes=eye)
        lit = covered(picture.view.panels)
        assert not (drawn[lit] == MAGENTA).all(-1).any(), f"a crack in view {number}"
        if number < controls:
            torn = picture.draw(display, room, chosen, eyes=eye, joined=False)[lit]
            cracked += bool((torn == MAGENTA).all(-1).any())
    return cracked


def test_no_crack_between_grids_of_any_fineness(stage: Any) -> None:
    rng = np.random.default_rng(11)
    picture = stage(GridLand(rough(257, 129, rng), (2.0, 2.0), leaf=16, roots=(2, 1)))
    picture.load(np.arange(len(picture.land.patch_of)))
    assert crack_views(picture, rng, 60, 20) > 2, "without the fans there are cracks to be seen"


def test_no_crack_between_adapted_triangulations_of_any_fineness(stage: Any) -> None:
    rng = np.random.default_rng(12)
    picture = stage(TinLand(rough(129, 129, rng), [4, 2, 1, 0.5, 0.25]))
    picture.load(np.arange(len(picture.land.patches.node)))
    assert crack_views(picture, rng, 60, 20) > 2, "without the fans there are cracks to be seen"


def overhead(land: GridLand, scale: float, turn: float, target: Any, far_m: float) -> Any:
    """The terrain as a wall behind the display, its up toward the viewer: shape (4, 4)."""
    matrix = np.eye(4)
    across = np.array([np.cos(turn), np.sin(turn), 0])
    down = np.array([np.sin(turn), -np.cos(turn), 0])
    matrix[:3, :3] = np.stack([across * land.spacing_m[0], down * land.spacing_m[1], [0, 0, 1]], axis=1) * scale
    post = np.array([*(np.array(target) * (np.array(land.size_posts) - 1)), land.high_m])
    matrix[:3, 3] = np.array([0, 0, -far_m]) - matrix[:3, :3] @ post
    return matrix


def covered(windows: QuiltPanels) -> Any:
    """Pixels whose centre lies in a panel's outline, shape (H, W)."""
    from limen.display.mapping import quilt_outlines

    width, height = windows.quilt.size_px
    y, x = np.mgrid[:height, :width] + 0.5
    inside = np.zeros((height, width), bool)
    for corners in quilt_outlines(windows.display, windows.quilt):
        step = np.roll(corners, -1, axis=0) - corners
        inside |= np.all(
            [s[0] * (y - c[1]) - s[1] * (x - c[0]) >= 0 for c, s in zip(corners, step, strict=True)], axis=0
        )
    return inside


def test_the_fans_are_those_of_the_plain_way() -> None:
    """The crack test's borders come from the compiled pool; here they are made by looking every border vertex up."""
    rng = np.random.default_rng(2)
    land = GridLand(hills(65, 65), leaf=16)
    for _ in range(20):
        chosen = mixture(land, rng)
        contents = [land.read_patch(int(patch)) for patch in chosen]
        first = np.cumsum([0, *(len(content.posts) for content in contents)])[:-1]
        pool = BorderPool()
        for patch, content, begin in zip(chosen.tolist(), contents, first.tolist(), strict=True):
            pool.add(patch, content, begin)
        posts = np.concatenate([content.posts for content in contents])

        def corners(triangles: Any, posts: Any = posts) -> Any:
            return sorted(tuple(map(tuple, posts[triangle].tolist())) for triangle in triangles)

        made = pool.fans(np.zeros(len(chosen), np.int64), chosen, 1).triangles
        assert corners(rolled(made, posts)) == corners(rolled(fans(contents, first.tolist()), posts))


def rolled(triangles: Any, posts: Any) -> Any:
    """Every triangle from its smallest corner on: the same turn, one name."""
    rows = [min((posts[v].tolist(), k) for k, v in enumerate(t))[1] for t in triangles]
    return np.array([np.roll(t, -k) for t, k in zip(triangles, rows, strict=True)])


def test_nothing_jitters_far_from_the_rasters_corner(stage: Any) -> None:
    """The same land as a part of one of 65,536 posts and more, seen from 3 m above a post 30 m wide."""
    heights = hills(65, 65, 20.0)
    display = one_panel()
    pictures = []
    for first in ((0, 0), (65_536, 65_500), (4_000_000, 3_000_000)):
        land = GridLand(heights, (30.0, 30.0), leaf=32, first_post=first)
        room = near_ground(land)
        picture = stage(land)
        picture.load(leaves(land), pages=np.empty(0, np.int64))
        picture.pages = nothing(land), nothing(land)
        pictures.append(picture.draw(display, room, leaves(land)).astype(int))
    assert (pictures[0] != np.array(MAGENTA)).any(axis=-1).mean() > 0.4
    for other in pictures[1:]:
        assert (np.abs(other - pictures[0]).max(axis=-1) > 2).mean() < 0.002


def near_ground(land: GridLand) -> Any:
    """The eye 3 m above the ground, looking along it; one metre of land is one of the room."""
    column, row = 20.4, 31.7
    ground = float(bilinear(land.heights_m.astype(float), np.array([column, row])))
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([[30.0, 0, 0], [0, 0, 30.0], [0, 1.0, 0]], axis=1)
    at = np.array([column + land.first_post[0], row + land.first_post[1], ground + 3.0])
    matrix[:3, 3] = np.array(EYE) - matrix[:3, :3] @ at
    return matrix


def nothing(land: GridLand) -> PageTable:
    """The table of a stream whose pages have not come."""
    count = land.relief.pyramid.page_count
    return PageTable(np.full(count, -1, np.int32), np.zeros(count, np.int32), np.ones(count, np.float32))


# ---------------------------------------------------------------- what fragments show


def flat_view(size: int = 64, **options: Any) -> tuple[GridLand, Display, Any]:
    """A land seen from straight above so that a pixel is a post, in the middle of the picture."""
    land = GridLand(hills(size + 1, size + 1, 0.0), leaf=32, **options)
    display = one_panel((size, size), 0.64)
    room = np.eye(4)
    pitch = 0.64 / size * 2  # twice as far away as the panel
    room[:3, :3] = np.stack([[pitch, 0, 0], [0, -pitch, 0], [0, 0, pitch]], axis=1)
    room[:3, 3] = [-pitch * size / 2, pitch * size / 2, -1.0]
    return land, display, room


ABOVE = (0.0, 0.0, 1.0)


@pytest.mark.parametrize("clip", [True, False])
def test_holes_are_cut_out_where_posts_have_no_data(stage: Any, clip: bool) -> None:
    void = np.zeros((65, 65), bool)
    void[20:30, 40:55] = True
    land, display, room = flat_view(void=void)
    picture = stage(land, clip=clip)
    picture.load(leaves(land))
    hole = (picture.draw(display, room, leaves(land), eyes=ABOVE) == MAGENTA).all(-1)
    # Pixel (x, y) shows the middle between posts (x, y) and (x + 1, y + 1): half valid is drawn.
    around = (void[:-1, :-1].astype(float) + void[1:, :-1] + void[:-1, 1:] + void[1:, 1:]) / 4
    sure = around != 0.5
    np.testing.assert_array_equal(hole[sure], around[sure] > 0.5)


def test_land_is_seen_through_holes_in_what_is_before_it(stage: Any) -> None:
    """A ridge lies across the view; its crest has no data, and hides nothing."""
    void = np.zeros((65, 65), bool)
    void[30:40] = True
    heights = np.zeros((65, 65))
    heights[25:45] = 40 * (1 - np.abs(np.arange(25, 45) - 34.5) / 10)[:, None]  # a ridge across the view
    display = one_panel()
    pictures, depths = [], []
    for holes in (void, None):
        land = GridLand(heights, leaf=32, void=holes)
        room = room_from_posts(land, display, EYE, LookAt(pitch_deg=25, range_m=90.0))
        picture = stage(land)
        picture.load(leaves(land))
        pictures.append(picture.draw(display, room, leaves(land), overlay="patches"))
        pictures.append(picture.draw(display, room, leaves(land)))
        depths.append(picture.drawer.read_depth(picture.view))
    sky = [(drawn == MAGENTA).all(-1) for drawn in pictures]
    np.testing.assert_array_equal(sky[0], sky[1], "drawn with its triangles or after them, land covers the same pixels")
    np.testing.assert_array_equal(sky[2], sky[3])
    farther = (depths[0] < 0.9 * depths[1]) & (depths[0] > 0)
    assert farther.sum() > 100, "what is behind the ridge is seen"


def test_a_draped_image_lies_where_its_map_says(stage: Any, memory_image: Any) -> None:
    land, display, room = flat_view()
    rng = np.random.default_rng(1)
    pixels = np.kron(rng.integers(0, 256, (9, 9, 3)), np.ones((8, 8, 1), int)).astype(np.uint8)
    # A quarter turn and a shift: texel x = 70 - row, texel y = column + 3.
    turned = np.array([[0.0, -1.0, 70.0], [1.0, 0.0, 3.0]])
    look = TerrainLook("drape", altitude_deg=90, ambient=0.0)
    picture = stage(land, look=look, drape=(memory_image(pixels), turned))
    picture.load(leaves(land))
    drawn = picture.draw(display, room, leaves(land), eyes=ABOVE)
    y, x = np.mgrid[:64, :64] + 0.5  # posts at pixel centres
    texel_x, texel_y = 70 - y, x + 3
    inside = (texel_y % 8 > 0.9) & (texel_y % 8 < 7.1) & (texel_x % 8 > 0.9) & (texel_x % 8 < 7.1)
    expected = pixels[texel_y.astype(int), texel_x.astype(int)]
    close_to(drawn[inside], expected[inside], 3, 0.0)


def test_contour_lines_follow_heights_and_every_fifth_is_stronger(stage: Any) -> None:
    land, display, room = flat_view()
    land.heights_m[:] = np.arange(65.0) * 0.1  # 10 px a metre
    land = GridLand(land.heights_m, leaf=32)

    def row_of(look: TerrainLook) -> Any:
        picture = stage(land, look=look)
        picture.load(leaves(land))
        return picture.draw(display, room, leaves(land), eyes=ABOVE)[32, :, 0].astype(int)

    row, plain = row_of(TerrainLook("plain", contour_interval_m=1.0)), row_of(TerrainLook("plain"))
    darker = plain - row
    lines = np.flatnonzero((darker > 20) & (darker >= np.roll(darker, 1)) & (darker > np.roll(darker, -1)))
    assert np.abs(lines - np.arange(0, 70, 10)).max() <= 1
    assert darker[48:52].sum() > 1.5 * darker[28:32].sum()
    dense = TerrainLook("plain", contour_interval_m=0.3)  # 3 px apart: only fifths are left, 15 px apart
    faded = plain - row_of(dense)
    assert (faded > 20).sum() < 14


def test_water_and_tints_of_a_given_range(stage: Any) -> None:
    land, display, room = flat_view()
    land.heights_m[:] = np.arange(65.0)
    land = GridLand(land.heights_m, leaf=32)
    picture = stage(land, look=TerrainLook(ambient=1.0, sea_level_m=20.0, tint_range_m=(20.0, 30.0)))
    picture.load(leaves(land))
    row = picture.draw(display, room, leaves(land), eyes=ABOVE)[32]
    sea, peak = np.array(list(bytes.fromhex(SEA))), codes_of(hypsometric_ramp()[-1])
    assert np.abs(row[5:15].astype(int) - sea).max() <= 1
    assert np.abs(row[40:60].astype(int) - peak).max() <= 1


def test_a_page_that_is_missing_is_replaced_by_a_coarser_one(stage: Any) -> None:
    heights = hills(513, 513, 4.0)
    land = GridLand(heights, leaf=128)
    display = one_panel((96, 96))
    room = room_from_posts(land, display, ABOVE, LookAt(pitch_deg=90, range_m=80.0, target=(0.3, 0.3)))
    picture = stage(land)
    coarsest = np.array([land.relief.pyramid.page_count - 1])
    picture.load(leaves(land, 1)[:16], pages=coarsest)
    coarse = picture.draw(display, room, leaves(land, 1), eyes=ABOVE)
    picture.load(leaves(land, 1))
    fine = picture.draw(display, room, leaves(land, 1), eyes=ABOVE)
    assert not (coarse == MAGENTA).all(-1).any()
    assert np.abs(coarse.astype(int) - fine).mean() < 12, "smooth hills look much the same from half their texels"
    assert (coarse != fine).any()


def test_a_page_fades_in_over_the_coarser_one(stage: Any) -> None:
    land = GridLand(hills(513, 513, 4.0), leaf=128)
    display, look = one_panel((96, 96)), TerrainLook("plain", altitude_deg=90)
    room = room_from_posts(land, display, ABOVE, LookAt(pitch_deg=90, range_m=80.0, target=(0.3, 0.3)))
    picture = stage(land, look=look)
    picture.load(leaves(land))
    table, *others = picture.pages
    light = []
    for share in (0.0, 0.5, 1.0):
        fade = np.where(np.arange(len(table.fade)) == len(table.fade) - 1, 1.0, share).astype(np.float32)
        picture.pages = table._replace(fade=fade), *others
        light.append(linear_of_srgb(picture.draw(display, room, leaves(land), eyes=ABOVE) / 255))
    assert np.abs(light[2] - light[0]).max() > 0.02, "levels differ"
    np.testing.assert_allclose(light[1], (light[0] + light[2]) / 2, atol=0.01)


def test_overlays_tell_panels_and_patches_apart(stage: Any) -> None:
    land, display, room = flat_view()
    picture = stage(land)
    picture.load(leaves(land))
    drawn = picture.draw(display, room, leaves(land), eyes=ABOVE)
    tinted = picture.draw(display, room, leaves(land), eyes=ABOVE, overlay="panels", seen=2)
    assert (tinted[..., 1].astype(int) - tinted[..., 0] > drawn[..., 1].astype(int) - drawn[..., 0] + 30).all()
    hues = picture.draw(display, room, leaves(land), eyes=ABOVE, overlay="patches")
    assert len({tuple(hues[y, x].tolist()) for y in (10, 50) for x in (10, 50)}) == 4, "four patches, four hues"


def test_two_eyes_are_drawn_side_by_side(stage: Any) -> None:
    land = GridLand(hills(65, 65), leaf=32)
    picture, display = stage(land), one_panel()
    picture.load(leaves(land))
    room = room_from_posts(land, display, EYE, LookAt(pitch_deg=30))
    eyes = [(0.05, 0.05, 0.8), (0.15, 0.05, 0.8)]
    both = picture.draw(display, room, leaves(land), eyes=eyes)
    for number, eye in enumerate(eyes):
        alone = picture.draw(display, room, leaves(land), eyes=eye)
        close_to(both[:, number * 96 : (number + 1) * 96], alone, 2, 0.01)


def test_what_cannot_be_drawn_is_refused(stage: Any) -> None:
    land, display, room = flat_view()
    picture = stage(land)
    with pytest.raises(ValueError, match="not resident"):
        picture.draw(display, room, leaves(land), joined=False)
    picture.load(leaves(land))
    picture.draw(display, room, leaves(land))
    with pytest.raises(ValueError, match="windows for 1 eyes were given 2"):
        QuiltView.of(picture.view.panels, [(0.0, 0.0, 0.0)] * 2)
