from __future__ import annotations

import itertools
import shutil

import numpy as np
import pytest

import limen.data
from limen.data.terrain import ingest as terrain_build
from limen.data.terrain.file import Terrain
from limen.data.terrain.ingest import code_range_m, error_ladder_m, ingest_terrain
from limen.data.terrain.page_kernels import halve
from limen.errors import FormatError, InputError, MissingFileError, NeedsIngestError, PageError
from support.dems import UTM, hills, write_dem

MOST = (1 << 24) - 1


def made(tmp_path, heights, name="a", **profile):
    source = write_dem(tmp_path / f"{name}.tif", heights, **{**UTM, **profile})
    ingest_terrain(source, tmp_path / f"{name}.terrain", threads=2)
    return Terrain.open(tmp_path / f"{name}.terrain")


def whole_level(pages, level):
    """All texels of a level, (rows, columns, 4)."""
    found = pages.pyramid.levels[level]
    texels = np.empty((found.rows * 256, found.columns * 256, 4), np.uint8)
    for row, column in itertools.product(range(found.rows), range(found.columns)):
        page = pages.read_page(pages.pyramid.page_index(level, column, row))
        texels[row * 256 : row * 256 + 256, column * 256 : column * 256 + 256] = page[4:260, 4:260]
    return texels[: found.size_px[1], : found.size_px[0]]


def heights_of(texels, terrain):
    code = texels[..., 0].astype(np.int64) * 65536 + texels[..., 1].astype(np.int64) * 256 + texels[..., 2]
    return terrain.low_m + code / MOST * (terrain.high_m - terrain.low_m)


