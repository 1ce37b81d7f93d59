from __future__ import annotations

import math

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st

from limen.data.terrain.elevation import ElevationSource, PostRect
from limen.data.terrain.elevation_type import is_elevation, is_terrain
from limen.data.terrain.georeference import metres_a_degree
from limen.errors import FormatError, InputError
from support.dems import UTM, hills, write_dem


def read_all(source):
    width, height = source.size_posts
    return source.read(PostRect(0, 0, width, height))


@pytest.mark.parametrize("dtype", ["int16", "uint8", "int32", "uint16", "float32", "float64"])
def test_heights_are_what_the_file_holds(tmp_path, dtype):
    heights = hills(50, 40).astype(dtype)
    with ElevationSource(write_dem(tmp_path / "a.tif", heights, **UTM)) as source:
        assert source.dtype == ("int16" if dtype in ("int16", "uint8") else "float32")
        assert source.exact == (dtype not in ("float64", "int32"))
        found, void = read_all(source)
        assert found.dtype == source.dtype
        assert np.array_equal(found, heights)
        assert not void.any()
        part, _ = source.read(PostRect(10, 5, 20, 30))
        assert np.array_equal(part, heights[5:35, 10:30])


def test_scale_offset_and_feet_become_metres(tmp_path):
    stored = hills(20, 10)
    path = write_dem(tmp_path / "a.tif", stored, **UTM, scales=(0.1,), offsets=(5.0,), units=("US survey foot",))
    with ElevationSource(path) as source:
        found, _ = read_all(source)
    expected = (stored.astype(float) * 0.1 + 5.0) * (1200.0 / 3937.0)
    assert np.abs(found - expected).max() < 1e-4
    unknown = write_dem(tmp_path / "b.tif", stored, **UTM, units=("kelvin",))
    with ElevationSource(unknown) as source:
        assert "'kelvin', is not known" in source.notes[0]
        assert np.array_equal(read_all(source)[0], stored)


@pytest.mark.parametrize(
    ("dtype", "nodata", "wrong"),
    [
        ("int16", -99, [-99, -32768]),
        ("int16", None, [-32768]),
        ("float32", None, [np.nan, np.inf, -np.inf, -3.4028235e38]),
        ("float32", -9999.0, [-9999.0, np.nan]),
    ],
)
def test_posts_without_data_are_voids(tmp_path, dtype, nodata, wrong):
    heights = hills(30, 20).astype(dtype)
    heights[3, 4 : 4 + len(wrong)] = wrong
    with ElevationSource(write_dem(tmp_path / "a.tif", heights, nodata=nodata, **UTM)) as source:
        found, void = read_all(source)
    expected = np.zeros(void.shape, bool)
    expected[3, 4 : 4 + len(wrong)] = True
    assert np.array_equal(void, expected)
    assert np.array_equal(found[~void], heights[~void])
    assert np.isfinite(found).all()


def test_a_mask_and_an_alpha_band_are_voids(tmp_path):
    heights = hills(30, 20)
    path = write_dem(tmp_path / "a.tif", heights, **UTM)
    mask = np.full((20, 30), 255, np.uint8)
    mask[5:8] = 0
    with rasterio.open(path, "r+") as file:
        file.write_mask(mask)
    with ElevationSource(path) as source:
        assert np.array_equal(read_all(source)[1], mask == 0)
    both = np.stack([heights.astype(np.uint16), np.where(mask, 65535, 0).astype(np.uint16)])
    with ElevationSource(write_dem(tmp_path / "b.tif", both, **UTM, ALPHA="YES")) as source:
        assert source.band == 1
        assert np.array_equal(read_all(source)[1], mask == 0)


def test_the_band_of_heights(tmp_path):
    bands = np.stack([hills(20, 10, seed) for seed in range(3)])
    path = write_dem(tmp_path / "a.tif", bands, **UTM)
    with pytest.raises(InputError, match=r"give --band, one of 1 \(int16\), 2 \(int16\), 3"):
        ElevationSource(path)
    with pytest.raises(InputError, match="--band 4: it has bands 1 to 3"):
        ElevationSource(path, band=4)
    with ElevationSource(path, band=2) as source:
        assert np.array_equal(read_all(source)[0], bands[1])
    named = write_dem(tmp_path / "b.tif", bands, **UTM, descriptions=("slope", "aspect", "Surface height"))
    with ElevationSource(named) as source:
        assert source.band == 3


