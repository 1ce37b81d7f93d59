"""From the numbers of a picture to the light of a display: cd/m2 for RGB."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares

from limen.errors import FormatError, InputError
from limen.geometry import Floats
from limen.vision.calibration import read_table

__all__ = ["Photometry"]

_CHANNELS = ("red", "green", "blue")
_SHARES = np.array([0.2126, 0.7152, 0.0722])
"""Of white's luminance, for the primaries of sRGB (IEC 61966-2-1)."""

_NOISE = 0.01
"""Of a channel's largest reading: readings may fall, and blacks may differ, by so much."""

_WIDEST_GAP = 64
_FEWEST = 5
_EXAMPLE = "channel,code,cd_m2 first and then lines like red,128,9.31"


@dataclass(frozen=True)
class Photometry:
    """How much light a panel sends to the eye for each RGB code.

    The channels add up: ``dark + red(r) + green(g) + blue(b)``.

    Parameters
    ----------
    channels_cd_m2
        What each channel adds at the codes 0 ... 255, shape (3, 256); 0 at code 0, and never falling.
    dark_cd_m2
        Of a black picture: what the panel leaks, and what it reflects of the room.

    Raises
    ------
    InputError
        If a luminance is negative, not finite or falls from one code to the next.
    """

    channels_cd_m2: Floats
    dark_cd_m2: float = 0.0

    def __post_init__(self) -> None:
        table = np.asarray(self.channels_cd_m2, dtype=float)
        object.__setattr__(self, "channels_cd_m2", table)
        if table.shape != (3, 256) or not np.isfinite(table).all() or (table[:, 0] != 0).any():
            raise InputError(f"channels_cd_m2 must be finite, of shape (3, 256), and 0 at code 0; got {table.shape}")
        if (np.diff(table, axis=1) < 0).any():
            raise InputError("channels_cd_m2 must not fall from one code to the next")
        if not (np.isfinite(self.dark_cd_m2) and self.dark_cd_m2 >= 0):
            raise InputError(f"dark_cd_m2 must be finite and not negative, got {self.dark_cd_m2}")

    @classmethod
    def srgb(cls, peak_cd_m2: float = 100.0, black_cd_m2: float = 0.0, ambient_cd_m2: float = 0.0) -> Photometry:
        """A display that follows sRGB (IEC 61966-2-1).

        Parameters
        ----------
        peak_cd_m2
            The panel's own white, in a dark room.
        black_cd_m2
            The panel's own black, in a dark room; less than its white.
        ambient_cd_m2
            Light of the room that the panel reflects: ``illuminance_lux x reflectance / pi`` of a matt surface.

        Raises
        ------
        InputError
            If a luminance is negative or not finite, or black is not darker than white.

        >>> grey = Photometry.srgb(peak_cd_m2=300, black_cd_m2=0.3).luminance_cd_m2([[0, 0, 0], [128] * 3, [255] * 3])
        >>> grey.round(2).tolist()
        [0.3, 64.99, 300.0]
        """
        for name, value in (("peak", peak_cd_m2), ("black", black_cd_m2), ("ambient", ambient_cd_m2)):
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name}_cd_m2 must be finite and not negative, got {value}")
        if black_cd_m2 >= peak_cd_m2:
            raise InputError(f"black_cd_m2 ({black_cd_m2:g}) must lie below peak_cd_m2 ({peak_cd_m2:g})")
        code = np.arange(256) / 255
        light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
        return cls((peak_cd_m2 - black_cd_m2) * _SHARES[:, None] * light, black_cd_m2 + ambient_cd_m2)

    @classmethod
    def load(
        cls,
        path: str | Path,
        fit: Literal["spline", "gain-offset-gamma"] = "spline",
        ambient_cd_m2: float = 0.0,
    ) -> Photometry:
        """A display as a photometer saw it: CSV with the columns ``channel,code,cd_m2``; ``#`` begins a comment.

        Channels are ``red``, ``green`` and ``blue``, each shown alone over black at codes from 0 to 255.

        Parameters
        ----------
        fit
            ``spline``: monotone cubic (Fritsch, Carlson 1980) through the readings, at most 64 codes apart.
            ``gain-offset-gamma``: ``(gain code / 255 + offset)^gamma`` of each channel (Berns 1996), for few readings.
        ambient_cd_m2
            Added everywhere: what the panel reflects where it hangs, if it was measured in the dark.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FormatError
            If it is not such a table, has holes, or falls by more than 1 % of the channel's largest reading; the
            message names file, line and channel, and what to do.
        """
        path = Path(path)
        if fit not in ("spline", "gain-offset-gamma"):
            raise InputError(f"the fit is spline or gain-offset-gamma, not '{fit}'")
        if not (np.isfinite(ambient_cd_m2) and ambient_cd_m2 >= 0):
            raise InputError(f"ambient_cd_m2 must be finite and not negative, got {ambient_cd_m2}")
        readings = [_checked_readings(path, name, rows, fit) for name, rows in _readings(path).items()]
        blacks = [light[0] for _, light in readings]
        black, noise = float(np.mean(blacks)), _NOISE * max(light[-1] for _, light in readings)
        if max(blacks) - min(blacks) > noise:
            raise FormatError(
                f"{path}: black (code 0) is {min(blacks):g} to {max(blacks):g} cd/m2; measure each channel over black"
            )
        curve = _spline if fit == "spline" else _gain_offset_gamma
        return cls(np.array([curve(code, light - light[0]) for code, light in readings]), black + ambient_cd_m2)

    @property
    def white_cd_m2(self) -> float:
        """What a panel's ``luminance_cd_m2`` is to be."""
        return float(self.dark_cd_m2 + self.channels_cd_m2[:, -1].sum())

    def luminance_cd_m2(self, rgb: ArrayLike) -> Floats:
        """Light for codes 0 ... 255: (..., 3) to (...) cd/m2.

        Raises
        ------
        InputError
            If the codes are not whole numbers from 0 to 255, three in the last axis.
        """
        codes = np.asarray(rgb)
        if codes.shape[-1:] != (3,) or codes.dtype.kind not in "iu":
            raise InputError(f"rgb must be whole numbers of shape (..., 3), got {codes.dtype} {codes.shape}")
        if codes.size and (codes.min() < 0 or codes.max() > 255):
            raise InputError(f"rgb must lie in 0 ... 255, got {codes.min()} ... {codes.max()}")
        red, green, blue = (self.channels_cd_m2[n][codes[..., n]] for n in range(3))
        return np.asarray(self.dark_cd_m2 + red + green + blue)


