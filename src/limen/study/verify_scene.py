"""What limen leaves out of meshes and points, judged by the independent observer from random views.

The paper's study with a model of vision for its subject: an object turned at random, of random size, is shown twice on
a monitor, in full and simplified; the gaze rests some degrees from its middle. Parts of the picture are judged at full
resolution: where the two differ most, and one at random.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, section 6.2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from limen.data.mesh.mesh import Mesh
from limen.data.mesh.store import tree_of
from limen.data.points.file import Points
from limen.display.display import Display
from limen.display.panel import Panel
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.geometry import Floats, as_vec3
from limen.gpu.device import Device
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import Extent, FoldTree
from limen.layers.points.layer import PointsLayer
from limen.study.frames import frame_of
from limen.study.observer import WINDOW_PX, Observer, Verdict, light_of, sampled
from limen.study.verify import ALIKE, Judged, Trial
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer
from limen.vision.motion import retinal_velocity_deg_s

__all__ = [
    "GAZE_DEG",
    "Pose",
    "Subject",
    "check_one_panel",
    "judge_views",
    "monitor",
    "pixels_per_degree",
    "random_poses",
    "random_windows",
    "standing",
    "subject_of",
]

GAZE_DEG = (0.0, 20.0, 40.0)
"""Angles between the gaze and the object's middle at which policies with gaze are tried, unless told otherwise."""

_SIZES_DEG = (5.0, 60.0)
_FULL = Policy("full")
_SIDE = 9  # points along a window's side at which angles from the gaze are asked for

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Pose:
    """How an object is shown once.

    Parameters
    ----------
    turn
        Rotation, (3, 3).
    size_deg
        Visual angle of its largest extent.
    gaze_turn_rad
        In which direction from the object's middle the gaze rests, where it does not rest on it.
    seed
        Of the window that is chosen at random.
    """

    turn: Floats
    size_deg: float
    gaze_turn_rad: float
    seed: int


class Subject(Protocol):
    """What is judged, on one panel."""

    @property
    def bounds(self) -> NDArray[Any]: ...

    def picture(self, stands: Floats, viewer: Viewer, policy: Policy, moves: Floats) -> Picture:
        """What the panel shows, (H, W, 4), of the object standing by a map (4, 4) from its coordinates to the room,
        where it moves by (3, 4), see `limen.viewing.tolerance.Tolerance`."""
        ...

    def close(self) -> None: ...


def monitor() -> tuple[Display, Viewer]:
    """The paper's monitor, 23 inches and 1600 x 1200 pixels, and an eye 25 inches before it: it fills 40 degrees."""
    size_m = (0.4674, 0.3506)
    pitch_m = (size_m[0] / 1600, size_m[1] / 1200)
    panel = Panel("monitor", (1600, 1200), (-size_m[0] / 2, size_m[1] / 2, 0.0), (1, 0, 0), (0, -1, 0), pitch_m)
    return Display("monitor", (panel,)), Viewer((0.0, 0.0, 0.635), eye_separation_m=0.0)


def random_poses(count: int, seed: int = 0) -> list[Pose]:
    """Orientations evenly over all there are, sizes evenly from 5 to 60 degrees.

    Raises
    ------
    InputError
        If there are none.
    """
    if count < 1:
        raise InputError(f"at least one view must be judged, got {count}")
    rng = np.random.default_rng(seed)
    return [
        Pose(
            _rotation(rng),
            float(rng.uniform(*_SIZES_DEG)),
            float(rng.uniform(0, 2 * math.pi)),
            int(rng.integers(2**31)),
        )
        for _ in range(count)
    ]


def check_one_panel(display: Display) -> None:
    """Raises
    ------
    InputError
        If the display has several panels.
    """
    if len(display.panels) != 1:
        raise InputError(
            f"'{display.name}' has {len(display.panels)} panels: meshes and points are judged on one (leave out "
            "--display for the paper's monitor, or name one of its --panels)"
        )


def subject_of(device: Device, content: Mesh | Points, display: Display, extent: Extent = "displacement") -> Subject:
    """A mesh with its vertex tree, or points, ready to be drawn on a display of one panel.

    Raises
    ------
    InputError
        If the display has several panels.
    """
    check_one_panel(display)
    if isinstance(content, Mesh):
        return _Shown(
            device, display, MeshLayer(content, tree=FoldTree(tree_of(content)), extent=extent), content.bounds
        )
    return _Shown(device, display, PointsLayer(content), content.bounds)


