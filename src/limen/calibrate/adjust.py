"""All at once: the camera, the photographs' and the panels' poses under which all corners fit best.

References
----------
Triggs, McLauchlan, Hartley, Fitzgibbon 2000, *Bundle adjustment: a modern synthesis*, LNCS 1883 (section 9: what a
choice of frame does to a covariance).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

from limen.calibrate.camera import Intrinsics
from limen.calibrate.observations import Observations
from limen.geometry import Floats

__all__ = ["Adjusted", "BundleAdjustment", "adjust"]

_CAMERA = 5
"""Focal length, principal point, k1 and k2: of a camera that calibrates itself. Its pixels are taken to be square."""

_CENTRE_SHARE, _K1, _K2 = 0.03, 0.3, 0.3
"""How far a camera's centre (as a share of the longer side) and bending usually lie from none, one standard deviation.

Few photographs may not tell; many tell so much better that this does not matter.
"""

_OUTLIER_SIGMAS, _OUTLIER_PX = 6.0, 0.3
"""Corners farther off than both are left out."""

_ROBUST_PASSES, _LEAST_SCALE_PX = 3, 0.1

_LEAST_SIGMA_PX = 0.02
"""No corner is known better, however well the few that there are happen to fit."""

_STEPS = (1e-3, 1e-3, 1e-3, 1e-6, 1e-6)
_POSE_STEP = 1e-6
"""Steps of differences: pixels and k1, k2; radians and metres."""

_DAMPING, _MOST_DAMPING, _MOST_STEPS = 1e-3, 1e12, 40
_ENOUGH_ROBUST, _ENOUGH = 1e-4, 1e-9


@dataclass(frozen=True)
class BundleAdjustment:
    """The unknowns as one vector: camera (if it is free), photographs, panels but the first one's.

    Parameters
    ----------
    seen
        The corners.
    camera
        As it is given, or as it is guessed first.
    free_camera
        Whether the camera is an unknown.
    photos, panels
        How many of each, all of them seen.
    reference
        The panel whose frame is that of all poses.
    """

    seen: Observations
    camera: Intrinsics
    free_camera: bool
    photos: int
    panels: int
    reference: int

    @property
    def camera_size(self) -> int:
        return _CAMERA if self.free_camera else 0

    @property
    def photo_start(self) -> int:
        return self.camera_size

    @property
    def panel_start(self) -> int:
        return self.camera_size + 6 * self.photos

    @property
    def size(self) -> int:
        return self.panel_start + 6 * (self.panels - 1)

    def panel_columns(self) -> NDArray[np.int64]:
        """Where each panel's six unknowns begin (P,); -1 for the reference."""
        order = np.arange(self.panels)
        columns = self.panel_start + 6 * (order - (order > self.reference))
        columns[self.reference] = -1
        return columns

    def pack(self, photo_poses: Floats, panel_poses: Floats) -> Floats:
        others = np.delete(panel_poses, self.reference, axis=0)
        camera = self.camera
        own = [camera.focal_px[0], *camera.centre_px, *camera.distortion[:2]] if self.free_camera else []
        return np.concatenate([own, photo_poses.ravel(), others.ravel()])

    def unpack(self, x: Floats) -> tuple[Intrinsics, Floats, Floats]:
        """Camera, photographs' poses (F, 6), panels' poses (P, 6)."""
        camera = self.camera
        if self.free_camera:
            focal, centre_x, centre_y, k1, k2 = (float(value) for value in x[:_CAMERA])
            # A step of the solver may try anything; a camera stays one.
            focal = max(focal, 1.0)
            camera = replace(
                camera, focal_px=(focal, focal), centre_px=(centre_x, centre_y), distortion=(k1, k2, 0, 0, 0)
            )
        photos = x[self.photo_start : self.panel_start].reshape(-1, 6)
        panels = np.insert(x[self.panel_start :].reshape(-1, 6), self.reference, 0.0, axis=0)
        return camera, photos, panels

    def residuals(self, x: Floats) -> Floats:
        """Errors in pixels of all corners (x and y in turn), then what is usual of cameras."""
        camera, photos, panels = self.unpack(x)
        errors = self.seen.errors_px(camera, photos, panels).ravel()
        return np.concatenate([errors, self._usual(camera)]) if self.free_camera else errors

    def _usual(self, camera: Intrinsics) -> Floats:
        width, height = camera.size_px
        off = np.array(camera.centre_px) - (np.array([width, height]) - 1) / 2
        return np.array(
            [*(off / (_CENTRE_SHARE * max(width, height))), camera.distortion[0] / _K1, camera.distortion[1] / _K2]
        )

    def jacobian(self, x: Floats) -> csr_array:
        """Of `residuals`, by central differences: (2 N (+ 4), size), sparse.

        A corner depends on the camera, on one photograph and on one panel; so one number of all photographs is moved
        at once, and 17 differences are enough for any number of them.
        """
        rows = np.arange(2 * len(self.seen))
        photo = np.repeat(self.photo_start + 6 * self.seen.photo, 2)
        panel = np.repeat(self.panel_columns()[self.seen.panel], 2)
        camera = np.arange(self.camera_size)
        moves = [(camera[offset : offset + 1], np.full(len(rows), offset), _STEPS[offset]) for offset in camera]
        for start, stop, column in ((self.photo_start, self.panel_start, photo), (self.panel_start, self.size, panel)):
            moves += [
                (np.arange(start + k, stop, 6), np.where(column < 0, -1, column + k), _POSE_STEP) for k in range(6)
            ]
        values, places = [], []
        for moved, column, step in moves:
            away = np.zeros(self.size)
            away[moved] = step
            slope = (self.residuals(x + away) - self.residuals(x - away)) / (2 * step)
            free = column >= 0
            values.append(slope[: len(rows)][free])
            places.append(np.stack([rows[free], column[free]]))
            if self.free_camera and column[0] in camera:  # what is usual of cameras depends on nothing else
                values.append(slope[len(rows) :])
                places.append(np.stack([len(rows) + np.arange(4), np.full(4, column[0])]))
        shape = (len(rows) + (4 if self.free_camera else 0), self.size)
        return csr_array((np.concatenate(values), np.concatenate(places, axis=1)), shape=shape)


