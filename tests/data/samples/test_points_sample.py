"""The scanned hall: the same every time, and where a hall is."""

import numpy as np
import pytest

from limen.data import sample_points
from limen.data.points.cloud import open_cloud
from limen.data.samples.points import scanned_hall
from limen.errors import InputError, MissingFileError


def whole(points, seed=0):
    return [np.concatenate(part) for part in zip(*scanned_hall(points, seed), strict=True)]


@pytest.mark.parametrize("ending", ["las", "laz", "ply"])
def test_the_same_bytes_on_every_run(tmp_path, ending):
    one, other = (sample_points(tmp_path / f"{name}.{ending}", 3000, seed=4) for name in "ab")
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    assert (one.size, one.bytes) == (other.size, other.bytes)
    third = sample_points(tmp_path / f"c.{ending}", 3000, seed=5)
    assert (tmp_path / f"a.{ending}").read_bytes() != (tmp_path / f"c.{ending}").read_bytes()
    assert third.facts["seed"] == 5


@pytest.mark.parametrize("ending", ["laz", "ply"])
def test_a_file_holds_what_was_scanned(tmp_path, ending):
    sample_points(tmp_path / f"a.{ending}", 5000, seed=1)
    cloud = open_cloud(tmp_path / f"a.{ending}")
    (read,) = cloud.batches(10_000)
    positions, rgb, normals, _ = whole(5000, 1)
    assert np.allclose(read.positions, positions, atol=1e-4)
    assert np.array_equal(read.rgb, rgb)
    assert cloud.has_intensity
    if ending == "ply":
        assert np.allclose(read.normals, normals, atol=1e-6)
    else:
        assert cloud.unit_m == 1.0


def test_points_lie_on_what_is_in_the_hall():
    positions, _, normals, _ = whole(60_000, 2)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert positions.min() > -0.02
    assert np.all(positions.max(axis=0) < [30.02, 18.02, 8.02])
    floor = np.abs(positions[:, 2]) < 0.01
    assert 0.1 < floor.mean() < 0.6
    assert np.allclose(normals[floor & (normals[:, 2] > 0.9)], [0, 0, 1])
    on_column = np.abs(np.hypot(positions[:, 0] - 8.4, positions[:, 1] - 3.0) - 0.45) < 0.01
    assert on_column.sum() > 50
    off = np.stack([positions[on_column, 0] - 8.4, positions[on_column, 1] - 3.0], axis=1)
    side = np.abs(normals[on_column, 2]) < 0.5
    assert ((off * normals[on_column, :2]).sum(axis=1)[side] > 0.4).all()


def test_every_station_scans_its_quarter():
    """A scanner sees nothing nearer than the floor below it, so each has a ring of its own."""
    positions = whole(8000)[0]
    for station, quarter in zip(
        [(6.0, 5.0), (24.0, 5.5), (15.0, 13.0), (15.0, 4.0)], positions.reshape(4, 2000, 3), strict=True
    ):
        below = np.linalg.norm(quarter - [*station, 0.0], axis=1).min()
        assert below < 0.2


@pytest.mark.parametrize(
    ("path", "size", "seed", "says"),
    [("a.xyz", 10, 0, "ends in"), ("a.laz", 0, 0, "1 to"), ("a.laz", 10, -1, "seed")],
)
def test_what_cannot_be_made_is_said(tmp_path, path, size, seed, says):
    with pytest.raises(InputError, match=says):
        sample_points(tmp_path / path, size, seed)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_said(tmp_path):
    with pytest.raises(MissingFileError):
        sample_points(tmp_path / "no/a.laz", 10)
