"""Files of points: what is read is what was written, and what is broken is said."""

import laspy
import numpy as np
import pytest

from limen.data import open as open_content
from limen.data.points.cloud import Stretch, open_cloud, stretch_of
from limen.data.points.cloud_type import cloud_type, is_points
from limen.data.points.info import cloud_info
from limen.errors import FormatError, MissingFileError
from support.cloud_files import CHANCE, PLACES, RGB, las, ply, vertices


def everything(path, size=700):
    batches = list(open_cloud(path).batches(size))
    assert max(len(batch.positions) for batch in batches) <= size
    parts = (None if part[0] is None else np.concatenate(part) for part in zip(*batches, strict=True))
    return batches[0]._make(parts)


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize(("deep", "says"), [(257, "16 bits"), (1, "8 bits in fields of 16")])
def test_las_comes_back_with_colours_of_either_depth(tmp_path, ending, deep, says):
    path = las(tmp_path / f"a.{ending}", rgb=RGB * deep, wkt='LOCAL_CS["here",UNIT["foot",0.3048]]')
    cloud, read = open_cloud(path), everything(path)
    assert (cloud.count, cloud.colours, cloud.has_intensity, cloud.unit_m) == (3000, says, False, 0.3048)
    assert np.allclose(read.positions, PLACES, atol=1e-9)
    assert np.array_equal(read.rgb, RGB)
    assert np.allclose(cloud.bounds, [PLACES.min(axis=0), PLACES.max(axis=0)])


def test_without_colours_intensities_are_grey(tmp_path):
    strong = np.concatenate([np.linspace(1000, 3000, 2995), [65535] * 5])
    path = las(tmp_path / "a.laz", intensity=strong)
    read = everything(path)
    assert open_cloud(path).colours == "grey, from intensity"
    assert np.array_equal(read.rgb, np.repeat(read.intensity[:, None], 3, axis=1))
    assert read.intensity[0] == 0
    assert read.intensity[2990] == 255
    assert abs(int(read.intensity[1500]) - 128) < 4  # five glints do not make all else black


def test_a_las_that_says_nothing_of_colour_or_unit(tmp_path):
    cloud = open_cloud(las(tmp_path / "a.las", point_format=0, version="1.2"))
    assert (cloud.colours, cloud.unit_m, cloud.crs) == ("none", None, "")
    assert everything(tmp_path / "a.las").rgb is None


def test_withheld_points_are_left_out(tmp_path):
    path = las(tmp_path / "a.las", rgb=RGB)
    data = laspy.read(path)
    data.withheld = np.arange(3000) % 3 == 0
    data.write(str(path))
    assert np.allclose(everything(path).positions, PLACES[np.arange(3000) % 3 != 0], atol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_a_laz_cut_short_is_said(tmp_path, share):
    path = las(tmp_path / "a.laz", rgb=RGB * 257, places=PLACES)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(FormatError, match="copy"):
        everything(path)


def test_a_las_cut_short_says_how_many_points_there_were(tmp_path):
    path = las(tmp_path / "a.las", rgb=RGB)
    path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(FormatError, match=r"cut short|cannot be read"):
        everything(path)


def test_nonsense_that_begins_like_a_las(tmp_path):
    (tmp_path / "a.las").write_bytes(b"LASF" + bytes(300))
    with pytest.raises(FormatError, match="cannot be read as LAS"):
        open_cloud(tmp_path / "a.las")


def test_no_points_are_said(tmp_path):
    with pytest.raises(FormatError, match="holds no points"):
        open_cloud(las(tmp_path / "a.las", places=np.zeros((0, 3))))
    with pytest.raises(FormatError, match="holds no points"):
        open_cloud(ply(tmp_path / "a.ply", vertices(np.zeros((0, 3)))))


@pytest.mark.parametrize("order", ["<", ">", ""])
def test_a_ply_comes_back_in_any_order_of_bytes(tmp_path, order):
    normals = CHANCE.normal(size=(3000, 3))
    fields = vertices() | dict(zip(("red", "green", "blue"), RGB.astype(np.uint8).T, strict=True))
    fields |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    path = ply(tmp_path / "a.ply", fields, order)
    cloud, read = open_cloud(path), everything(path)
    assert (cloud.count, cloud.has_normals, cloud.bounds) == (3000, True, None)
    assert np.allclose(read.positions, PLACES)
    assert np.array_equal(read.rgb, RGB)
    assert np.allclose(read.normals, normals)
    assert np.allclose(cloud.found_bounds(), [PLACES.min(axis=0), PLACES.max(axis=0)])


@pytest.mark.parametrize(
    ("names", "kind", "factor"),
    [(("r", "g", "b"), "u1", 1), (("diffuse_red", "diffuse_green", "diffuse_blue"), "u2", 257),
     (("scalar_Red", "scalar_Green", "scalar_Blue"), "f4", 1.0), (("red", "green", "blue"), "f4", 1 / 255)],
)  # fmt: skip
def test_colours_of_a_ply_have_many_names_and_depths(tmp_path, names, kind, factor):
    fields = vertices() | {name: (RGB[:, c] * factor).astype(kind) for c, name in enumerate(names)}
    assert np.array_equal(everything(ply(tmp_path / "a.ply", fields)).rgb, RGB)


def test_points_of_a_ply_that_are_nowhere_are_left_out(tmp_path):
    broken = PLACES.copy()
    broken[::4, 1], broken[1::4, 0] = np.nan, np.inf
    path = ply(tmp_path / "a.ply", vertices(broken))
    assert np.allclose(everything(path).positions, PLACES[np.arange(3000) % 4 > 1])
    broken[:] = np.nan
    with pytest.raises(FormatError, match=r"none of its 3,000 points has a finite position"):
        open_cloud(ply(path, vertices(broken))).found_bounds()


@pytest.mark.parametrize("order", ["<", ""])
def test_a_ply_cut_short_is_said(tmp_path, order):
    path = ply(tmp_path / "a.ply", vertices(), order)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(FormatError, match=r"cut short after [\d,]+ of 3,000 points"):
        everything(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"ply\nelement vertex 1\nproperty float x\nend_header\n1\n", "no format"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "x, y and z"),
        (b"ply\nformat ascii 1.0\nelement vertex\nproperty float x\nend_header\n1\n", "without a number"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            b"property list uchar int more\nend_header\n1 2 3 0\n",
            "lists",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n1 2 cucumber\n",
            "damaged",
        ),
    ],
)
def test_a_ply_that_cannot_be_read_is_said(tmp_path, content, says):
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(FormatError, match=says):
        everything(tmp_path / "a.ply")