@dataclass(frozen=True)
class Adjusted:
    """The answer in the frame of the problem's reference panel.

    Parameters
    ----------
    camera, photo_poses, panel_poses
        What fits best.
    errors_px
        Seen less predicted of all corners, those left out too, (N, 2).
    kept
        Which corners it was fitted to, (N,).
    jacobian
        Of the residuals in the unknowns, at the answer.
    problem
        What was solved, of the corners that were kept.
    sigma_px
        Standard deviation of one coordinate of a corner, from what is left over.
    left_out_by_photo, left_out_by_panel
        How many corners of each photograph (F,), and of each panel (P,), were left out.
    """

    camera: Intrinsics
    photo_poses: Floats
    panel_poses: Floats
    errors_px: Floats
    kept: NDArray[np.bool_]
    jacobian: csr_array
    problem: BundleAdjustment
    sigma_px: float
    left_out_by_photo: NDArray[np.int64]
    left_out_by_panel: NDArray[np.int64]


def adjust(problem: BundleAdjustment, photo_poses: Floats, panel_poses: Floats) -> Adjusted:
    """Fit everything; corners that nothing explains are found by a robust fit and left out of the last one."""
    x = problem.pack(photo_poses, panel_poses)
    for _ in range(_ROBUST_PASSES):
        # What is usual now, off as the first guess may be: smaller errors count in full, larger ones less and less.
        usual = float(np.median(_lengths(problem, x)))
        x = _solve(problem, x, max(2 * usual, _LEAST_SCALE_PX))
    apart = _lengths(problem, x)
    # The median of a length whose two coordinates are normal is 1.1774 standard deviations (Rayleigh).
    limit = max(_OUTLIER_SIGMAS * float(np.median(apart)) / 1.1774, _OUTLIER_PX)
    kept = apart <= limit
    last = replace(problem, seen=problem.seen.where(kept))
    x = _solve(last, x, math.inf)
    camera, photos, panels = last.unpack(x)
    freedom = 2 * len(last.seen) - last.size
    sigma = max(float(np.sqrt((last.residuals(x) ** 2).sum() / max(freedom, 1))), _LEAST_SIGMA_PX)
    errors = problem.seen.errors_px(camera, photos, panels)
    by_photo = np.bincount(problem.seen.photo[~kept], minlength=problem.photos)
    by_panel = np.bincount(problem.seen.panel[~kept], minlength=problem.panels)
    return Adjusted(camera, photos, panels, errors, kept, last.jacobian(x), last, sigma, by_photo, by_panel)


def _lengths(problem: BundleAdjustment, x: Floats) -> Floats:
    return np.asarray(np.linalg.norm(problem.seen.errors_px(*problem.unpack(x)), axis=1))


def _solve(problem: BundleAdjustment, x: Floats, scale_px: float) -> Floats:
    """Levenberg's and Marquardt's method (Marquardt 1963, J. SIAM 11), under Cauchy's loss by reweighting.

    Errors much beyond ``scale_px`` hardly count; an infinite one means plain least squares.
    """
    damping, residuals = _DAMPING, problem.residuals(x)
    cost = _cost(problem, residuals, scale_px)
    enough = _ENOUGH_ROBUST if math.isfinite(scale_px) else _ENOUGH
    for _ in range(_MOST_STEPS):
        jacobian = problem.jacobian(x)
        weights = _weights(problem, residuals, scale_px)
        weighted = jacobian.multiply(weights[:, None]).tocsc()
        normal, slope = (weighted.T @ jacobian).tocsc(), weighted.T @ residuals
        scale = diags_array(normal.diagonal() + 1e-12)
        before = cost
        while cost >= before and damping < _MOST_DAMPING:
            step = splu((normal + damping * scale).tocsc(), permc_spec="MMD_AT_PLUS_A").solve(-slope)
            tried = problem.residuals(x + step)
            cost = _cost(problem, tried, scale_px)
            damping = damping / 10 if cost < before else damping * 10
        if cost >= before:
            return x
        x, residuals = x + step, tried
        if before - cost < enough * before:
            return x
    return x


def _cost(problem: BundleAdjustment, residuals: Floats, scale_px: float) -> float:
    corners = 2 * len(problem.seen)
    lengths = residuals[:corners].reshape(-1, 2) ** 2
    squares = lengths.sum(axis=1)
    if math.isfinite(scale_px):
        squares = scale_px**2 * np.log1p(squares / scale_px**2)
    return float(squares.sum() + (residuals[corners:] ** 2).sum())


def _weights(problem: BundleAdjustment, residuals: Floats, scale_px: float) -> Floats:
    """Weights under which squares have the slope of the loss."""
    corners = 2 * len(problem.seen)
    squares = (residuals[:corners].reshape(-1, 2) ** 2).sum(axis=1)
    return np.concatenate([np.repeat(1 / (1 + squares / scale_px**2), 2), np.ones(len(residuals) - corners)])
