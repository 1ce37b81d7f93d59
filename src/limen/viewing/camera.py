"""A pinhole camera in the room: somebody who looks on, or, run backwards, a projector."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from limen.errors import InputError
from limen.geometry import Floats, Vec3, as_vec3, cross, length, normalised

__all__ = ["Camera"]

_MARGINS = np.array([0.9, 0.82])
"""Share of the width and height that a framing camera fills at most."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. A picture's corner is pixel (0, 0), the centre of its first pixel (0.5, 0.5), y points down.

    Parameters
    ----------
    eye_m
        Where it stands.
    target_m
        What it looks at: the place on its axis.
    size_px
        Width and height of its picture.
    fov_deg
        Vertical field of view that the picture would have if the axis went through its middle.
    up
        What is up in the picture.
    axis_px
        Where the axis meets the picture; None is the middle. A projector's is often below it.

    Raises
    ------
    InputError
        If it looks nowhere, or its picture has no size.
    """

    eye_m: Vec3
    target_m: Vec3
    size_px: tuple[int, int] = (1600, 900)
    fov_deg: float = 34.0
    up: Vec3 = (0.0, 1.0, 0.0)
    axis_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        try:
            self._check()
        except ValueError as error:
            raise InputError(f"camera: {error}") from None

    def _check(self) -> None:
        eye, target, up = (as_vec3(getattr(self, name), name) for name in ("eye_m", "target_m", "up"))
        forward = normalised((target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]), "the way to target_m")
        if length(cross(forward, normalised(up, "up"))) < 1e-6:
            raise ValueError("up must not lie along the way to target_m; give another")
        if min(self.size_px) < 1:
            raise ValueError(f"size_px must be from 1 pixel a side, got {list(self.size_px)}")
        if not 0 < self.fov_deg < 180:
            raise ValueError(f"fov_deg must lie between 0 and 180, got {self.fov_deg}")
        if self.axis_px is not None and not all(math.isfinite(value) for value in self.axis_px):
            raise ValueError(f"axis_px must be finite, got {self.axis_px}")

    @cached_property
    def axes(self) -> Floats:
        """Unit vectors to the right and down in the picture, and forward: shape (3, 3), one a row."""
        eye, target = self.eye_m, self.target_m
        forward = normalised((target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]), "the way to target_m")
        right = normalised(cross(forward, self.up), "right")
        return np.array([right, cross(forward, right), forward])

    @cached_property
    def focal_px(self) -> float:
        """Pixels per unit of the tangent of an angle from the axis."""
        return self.size_px[1] / 2 / math.tan(math.radians(self.fov_deg) / 2)

    @cached_property
    def middle_px(self) -> Floats:
        """Where the axis meets the picture, shape (2,)."""
        return np.array(self.axis_px or (self.size_px[0] / 2, self.size_px[1] / 2), dtype=float)

    def project(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Pixels (..., 2) and depth along the axis in metres (...) of room positions (..., 3).

        Positions less than a millimetre in front of the eye, or behind it, get pixels that mean nothing.
        """
        local = (np.asarray(points_m, dtype=float) - np.array(self.eye_m)) @ self.axes.T
        depth_m = local[..., 2]
        return self.middle_px + self.focal_px * local[..., :2] / np.maximum(depth_m, 1e-3)[..., None], depth_m

    def rays(self, places_px: Floats) -> Floats:
        """Directions (..., 3) in the room through places (..., 2) of the picture, one metre long along the axis."""
        across = (np.asarray(places_px, dtype=float) - self.middle_px) / self.focal_px
        return np.asarray(across @ self.axes[:2] + self.axes[2])

    def clip_rows(self, shift_px: tuple[float, float] = (0.0, 0.0)) -> Floats:
        """Linear forms of the way from the eye to a place: x, y and w of WebGPU's clip space, shape (3, 3).

        ``shift_px`` moves the places that pixels' centres look at; w is the depth along the axis.
        """
        right, down, forward = self.axes
        x, y = self.middle_px - np.array(shift_px)
        width, height = self.size_px
        return np.stack(
            [
                2 / width * (self.focal_px * right + x * forward) - forward,
                forward - 2 / height * (self.focal_px * down + y * forward),
                forward,
            ]
        )

    def sized(self, size_px: tuple[int, int]) -> Camera:
        """The same view as a picture of another size; the vertical field of view stays."""
        scale = [new / old for new, old in zip(size_px, self.size_px, strict=True)]
        axis = None if self.axis_px is None else (self.axis_px[0] * scale[0], self.axis_px[1] * scale[1])
        return replace(self, size_px=size_px, axis_px=axis)

    @classmethod
    def framing(cls, points_m: Floats, toward: Floats, size_px: tuple[int, int], fov_deg: float = 34.0) -> Camera:
        """The nearest camera that sees all points (N, 3) from the direction ``toward`` (3,), with a margin."""
        toward = np.asarray(toward, dtype=float) / np.linalg.norm(toward)
        aim = cls(_vec(toward), (0.0, 0.0, 0.0), size_px, fov_deg)
        local = np.asarray(points_m, dtype=float) @ aim.axes.T
        # A point at (x, z) lies between the left and right side of a pyramid of slope t with its tip at (a, c) where
        # |x - a| <= t (z - c). The tip nearest to the points for which that holds of all, and the same upright:
        slope = np.array(size_px) * _MARGINS / 2 / aim.focal_px
        high = (local[:, :2] - slope * local[:, 2:]).max(axis=0)
        low = (-local[:, :2] - slope * local[:, 2:]).max(axis=0)
        nearest = local[:, 2].min() - 1e-3 - 0.01 * float(np.ptp(local, axis=0).max())
        back = min(float((-(high + low) / 2 / slope).min()), nearest)
        eye = np.array([*(high - low) / 2, back]) @ aim.axes
        return cls(_vec(eye), _vec(eye - toward), size_px, fov_deg)


def _vec(values: Floats) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
