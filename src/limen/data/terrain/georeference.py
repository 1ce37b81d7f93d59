"""How far apart the posts of a raster are, in metres, from what its file says of its coordinates."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from limen.errors import InputError

__all__ = ["Spacing", "bounds_of", "metres_a_degree", "metres_of_unit", "spacing_of"]

_WGS84 = 6378137.0, 298.257223563
_ELLIPSOID = re.compile(r'(?:SPHEROID|ELLIPSOID)\["[^"]*",\s*([0-9.eE+]+),\s*([0-9.eE+]+)')
_UNITS = {
    1.0: ("", "m", "metre", "metres", "meter", "meters"),
    0.3048: ("ft", "foot", "feet", "international foot"),
    1200.0 / 3937.0: ("us-ft", "ftus", "us survey foot", "us survey feet", "us_survey_foot", "us_survey_feet"),
    0.01: ("cm", "centimetre", "centimetres", "centimeter", "centimeters"),
    0.1: ("dm", "decimetre", "decimetres", "decimeter", "decimeters"),
    1000.0: ("km", "kilometre", "kilometres", "kilometer", "kilometers"),
}


class Spacing(NamedTuple):
    """Metres from post to post along columns' and rows' numbers; ``note`` says what was assumed, or is empty."""

    along_m: tuple[float, float]
    note: str


def metres_of_unit(name: str | None) -> float | None:
    """What one unit of heights is in metres; None for a name that is not known, 1 where there is none.

    >>> metres_of_unit("US survey foot"), metres_of_unit(None), metres_of_unit("kelvin")
    (0.3048006096012192, 1.0, None)
    """
    wanted = (name or "").strip().lower()
    return next((factor for factor, names in _UNITS.items() if wanted in names), None)


def metres_a_degree(latitude_deg: float, axis_m: float = _WGS84[0], inverse_flattening: float = _WGS84[1]) -> Any:
    """(east, north): metres of one degree of longitude and of latitude on an ellipsoid; (float, float).

    The radii of the prime vertical times the latitude's cosine, and of the meridian (Snyder 1987, Map projections - a
    working manual, eqs. 4-20 and 4-18). An inverse flattening of 0 stands for a sphere, as it does in WKT.

    >>> [round(metres, 1) for metres in metres_a_degree(45.0)]
    [78846.8, 111131.8]
    """
    flattening = 1.0 / inverse_flattening if inverse_flattening else 0.0
    eccentricity2 = flattening * (2.0 - flattening)
    latitude = math.radians(latitude_deg)
    w2 = 1.0 - eccentricity2 * math.sin(latitude) ** 2
    east = axis_m * math.cos(latitude) / math.sqrt(w2)
    north = axis_m * (1.0 - eccentricity2) / w2**1.5
    return math.radians(east), math.radians(north)


def _ellipsoid(crs: Any) -> tuple[float, float]:
    found = _ELLIPSOID.search(crs.to_wkt())
    return (float(found[1]), float(found[2])) if found else _WGS84


def _linear_unit_m(crs: Any) -> float:
    try:
        return float(crs.linear_units_factor[1])
    except Exception:  # rasterio's CRSError, for systems that have none: local ones
        return 1.0


def spacing_of(crs: Any, transform: tuple[float, ...] | None, size_posts: tuple[int, int], where: str) -> Spacing:
    """Spacing of posts that ``transform`` (a ... f) maps from column and row to ``crs`` (rasterio's; both may be None).

    Of a projected system by its linear unit, of a geographic one by its ellipsoid at the middle latitude. Raises
    InputError, beginning with ``where``, where posts would coincide.
    """
    if transform is None:
        return Spacing((1.0, 1.0), "no georeference: posts are taken to be 1 m apart; give --spacing-m if they are not")
    a, b, _, d, e, f = transform
    east = north = 1.0
    note = ""
    if not crs:
        note = (
            f"no coordinate system: its spacing, {math.hypot(a, d):.6g} by {math.hypot(b, e):.6g}, is taken as metres; "
            "give --spacing-m if it is not"
        )
    elif crs.is_geographic:
        latitude_deg = d * size_posts[0] / 2 + e * size_posts[1] / 2 + f
        if not -90.0 < latitude_deg < 90.0:
            raise InputError(f"{where}: its middle lies at latitude {latitude_deg:g}; give --spacing-m")
        east, north = metres_a_degree(latitude_deg, *_ellipsoid(crs))
    else:
        east = north = _linear_unit_m(crs)
    along = math.hypot(a * east, d * north), math.hypot(b * east, e * north)
    if not all(0.0 < metres < math.inf for metres in along):
        raise InputError(f"{where}: its geotransform puts posts {along[0]:g} by {along[1]:g} m apart; give --spacing-m")
    return Spacing(along, note)


def bounds_of(transform: tuple[float, ...] | None, size_posts: tuple[int, int]) -> tuple[float, ...] | None:
    """West, south, east, north of a raster that ``transform`` (a ... f) maps from columns and rows; None without one.

    >>> bounds_of((30.0, 0.0, 500000.0, 0.0, -30.0, 4600000.0), (100, 200))
    (500000.0, 4594000.0, 503000.0, 4600000.0)
    """
    if transform is None:
        return None
    a, b, c, d, e, f = transform
    corners = [(x, y) for x in (0, size_posts[0]) for y in (0, size_posts[1])]
    xs, ys = [a * x + b * y + c for x, y in corners], [d * x + e * y + f for x, y in corners]
    return min(xs), min(ys), max(xs), max(ys)
