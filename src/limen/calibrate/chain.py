"""First guesses, good enough for the adjustment of all at once to find the best answer.

References
----------
Collins, Bartoli 2014, *Infinitesimal plane-based pose estimation*, International Journal of Computer Vision 109
(the two poses that one flat board in one photograph leaves open).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from limen.calibrate.camera import Intrinsics
from limen.calibrate.observations import Observations
from limen.calibrate.opencv import load
from limen.calibrate.poses import IDENTITY, compose, inverse
from limen.geometry import Floats

__all__ = ["first_camera", "first_poses"]

_FOCALS = np.geomspace(0.4, 4.0, 32)
"""Of the photographs' longer side: 103 to 14 degrees across."""

_VIEWS = 60

View = tuple[int, int]


def first_camera(seen: Observations, size_px: tuple[int, int]) -> Intrinsics:
    """A pinhole with the focal length under which boards, each by itself, fit best; no distortion.

    A board seen at an angle tells how fast things grow smaller with distance, and so the focal length (Zhang 2000, *A
    flexible new technique for camera calibration*, IEEE PAMI 22). A photograph that agrees with no other weighs little.
    """
    views = sorted(_views(seen).values(), key=len, reverse=True)[:_VIEWS]
    cameras = [_pinhole(size_px, float(focal) * max(size_px)) for focal in _FOCALS]
    costs = []
    for camera in cameras:
        errors = np.array([_board_poses(view, camera)[0][1] for view in views])
        costs.append(float(np.log1p(errors**2).sum()))
    return cameras[int(np.argmin(costs))]


def first_poses(seen: Observations, camera: Intrinsics, photos: int, panels: int, start: int) -> tuple[Floats, Floats]:
    """Poses (F, 6) of photographs and (P, 6) of panels, in the frame of panel ``start``; NaN where nothing links.

    Whatever shares most corners with what has its place is placed next. Of all poses that single boards suggest, the
    one is taken that all these corners agree with best, and is then fitted to them.
    """
    suggestions = {key: [pose for pose, _ in _board_poses(view, camera)] for key, view in _views(seen).items()}
    photo_poses, panel_poses = np.full((photos, 6), np.nan), np.full((panels, 6), np.nan)
    panel_poses[start] = IDENTITY
    while True:
        photo_known = np.isfinite(photo_poses[:, 0])[seen.photo]
        panel_known = np.isfinite(panel_poses[:, 0])[seen.panel]
        next_photo = np.bincount(seen.photo[panel_known & ~photo_known], minlength=photos)
        next_panel = np.bincount(seen.panel[photo_known & ~panel_known], minlength=panels)
        if not next_photo.any() and not next_panel.any():
            return photo_poses, panel_poses
        if next_photo.max() >= next_panel.max():
            photo = int(next_photo.argmax())
            linked = seen.where((seen.photo == photo) & panel_known)
            ways = [
                compose(pose, inverse(panel_poses[panel]))
                for panel in np.unique(linked.panel)
                for pose in suggestions[photo, int(panel)]
            ]
            photo_poses[photo] = _best(linked, camera, photo_poses, panel_poses, ("photo", photo), ways)
        else:
            panel = int(next_panel.argmax())
            linked = seen.where((seen.panel == panel) & photo_known)
            ways = [
                compose(inverse(photo_poses[photo]), pose)
                for photo in np.unique(linked.photo)
                for pose in suggestions[int(photo), panel]
            ]
            panel_poses[panel] = _best(linked, camera, photo_poses, panel_poses, ("panel", panel), ways)


def _best(
    linked: Observations,
    camera: Intrinsics,
    photo_poses: Floats,
    panel_poses: Floats,
    what: tuple[str, int],
    ways: list[Floats],
) -> Floats:
    """The pose of one photograph or panel that most corners agree with, fitted to them."""

    def errors(pose: Floats) -> Floats:
        photos, panels = photo_poses.copy(), panel_poses.copy()
        (photos if what[0] == "photo" else panels)[what[1]] = pose
        return linked.errors_px(camera, photos, panels)

    costs = [float(np.log1p((errors(pose) ** 2).sum(axis=1)).sum()) for pose in ways]
    best = ways[int(np.argmin(costs))]

    def flat(pose: Floats) -> Floats:
        return errors(pose).ravel()

    return np.asarray(least_squares(flat, best, loss="cauchy", x_scale="jac").x)


def _views(seen: Observations) -> dict[View, Observations]:
    """What each photograph saw of each panel."""
    pairs = np.unique(np.stack([seen.photo, seen.panel], axis=1), axis=0)
    return {(int(f), int(p)): seen.where((seen.photo == f) & (seen.panel == p)) for f, p in pairs}


def _pinhole(size_px: tuple[int, int], focal_px: float) -> Intrinsics:
    centre = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    return Intrinsics(size_px, (focal_px, focal_px), centre)


def _board_poses(view: Observations, camera: Intrinsics) -> list[tuple[Floats, float]]:
    """The one or two poses of a panel in the camera's frame that one photograph allows, each with its error in px."""
    cv2 = load()
    _, turns, moves, errors = cv2.solvePnPGeneric(
        view.place_m, view.seen_px, camera.matrix, np.array(camera.distortion), flags=cv2.SOLVEPNP_IPPE
    )
    poses = [np.concatenate([turn.ravel(), move.ravel()]) for turn, move in zip(turns, moves, strict=True)]
    found = sorted(zip(poses, np.ravel(errors).tolist(), strict=True), key=lambda each: each[1])
    return [(pose, float(error)) for pose, error in found]
