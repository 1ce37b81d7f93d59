"""What can stand on a display and be drawn live: one content with its settings, and how time and hands move it.

Windows know a `Stage` and not what is on it; `MeshExhibit` puts a mesh there, `limen.show.terrain_stage` a terrain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.data.samples.mesh import ripple
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.geometry import Floats
from limen.gpu.device import Device
from limen.layers.common.room_placement import mesh_in_room, mesh_stand, motion_of
from limen.layers.mesh.draw.drawer import SceneOverlay
from limen.layers.mesh.renderer import BACKGROUND, SceneRenderer, SceneReport, Simplified
from limen.viewing.choices import Animation, Depth, Stereo
from limen.viewing.tolerance import STANDS
from limen.viewing.viewer import Viewer

__all__ = [
    "STILL",
    "Animation",
    "Bounded",
    "Exhibit",
    "MeshExhibit",
    "MeshStage",
    "SceneSettings",
    "Shown",
    "Stage",
    "Turn",
    "about_middle",
    "check_one_picture",
    "check_still",
    "posed",
]

_TURN_DEG_PER_S = 20.0


class Turn(NamedTuple):
    """What dragging and the wheel have done to what is behind a window."""

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    nearer: float = 1.0


STILL = Turn()


class Shown(Protocol):
    """What any frame's report tells."""

    @property
    def panels_active(self) -> int: ...
    @property
    def drawn(self) -> str:
        """How many of what were drawn, for people."""
        ...


class Stage(Protocol):
    """One content on one display, ready to be drawn."""

    @property
    def quilts(self) -> Sequence[Quilt]: ...
    @property
    def guard_px(self) -> float: ...

    def pose(self, time_s: float, turn: Turn = STILL, *, paused: bool = False) -> None:
        """Put the content where it is at a time that passes or is paused, turned as hands have turned it."""
        ...

    def frame(
        self, viewers: Sequence[Viewer], *, quilt: Quilt, overlay: bool, target: Any, target_format: str
    ) -> Shown:
        """Draw one quilt into a texture view of its size."""
        ...

    def textures(self, viewers: Sequence[Viewer], *, overlay: bool) -> tuple[list[Any], Shown]:
        """The textures of all quilts; valid until the next frame."""
        ...

    def close(self) -> None: ...


class Exhibit(Protocol):
    """One content with its settings, for whatever display."""

    @property
    def name(self) -> str: ...

    def on(self, device: Device, display: Display) -> Stage: ...


class Bounded(Protocol):
    """What stands somewhere."""

    @property
    def bounds(self) -> NDArray[Any]:
        """Smallest and largest coordinates, shape (2, 3)."""
        ...


@dataclass(frozen=True, slots=True)
class SceneSettings:
    """How a mesh or a cloud of points is shown, and where it stands."""

    stereo: Stereo = "none"
    animate: Animation = "none"
    size_m: float | None = None
    at_m: tuple[float, float, float] | None = None
    up: Literal["y", "z"] = "y"
    turn_deg: float = 0.0
    background: tuple[float, float, float] = BACKGROUND
    tilt_deg: float = 0.0
    depth: Depth = "panel"

    def room_from_mesh(self, mesh: Bounded, display: Display, time_s: float = 0.0) -> Floats:
        """Where a mesh (or a cloud of points) stands at a time, shape (4, 4)."""
        turned = self.turn_deg + (_TURN_DEG_PER_S * time_s if self.animate == "turn" else 0.0)
        return mesh_in_room(
            mesh.bounds, display, size_m=self.size_m, at_m=self.at_m, up=self.up, turn_deg=turned,
            tilt_deg=self.tilt_deg,
        )  # fmt: skip

    def motion(self, mesh: Bounded, display: Display, time_s: float, *, paused: bool = False) -> Floats:
        """How places of the room move with what stands there at a time, (3, 4): for `limen.viewing.tolerance`."""
        if paused or self.animate != "turn":
            return STANDS
        return motion_of(lambda moment_s: self.room_from_mesh(mesh, display, moment_s), time_s)

    def standing_in(self, display: Display) -> SceneSettings:
        """The same with size and place as a whole display suggests them: parts of it then show parts of one scene."""
        at_m, size_m = mesh_stand(display, self.size_m)
        return replace(self, at_m=self.at_m or at_m, size_m=size_m)


