"""A session: where viewers were and looked, and what they pointed at, over time; recorded or generated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from limen.errors import SessionError
from limen.geometry import Floats, as_vec3
from limen.viewing.viewer import FASTEST_M_S, Pointer, Viewer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

__all__ = ["Fault", "Frame", "Session", "Track", "find_fault"]

_PACE_S = 0.1
"""How long velocities are a mean of: what trackers tremble by counts for little then, and eyes see no sooner."""


class Frame(NamedTuple):
    """All viewers and pointers at one instant."""

    time_s: float
    viewers: tuple[Viewer, ...]
    pointers: tuple[Pointer, ...] = ()


class Fault(NamedTuple):
    """What is wrong with one sample of a track."""

    sample: int
    field: str
    message: str


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The samples of one viewer, or of one hand-held pointer, in the order of time.

    Parameters
    ----------
    viewer
        Tells the viewers (or the pointers) of a session apart.
    time_s
        Shape (N,), growing from sample to sample.
    position_m, direction
        Midpoint between the eyes and where the head points, shape (N, 3); of a pointer, the hand and where it points.
    gaze
        Where the eyes look, shape (N, 3), NaN where the eye tracker lost them; ``None`` without a tracker.
    acuity_arcmin
        The viewer's own acuity, shape (N,), NaN where the policy's counts; ``None`` if it always does.

    Raises
    ------
    SessionError
        If a sample cannot be used; the message names the viewer, the sample and the field.
    """

    viewer: str
    time_s: Floats
    position_m: Floats
    direction: Floats
    gaze: Floats | None = None
    acuity_arcmin: Floats | None = None

    def __post_init__(self) -> None:
        count = len(self.time_s)
        shapes = {"time_s": (count,), "position_m": (count, 3), "direction": (count, 3)}
        shapes |= {"gaze": (count, 3)} if self.gaze is not None else {}
        shapes |= {"acuity_arcmin": (count,)} if self.acuity_arcmin is not None else {}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, value)
            if value.shape != shape:
                raise SessionError(f"viewer '{self.viewer}': {name} must have shape {shape}, got {value.shape}")
        if not count:
            raise SessionError(f"viewer '{self.viewer}' has no samples: leave the viewer out")
        fault = find_fault(self.time_s, self.position_m, self.direction, self.gaze, self.acuity_arcmin)
        if fault is not None:
            raise SessionError(f"viewer '{self.viewer}', sample {fault.sample}: {fault.field} {fault.message}")

    def viewers(self, time_s: Floats) -> list[Viewer]:
        """The viewer at other times (sorted or not), shape (F,).

        Positions and directions are interpolated linearly. Gaze and acuity are those of the last sample:
        eyes jump, and what lies between two fixations was never looked at. Before the first sample the viewer
        stands at the first, after the last at the last, so nobody's demand is dropped when a tracker starts
        late or stops early. Velocities are those of the last tenth of a second.
        """
        position, direction, before = self._poses(time_s)
        velocity = (position - self._poses(time_s - _PACE_S)[0]) / _PACE_S
        velocity[np.linalg.norm(velocity, axis=1) > FASTEST_M_S] = 0.0
        gaze = None if self.gaze is None else self.gaze[before]
        acuity = None if self.acuity_arcmin is None else self.acuity_arcmin[before]
        return [
            Viewer(
                position_m=as_vec3(position[i], "position_m"),
                direction=as_vec3(direction[i], "direction"),
                gaze=None if gaze is None or math.isnan(gaze[i, 0]) else as_vec3(gaze[i], "gaze"),
                acuity_arcmin=None if acuity is None or math.isnan(acuity[i]) else float(acuity[i]),
                time_s=float(time_s[i]),
                name=self.viewer,
                velocity_m_s=as_vec3(velocity[i], "velocity_m_s"),
            )
            for i in range(len(time_s))
        ]

    def pointers(self, time_s: Floats) -> list[Pointer]:
        """The pointer at other times, shape (F,): between, before and after its samples as `viewers` are."""
        position, direction, _ = self._poses(time_s)
        return [
            Pointer(as_vec3(at, "position_m"), as_vec3(way, "direction"), float(when), self.viewer)
            for at, way, when in zip(position, direction, time_s, strict=True)
        ]

    def _poses(self, time_s: Floats) -> tuple[Floats, Floats, NDArray[np.intp]]:
        """Positions and directions, shape (F, 3), and the samples before, shape (F,)."""
        before = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, None)
        position = np.stack([np.interp(time_s, self.time_s, axis) for axis in self.position_m.T], axis=1)
        unit = self.direction / np.linalg.norm(self.direction, axis=1, keepdims=True)
        direction = np.stack([np.interp(time_s, self.time_s, axis) for axis in unit.T], axis=1)
        turned_back = np.linalg.norm(direction, axis=1) < 1e-6  # halfway between opposite directions
        direction[turned_back] = unit[before[turned_back]]
        return position, direction, before

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.position_m, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Tracks of one or several viewers in front of a display, and of what they point with.

    Parameters
    ----------
    name
        What reports call it: ``A``, or the file's stem.
    display
        Name of the display whose room frame the poses are in.
    rate_hz
        Samples a second, nominally; a sample counts for ``1 / rate_hz``.
    tracks
        One per viewer; their samples need not share times.
    pointers
        One per pointer, with neither gaze nor acuity. A session lasts as long as its viewers' tracks.

    Raises
    ------
    SessionError
        If there is nobody in it, two viewers or two pointers share a name, a pointer has a gaze or an acuity, or
        the rate is impossible.
    """

    name: str
    display: str
    rate_hz: float
    tracks: tuple[Track, ...]
    pointers: tuple[Track, ...] = ()

    def __post_init__(self) -> None:
        if not 0 < self.rate_hz <= 100_000:
            raise SessionError(
                f"session '{self.name}': rate_hz must lie above 0 and at most at 100000, got {self.rate_hz}"
            )
        if not self.tracks:
            raise SessionError(f"session '{self.name}' has no viewers: add at least one sample of one")
        for role, tracks in (("viewer", self.tracks), ("pointer", self.pointers)):
            names = [track.viewer for track in tracks]
            if len(set(names)) != len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise SessionError(f"session '{self.name}': two {role}s are named '{twice}'")
        for track in self.pointers:
            if track.gaze is not None or track.acuity_arcmin is not None:
                raise SessionError(
                    f"session '{self.name}': pointer '{track.viewer}' has a gaze or an acuity: leave it out"
                )

    @property
    def start_s(self) -> float:
        return min(float(track.time_s[0]) for track in self.tracks)

    @property
    def duration_s(self) -> float:
        """From the first sample to the end of the last, which lasts ``1 / rate_hz`` as all others do."""
        end_s = max(float(track.time_s[-1]) for track in self.tracks) + 1 / self.rate_hz
        return round(end_s - self.start_s, 6)  # files hold microseconds

    @property
    def length_m(self) -> float:
        """Metres walked by all viewers together."""
        return sum(track.length_m for track in self.tracks)

    @property
    def sample_count(self) -> int:
        """Samples of the longest track: the session's frames at its own rate."""
        return max(len(track.time_s) for track in self.tracks)

    def at(self, time_s: float) -> tuple[Viewer, ...]:
        """All viewers at a time on the session's clock; see `Track.viewers` for what lies between samples."""
        return tuple(track.viewers(np.array([time_s]))[0] for track in self.tracks)

    def pointers_at(self, time_s: float) -> tuple[Pointer, ...]:
        """All pointers at a time on the session's clock."""
        return tuple(track.pointers(np.array([time_s]))[0] for track in self.pointers)

    def times_s(self, rate_hz: float | None = None) -> NDArray[np.float64]:
        """When the frames of another rate happen, the first at the session's start.

        Raises
        ------
        SessionError
            If the rate is not a positive number.
        """
        rate_hz = self.rate_hz if rate_hz is None else rate_hz
        if not 0 < rate_hz < math.inf:
            raise SessionError(f"rate_hz must be a positive number, got {rate_hz}")
        # Times are kept to the microsecond in files: without the slack, a rounded end would cost a frame.
        count = max(1, math.floor(self.duration_s * rate_hz + 1e-3))
        return np.asarray(self.start_s + np.arange(count) / rate_hz)

    def frames(self, rate_hz: float | None = None) -> Iterator[Frame]:
        """Frames at a steady rate (the session's own by default)."""
        times = self.times_s(rate_hz)
        viewers = [track.viewers(times) for track in self.tracks]
        pointers = [track.pointers(times) for track in self.pointers]
        for number, time_s in enumerate(times.tolist()):
            yield Frame(time_s, tuple(of[number] for of in viewers), tuple(of[number] for of in pointers))

    @classmethod
    def of(cls, name: str, display: str, rate_hz: float, viewers: Iterable[Viewer]) -> Session:
        """A session from viewers in any order, told apart by their names.

        Raises
        ------
        SessionError
            As for the parts: no viewer at all, or two samples of one viewer at one time.
        """
        people: dict[str, list[Viewer]] = {}
        for viewer in viewers:
            people.setdefault(viewer.name, []).append(viewer)
        return cls(name, display, rate_hz, tuple(_track_of(who, samples) for who, samples in people.items()))