def test_spacing_comes_from_the_projection(tmp_path):
    heights = hills(100, 60)
    with ElevationSource(write_dem(tmp_path / "a.tif", heights, **UTM)) as source:
        assert source.spacing_m == (30.0, 20.0)
        assert source.bounds == (500_000.0, 4_398_800.0, 503_000.0, 4_400_000.0)
        assert source.notes == ()
    feet = {**UTM, "crs": "EPSG:2225"}  # California zone 1, in US survey feet
    with ElevationSource(write_dem(tmp_path / "b.tif", heights, **feet)) as source:
        assert source.spacing_m == pytest.approx((30 * 1200 / 3937, 20 * 1200 / 3937))
    angle = math.radians(20)
    turned = rasterio.Affine(
        30 * math.cos(angle), 20 * math.sin(angle), 0, 30 * math.sin(angle), -20 * math.cos(angle), 0
    )
    with ElevationSource(write_dem(tmp_path / "c.tif", heights, crs=UTM["crs"], transform=turned)) as source:
        assert source.spacing_m == pytest.approx((30.0, 20.0))
        assert np.array_equal(read_all(source)[0], heights)


def test_spacing_of_degrees_is_that_of_the_ellipsoid_in_the_middle(tmp_path):
    arcsecond = 1 / 3600
    place = {"crs": "EPSG:4326", "transform": rasterio.Affine(arcsecond, 0, -120, 0, -arcsecond, 45 + 30 * arcsecond)}
    with ElevationSource(write_dem(tmp_path / "a.tif", hills(80, 60), **place)) as source:
        # National Geospatial-Intelligence Agency: 78,847 and 111,132 m a degree at latitude 45.
        assert source.spacing_m == pytest.approx((78_847 / 3600, 111_132 / 3600), rel=1e-5)
    moon = {**place, "crs": "+proj=longlat +R=1737400 +no_defs"}
    with ElevationSource(write_dem(tmp_path / "b.tif", hills(80, 60), **moon)) as source:
        degree = math.pi * 1737400 / 180
        assert source.spacing_m == pytest.approx((degree * math.cos(math.pi / 4) / 3600, degree / 3600), rel=1e-6)


@given(st.floats(-89.0, 89.0))
def test_a_degree_is_an_arc_of_the_ellipse(latitude_deg):
    """The chord between two near points of the meridian, and the parallel's circumference."""
    axis, flattening = 6378137.0, 1 / 298.257223563
    polar = axis * (1 - flattening)

    def point(degrees):
        reduced = math.atan2(polar * math.sin(math.radians(degrees)), axis * math.cos(math.radians(degrees)))
        return axis * math.cos(reduced), polar * math.sin(reduced)

    east, north = metres_a_degree(latitude_deg)
    step = 1e-3
    assert north == pytest.approx(
        math.dist(point(latitude_deg - step), point(latitude_deg + step)) / (2 * step), rel=1e-6
    )
    assert east == pytest.approx(2 * math.pi * point(latitude_deg)[0] / 360, rel=1e-9)


def test_rows_that_run_north_are_turned_over(tmp_path):
    heights = hills(30, 20)
    south_up = rasterio.Affine(30.0, 0.0, 500_000.0, 0.0, 20.0, 4_399_600.0)
    with ElevationSource(write_dem(tmp_path / "a.tif", heights, crs=UTM["crs"], transform=south_up)) as source:
        assert np.array_equal(read_all(source)[0], heights[::-1])
        assert np.array_equal(source.read(PostRect(2, 3, 5, 4))[0], heights[::-1][3:7, 2:7])
        assert source.transform == (30.0, 0.0, 500_000.0, 0.0, -20.0, 4_400_000.0)


