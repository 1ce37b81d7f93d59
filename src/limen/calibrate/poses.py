"""Rigid motions as rotation vectors and translations, and the panels' place among them.

A pose is a row ``(rx, ry, rz, tx, ty, tz)``: rotation vector in radians (axis times angle), then metres. It takes
``x`` to ``R x + t``. A panel's pose takes its own frame (x along rows, y along columns, z away from the viewers, from
the outer corner of the first pixel) to the room's; a photograph's takes the room's frame to the camera's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from limen.display.panel import Panel
from limen.geometry import Floats, as_vec3

__all__ = ["IDENTITY", "apply", "compose", "fit", "inverse", "of_panel", "panel_at", "turn_deg"]

IDENTITY = np.zeros(6)


def apply(pose: Floats, points_m: Floats) -> Floats:
    """Points (N, 3) moved by one pose (6,), or each by its own (N, 6)."""
    return np.asarray(Rotation.from_rotvec(pose[..., :3]).apply(points_m) + pose[..., 3:])


def compose(after: Floats, first: Floats) -> Floats:
    """The pose that does ``first`` and then ``after``: each one (6,) or many (N, 6)."""
    turn = Rotation.from_rotvec(after[..., :3])
    rotation = (turn * Rotation.from_rotvec(first[..., :3])).as_rotvec()
    return np.concatenate([rotation, turn.apply(first[..., 3:]) + after[..., 3:]], axis=-1)


def inverse(pose: Floats) -> Floats:
    """The pose that undoes this one: (6,) or (N, 6)."""
    back = Rotation.from_rotvec(-pose[..., :3])
    return np.concatenate([back.as_rotvec(), -back.apply(pose[..., 3:])], axis=-1)


def turn_deg(pose: Floats) -> Floats:
    """Angle of the rotation, 0 to 180 degrees: of (6,) a scalar, of (N, 6) an array."""
    return np.degrees(Rotation.from_rotvec(pose[..., :3]).magnitude())


def fit(from_m: Floats, to_m: Floats) -> Floats:
    """The pose (6,) that brings points (N, 3) closest to others (N, 3), in the sense of least squares.

    Kabsch 1976, *A solution for the best rotation to relate two sets of vectors*, Acta Crystallographica A32.

    Raises
    ------
    ValueError
        If there are fewer than three points.
    """
    if len(from_m) < 3 or from_m.shape != to_m.shape:
        raise ValueError(f"a rigid fit needs at least three pairs of points, got {from_m.shape} and {to_m.shape}")
    middle_from, middle_to = from_m.mean(axis=0), to_m.mean(axis=0)
    turn, _ = Rotation.align_vectors(to_m - middle_to, from_m - middle_from)
    return np.concatenate([turn.as_rotvec(), middle_to - turn.apply(middle_from)])


def of_panel(panel: Panel) -> Floats:
    """The pose (6,) of a panel in the room."""
    away = -np.array(panel.normal)
    axes = np.stack([panel.right, panel.down, away], axis=1)
    return np.concatenate([Rotation.from_matrix(axes).as_rotvec(), panel.origin_m])


def panel_at(panel: Panel, pose: Floats) -> Panel:
    """The same panel hung at a pose (6,) in the room."""
    axes = Rotation.from_rotvec(pose[:3]).as_matrix()
    return replace(
        panel,
        origin_m=as_vec3(pose[3:], "origin"),
        right=as_vec3(axes[:, 0], "right"),
        down=as_vec3(axes[:, 1], "down"),
    )
