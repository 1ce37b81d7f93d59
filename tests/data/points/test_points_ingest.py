"""Points in a folder: the same as in memory, whole or not there at all."""

import itertools

import numpy as np
import pytest

from limen.data import Points, build_points, ingest_points, open_points
from limen.data.points import buckets as point_buckets
from limen.data.points import opening as points_opening
from limen.data.points.hilbert_kernels import KEY_LEVELS, hilbert_keys
from limen.data.points.tree import POINT
from limen.errors import FormatError, InputError, MissingFileError, NeedsIngestError, PageError
from support.cloud_files import PLACES, RGB, las, ply, vertices
from support.point_reference import levels_of


def spread(count, seed=1):
    chance = np.random.default_rng(seed)
    return chance.random((count, 3)) * [60.0, 50.0, 4.0], chance.integers(0, 256, (count, 3))


def source(tmp_path, count, seed=1, **more):
    places, rgb = spread(count, seed)
    fields = vertices(places) | dict(zip(("red", "green", "blue"), rgb.astype(np.uint8).T, strict=True))
    return ply(tmp_path / "s.ply", fields | more), places, rgb


def sorted_rows(level):
    rows = np.column_stack([level.place.round(4), level.rgb])
    return rows[np.lexsort(rows.T)]


def test_a_folder_holds_what_memory_does(tmp_path):
    path, places, rgb = source(tmp_path, 9000)
    done = []
    report = ingest_points(path, tmp_path / "s.points", progress=done.append)
    stored, built = Points.open(tmp_path / "s.points"), build_points(places, rgb)
    assert (report.size, report.facts["chunks"], report.facts["normals"]) == (9000, 3, "estimated")
    assert done == sorted(done)
    assert done[-1] == 1.0
    for chunk in range(3):
        assert np.array_equal(stored.read_chunk(chunk), built.read_chunk(chunk))
    for ours, theirs in zip(stored.tops, built.tops, strict=True):
        assert np.array_equal(ours, theirs)
    assert all(np.array_equal(a, b) for a, b in zip(stored.frames, built.frames, strict=True))
    assert np.array_equal(stored.bounds, built.bounds)
    assert stored.info().size == 9000
    assert stored.info().bytes == report.bytes


def test_buckets_of_any_size_make_a_whole_cloud(tmp_path, monkeypatch):
    path, places, rgb = source(tmp_path, 30_000)
    monkeypatch.setattr(point_buckets, "BUCKET_POINTS", 5000)
    monkeypatch.setattr(point_buckets, "_BLOCK", 4000)
    ingest_points(path, tmp_path / "s.points", threads=2)
    levels, built = levels_of(Points.open(tmp_path / "s.points")), levels_of(build_points(places, rgb))
    step = 60.0 / 65535
    assert np.allclose(np.sort(levels[0].place, axis=0), np.sort(built[0].place, axis=0), atol=2 * step)
    for lower, upper in itertools.pairwise(levels):
        parent = np.arange(len(lower.radius)) // 8
        apart = np.linalg.norm(lower.place - upper.place[parent], axis=1)
        assert np.all(apart + lower.radius <= upper.radius[parent] * (1 + 1e-12))
    # As good a tree as the one that was made at once.
    for ours, theirs in zip(levels, built, strict=True):
        assert np.sum(ours.radius**2) < 1.1 * np.sum(theirs.radius**2)


def lattice_points(places):
    points = np.zeros(len(places), POINT)
    points["place"] = places
    points["rgb"][:, 0] = np.arange(len(places)) % 256
    return points


@pytest.mark.parametrize("dense", [False, True])
def test_buckets_follow_the_curve(tmp_path, dense):
    chance = np.random.default_rng(4)
    places = chance.integers(0, 2**30, (20_000, 3))
    if dense:  # so close together that cells are split four times
        places[:15_000] = chance.integers(2**20, 2**20 + 2**12, (15_000, 3))
    points = lattice_points(places)
    buckets = list(point_buckets.along_curve(points, tmp_path, most=3000))
    together = np.concatenate(buckets)
    assert max(len(bucket) for bucket in buckets) <= 3000
    assert np.array_equal(np.sort(together, order=POINT.names[:2]), np.sort(points, order=POINT.names[:2]))
    ends = []
    for bucket in buckets:
        keys = np.empty(len(bucket), np.uint64)
        hilbert_keys(bucket["place"], KEY_LEVELS, keys)
        ends.append((int(keys.min()), int(keys.max())))
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(ends))
    assert list(tmp_path.iterdir()) == []


