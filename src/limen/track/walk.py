"""Synthetic sessions: people who walk from one place of interest to the next in front of a display.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 6.3: a heat map of 160 x 100 cells of
where people stood, 1,500 samples of its non-zero cells, k-means with k = 6, walks between the six hotspots at
2.8 mph, sampled at 120 Hz. Their heat map was never published, so `heat_map` makes one up from a seed.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.cluster.vq import ClusterError, kmeans2
from scipy.signal import lfilter

from limen.errors import InputError
from limen.track.pointing import wandering_pointer
from limen.track.replay import read_session
from limen.track.room import BODY_M, Room, room_of
from limen.track.session import Session, Track
from limen.units import mph_to_m_per_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from limen.display.display import Display
    from limen.geometry import Floats

__all__ = ["SESSIONS", "SPEED_M_PER_S", "Heat", "Plan", "heat_map", "hotspots", "make_walk", "plan_of", "session_named"]

SPEED_M_PER_S = mph_to_m_per_s(2.8)
SESSIONS = {"A": (145.0, 1), "B": (216.0, 2), "C": (175.0, 3)}
"""Seconds (the paper's) and seed (ours) of the sessions that have names."""

EYE_HEIGHT_M = 1.7
_HOTSPOTS = 6
_SAMPLES = 1_500
_VISITS = 40_000  # few enough that rarely visited cells stay at zero
_TURN_S = 0.25  # time constant of the head's turning
_GAZE = "+gaze"
_FIXATION_S = (0.3, 0.45)  # median, and spread of its logarithm
_EYE_TURN_DEG = (7.5, 4.5)  # standard deviation of where the eyes look beside the head, across and up; cut at 2
_APPROACH_M = 1.0  # on the last metre to a hotspot the head turns to the wall there


class Heat(NamedTuple):
    """Where people stood."""

    room: Room
    visits: NDArray[np.int64]  # (rows, columns)


class Plan(NamedTuple):
    """The way of one viewer."""

    corners_m: Floats  # (C, 2): x and z, walked straight from one to the next
    stops: NDArray[np.int64]  # (S,): which corners are hotspots
    eye_height_m: float


def make_walk(
    display: Display,
    seconds: float,
    seed: int = 0,
    viewers: int = 1,
    rate_hz: float = 120.0,
    name: str = "walk",
    gaze: bool = False,
    pointers: int = 0,
) -> Session:
    """A walk of one or several people in front of a display; the same arguments give the same session.

    All viewers share the heat map; each has hotspots, a path and an eye height of their own, and the first of
    several walks as one alone would. Six hotspots last some 20 s: when all were visited, six new ones are drawn
    from the same heat map, until the time is up.

    Parameters
    ----------
    display
        What they look at.
    seconds
        How long; the session has ``seconds * rate_hz`` frames.
    seed
        Another seed is another heat map and other paths.
    gaze
        Whether an eye tracker is made up, too: the eyes stay on one place for about 0.3 s, then jump to another, within
        15 degrees of where the head points.
    pointers
        How many hand-held pointers wander over the display, held by the viewers in turn.

    Raises
    ------
    InputError
        For a duration, a rate, a seed or a number of viewers or pointers that cannot be.
    DisplayError
        If there is no floor to walk on.
    """
    if not 0 < seconds <= 86_400:
        raise InputError(f"seconds must lie above 0 and at most at 86400 (a day), got {seconds}")
    if not 1 <= rate_hz <= 1_000:
        raise InputError(f"rate_hz must be from 1 to 1000, got {rate_hz}")
    if not 1 <= viewers <= 64:
        raise InputError(f"viewers must be from 1 to 64, got {viewers}")
    if not 0 <= pointers <= 64:
        raise InputError(f"pointers must be from 0 to 64, got {pointers}")
    heat = heat_map(display, seed)
    time_s = np.arange(max(1, round(seconds * rate_hz))) / rate_hz
    length_m = SPEED_M_PER_S * float(time_s[-1])
    tracks = [
        _track(heat.room, plan_of(heat, seed, number, length_m), time_s, f"v{number + 1}") for number in range(viewers)
    ]
    if gaze:
        tracks = [_looking(track, [seed, number, 7]) for number, track in enumerate(tracks)]
    held = (
        wandering_pointer(display, tracks[number % viewers], f"p{number + 1}", [seed, number, 11])
        for number in range(pointers)
    )
    return Session(name, display.name, float(rate_hz), tuple(tracks), tuple(held))


def session_named(name_or_path: str, display: Display, viewers: int = 1) -> Session:
    """One of the synthetic sessions ``A``, ``B``, ``C`` for a display, or a session file.

    ``A+gaze`` is the same walk with an eye tracker.

    Raises
    ------
    InputError
        If it is neither; or as for `limen.track.replay.read_session`.
    """
    base = name_or_path.removesuffix(_GAZE)
    if base in SESSIONS:
        seconds, seed = SESSIONS[base]
        return make_walk(display, seconds, seed, viewers, name=name_or_path, gaze=base != name_or_path)
    if "." not in name_or_path and "/" not in name_or_path:
        raise InputError(
            f"no session is named '{name_or_path}': there are {', '.join(SESSIONS)}; or give a session file"
        )
    return read_session(name_or_path)


def heat_map(display: Display, seed: int) -> Heat:
    """Where people might have stood, made up: 40,000 visits over 160 x 100 cells of the display's floor.

    People linger 0.4 to 1.5 m from the walls, less in the middle (12 %), and never closer than their bodies
    allow. They gather in front of what is worth looking at: as many places along the walls as there are metres
    and a half of them, each with a spread of 0.4 to 1 m and a weight of its own.
    """
    if seed < 0:
        raise InputError(f"seed must not be negative, got {seed}")
    rng = np.random.default_rng([seed, 0])
    room = room_of(display)
    centres = room.cell_centres_m[room.mask]
    distance, _ = room.wall_distance_m(centres)
    wanted = _lingering(distance) * (0.15 + _attraction(room, centres, rng))
    heat = np.zeros(room.mask.shape)
    heat[room.mask] = wanted
    heat = ndimage.gaussian_filter(heat, 1.0) * room.mask
    return Heat(room, rng.poisson(heat * (_VISITS / heat.sum())))


def _lingering(distance_m: Floats) -> Floats:
    """How long people stay at a distance from the nearest wall, 0 to 1."""
    rise = np.clip((distance_m - BODY_M) / 0.2, 0, 1)
    far = np.exp(-((np.clip(distance_m - 1.5, 0, 20) / 0.7) ** 2))
    return np.asarray(rise * (0.12 + 0.88 * far))


def _attraction(room: Room, places: Floats, rng: np.random.Generator) -> Floats:
    """How much there is to look at near places of the floor."""
    rows = room.rows
    if not len(rows.start):
        return np.ones(len(places))
    walls = rows.length_m / rows.length_m.sum()
    count = max(4, round(float(rows.length_m.sum()) / 1.5))
    chosen = rng.choice(len(walls), size=count, p=walls)
    along = rows.start[chosen] + (rng.random(count) * rows.length_m[chosen])[:, None] * rows.along[chosen]
    stand = along + rows.facing[chosen] * rng.uniform(0.5, 1.3, count)[:, None]
    spread, weight = rng.uniform(0.4, 1.0, count), rng.gamma(1.5, 1.0, count)
    distance2 = ((places[:, None] - stand) ** 2).sum(axis=2)
    return np.asarray((weight * np.exp(-distance2 / (2 * spread**2))).sum(axis=1))


def hotspots(heat: Heat, rng: np.random.Generator) -> Floats:
    """Places of interest, (6, 2): the means of six clusters among 1,500 visits drawn from the heat map.

    A cell is drawn as often as it was visited; a mean that lies where nobody can stand moves to the nearest
    place where one can. A tiny floor has fewer.
    """
    visits = heat.visits.ravel()
    drawn = rng.choice(len(visits), size=_SAMPLES, p=visits / visits.sum())
    samples = heat.room.cell_centres_m.reshape(-1, 2)[drawn]
    clusters = min(_HOTSPOTS, len(np.unique(drawn)))
    while True:
        first = samples[_spread_out(samples, clusters, rng)]
        try:
            means, _ = kmeans2(samples, first, minit="matrix", missing="raise")
        except ClusterError:  # a cluster lost all its samples: begin elsewhere
            continue
        return np.stack([heat.room.nearest_cell(mean) for mean in np.asarray(means)])


def _spread_out(samples: Floats, count: int, rng: np.random.Generator) -> list[int]:
    """Samples to begin the clusters with, far from one another (k-means++, Arthur, Vassilvitskii 2007)."""
    chosen = [int(rng.integers(len(samples)))]
    while len(chosen) < count:
        distance2 = ((samples[:, None] - samples[chosen]) ** 2).sum(axis=2).min(axis=1)
        chosen.append(int(rng.choice(len(samples), p=distance2 / distance2.sum())))
    return chosen


def plan_of(heat: Heat, seed: int, number: int, length_m: float) -> Plan:
    """The way of a session's viewer (0 is the first) over at least ``length_m``."""
    rng = np.random.default_rng([seed, 1, number])
    eye_height = min(EYE_HEIGHT_M + float(rng.normal(0, 0.06)), heat.room.top_m)
    corners, stops = _path(heat, rng, length_m)
    return Plan(corners, np.array(stops), eye_height)


def _track(room: Room, plan: Plan, time_s: Floats, viewer: str) -> Track:
    walked = np.append(0.0, np.linalg.norm(np.diff(plan.corners_m, axis=0), axis=1).cumsum())
    at = SPEED_M_PER_S * time_s
    place = np.stack([np.interp(at, walked, axis) for axis in plan.corners_m.T], axis=1)
    step_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0
    yaw = _head_yaw(room, place, at, walked[plan.stops], step_s)
    height = np.full(len(at), plan.eye_height_m)
    # To the micrometre and the microsecond, so that a file holds the very same session.
    return Track(
        viewer,
        np.round(time_s, 6),
        np.round(np.stack([place[:, 0], height, place[:, 1]], axis=1), 6) + 0.0,
        np.round(np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], axis=1), 6) + 0.0,
    )


