"""Corners of markers in synthetic photographs, against where they are."""

from __future__ import annotations

import numpy as np
import pytest

from limen.calibrate.boards import boards_of
from limen.calibrate.detect import detect
from limen.calibrate.edges import refine
from limen.calibrate.poses import apply
from support import photographs

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def scene():
    """A photograph of the wall and the triangle's two panels, and the true corners by marker."""
    wall = photographs.wall()
    (pose,) = photographs.around(wall, 1.2, [25], [0.3])
    truth, (photo,) = photographs.photographed(wall, [pose])
    true_px = {
        marker: photographs.CAMERA.project(apply(pose, panel.position_m(corners)))
        for board, panel in zip(boards_of(truth), truth.panels, strict=True)
        for marker, corners in zip(board.ids, board.corners_px, strict=True)
    }
    return photo, true_px


def apart(ids, corners_px, true_px):
    return np.concatenate([np.linalg.norm(c - true_px[int(i)], axis=1) for i, c in zip(ids, corners_px, strict=True)])


def test_corners_are_found_to_hundredths_of_a_pixel(scene):
    photo, true_px = scene
    ids, corners_px = detect(photo)
    errors = apart(ids, corners_px, true_px)
    assert len(ids) >= 34, "of 36"
    assert np.median(errors) < 0.08
    assert np.quantile(errors, 0.95) < 0.3


def test_they_are_several_times_better_than_by_opencvs_window_around_the_corner(scene):
    photo, true_px = scene
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), settings)
    found, numbers, _ = detector.detectMarkers(photo)
    theirs = apart(numbers.ravel(), [each.reshape(4, 2) for each in found], true_px)
    assert np.median(apart(*detect(photo), true_px)) < 0.5 * np.median(theirs)


def test_turning_the_photograph_turns_the_corners(scene):
    photo, _ = scene
    ids, corners_px = detect(photo)
    turned_ids, turned_px = detect(np.ascontiguousarray(np.rot90(photo)))
    by_id = dict(zip(turned_ids.tolist(), turned_px, strict=True))
    gaps = [
        np.stack([c[:, 1], photo.shape[1] - 1 - c[:, 0]], axis=1) - by_id[int(i)]
        for i, c in zip(ids, corners_px, strict=True)
        if int(i) in by_id
    ]
    assert len(gaps) > 0.9 * len(ids)
    assert np.median(np.abs(gaps)) < 0.02


def test_exposure_changes_nothing(scene):
    photo, true_px = scene
    corners_px = np.stack([true_px[int(i)] for i in detect(photo)[0]])
    light = photo.astype(float)
    assert refine(0.3 * light + 40, corners_px) == pytest.approx(refine(light, corners_px), abs=1e-6, nan_ok=True)


def test_where_there_is_no_marker_there_are_no_corners():
    square = np.array([[[100.0, 100], [180, 100], [180, 180], [100, 180]]])
    noise = np.random.default_rng(0).normal(0.5, 0.1, (300, 300))
    assert np.isnan(refine(noise, square)).all()
    assert np.isnan(refine(np.full((300, 300), 0.5), square)).all()
    assert refine(noise, np.empty((0, 4, 2))).shape == (0, 4, 2)


def test_half_a_marker_that_is_covered_is_left_out(scene):
    photo, _ = scene
    ids, corners_px = detect(photo)
    marker = int(ids[0])
    box = corners_px[0]
    covered = photo.copy()
    x, y = box.mean(axis=0).astype(int)
    covered[y:, : x + 40] = 128
    assert marker not in detect(covered)[0]


def test_a_marker_and_its_reflection_are_both_left_out(scene):
    photo, _ = scene
    ids, _ = detect(photo)
    twice = np.concatenate([photo, photo], axis=1)
    assert not set(ids.tolist()) & set(detect(twice)[0].tolist())