def check_one_picture(stereo: Stereo) -> None:
    """Raises
    ------
    InputError
        For two eyes that are not mixed into one picture.
    """
    if stereo not in ("none", "anaglyph"):
        raise InputError(
            f"a window shows one picture at a time, not '{stereo}': give --stereo none or anaglyph, or --out FOLDER to "
            "write both"
        )


def check_still(settings: SceneSettings, simplified: Simplified | None) -> None:
    """Raises
    ------
    InputError
        For a mesh that is deformed and simplified: its vertex tree is of the places that it was made for.
    """
    if simplified is not None and settings.animate == "ripple":
        raise InputError("a mesh that ripples is drawn in full: give --policy full, or --animate turn")


def posed(renderer: SceneRenderer, mesh: Mesh, settings: SceneSettings, time_s: float, *, paused: bool = False) -> None:
    """Put the mesh in the pose that its animation has at a time that passes or is paused."""
    renderer.motion = settings.motion(mesh, renderer.display, time_s, paused=paused)
    if settings.animate == "ripple":
        renderer.move(ripple(mesh, time_s))
    elif settings.animate == "turn":
        renderer.room_from_mesh = settings.room_from_mesh(mesh, renderer.display, time_s)


class MeshStage:
    """A mesh on a display: a `Stage`."""

    def __init__(
        self,
        device: Device,
        display: Display,
        mesh: Mesh,
        settings: SceneSettings,
        simplified: Simplified | None = None,
        overlay: SceneOverlay | None = None,
    ) -> None:
        self._mesh, self._settings = mesh, settings
        self._renderer = SceneRenderer(
            device, display, mesh, room_from_mesh=settings.room_from_mesh(mesh, display), stereo=settings.stereo,
            depth=settings.depth, background=settings.background, simplified=simplified,
        )  # fmt: skip
        self._overlay: SceneOverlay = overlay or ("panels" if simplified is None else "simplified")
        self.quilts, self.guard_px = self._renderer.quilts, self._renderer.guard_px

    def pose(self, time_s: float, turn: Turn = STILL, *, paused: bool = False) -> None:
        posed(self._renderer, self._mesh, self._settings, time_s, paused=paused)
        if turn != STILL:
            stood = self._settings.room_from_mesh(self._mesh, self._renderer.display, time_s)
            self._renderer.room_from_mesh = about_middle(stood, self._mesh.bounds, turn)
        elif self._settings.animate != "turn":
            self._renderer.room_from_mesh = self._settings.room_from_mesh(self._mesh, self._renderer.display)

    def frame(
        self, viewers: Sequence[Viewer], *, quilt: Quilt, overlay: bool, target: Any, target_format: str
    ) -> SceneReport:
        return self._renderer.frame(
            viewers, quilt=quilt, overlay=self._overlay if overlay else None, target=target, target_format=target_format
        )

    def textures(self, viewers: Sequence[Viewer], *, overlay: bool) -> tuple[list[Any], SceneReport]:
        return self._renderer.textures(viewers, overlay=self._overlay if overlay else None)

    def close(self) -> None:
        self._renderer.close()


@dataclass(frozen=True, slots=True)
class MeshExhibit:
    """A mesh and how it is shown in windows: an `Exhibit`.

    Parameters
    ----------
    overlay
        What the overlay shows while it is on: by default panels, or of a simplified mesh what stands for much.

    Raises
    ------
    InputError
        For two eyes that are not mixed into one picture.
    """

    mesh: Mesh
    settings: SceneSettings = SceneSettings()
    simplified: Simplified | None = None
    overlay: SceneOverlay | None = None

    def __post_init__(self) -> None:
        check_one_picture(self.settings.stereo)
        check_still(self.settings, self.simplified)

    @property
    def name(self) -> str:
        return self.mesh.path.name if self.mesh.path else "mesh"

    def on(self, device: Device, display: Display) -> MeshStage:
        return MeshStage(device, display, self.mesh, self.settings, self.simplified, self.overlay)


def about_middle(room_from_mesh: Floats, bounds: NDArray[Any], turn: Turn) -> Floats:
    """The same place for the middle of what has these bounds, (2, 3), turned and scaled about it."""
    yaw, pitch = math.radians(turn.yaw_deg), math.radians(turn.pitch_deg)
    about_y = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
    middle = np.append(bounds.mean(axis=0), 1.0)
    stood = room_from_mesh @ middle
    matrix = np.array(room_from_mesh)
    matrix[:3, :3] = about_x @ about_y @ matrix[:3, :3] / turn.nearer
    matrix[:3, 3] = stood[:3] - matrix[:3, :3] @ middle[:3]
    return matrix