def judge_views(
    subject: Subject,
    display: Display,
    viewer: Viewer,
    poses: Sequence[Pose],
    trials: Sequence[Trial],
    observer: Observer,
    *,
    changes: bool = False,
    speed_deg_s: float = 0.0,
) -> Iterator[list[Judged]]:
    """Draw and judge the poses one after the other: of each, one or two windows.

    Where a policy knows no gaze, eyes may rest anywhere: its windows are judged as in the fovea. ``changes``: what is
    judged is the moment in which the whole object becomes what the policy leaves of it. ``speed_deg_s``: the object
    passes that fast, in a direction of its own in every view, and the eye follows it as well as it can.
    """
    for pose in poses:
        view = _View(subject, display.panels[0], viewer, pose, observer, changes=changes, speed_deg_s=speed_deg_s)
        yield view.all(trials)


def pixels_per_degree(panel: Panel, viewer: Viewer) -> float:
    """Of a panel, at its middle."""
    distance_m = float(np.linalg.norm(np.asarray(panel.centre_m, dtype=float) - np.array(viewer.position_m)))
    return 1 / math.degrees(math.atan(max(panel.pitch_m) / distance_m))


def standing(bounds: NDArray[Any], panel: Panel, viewer: Viewer, pose: Pose) -> Floats:
    """How an object of some bounds (2, 3) stands on or behind a panel: (4, 4), from its coordinates to the room.

    In front of the panel's plane, it would not end at the panel's edges.
    """
    eye_m, middle_m = np.array(viewer.position_m), np.asarray(panel.centre_m, dtype=float)
    distance_m = float(np.linalg.norm(middle_m - eye_m))
    low, high = np.asarray(bounds, dtype=float)
    scale = 2 * distance_m * math.tan(math.radians(pose.size_deg / 2)) / float((high - low).max())
    behind_m = scale * float(np.linalg.norm(high - low)) / 2
    grown = (distance_m + behind_m) / distance_m
    stands = np.eye(4)
    stands[:3, :3] = scale * grown * pose.turn
    nearest_m = middle_m + (middle_m - eye_m) / distance_m * behind_m * grown
    stands[:3, 3] = nearest_m - stands[:3, :3] @ ((low + high) / 2)
    return stands


class _View:
    """One pose; a trial's pictures are compared where it differs most, and at one random place."""

    def __init__(
        self,
        subject: Subject,
        panel: Panel,
        viewer: Viewer,
        pose: Pose,
        observer: Observer,
        *,
        changes: bool,
        speed_deg_s: float,
    ) -> None:
        self._changes = changes
        self._subject, self._panel, self._viewer, self._pose, self._observer = subject, panel, viewer, pose, observer
        self._middle_m = np.asarray(panel.centre_m, dtype=float)
        self._per_degree = pixels_per_degree(panel, viewer)
        self._stands = standing(subject.bounds, panel, viewer, pose)
        self._moves, self._glides_deg_s = self._passing(speed_deg_s)
        self._full = self._draw(_FULL, 0.0)
        self._again = self._draw(_FULL, 0.0)

    def all(self, trials: Sequence[Trial]) -> list[Judged]:
        """A verdict for every trial, of the windows of this view."""
        shown = (self._full[..., :3] != self._full[0, 0, :3]).any(axis=-1)
        (at_random,) = random_windows(shown, self._pose.seed)
        found = [self._of(trial, at_random) for trial in trials]
        return [Judged(tuple(pair[n][0] for pair in found), tuple(pair[n][1] for pair in found)) for n in range(2)]

    def _of(self, trial: Trial, at_random: tuple[int, int]) -> tuple[tuple[Verdict, Verdict], ...]:
        """Verdict and catch, where the pictures differ most and at the random place."""
        picture = self._draw(trial.policy, trial.eccentricity_deg)
        differs = np.abs(picture[..., :3].astype(int) - self._full[..., :3]).sum(axis=-1)
        places = (_most(differs), at_random)
        return tuple((self._verdict(picture, at, trial), self._verdict(self._again, at, trial)) for at in places)

    def _verdict(self, picture: Picture, at: tuple[int, int], trial: Trial) -> Verdict:
        part = np.s_[at[1] : at[1] + WINDOW_PX, at[0] : at[0] + WINDOW_PX, :3]
        if np.array_equal(picture[part], self._full[part]):
            return ALIKE
        light, rate = sampled(light_of(picture[part]), self._per_degree)
        reference, _ = sampled(light_of(self._full[part]), self._per_degree)
        return self._observer.judge_light(
            light,
            reference,
            rate,
            self._away_deg(at, trial),
            second_opinion=trial.policy.distance_factor == 1,
            change=self._changes,
            velocity_deg_s=self._glides_deg_s,
        )

    def _passing(self, speed_deg_s: float) -> tuple[Floats, tuple[float, float]]:
        """How places move around the eye, (3, 4), and what an eye that follows them does not keep up with, to the right
        and down."""
        turn = np.random.default_rng([self._pose.seed, 1]).uniform(0, 2 * math.pi)
        right, down = math.cos(turn), math.sin(turn)
        eye_m = np.array(self._viewer.position_m)
        way = right * np.array(self._panel.right) + down * np.array(self._panel.down)
        ahead = (self._middle_m - eye_m) / np.linalg.norm(self._middle_m - eye_m)
        x, y, z = math.radians(speed_deg_s) * np.cross(ahead, way)
        turns = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        left = float(retinal_velocity_deg_s(speed_deg_s)) if speed_deg_s else 0.0
        return np.column_stack([turns, -turns @ eye_m]), (left * right, left * down)

    def _draw(self, policy: Policy, eccentricity_deg: float) -> Picture:
        return self._subject.picture(self._stands, self._gazing(eccentricity_deg), policy, self._moves)

    def _gazing(self, eccentricity_deg: float) -> Viewer:
        """The viewer, looking so far past the object's middle."""
        ahead = self._middle_m - np.array(self._viewer.position_m)
        ahead = ahead / np.linalg.norm(ahead)
        beside = math.cos(self._pose.gaze_turn_rad) * np.array(self._panel.right) + math.sin(
            self._pose.gaze_turn_rad
        ) * np.array(self._panel.down)
        away = math.radians(eccentricity_deg)
        return replace(self._viewer, gaze=as_vec3(math.cos(away) * ahead + math.sin(away) * beside, "gaze"))

    def _away_deg(self, at: tuple[int, int], trial: Trial) -> float | Floats:
        if not trial.policy.gaze:
            return 0.0
        steps = np.linspace(0, WINDOW_PX, _SIDE)
        x, y = np.meshgrid(at[0] + steps, at[1] + steps)
        sight = self._panel.position_m(np.stack([x, y], axis=-1).reshape(-1, 2)) - np.array(self._viewer.position_m)
        sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
        gaze = np.array(self._gazing(trial.eccentricity_deg).gaze)
        return np.asarray(np.degrees(np.arccos(np.clip(sight @ gaze, -1, 1))).reshape(_SIDE, _SIDE))


