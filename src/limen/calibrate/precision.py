"""How well the panels' poses are known, from what is left over and how the answer depends on it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_array, csr_array

from limen.calibrate.adjust import Adjusted
from limen.calibrate.poses import apply, compose, inverse
from limen.geometry import Floats

__all__ = ["Precision", "precision"]

_STEP = 1e-5


class Precision(NamedTuple):
    """Standard deviations: root of the sum of the variances along, or about, three axes."""

    position_m: Floats  # (P,), of the panels' centres
    angle_deg: Floats  # (P,)
    focal_share: float  # of the focal length; 0 for a camera that was given, infinite if nothing tells


def precision(found: Adjusted, corners_m: Floats, anchors: Floats) -> Precision:
    """Standard deviations in the frame that anchors define.

    Parameters
    ----------
    found
        The adjustment.
    corners_m
        Corners of the panels in their own frames, (P, 4, 3).
    anchors
        1 for panels whose corners, fitted to their nominal places, define the frame, else 0: (P,). An anchor's own
        deviation is what the others leave to it; a panel that is the only anchor has none.
    """
    camera_size, panels = found.problem.camera_size, found.problem.panels
    covariance = found.sigma_px**2 * np.linalg.inv(_reduced(found))
    focal_variance = float(covariance[0, 0]) if camera_size else 0.0
    # Below zero: what was seen leaves the focal length so open that the inverse is rounding alone.
    focal = math.sqrt(focal_variance) / found.camera.focal_px[0] if focal_variance >= 0 else math.inf
    whole = np.zeros((6 * panels, 6 * panels))
    free = np.repeat(np.arange(panels) != found.problem.reference, 6)
    whole[np.ix_(free, free)] = covariance[camera_size:, camera_size:]
    poses = found.panel_poses
    room = np.stack([apply(pose, corners) for pose, corners in zip(poses, corners_m, strict=True)])
    centres = room.mean(axis=1)
    local = _block_diagonal(_motions(poses, centres))
    frame = _frame_change(room, centres, anchors)
    change = frame @ local
    variances = np.diag(change @ whole @ change.T).reshape(-1, 2, 3).sum(axis=2)
    deviations = np.sqrt(np.maximum(variances, 0))
    return Precision(deviations[:, 0], np.degrees(deviations[:, 1]), focal)


def _reduced(found: Adjusted) -> Floats:
    """The normal matrix of camera and panels, with the photographs' poses eliminated (Schur's complement)."""
    start, stop = found.problem.photo_start, found.problem.panel_start
    jacobian = found.jacobian.tocsc()
    photos = csr_array(jacobian[:, start:stop])
    others = csr_array(jacobian[:, np.r_[0:start, stop : found.problem.size]])
    # A corner is in one photograph, so theirs is a matrix of 6 x 6 blocks along the diagonal.
    blocks = (photos.T @ photos).toarray().reshape(found.problem.photos, 6, found.problem.photos, 6)
    each = np.arange(found.problem.photos)
    inverses = np.linalg.inv(blocks[each, :, each, :] + 1e-9 * np.eye(6))
    middle = bsr_array((inverses, each, np.arange(len(each) + 1)))
    mixed = (photos.T @ others).tocsr()
    return np.asarray((others.T @ others - mixed.T @ (middle @ mixed)).toarray())


def _motions(poses: Floats, centres: Floats) -> Floats:
    """How the numbers of each pose move its panel's centre and turn it, in the common frame: (P, 6, 6)."""
    columns = []
    for number in range(6):
        step = np.zeros(6)
        step[number] = _STEP
        motion = compose(poses + step, inverse(poses - step))
        moved = apply(motion, centres) - centres
        columns.append(np.concatenate([moved, motion[:, :3]], axis=1) / (2 * _STEP))
    return np.stack(columns, axis=2)


def _frame_change(room: Floats, centres: Floats, anchors: Floats) -> Floats:
    """Takes small motions (6 P,) in any frame to those in the frame that is fitted to the anchors' corners.

    What is taken off is the motion of everything as one body that fits the anchors' corners best: the weighted
    projection of Triggs et al. 2000, equation 53.
    """
    body = np.concatenate([np.concatenate([np.eye(3), -_cross(c)], axis=1) for c in centres], axis=0)
    body = body.reshape(-1, 3, 6)
    turns = np.broadcast_to(np.concatenate([np.zeros((3, 3)), np.eye(3)], axis=1), body.shape)
    as_one = np.concatenate([body, turns], axis=1).reshape(-1, 6)
    weights = np.zeros((len(centres), 6, 6))
    for number, (corners, centre) in enumerate(zip(room, centres, strict=True)):
        to_corners = np.concatenate([np.concatenate([np.eye(3), -_cross(c - centre)], axis=1) for c in corners])
        weights[number] = anchors[number] * to_corners.T @ to_corners
    weighted = as_one.T @ _block_diagonal(weights)
    return np.asarray(np.eye(len(as_one)) - as_one @ np.linalg.solve(weighted @ as_one, weighted))


def _block_diagonal(blocks: Floats) -> Floats:
    count = len(blocks)
    whole = np.zeros((count, 6, count, 6))
    whole[np.arange(count), :, np.arange(count), :] = blocks
    return whole.reshape(6 * count, 6 * count)


def _cross(v: Floats) -> Floats:
    """The matrix that takes ``x`` to ``v x x``."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