def test_what_is_a_cloud_and_what_a_mesh(tmp_path):
    fields = vertices(PLACES[:3], np.float32)
    faces = "element face {}\nproperty list uchar int vertex_indices"
    assert cloud_type(ply(tmp_path / "a.ply", fields, extra=faces.format(1))) is None
    assert cloud_type(ply(tmp_path / "b.ply", fields, extra=faces.format(0))) == "ply"
    assert cloud_type(las(tmp_path / "c.laz")) == "las"
    assert is_points(tmp_path / "not there.points")
    assert not is_points(tmp_path / "not there.laz")
    with pytest.raises(MissingFileError):
        open_cloud(tmp_path / "not there.laz")
    with pytest.raises(FormatError, match="no cloud of points"):
        open_cloud(tmp_path / "a.ply")


def test_info_of_a_file_reads_it_for_its_bounds(tmp_path):
    found = cloud_info(ply(tmp_path / "a.ply", vertices()))
    assert (found.kind, found.ready, found.size, found.levels[-1]) == ("points", False, 3000, 1)
    assert np.allclose(found.bounds, [PLACES.min(axis=0), PLACES.max(axis=0)])


def e57(path, poses):
    pye57 = pytest.importorskip("pye57", reason="NO E57: pip install 'limen[e57]'")
    with pye57.E57(str(path), mode="w") as file:
        for turn, move in poses:
            fields = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), PLACES.T.copy(), strict=True))
            fields |= {n: RGB[:, c].astype(np.uint8) for c, n in enumerate(("colorRed", "colorGreen", "colorBlue"))}
            fields["intensity"] = np.linspace(0, 1, 3000).astype(np.float32)
            fields["cartesianInvalidState"] = (np.arange(3000) % 5 == 0).astype(np.int8)
            file.write_scan_raw(fields, rotation=np.array(turn), translation=np.array(move))
    return path


def test_scans_of_an_e57_lie_where_their_poses_say(tmp_path):
    quarter = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # about z
    path = e57(tmp_path / "a.e57", [([1.0, 0, 0, 0], [0.0, 0, 0]), (quarter, [7.0, 0, 1])])
    cloud, read = open_cloud(path), everything(path)
    kept = PLACES[np.arange(3000) % 5 != 0]
    turned = np.stack([7.0 - kept[:, 1], kept[:, 0], kept[:, 2] + 1.0], axis=1)
    assert (cloud.count, cloud.unit_m, cloud.colours) == (6000, 1.0, "given")
    assert np.allclose(read.positions, np.concatenate([kept, turned]))
    assert np.array_equal(read.rgb, np.tile(RGB[np.arange(3000) % 5 != 0], (2, 1)))
    assert read.intensity.min() < 5
    assert read.intensity.max() > 250


def test_an_e57_cut_short_is_said(tmp_path):
    path = e57(tmp_path / "a.e57", [([1.0, 0, 0, 0], [0.0, 0, 0])])
    path.write_bytes(path.read_bytes()[:2048])
    with pytest.raises(FormatError, match="cannot be read as E57"):
        open_cloud(path)


def test_a_missing_package_is_said_with_its_cure(tmp_path, monkeypatch):
    import sys

    (tmp_path / "a.e57").write_bytes(b"ASTM-E57" + bytes(100))
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(FormatError, match=r"pip install 'limen\[e57\]'"):
        open_cloud(tmp_path / "a.e57")


def test_a_stretch_of_nothing_is_harmless():
    assert stretch_of(np.array([])) == Stretch(0.0, 1.0)
    assert stretch_of(np.full(9, 5.0)).apply(np.array([4.0, 5.0, 7.0, np.nan])).tolist() == [0, 0, 255, 0]


@pytest.mark.data
def test_real_clouds_say_what_they_are(data_dir):
    trim = open_cloud(data_dir / "points/autzen_trim.laz")
    assert (trim.count, trim.colours, trim.unit_m) == (110_000, "8 bits in fields of 16", 0.3048)
    lion = open_cloud(data_dir / "points/lion_takanawa.copc.laz")
    assert (lion.count, lion.colours, lion.unit_m) == (341_989, "16 bits", None)
    assert sum(len(batch.positions) for batch in lion.batches(100_000)) == lion.count


def test_open_takes_a_cloud_for_points(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    points = open_content(las(tmp_path / "a.laz", rgb=RGB))
    assert (points.size, points.two_sided) == (3000, True)
