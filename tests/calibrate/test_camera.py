"""Intrinsics against OpenCV's, their file, and the rays of synthetic photographs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.calibrate.camera import Intrinsics
from limen.calibrate.synthetic import Photographer
from limen.errors import FormatError, MissingFileError

cv2 = pytest.importorskip("cv2")

WIDE = Intrinsics((640, 480), (500.0, 510.0), (325.0, 236.0), (-0.2, 0.05, 0.002, -0.001, 0.01))
places = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(1, 5)), min_size=1, max_size=20).map(np.array)


@given(places)
def test_projecting_is_what_opencv_does(points_m):
    expected, _ = cv2.projectPoints(points_m, np.zeros(3), np.zeros(3), WIDE.matrix, np.array(WIDE.distortion))
    assert WIDE.project(points_m) == pytest.approx(expected[:, 0], abs=1e-8)


def test_rays_of_a_synthetic_camera_come_back_to_their_pixels():
    rays = Photographer(WIDE, oversampling=2)._rays
    ahead = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2).astype(float)
    back, _ = cv2.projectPoints(ahead.reshape(-1, 3), np.zeros(3), np.zeros(3), WIDE.matrix, np.array(WIDE.distortion))
    x, y = np.meshgrid((np.arange(1280) + 0.5) / 2 - 0.5, (np.arange(960) + 0.5) / 2 - 0.5)
    assert np.abs(back.reshape(960, 1280, 2) - np.stack([x, y], axis=-1)).max() < 0.02


def test_a_camera_file_comes_back(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text(WIDE.to_toml())
    assert Intrinsics.load(path) == WIDE


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("size_px = [1, 2]\n", "focal_px"),
        ("size_px = [640, 480]\nfocal_px = [0, 1]\ncentre_px = [1, 1]\n", "positive"),
        ("size_px = [640, 480]\nfocal_px = [1, 1]\ncentre_px = [nan, 1]\n", "finite"),
        ("size_px = [640, 480]\nfocal = 1\n", "focal"),
        ("size_px = [", "not valid TOML"),
    ],
)
def test_a_wrong_camera_file_is_named_with_the_field(tmp_path, text, said):
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(FormatError, match=said) as failed:
        Intrinsics.load(path)
    assert str(path) in str(failed.value)
    assert "\n" not in str(failed.value)


def test_a_camera_file_that_is_not_there(tmp_path):
    with pytest.raises(MissingFileError):
        Intrinsics.load(tmp_path / "no.toml")
