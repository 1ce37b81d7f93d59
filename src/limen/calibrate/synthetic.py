"""Synthetic photographs of a display whose every pixel is known: rays of a camera meet panels that show pictures.

They have the lens's distortion, the blur of optics and sensor, noise, and panels that hide each other. Light is added
up linearly, and written as sRGB.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from limen.calibrate.camera import Intrinsics
from limen.calibrate.opencv import load
from limen.data.store.resample import LINEAR_OF_SRGB, srgb_of_linear
from limen.display.display import Display
from limen.display.panel import Panel
from limen.geometry import Floats

__all__ = ["Photographer"]

Singles: TypeAlias = NDArray[np.float32]

_BACKGROUND, _BACK = 0.1, 0.01
"""Light of the room and of panels seen from behind; white is 1."""

_NEAREST_M = 0.05
_CORRECTIONS = 40
_MARGIN_PX = 3
_KNOT = 8


@dataclass(frozen=True)
class Photographer:
    """Takes photographs with one camera.

    Parameters
    ----------
    camera
        Its intrinsics.
    blur_px, noise
        Standard deviations of a Gaussian blur, in pixels, and of noise, in grey levels (0 to 255).
    oversampling
        Rays a pixel along each side.
    """

    camera: Intrinsics
    blur_px: float = 0.5
    noise: float = 2.0
    oversampling: int = 3

    @cached_property
    def _rays(self) -> Singles:
        """Directions (x / z, y / z) of all rays, (height, width, 2): the same for every photograph."""
        # The centre of pixel i is at i, so its rays stand at (j + 0.5) / n - 0.5.
        x, y = ((np.arange(side * self.oversampling) + 0.5) / self.oversampling - 0.5 for side in self.camera.size_px)
        # What a lens does is smooth: lines between every eighth ray are right to 0.002 pixels.
        across, down = _knots(x), _knots(y)
        places = np.stack(np.meshgrid(across, down), axis=-1)
        focal, centre = np.array(self.camera.focal_px), np.array(self.camera.centre_px)
        rays = (places - centre) / focal
        for _ in range(_CORRECTIONS):
            rays += (
                places - self.camera.project(np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2))
            ) / focal
        to_rows, to_columns = _lines(y, down), _lines(x, across)
        return np.stack([to_rows @ rays[..., axis] @ to_columns.T for axis in (0, 1)], axis=-1).astype(np.float32)

    def photograph(
        self, display: Display, pictures: Mapping[str, NDArray[np.uint8]], pose: Floats, seed: int = 0
    ) -> NDArray[np.uint8]:
        """One photograph, uint8 (height, width), of what panels show: uint8 (h, w) by panel name.

        Parameters
        ----------
        pose
            Takes the room's frame to the camera's (6,), see `limen.calibrate.poses`.
        seed
            Of the noise.
        """
        cv2, n = load(), self.oversampling
        seen = np.full(self._rays.shape[:2], _BACKGROUND, dtype=np.float32)
        nearest = np.full(self._rays.shape[:2], np.inf, dtype=np.float32)
        for panel in display.panels:
            self._draw(panel, pictures.get(panel.name), pose, seen, nearest)
        width, height = self.camera.size_px
        photo = cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA) if n > 1 else seen
        if self.blur_px > 0:
            photo = cv2.GaussianBlur(photo, (0, 0), self.blur_px)
        photo = 255 * srgb_of_linear(np.asarray(photo, dtype=float)) + np.random.default_rng(seed).normal(
            0, self.noise, photo.shape
        )
        return np.asarray(np.clip(np.rint(photo), 0, 255), dtype=np.uint8)

    def _draw(
        self, panel: Panel, picture: NDArray[np.uint8] | None, pose: Floats, seen: Singles, nearest: Singles
    ) -> None:
        """One panel over what is there, where it is nearer."""
        turn = Rotation.from_rotvec(pose[:3]).as_matrix()
        corners = panel.corners_m @ turn.T + pose[3:]
        if corners[:, 2].min() < _NEAREST_M:
            return
        box = _box(corners, self.camera, self.oversampling)
        right, down = (turn @ np.array(axis) for axis in (panel.right, panel.down))
        # A ray d meets the panel where d t = u right + v down + corner; this matrix takes d to (u, v, 1) / t.
        frame = np.stack([right * panel.pitch_m[0], down * panel.pitch_m[1], corners[0]], axis=1)
        x, y = np.moveaxis(self._rays[box], -1, 0)
        u, v, w = (row[0] * x + row[1] * y + row[2] for row in np.linalg.inv(frame).astype(np.float32))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            u, v, depth = u / w, v / w, 1 / w
        hit = (depth > 0) & (depth < nearest[box]) & _inside(panel, u, v)
        if not hit.any():
            return
        faces = float(np.dot(np.cross(down, right), corners.mean(axis=0))) < 0
        lit = picture is not None and faces
        seen[box][hit] = _sample(picture, u, v, hit)[hit] if picture is not None and lit else _BACK
        nearest[box][hit] = depth[hit]


def _box(corners_m: Floats, camera: Intrinsics, oversampling: int) -> tuple[slice, slice]:
    """Rows and columns of the rays that can meet a panel with these corners in the camera's frame."""
    share = np.linspace(0, 1, 16, endpoint=False)[:, None, None]
    edges = corners_m + share * (np.roll(corners_m, -1, axis=0) - corners_m)
    places = camera.project(edges).reshape(-1, 2)
    low = np.floor(np.maximum(places.min(axis=0) - _MARGIN_PX, 0)).astype(int) * oversampling
    high = np.ceil(np.maximum(places.max(axis=0) + _MARGIN_PX, 0)).astype(int) * oversampling
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _inside(panel: Panel, u: Singles, v: Singles) -> NDArray[np.bool_]:
    """Whether places on the pixel grid lie on the panel, within its outline."""
    width, height = panel.size_px
    inside = (u >= 0) & (v >= 0) & (u <= width) & (v <= height)
    if panel.outline_px:
        corners = np.array(panel.outline_px)
        along = np.roll(corners, -1, axis=0) - corners
        sides = [a[0] * (v - c[1]) - a[1] * (u - c[0]) for a, c in zip(along, corners, strict=True)]
        inside &= np.logical_and.reduce([s >= 0 for s in sides]) | np.logical_and.reduce([s <= 0 for s in sides])
    return inside