def _looking(track: Track, seed: list[int]) -> Track:
    """The same person with an eye tracker: fixations in the room, and jumps between them."""
    rng = np.random.default_rng(seed)
    duration_s = float(track.time_s[-1] - track.time_s[0])
    count = int(duration_s / _FIXATION_S[0] * 2) + 8
    ends_s = track.time_s[0] + rng.lognormal(np.log(_FIXATION_S[0]), _FIXATION_S[1], count).cumsum()
    number = np.searchsorted(ends_s, track.time_s, side="right").clip(max=count - 1)
    first = np.searchsorted(number, np.unique(number))  # the eyes turn from where the head points when they jump
    turn = np.radians(np.clip(rng.normal(size=(count, 2)), -2, 2) * _EYE_TURN_DEG)[number[first]]
    head = track.direction[first]
    yaw, pitch = np.arctan2(head[:, 0], head[:, 2]) + turn[:, 0], np.arcsin(np.clip(head[:, 1], -1, 1)) + turn[:, 1]
    looks = np.stack([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)], axis=1)
    gaze = np.round(looks[np.searchsorted(first, np.arange(len(number)), side="right") - 1], 6) + 0.0
    return replace(track, gaze=gaze)


def _path(heat: Heat, rng: np.random.Generator, length_m: float) -> tuple[Floats, list[int]]:
    """Corners of a walk of at least ``length_m``, and which of them are hotspots."""
    open_spots = list(hotspots(heat, rng))
    corners = [open_spots.pop(int(rng.integers(len(open_spots))))]
    stops, walked = [0], 0.0
    while walked < length_m or len(corners) == 1:
        if not open_spots:
            open_spots = list(hotspots(heat, rng))
        way = heat.room.way(corners[-1], open_spots.pop(int(rng.integers(len(open_spots)))))
        walked += sum(float(np.linalg.norm(b - a)) for a, b in pairwise(way))
        corners += list(way[1:])
        stops.append(len(corners) - 1)
    return np.stack(corners), stops


def _head_yaw(room: Room, place: Floats, at_m: Floats, stops_m: Floats, step_s: float) -> Floats:
    """Where the head points, radians from +z toward +x: along the path, and on the last metre to a hotspot
    more and more to the nearest wall; smoothed, since heads turn in a few tenths of a second."""
    step = np.diff(place, axis=0, append=place[-1:])
    if len(step) > 1:
        step[-1] = step[-2]
    _, wall = room.wall_distance_m(place)
    along = np.arctan2(step[:, 0], step[:, 1])
    turn = np.angle(np.exp(1j * (np.arctan2(wall[:, 0], wall[:, 1]) - along)))
    remaining = stops_m[np.searchsorted(stops_m, at_m).clip(max=len(stops_m) - 1)] - at_m
    share = np.clip(1 - remaining / _APPROACH_M, 0, 1) * wall.any(axis=1)
    wanted = np.unwrap(along + share * turn)
    decay = float(np.exp(-step_s / _TURN_S))
    start = np.array([decay * wanted[0]])
    return np.asarray(lfilter([1 - decay], [1, -decay], wanted, zi=start)[0])
