"""How a terrain looks: colours, sun, contour lines, and the tints that tell panels apart. No GPU here.

References
----------
Imhof 1965, *Kartographische Geländedarstellung* (light from the north-west; hypsometric tints under a shaded relief).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limen.data.store.resample import linear_of_srgb
from limen.errors import InputError
from limen.geometry import Floats

__all__ = [
    "COLOURS",
    "SEA",
    "STOPS",
    "Colours",
    "TerrainLook",
    "contour_interval_m",
    "hypsometric_ramp",
    "panel_tints",
    "toward_sun",
]

Colours: TypeAlias = Literal["hypsometric", "plain", "drape"]
COLOURS: tuple[Colours, ...] = get_args(Colours)

STOPS = (
    "acd0a5", "94bf8b", "a8c68f", "bdcc96", "d1d7ab", "e1e4b5", "efebc0", "e8e1b6", "ded6a3", "d3ca9d", "cab982",
    "c3a76b", "b9985a", "aa8753", "ac9a7c", "baae9a", "cac3b8", "e0ded8", "f5f4f2",
)  # fmt: skip
"""sRGB of lowland to peaks, in equal steps of height: Wikipedia's convention for topographic maps."""

SEA = "96c9f0"
"""sRGB of what lies at or below the level of the sea, of the same convention."""

_CLASS_COLOURS = ("707070", "4a7dff", "35c759", "ff9500")
"""sRGB of panels outside, in the periphery, in the focus, selected."""
_TINT_SHARE = 0.45
_LEAST_BRIGHTNESS = 0.25
_LINES = 25
"""About how many contour lines an automatic interval leaves between the lowest and the highest post."""


@dataclass(frozen=True, slots=True)
class TerrainLook:
    """How a terrain is coloured and lit.

    Parameters
    ----------
    colours
        ``hypsometric``: tints by height. ``plain``: one light grey. ``drape``: the image that lies over the terrain.
    azimuth_deg, altitude_deg
        Where the sun stands: clockwise from north, and above the horizon. Maps are lit from the north-west.
    ambient
        Share of the light that comes from everywhere: 0 ... 1.
    contour_interval_m
        Height between contour lines, of which every fifth is stronger; 0 draws none, ``auto`` see `contour_interval_m`.
    tint_range_m
        Heights of the first and the last hypsometric tint; ``None``: the lowest (or the sea) and the highest post.
    sea_level_m
        What is not higher has the colour of water; ``None``: nothing is sea, for land below the sea's level exists.

    Raises
    ------
    InputError
        For numbers that cannot be.
    """

    colours: Colours = "hypsometric"
    azimuth_deg: float = 315.0
    altitude_deg: float = 45.0
    ambient: float = 0.25
    contour_interval_m: float | Literal["auto"] = 0.0
    tint_range_m: tuple[float, float] | None = None
    sea_level_m: float | None = None

    def __post_init__(self) -> None:
        if self.colours not in COLOURS:
            raise InputError(f"no colours are named '{self.colours}': there are {', '.join(COLOURS)}")
        if not math.isfinite(self.azimuth_deg):
            raise InputError(f"azimuth_deg must be finite, got {self.azimuth_deg}")
        if not 0 <= self.altitude_deg <= 90:
            raise InputError(f"altitude_deg must be from 0 (horizon) to 90 (overhead), got {self.altitude_deg}")
        if not 0 <= self.ambient <= 1:
            raise InputError(f"ambient must be a share from 0 to 1, got {self.ambient}")
        interval = self.contour_interval_m
        if not (interval == "auto" or (isinstance(interval, int | float) and 0 <= interval < math.inf)):
            raise InputError(f"contour_interval_m must be metres, 0 for none, or 'auto', got {interval!r}")
        if self.tint_range_m is not None and not -math.inf < self.tint_range_m[0] < self.tint_range_m[1] < math.inf:
            raise InputError(f"tint_range_m must be two heights, the lower first, got {self.tint_range_m}")
        if self.sea_level_m is not None and not math.isfinite(self.sea_level_m):
            raise InputError(f"sea_level_m must be finite, or None, got {self.sea_level_m}")


def toward_sun(look: TerrainLook) -> Floats:
    """Unit vector toward the sun, (east, north, up).

    >>> toward_sun(TerrainLook(azimuth_deg=90, altitude_deg=0)).round(6) + 0.0
    array([1., 0., 0.])
    """
    azimuth, altitude = math.radians(look.azimuth_deg), math.radians(look.altitude_deg)
    level = math.cos(altitude)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude)])


def contour_interval_m(look: TerrainLook, low_m: float, high_m: float) -> float:
    """Metres between contour lines: the round number (1, 2 or 5 times a power of ten) that leaves about 25 of them.

    >>> contour_interval_m(TerrainLook(contour_interval_m="auto"), -86, 4418)
    200.0
    """
    if look.contour_interval_m != "auto":
        return look.contour_interval_m
    wished = (high_m - low_m) / _LINES
    if wished <= 0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(wished))
    return min((power * factor for factor in (1, 2, 5, 10)), key=lambda interval: abs(math.log(interval / wished)))


def tint_range_m(look: TerrainLook, low_m: float, high_m: float) -> tuple[float, float]:
    """Heights of the first and the last tint; the last is the higher one, on a plain too."""
    if look.tint_range_m is not None:
        return look.tint_range_m
    first = low_m if look.sea_level_m is None else max(low_m, look.sea_level_m)
    return first, max(high_m, first + 1.0)


def hypsometric_ramp() -> Floats:
    """Linear light of `STOPS`, shape (19, 3)."""
    return np.array([_light(stop) for stop in STOPS])


def sea_light() -> Floats:
    """Linear light of `SEA`, shape (3,)."""
    return _light(SEA)


def panel_tints(seen: NDArray[np.int8], error_px: Floats) -> NDArray[np.float32]:
    """What the overlay ``panels`` lays over every panel: linear light and its share, shape (N, 4).

    The hue tells the class (0 outside: grey, 1 periphery: blue, 2 focus: green, 3 selected: orange); the larger the
    error reached, the darker: half as bright from 1 px to 4 px, and so on.
    """
    tints = np.zeros((len(seen), 4), np.float32)
    brightness = np.clip(np.maximum(error_px, 1.0) ** -0.5, _LEAST_BRIGHTNESS, 1.0)
    tints[:, :3] = np.array([_light(colour) for colour in _CLASS_COLOURS])[seen] * brightness[:, None]
    tints[:, 3] = _TINT_SHARE
    return tints


def _light(colour: str) -> Floats:
    return np.asarray(linear_of_srgb(np.array(list(bytes.fromhex(colour))) / 255.0))
