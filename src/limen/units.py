"""The only conversions between degrees, arcminutes, radians, inches and metres."""

from __future__ import annotations

import math

__all__ = ["arcmin_to_rad", "deg_to_rad", "inch_to_m", "mph_to_m_per_s", "rad_to_arcmin", "rad_to_deg"]


def deg_to_rad(angle_deg: float) -> float:
    return math.radians(angle_deg)


def rad_to_deg(angle_rad: float) -> float:
    return math.degrees(angle_rad)


def arcmin_to_rad(angle_arcmin: float) -> float:
    """
    >>> round(arcmin_to_rad(60), 6) == round(deg_to_rad(1), 6)
    True
    """
    return math.radians(angle_arcmin / 60.0)


def rad_to_arcmin(angle_rad: float) -> float:
    return math.degrees(angle_rad) * 60.0


def inch_to_m(length_in: float) -> float:
    return length_in * 0.0254


def mph_to_m_per_s(speed_mph: float) -> float:
    """
    >>> round(mph_to_m_per_s(2.8), 3)
    1.252
    """
    return speed_mph * 0.44704
