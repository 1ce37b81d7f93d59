"""Displays, their boards and synthetic photographs of them, small enough for tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from limen.calibrate.boards import boards_of, draw_board
from limen.calibrate.camera import Intrinsics
from limen.calibrate.detect import Sighting, detect
from limen.calibrate.poses import apply
from limen.calibrate.rehearse import displaced, looking
from limen.calibrate.synthetic import Photographer
from limen.display.display import Display
from limen.display.grid import Grid, panels_of_grid
from limen.display.panel import Panel

CAMERA = Intrinsics((960, 720), (830, 830), (486, 352), (-0.11, 0.03, 0, 0, 0))
"""Neither centred nor straight; 60 degrees across, so that a pixel is 1.2 milliradians."""


def wall():
    """Three by two panels of 0.4 m with bezels."""
    grid = Grid(
        name="wall",
        size_px=(480, 300),
        columns=3,
        rows=2,
        size_m=(0.4, 0.25),
        bezel_mm=(12, 12),
        centre_m=(0, 1.4, -1),
    )
    return Display("wall", tuple(panels_of_grid(grid, 0.0)))


def triangle():
    """A square panel with a triangular one leaning beside it."""
    square = Panel("square", (400, 400), (-0.4, 1.4, 0), (1, 0, 0), (0, -1, 0), (0.001, 0.001))
    outline = ((10.0, 390.0), (200.0, 10.0), (390.0, 390.0))
    lean = np.radians(25)
    leaning = replace(
        square, name="triangle", origin_m=(0.05, 1.4, 0), right=(np.cos(lean), 0, np.sin(lean)), outline_px=outline
    )
    return Display("triangle", (square, leaning))


def around(display, distance_m, azimuths_deg, heights_m, target=None):
    """Poses of photographs taken around a display, every third one in portrait."""
    middle = display.bounds_m.mean(axis=0) if target is None else np.array(target)
    poses = []
    for number, (azimuth, height) in enumerate(zip(np.radians(azimuths_deg), heights_m, strict=True)):
        eye = middle + np.array([distance_m * np.sin(azimuth), height, distance_m * np.cos(azimuth)])
        poses.append(looking(eye, middle, np.array([0.0, 1, 0]), 90.0 if number % 3 == 2 else 7.0 * number))
    return poses


def photographed(nominal, poses, *, off_m=0.02, off_deg=3.0, seed=1, photographer=None):
    """The truth, and photographs of it: uint8 (height, width) each."""
    truth = displaced(nominal, off_m, off_deg, seed)
    pictures = {b.panel: draw_board(b, p)[..., 0] for b, p in zip(boards_of(nominal), nominal.panels, strict=True)}
    camera = photographer or Photographer(CAMERA, oversampling=2)
    return truth, [camera.photograph(truth, pictures, pose, seed + n) for n, pose in enumerate(poses)]


def sighted(photos):
    return [Sighting(f"{n}.png", (p.shape[1], p.shape[0]), *detect(p)) for n, p in enumerate(photos)]


def ideal_sightings(truth, poses, camera=CAMERA, noise_px=0.05, seed=0):
    """What a perfect detector would see, with noise, of panels that face the camera and nothing hides."""
    random = np.random.default_rng(seed)
    sightings = []
    for number, pose in enumerate(poses):
        ids, corners = [], []
        for board, panel in zip(boards_of(truth), truth.panels, strict=True):
            eye = -apply(np.concatenate([-pose[:3], np.zeros(3)]), pose[None, 3:])[0]
            if (eye - panel.centre_m) @ np.array(panel.normal) <= 0.2 * np.linalg.norm(eye - panel.centre_m):
                continue
            for marker, places in zip(board.ids, board.corners_px, strict=True):
                seen = camera.project(apply(pose, panel.position_m(places)))
                if (seen > 5).all() and (seen < np.array(camera.size_px) - 5).all():
                    ids.append(marker)
                    corners.append(seen + random.normal(0, noise_px, seen.shape))
        sightings.append(
            Sighting(
                f"{number}.png", camera.size_px, np.array(ids, dtype=np.int64), np.array(corners).reshape(-1, 4, 2)
            )
        )
    return sightings