_Rows = list[tuple[int, int, float]]  # line, code, cd/m2


def _readings(path: Path) -> dict[str, _Rows]:
    """The readings of each channel, in the order of codes."""
    lines, cells = read_table(path, f"it should hold {_EXAMPLE}")
    if cells[0] != ["channel", "code", "cd_m2"]:
        raise FormatError(f"{path}:{lines[0]}: not a table of readings; it should hold {_EXAMPLE}")
    found: dict[str, _Rows] = {name: [] for name in _CHANNELS}
    for line, row in zip(lines[1:], cells[1:], strict=True):
        if len(row) != 3:
            raise FormatError(f"{path}:{line}: {len(row)} cells for 3 columns; it should hold {_EXAMPLE}")
        if row[0] not in found:
            raise FormatError(f"{path}:{line}: channel is '{row[0]}'; there are {', '.join(_CHANNELS)}")
        found[row[0]].append((line, _code(path, line, row[1]), _reading(path, line, row[2])))
    return {name: sorted(rows, key=lambda row: row[1]) for name, rows in found.items()}


def _code(path: Path, line: int, cell: str) -> int:
    if not cell.isdecimal() or int(cell) > 255:
        raise FormatError(f"{path}:{line}: code is '{cell}'; it must be a whole number from 0 to 255")
    return int(cell)


def _reading(path: Path, line: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise FormatError(f"{path}:{line}: cd_m2 is '{cell}', which is not a number; measure it again") from None
    if not (np.isfinite(value) and value >= 0):
        raise FormatError(f"{path}:{line}: cd_m2 is '{cell}'; it must be finite and not negative: measure it again")
    return value


def _checked_readings(path: Path, name: str, rows: _Rows, fit: str) -> tuple[NDArray[np.int64], Floats]:
    """Codes and luminances of a channel, smoothed to rise where noise let them fall."""
    code = np.array([row[1] for row in rows], np.int64)
    light = np.array([row[2] for row in rows], dtype=float)
    if len(rows) < _FEWEST or code[0] != 0 or code[-1] != 255:
        raise FormatError(
            f"{path}: channel {name} has {len(rows)} readings; measure at least {_FEWEST}, codes 0 and 255 among them"
        )
    step = np.diff(code)
    if not step.all():
        raise FormatError(
            f"{path}:{rows[int((step == 0).argmax()) + 1][0]}: channel {name} has two readings of one code"
        )
    if fit == "spline" and step.max() > _WIDEST_GAP:
        gap = int(step.argmax())
        raise FormatError(
            f"{path}:{rows[gap][0]}: channel {name} has no reading between the codes {code[gap]} and {code[gap + 1]}; "
            "measure one there, or fit gain-offset-gamma"
        )
    fall = np.maximum.accumulate(light) - light
    if light[-1] <= light[0] or fall.max() > _NOISE * light.max():
        worst = int(fall.argmax()) if light[-1] > light[0] else len(rows) - 1
        raise FormatError(
            f"{path}:{rows[worst][0]}: channel {name} falls to {light[worst]:g} cd/m2 at code {code[worst]}; "
            "let the display warm up, and measure it again"
        )
    # Midway between the smallest rising curve above and the largest below.
    return code, (np.maximum.accumulate(light) + np.minimum.accumulate(light[::-1])[::-1]) / 2


def _spline(code: NDArray[np.int64], light: Floats) -> Floats:
    curve = np.asarray(PchipInterpolator(code, light)(np.arange(256)), dtype=float)
    return np.asarray(np.maximum.accumulate(np.maximum(curve, 0.0)))  # rounding may fall by 1e-16


def _gain_offset_gamma(code: NDArray[np.int64], light: Floats) -> Floats:
    """``most (g d + 1 - g)^gamma`` for ``d = code / 255``, 0 where the bracket is negative, less its value at 0."""

    def curve(parameters: Floats, place: Floats) -> Floats:
        most, gain, gamma = parameters
        bright = np.maximum(gain * place + 1 - gain, 0.0) ** gamma - max(1 - gain, 0.0) ** gamma
        return np.asarray(most * bright)

    def miss(parameters: Floats) -> Floats:
        return np.asarray(curve(parameters, code / 255) - light / size)

    size = light[-1]
    fitted = least_squares(miss, x0=(1.0, 1.0, 2.2), bounds=((0.5, 0.5, 0.5), (2.0, 1.5, 5.0))).x
    return np.asarray(np.maximum.accumulate(size * curve(fitted, np.arange(256) / 255)))
