"""The camera that took the photographs: a pinhole with a lens that bends straight lines."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import tomli_w

from limen.errors import FormatError, MissingFileError
from limen.geometry import Floats

__all__ = ["Intrinsics"]


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Intrinsics of one camera at one zoom; the centre of a photograph's first pixel is (0, 0), as in OpenCV.

    Parameters
    ----------
    size_px
        Width and height of its photographs.
    focal_px
        Focal length in pixels, along rows and along columns.
    centre_px
        The principal point.
    distortion
        ``k1, k2, p1, p2, k3`` of Brown 1971, in OpenCV's order: radial, radial, tangential (two), radial.

    Raises
    ------
    ValueError
        If a number is not finite, or a length not positive.
    """

    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        numbers = (*self.focal_px, *self.centre_px, *self.distortion)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError("focal_px, centre_px and distortion must be finite numbers")
        if min(self.focal_px) <= 0 or min(self.size_px) < 1:
            raise ValueError(f"focal_px and size_px must be positive, got {self.focal_px} and {self.size_px}")

    @property
    def matrix(self) -> Floats:
        """The camera matrix, (3, 3)."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    def project(self, points_m: Floats) -> Floats:
        """Pixels (..., 2) of positions (..., 3) in the camera's frame: x right, y down, z forward.

        Brown 1971, *Close-range camera calibration*, Photogrammetric Engineering 37(8), as OpenCV writes it.
        Positions at or behind the camera's plane land far outside.

        >>> Intrinsics((640, 480), (500, 500), (320, 240), (-0.1, 0, 0, 0, 0)).project(np.array([0.5, 0, 1.0]))[0]
        np.float64(563.75)
        """
        k1, k2, p1, p2, k3 = self.distortion
        depth = np.maximum(points_m[..., 2], 1e-6)
        x, y = points_m[..., 0] / depth, points_m[..., 1] / depth
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack(
            [self.focal_px[0] * bent_x + self.centre_px[0], self.focal_px[1] * bent_y + self.centre_px[1]], axis=-1
        )

    @classmethod
    def load(cls, path: str | Path) -> Intrinsics:
        """Read a camera file (TOML), as `to_toml` writes it.

        Raises
        ------
        MissingFileError
            If there is no such file.
        FormatError
            If it is not TOML, or a field is missing, unknown or wrong; the message names the field.
        """
        try:
            file = msgspec.convert(tomllib.loads(Path(path).read_text(encoding="utf-8")), _CameraFile)
            return cls(file.size_px, file.focal_px, file.centre_px, file.distortion)
        except FileNotFoundError:
            raise MissingFileError(f"{path}: no such camera file") from None
        except (OSError, UnicodeDecodeError) as error:
            raise FormatError(f"{path}: cannot be read as a text file: {error}") from None
        except tomllib.TOMLDecodeError as error:
            raise FormatError(f"{path}: not valid TOML: {error}") from None
        except ValueError as error:
            raise FormatError(f"{path}: {error}; `limen calibrate solve --save-camera` writes such a file") from None

    def to_toml(self) -> str:
        """The camera as a file that `load` reads back."""
        return tomli_w.dumps(
            msgspec.to_builtins(_CameraFile(self.size_px, self.focal_px, self.centre_px, self.distortion))
        )


class _CameraFile(msgspec.Struct, forbid_unknown_fields=True):
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