def test_more_points_in_one_place_than_a_bucket_takes(tmp_path):
    buckets = list(point_buckets.along_curve(lattice_points(np.full((7000, 3), 12345)), tmp_path, most=3000))
    assert [len(bucket) for bucket in buckets] == [3000, 3000, 1000]


def test_a_header_that_is_wrong_about_its_bounds_is_not_believed(tmp_path):
    import struct

    path = las(tmp_path / "a.las", rgb=RGB)
    content = bytearray(path.read_bytes())
    struct.pack_into("<2d", content, 179, 4000.0, 3999.5)  # largest and smallest x
    path.write_bytes(bytes(content))
    ingest_points(path, tmp_path / "a.points")
    points = Points.open(tmp_path / "a.points")
    assert np.allclose(points.bounds, [PLACES.min(axis=0), PLACES.max(axis=0)])
    assert np.ptp(levels_of(points)[0].place[:, 0]) > 19.0


def test_points_left_out_are_counted(tmp_path):
    broken = PLACES.copy()
    broken[:10] = np.nan
    report = ingest_points(ply(tmp_path / "a.ply", vertices(broken)), tmp_path / "a.points")
    assert report.size == 2990
    assert "10 points left out" in report.notes[-1]


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_source_cut_short_leaves_nothing_behind(tmp_path, share):
    path, *_ = source(tmp_path, 5000)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(FormatError, match="cut short"):
        ingest_points(path, tmp_path / "s.points")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["s.ply"]


def test_an_interrupt_leaves_what_was_there(tmp_path):
    path, *_ = source(tmp_path, 3000)
    ingest_points(path, tmp_path / "s.points")

    def stop(done):
        if done > 0.8:
            raise KeyboardInterrupt

    source(tmp_path, 4000, seed=2)
    with pytest.raises(KeyboardInterrupt):
        ingest_points(path, tmp_path / "s.points", progress=stop)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["s.ply", "s.points"]
    assert Points.open(tmp_path / "s.points").size == 3000


def test_what_is_something_else_is_not_replaced(tmp_path):
    path, *_ = source(tmp_path, 10)
    (tmp_path / "s.points").mkdir()
    with pytest.raises(InputError, match="no cloud of points"):
        ingest_points(path, tmp_path / "s.points")
    with pytest.raises(InputError, match=r"ends in \.points"):
        ingest_points(path, tmp_path / "s.zarr")
    with pytest.raises(MissingFileError, match="make it first"):
        ingest_points(path, tmp_path / "no/s.points")


def test_a_folder_that_is_damaged_is_found_out(tmp_path):
    path, *_ = source(tmp_path, 9000)
    folder = tmp_path / "s.points"
    ingest_points(path, folder)
    shard = next(each for each in (folder / "chunks").rglob("*") if each.is_file() and each.name != "zarr.json")
    content = bytearray(shard.read_bytes())
    content[100] ^= 255
    shard.write_bytes(content)
    with pytest.raises(PageError, match="chunk 0 cannot be read"):
        Points.open(folder).read_chunk(0)
    shard.write_bytes(content[:-1])
    with pytest.raises(FormatError, match="missing or cut short"):
        Points.open(folder)
    with pytest.raises(MissingFileError):
        Points.open(tmp_path / "t.points")


def test_the_cache_keeps_a_cloud_until_its_file_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path, *_ = source(tmp_path, 100)
    done = []
    assert open_points(path, progress=done.append).size == 100
    first = len(done)
    assert open_points(path, progress=done.append).size == 100
    assert len(done) == first > 0
    source(tmp_path, 101, seed=3)
    assert open_points(path).size == 101
    monkeypatch.setattr(points_opening, "LARGEST_AT_ONCE_POINTS", 50)
    source(tmp_path, 102, seed=3)
    with pytest.raises(NeedsIngestError, match=r"limen ingest .*s\.ply .*s\.points"):
        open_points(path)


def test_given_normals_have_one_side(tmp_path):
    places, _ = spread(500)
    normals = dict(zip(("nx", "ny", "nz"), np.tile([[0.0], [0.0], [2.0]], 500), strict=True))
    ingest_points(ply(tmp_path / "a.ply", vertices(places) | normals), tmp_path / "a.points")
    points = Points.open(tmp_path / "a.points")
    assert not points.two_sided
    assert np.allclose(levels_of(points)[0].normal, [0, 0, 1])
    assert points.info().normals == "given"


@pytest.mark.data
def test_autzen_is_made_ready(data_dir, tmp_path):
    report = ingest_points(data_dir / "points/autzen_trim.laz", tmp_path / "a.points")
    points = Points.open(tmp_path / "a.points")
    assert report.size == points.size == 110_000
    assert points.unit_m == 0.3048
    assert report.bytes < 16 * points.size