def random_windows(shown: NDArray[np.bool_], seed: int, count: int = 1) -> list[tuple[int, int]]:
    """Corners of windows around random pixels of what is shown, (H, W); the first corner of the picture if none is."""
    rows, columns = np.nonzero(shown)
    if not len(rows):
        return [(0, 0)]
    chosen = np.random.default_rng(seed).integers(len(rows), size=count).tolist()
    return [_inside(int(columns[each]), int(rows[each]), shown.shape) for each in chosen]


def _most(differs: NDArray[np.int64]) -> tuple[int, int]:
    """The corner of the window in which pictures differ most."""
    mean = ndimage.uniform_filter(differs.astype(float), WINDOW_PX, mode="constant")
    row, column = np.unravel_index(int(mean.argmax()), mean.shape)
    return _inside(int(column), int(row), (differs.shape[0], differs.shape[1]))


def _inside(column: int, row: int, shape: tuple[int, ...]) -> tuple[int, int]:
    half = WINDOW_PX // 2
    return (
        min(max(column - half, 0), max(shape[1] - WINDOW_PX, 0)),
        min(max(row - half, 0), max(shape[0] - WINDOW_PX, 0)),
    )


class _Shown:
    def __init__(self, device: Device, display: Display, layer: MeshLayer | PointsLayer, bounds: NDArray[Any]) -> None:
        self.bounds = bounds
        self._renderer = Renderer(device, display, [layer])

    def picture(self, stands: Floats, viewer: Viewer, policy: Policy, moves: Floats) -> Picture:
        motion = tuple(moves.ravel().tolist())
        frame = frame_of(self._renderer, [viewer], placement=InRoom.of(stands), motion=motion, policy=policy)
        ((_, picture, _),) = self._renderer.pictures(frame)
        return picture.copy()

    def close(self) -> None:
        self._renderer.close()


def _rotation(rng: np.random.Generator) -> Floats:
    """A random rotation (Shoemake 1992): that of a unit quaternion evenly over the sphere of all."""
    a, b, c, d = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (c * c + d * d), 2 * (b * c - d * a), 2 * (b * d + c * a)],
            [2 * (b * c + d * a), 1 - 2 * (b * b + d * d), 2 * (c * d - b * a)],
            [2 * (b * d - c * a), 2 * (c * d + b * a), 1 - 2 * (b * b + c * c)],
        ]
    )