def _sample(picture: NDArray[np.uint8], u: Singles, v: Singles, hit: NDArray[np.bool_]) -> Singles:
    """The picture at places on the pixel grid, averaged over about what a ray stands for."""
    cv2 = load()
    height, width = picture.shape[:2]
    # Along rows and along columns by themselves: a panel seen at an angle is small in one direction only.
    steps = [np.hypot(_slope(place, hit, 0), _slope(place, hit, 1)) for place in (u, v)]
    size = (max(1, round(width / max(steps[0], 1))), max(1, round(height / max(steps[1], 1))))
    small = cv2.resize(LINEAR_OF_SRGB[picture], size, interpolation=cv2.INTER_AREA)
    x, y = u * np.float32(size[0] / width) - 0.5, v * np.float32(size[1] / height) - 0.5
    return np.asarray(cv2.remap(small, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _slope(place: Singles, hit: NDArray[np.bool_], axis: int) -> float:
    """Usual change of a place on the panel from one ray to the next."""
    chosen = hit[:, 1:] if axis else hit[1:]
    steps = np.abs(np.diff(place, axis=axis))[chosen]
    return float(np.median(steps)) if steps.size else 0.0


def _knots(places: Floats) -> Floats:
    """Every eighth of evenly spaced places, and one beyond the last."""
    step = (places[1] - places[0]) * _KNOT
    return np.asarray(places[0] + step * np.arange(len(places) // _KNOT + 2))


def _lines(places: Floats, knots: Floats) -> Floats:
    """Linear interpolation from knots to places as a matrix, (places, knots)."""
    return np.asarray(np.maximum(1 - np.abs(places[:, None] - knots) / (knots[1] - knots[0]), 0))