def test_without_georeference_posts_are_a_metre_apart_and_it_is_said(tmp_path):
    path = write_dem(tmp_path / "a.tif", hills(30, 20))
    with ElevationSource(path) as source:
        assert (source.spacing_m, source.crs, source.transform) == ((1.0, 1.0), "", None)
        assert "give --spacing-m" in source.notes[0]
    with ElevationSource(path, spacing_m=12.5) as source:
        assert (source.spacing_m, source.notes) == ((12.5, 12.5), ())
    with pytest.raises(InputError, match="--spacing-m 0 by 0: give metres"):
        ElevationSource(path, spacing_m=0.0)
    nowhere = write_dem(tmp_path / "b.tif", hills(30, 20), transform=UTM["transform"])
    with ElevationSource(nowhere) as source:
        assert source.spacing_m == (30.0, 20.0)
        assert "30 by 20, is taken as metres; give --spacing-m" in source.notes[0]


def test_bad_rasters_say_what_is_wrong(tmp_path, capfd):
    complex_ = write_dem(tmp_path / "c.tif", hills(9, 9).astype(np.complex64), **UTM)
    with pytest.raises(FormatError, match="band 1 holds complex numbers"):
        ElevationSource(complex_)
    with pytest.raises(FormatError, match="1 x 1 posts are no surface; at least 2 x 2"):
        ElevationSource(write_dem(tmp_path / "p.tif", hills(1, 1), **UTM))
    (tmp_path / "n.asc").write_text("this is a letter")
    with pytest.raises(FormatError, match=r"n\.asc: is no raster that can be read"):
        ElevationSource(tmp_path / "n.asc")
    assert capfd.readouterr() == ("", "")


def test_a_file_cut_short_says_where(tmp_path, capfd):
    path = write_dem(tmp_path / "a.tif", hills(900, 700), **UTM, tiled=True, blockxsize=256, blockysize=256)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with ElevationSource(path) as source:
        with pytest.raises(FormatError, match=r"rows 500 to 699, columns 0 to 899 cannot be read.*copy it again"):
            source.read(PostRect(0, 500, 900, 200))
        assert source.read(PostRect(0, 0, 100, 100))[0].shape == (100, 100)
    assert capfd.readouterr() == ("", "")


def test_pictures_and_heights_are_told_apart(tmp_path):
    def holds_heights(name, texels, **profile):
        return is_elevation(write_dem(tmp_path / name, texels, **profile))

    assert holds_heights("a.tif", hills(9, 9))
    assert holds_heights("b.tif", hills(9, 9).astype(np.float32))
    assert holds_heights("c.tif", hills(9, 9).astype(np.uint16), **UTM)
    assert holds_heights("d.tif", hills(9, 9).astype(np.uint16), nodata=0)
    assert not holds_heights("e.tif", hills(9, 9).astype(np.uint16))
    assert not holds_heights("f.tif", hills(9, 9).astype(np.uint8), **UTM)
    assert not holds_heights("g.tif", np.stack([hills(9, 9)] * 3))
    (tmp_path / "h.hgt").write_bytes(b"")
    assert is_elevation(tmp_path / "h.hgt")
    assert is_terrain(tmp_path / "no.terrain")
    assert not is_terrain(tmp_path / "no.tif")


def test_a_microscope_is_no_surveyor(tmp_path):
    import tifffile

    tifffile.imwrite(tmp_path / "cell.tif", np.zeros((9, 9), np.float32), imagej=True)
    assert not is_elevation(tmp_path / "cell.tif")


@pytest.mark.data
def test_a_window_of_the_real_file(data_dir):
    path = data_dir / "terrain/california_nevada_3arcsec_10801x4801.tif"
    with ElevationSource(path) as source, rasterio.open(path) as file:
        window = PostRect(2400, 352, 700, 300)
        found, void = source.read(window)
        assert np.array_equal(found, file.read(1, window=rasterio.windows.Window(*window)))
        assert not void.any()
        assert source.size_posts == (10801, 4801)
        assert source.spacing_m == pytest.approx((73.19, 92.50), abs=0.01)