def _track_of(name: str, samples: list[Viewer]) -> Track:
    samples = sorted(samples, key=lambda viewer: viewer.time_s)
    nothing = (math.nan, math.nan, math.nan)
    gaze = np.array([nothing if viewer.gaze is None else viewer.gaze for viewer in samples])
    acuity = np.array([math.nan if viewer.acuity_arcmin is None else viewer.acuity_arcmin for viewer in samples])
    return Track(
        name,
        np.array([viewer.time_s for viewer in samples]),
        np.array([viewer.position_m for viewer in samples]),
        np.array([viewer.direction for viewer in samples]),
        None if np.isnan(gaze).all() else gaze,
        None if np.isnan(acuity).all() else acuity,
    )


def find_fault(
    time_s: Floats, position_m: Floats, direction: Floats, gaze: Floats | None, acuity_arcmin: Floats | None
) -> Fault | None:
    """The first sample that cannot be used, and why; ``None`` if all can.

    Pure, so that a reader of files can turn the sample into a line number.
    """
    checks: list[tuple[NDArray[np.bool_], str, str]] = [
        (~np.isfinite(time_s), "time_s", "is not a finite number; drop the sample"),
        (
            _falls(time_s),
            "time_s",
            "does not grow; sort the viewer's samples by time and drop repeats",
        ),
        (
            ~_finite(position_m),
            "position",
            "is not finite; drop samples where the tracker lost the viewer",
        ),
        (
            ~_finite(direction),
            "direction",
            "is not finite; drop samples where the tracker lost the viewer",
        ),
        (
            _is_short(direction),
            "direction",
            "is zero; give where the head points, of any length",
        ),
    ]
    if gaze is not None:
        empty, known = np.asarray(np.isnan(gaze).all(axis=1)), _finite(gaze)
        checks.append((~(empty | known), "gaze", "is not finite; give all three numbers or leave all three empty"))
        checks.append(
            (
                known & _is_short(gaze),
                "gaze",
                "is zero; leave it empty where it is unknown",
            )
        )
    if acuity_arcmin is not None:
        impossible = ~(np.isnan(acuity_arcmin) | ((acuity_arcmin > 0) & (acuity_arcmin <= 600)))
        checks.append((impossible, "acuity_arcmin", "must lie above 0 and at most at 600, or be empty"))
    faults = [Fault(int(bad.argmax()), field, message) for bad, field, message in checks if bad.any()]
    return min(faults, key=lambda fault: fault.sample, default=None)


def _falls(time_s: Floats) -> NDArray[np.bool_]:
    """Where a time is not later than the one before it; inf is compared without harm."""
    return np.append(False, time_s[1:] <= time_s[:-1])


def _is_short(vectors: Floats) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(vectors, axis=1) < 1e-6)


def _finite(vectors: Floats) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(vectors).all(axis=1))