def plain_normals(heights, spacing_m):
    """Unit normals (rows, columns, 3), x east, y north, z up, by NumPy's gradient."""
    down, across = np.gradient(heights.astype(float), spacing_m[1], spacing_m[0])
    normals = np.stack([-across, down, np.ones(heights.shape)], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def plain_halving(texels, share):
    """Means over 2 x 2 of (rows, columns, channels) weighted by ``share``, and the mean share; sizes rounded up."""
    rows, columns = share.shape
    odd = ((0, rows % 2), (0, columns % 2))
    shape = -(-rows // 2), 2, -(-columns // 2), 2
    weight = np.pad(share, odd).reshape(shape)
    count = np.pad(np.ones(share.shape), odd).reshape(shape).sum((1, 3))
    total = (np.pad(texels, (*odd, (0, 0))).reshape(*shape, -1) * weight[..., None]).sum((1, 3))
    return total / np.maximum(weight.sum((1, 3)), 1e-30)[..., None], weight.sum((1, 3)) / count


WIDE = 4200, 48
"""Two blocks side by side."""


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """A terrain of two blocks with a void across the border of them, its heights and what is valid."""
    heights = hills(*WIDE)
    valid = np.ones(heights.shape, bool)
    valid[15:40, 4080:4111] = False
    valid[5, 7] = False
    heights[~valid] = -32768
    terrain = made(tmp_path_factory.mktemp("wide"), heights)
    return terrain, heights, valid


def test_heights_are_exact_and_voids_are_filled(wide):
    terrain, heights, valid = wide
    found, void = terrain.read_posts(0, 0, *terrain.size_posts)
    assert np.array_equal(void, ~valid)
    assert np.array_equal(found[valid], heights[valid])
    low, high = heights[valid].min(), heights[valid].max()
    assert low <= found.min() <= found.max() <= high
    assert terrain.header.height_range_m == (low, high)
    assert terrain.header.void_share == pytest.approx((~valid).mean())
    assert terrain.has_voids
    # No cliff in the void where the blocks meet.
    steps = np.abs(np.diff(found[15:40], axis=1))
    assert steps[:, 4095].max() <= steps[:, 4082:4108].max() + 1
    part, _ = terrain.read_posts(4000, 10, 150, 33)
    assert np.array_equal(part, found[10:43, 4000:4150])


def test_patches_are_of_the_exact_heights_and_meet_at_the_borders_of_blocks(wide):
    terrain, _, _ = wide
    found, _ = terrain.read_posts(0, 0, *terrain.size_posts)
    nodes, patches = terrain.nodes, terrain.patches
    assert nodes.roots == 2
    assert nodes.rect[:2].tolist() == [[0, 0, 4096, 47], [4096, 0, 4199, 47]]
    for number in range(len(patches.node)):
        patch = terrain.read_patch(number)
        left, top, right, bottom = nodes.rect[patches.node[number]]
        x, y = patch.posts.T
        assert np.array_equal(patch.heights_m, found[y, x])
        assert (len(patch.posts), len(patch.core) + len(patch.rims)) == (
            patches.vertices[number],
            patches.triangles[number],
        )
        corners = patch.posts[np.concatenate([patch.core, patch.rims]).astype(int)].astype(np.int64)
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1]  # rows run down
        assert (area > 0).all()
        assert area.sum() == 2 * (right - left) * (bottom - top)
        for side, edge, along in zip(
            patch.sides, ((1, top), (0, right), (1, bottom), (0, left)), (0, 1, 0, 1), strict=True
        ):
            assert (patch.posts[side, edge[0]] == edge[1]).all()
            assert (np.diff(patch.posts[side, along]) > 0).all()
            assert np.count_nonzero(patch.posts[:, edge[0]] == edge[1]) == len(side)
        for side, ends in zip(patch.rim_side, patch.rims[:, 1:], strict=True):
            assert set(ends) <= set(patch.sides[side])
    leaves = np.flatnonzero(nodes.is_leaf)
    assert (patches.error_m[nodes.first_patch[leaves + 1] - 1] == 0).all()


def test_children_cover_their_parents_and_are_finer(wide):
    nodes, patches = wide[0].nodes, wide[0].patches
    seen = set(range(nodes.roots))
    for node in np.flatnonzero(~nodes.is_leaf):
        kids = nodes.children[node][nodes.children[node] >= 0]
        assert seen.isdisjoint(kids)
        seen.update(int(kid) for kid in kids)
        rects = nodes.rect[kids]
        size = rects[:, 2:] - rects[:, :2]
        assert size.prod(1).sum() == np.prod(nodes.rect[node, 2:] - nodes.rect[node, :2])
        finest = patches.error_m[nodes.first_patch[node + 1] - 1]
        assert (patches.error_m[nodes.first_patch[kids]] <= finest).all()
        assert (nodes.low_high_m[kids, 0] >= nodes.low_high_m[node, 0]).all()
    assert seen == set(range(len(nodes.rect)))


def test_pages_are_normals_and_heights_across_blocks(wide):
    terrain, _, valid = wide
    found, _ = terrain.read_posts(0, 0, *terrain.size_posts)
    texels = np.concatenate([plain_normals(found, (30.0, 20.0)) * 127.5 + 127.5, found[..., None]], axis=-1)
    share = valid.astype(float)
    for level in range(len(terrain.relief.pyramid.levels)):
        relief, coded = whole_level(terrain.relief, level), whole_level(terrain.heights, level)
        some = share > 0
        # Rounding, and once more at every level above the finest.
        assert np.abs(relief[..., :3].astype(float) - texels[..., :3])[some].max() <= 0.51 + 0.51 * level
        step_m = (terrain.high_m - terrain.low_m) / MOST
        off_m = np.abs(heights_of(coded, terrain) - texels[..., 3])
        assert off_m[share == 1].max() <= (0.51 + 0.51 * level) * step_m + 1e-4
        # Beside voids means are weighted by shares of 8 bits: by up to 1/4 % of the heights' differences off.
        assert off_m[some].max() <= 0.0025 * 100.0
        assert np.abs(relief[..., 3] - 255 * share).max() <= 0.51 + 0.51 * level
        assert np.array_equal(relief[..., 3], coded[..., 3])
        texels, share = plain_halving(texels, share)


def test_gutters_are_the_neighbours_texels(wide):
    terrain = wide[0]
    for pages, level in itertools.product((terrain.relief, terrain.heights), (0, 1)):
        texels = whole_level(pages, level)
        for column in range(pages.pyramid.levels[level].columns):
            page = pages.read_page(pages.pyramid.page_index(level, column, 0))
            x = np.clip(np.arange(column * 256 - 4, column * 256 + 260), 0, texels.shape[1] - 1)
            y = np.clip(np.arange(-4, 260), 0, texels.shape[0] - 1)
            assert np.array_equal(page, texels[np.ix_(y, x)])


def test_a_tall_terrain_is_the_wide_one_turned(tmp_path):
    """Blocks below each other are treated as blocks beside each other: transposed heights give transposed pages."""
    heights = hills(4104, 6)
    wide = made(tmp_path, heights, "w")
    tall = made(tmp_path, np.ascontiguousarray(heights.T), "t")
    for level in (0, 2):
        a, b = whole_level(wide.heights, level), whole_level(tall.heights, level)
        assert np.array_equal(a, b.transpose(1, 0, 2))
    assert tall.nodes.rect[:2].tolist() == [[0, 0, 5, 4096], [0, 4096, 5, 4103]]


@pytest.mark.parametrize(("east", "north"), [(0.5, 0.0), (0.0, 0.5), (-0.3, -0.7), (0.0, 0.0)])
def test_relief_of_a_plane_is_its_normal_everywhere(tmp_path, east, north):
    """Ground that rises to the east faces west: nx < 0."""
    y, x = np.mgrid[0:300, 0:530]
    terrain = made(tmp_path, (1000 + 30.0 * east * x - 20.0 * north * y).astype(np.float32))
    normal = np.array([-east, -north, 1.0]) / np.sqrt(1 + east**2 + north**2)
    for page in range(terrain.relief.pyramid.page_count):
        found = terrain.relief.read_page(page)
        assert np.abs(found[..., :3] / 127.5 - 1.0 - normal).max() < 0.51 / 127.5 + 1e-4
        assert (found[..., 3] == 255).all()


@pytest.mark.parametrize("seed", range(3))
def test_halving_equals_numpy(seed):
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 40, 2)
    fine = rng.integers(0, 256, (rows, columns, 4), dtype=np.uint8)
    fine[rng.random((rows, columns)) < 0.4, 3] = 0
    fine[rng.random((rows, columns)) < 0.4, 3] = 255
    share = fine[..., 3].astype(float)
    coarse = np.empty((-(-rows // 2), -(-columns // 2), 4), np.uint8)
    halve(fine, coarse, False)
    mean, mean_share = plain_halving(fine[..., :3].astype(float), share)
    some = mean_share > 0
    assert np.abs(coarse[..., :3] - mean)[some].max(initial=0) <= 0.5 + 1e-9
    assert np.abs(coarse[..., 3] - mean_share).max() <= 0.5 + 1e-9
    code = fine[..., 0].astype(np.int64) * 65536 + fine[..., 1].astype(np.int64) * 256 + fine[..., 2]
    halve(fine, coarse, True)
    mean, _ = plain_halving(code[..., None].astype(float), share)
    found = coarse[..., 0].astype(np.int64) * 65536 + coarse[..., 1].astype(np.int64) * 256 + coarse[..., 2]
    assert np.abs(found - mean[..., 0])[some].max(initial=0) <= 0.5 + 1e-6


def test_halving_again_and_again_has_no_bias():
    """Rounding halves up would add an eighth of a code at every level."""
    texels = np.random.default_rng(0).integers(0, 256, (1024, 1024, 4), dtype=np.uint8)
    texels[..., 3] = 255
    mean = texels[..., :3].mean()
    for _ in range(4):
        coarse = np.empty((len(texels) // 2, len(texels) // 2, 4), np.uint8)
        halve(texels, coarse, False)
        texels = coarse
    assert abs(texels[..., :3].mean() - mean) < 0.05


def test_float_heights_and_huge_ones_are_exact(tmp_path):
    heights = hills(300, 200, dtype=np.float32) + np.float32(0.123)
    terrain = made(tmp_path, heights)
    found, void = terrain.read_posts(0, 0, 300, 200)
    assert np.array_equal(found, heights)
    assert void is None
    assert not terrain.has_voids
    exact = int(terrain.nodes.first_patch[np.flatnonzero(terrain.nodes.is_leaf)[0] + 1] - 1)
    patch = terrain.read_patch(exact)
    assert np.array_equal(patch.heights_m, heights[patch.posts[:, 1], patch.posts[:, 0]])


@pytest.mark.parametrize(("columns", "rows"), [(2, 2), (2, 700), (129, 130), (4098, 2)])
def test_odd_sizes(tmp_path, columns, rows):
    heights = hills(columns, rows)
    terrain = made(tmp_path, heights)
    assert np.array_equal(terrain.read_posts(0, 0, columns, rows)[0], heights)
    for patch in range(len(terrain.patches.node)):
        assert len(terrain.read_patch(patch).posts) == terrain.patches.vertices[patch]
    top = terrain.heights.read_page(terrain.heights.pyramid.page_count - 1)
    assert top.shape == (264, 264, 4)


def test_a_flat_terrain(tmp_path):
    terrain = made(tmp_path, np.full((40, 50), 7, np.int16))
    assert terrain.header.height_range_m == (7.0, 7.0)
    assert heights_of(whole_level(terrain.heights, 0), terrain) == pytest.approx(7.0, abs=1e-4)


def test_the_ladder_and_codes():
    ladder = error_ladder_m(4489.0, 73.0)
    assert ladder[0] <= 4489 / 2 < ladder[0] * 2**0.5
    assert ladder[-1] >= 73 / 8 > ladder[-1] / 2**0.5
    assert np.allclose(np.array(ladder[:-1]) / ladder[1:], 2**0.5)
    assert len(error_ladder_m(0.0, 30.0)) == 1
    assert code_range_m(-3.5, 12.25, whole=False) == (-3.5, 12.25)
    low, high = code_range_m(-85.0, 4404.0, whole=True)
    codes = (np.arange(-85, 4405) - low) / (high - low) * MOST
    assert np.abs(codes - np.rint(codes)).max() < 1e-6
    assert (np.rint(codes).astype(int) % 256 == 0).all()
    assert codes.max() <= MOST


def test_bad_input_is_named(tmp_path):
    with pytest.raises(MissingFileError):
        ingest_terrain(tmp_path / "no.tif", tmp_path / "a.terrain")
    source = write_dem(tmp_path / "a.tif", hills(30, 20), **UTM)
    with pytest.raises(InputError, match=r"give it a name that ends in \.terrain"):
        ingest_terrain(source, tmp_path / "a.tiff")
    (tmp_path / "mine.terrain").mkdir()
    (tmp_path / "mine.terrain/precious").write_text("!")
    with pytest.raises(InputError, match=r"is there already, and no terrain"):
        ingest_terrain(source, tmp_path / "mine.terrain")
    with pytest.raises(FormatError, match="no post has a height"):
        ingest_terrain(
            write_dem(tmp_path / "v.tif", np.full((20, 30), -32768, np.int16), **UTM), tmp_path / "v.terrain"
        )
    short = write_dem(tmp_path / "s.tif", hills(900, 700), **UTM, tiled=True, blockxsize=256, blockysize=256)
    short.write_bytes(short.read_bytes()[:500_000])
    with pytest.raises(FormatError, match="cannot be read, it is damaged or cut short"):
        ingest_terrain(short, tmp_path / "s.terrain")
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"a.tif", "mine.terrain", "v.tif", "s.tif"}
    with pytest.raises(MissingFileError):
        Terrain.open(tmp_path / "no.terrain")
    with pytest.raises(FormatError, match="is no terrain, or copied in part"):
        Terrain.open(tmp_path / "mine.terrain")


def test_an_interrupt_leaves_nothing_and_the_old_one(tmp_path, monkeypatch):
    terrain = made(tmp_path, hills(300, 200))
    before = terrain.read_posts(0, 0, 300, 200)[0]

    def interrupted(done):
        if done > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ingest_terrain(tmp_path / "a.tif", tmp_path / "b.terrain", progress=interrupted)
    with pytest.raises(KeyboardInterrupt):
        ingest_terrain(tmp_path / "a.tif", tmp_path / "a.terrain", progress=interrupted)
    assert {path.name for path in tmp_path.iterdir()} == {"a.tif", "a.terrain"}
    assert np.array_equal(Terrain.open(tmp_path / "a.terrain").read_posts(0, 0, 300, 200)[0], before)
    write_dem(tmp_path / "a.tif", hills(310, 200), **UTM)
    seen = []
    report = ingest_terrain(tmp_path / "a.tif", tmp_path / "a.terrain", progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert Terrain.open(tmp_path / "a.terrain").size_posts == report.size == (310, 200)


def read_everything(terrain):
    for page in range(terrain.relief.pyramid.page_count):
        terrain.relief.read_page(page)
    for patch in range(len(terrain.patches.node)):
        terrain.read_patch(patch)


def test_damage_is_found(tmp_path):
    terrain = made(tmp_path, hills(300, 200))
    folder, copy = terrain.path, tmp_path / "copy.terrain"
    files = [path for path in folder.rglob("c/**/*") if path.is_file()]
    assert len(files) > 15
    for victim in ("relief/0/c/0/0/0/0/0", "chunks/posts/c/0/0/0"):
        shutil.copytree(folder, copy)
        whole = (copy / victim).read_bytes()
        (copy / victim).write_bytes(whole[:-10])
        with pytest.raises(
            FormatError, match=rf"1 of its \d+ files are missing or cut short \({victim}\); copy it again"
        ):
            Terrain.open(copy)
        (copy / victim).unlink()
        with pytest.raises(FormatError, match="missing or cut short"):
            Terrain.open(copy)
        bad = bytearray(whole)
        bad[len(bad) // 3] ^= 255
        (copy / victim).write_bytes(bad)
        opened = Terrain.open(copy)
        with pytest.raises(PageError, match=r"cannot be read .*; copy it again"):
            read_everything(opened)
        shutil.rmtree(copy)
    with pytest.raises(InputError, match="patch -1: this terrain has patches 0 to"):
        terrain.read_patch(-1)
    with pytest.raises(InputError, match="are not all among 300 x 200"):
        terrain.read_posts(0, 0, 301, 2)


def test_open_makes_a_terrain_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = write_dem(tmp_path / "a.tif", hills(300, 200), **UTM)
    seen = []
    first = limen.data.open(path, progress=seen.append)
    assert isinstance(first, Terrain)
    assert seen[-1] == 1.0
    again = limen.data.open(path, progress=lambda done: pytest.fail("was made twice"))
    assert (again.path, again.size_posts) == (first.path, (300, 200))
    assert first.path.parent == tmp_path / "cache/limen"
    assert limen.data.open(first.path).size_posts == (300, 200)
    write_dem(path, hills(310, 200), **UTM)
    assert limen.data.open(path).size_posts == (310, 200)
    monkeypatch.setattr("limen.data.terrain.opening.LARGEST_AT_ONCE_POSTS", 1000)
    write_dem(path, hills(320, 200), **UTM)
    with pytest.raises(NeedsIngestError, match=r"320 x 200 posts take a while; .*limen ingest .*a\.tif .*a\.terrain"):
        limen.data.open(path)


def test_triangles_of_the_whole_grow_down_the_ladder(wide):
    info = wide[0].info()
    assert len(info.triangles) == len(info.errors_m)
    assert list(info.triangles) == sorted(info.triangles)
    assert 2 <= info.triangles[0] < info.triangles[-1] < 2 * 4199 * 47
    assert terrain_build.BLOCK == 4096


@pytest.mark.data
def test_a_window_of_the_real_file_is_kept_exactly(data_dir, tmp_path):
    import rasterio

    window = rasterio.windows.Window(2400, 352, 400, 300)
    with rasterio.open(data_dir / "terrain/california_nevada_3arcsec_10801x4801.tif") as file:
        heights = file.read(1, window=window)
        a, b, c, d, e, f = tuple(file.transform)[:6]
        place = rasterio.Affine(a, b, c + a * window.col_off, d, e, f + e * window.row_off)
        terrain = made(tmp_path, heights, crs=file.crs, transform=place)
    assert np.array_equal(terrain.read_posts(0, 0, 400, 300)[0], heights)
    assert np.abs(heights_of(whole_level(terrain.heights, 0), terrain) - heights).max() < 1e-3
    assert terrain.spacing_m == pytest.approx((71.7, 92.5), abs=0.3)
