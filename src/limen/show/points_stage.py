"""A cloud of points on a display, drawn live: dragging turns it, the wheel comes nearer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from limen.data.points.file import Points
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.gpu.device import Device
from limen.layers.points.draw.drawer import PointsOverlay, Shape
from limen.layers.points.renderer import PointsRenderer, PointsReport
from limen.show.stage import STILL, SceneSettings, Turn, about_middle
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

__all__ = ["PointsExhibit", "PointsStage"]


@dataclass(frozen=True, slots=True)
class PointsExhibit:
    """A cloud and how it is shown: an `limen.show.stage.Exhibit`.

    Parameters
    ----------
    settings
        Where it stands, and how it turns.
    policy
        How viewers decide about detail.
    lit, shape
        See `limen.layers.points.renderer.PointsRenderer`.
    overlay
        What the overlay shows while it is on.

    Raises
    ------
    InputError
        For two eyes, or an animation that is for meshes.
    """

    points: Points
    settings: SceneSettings = field(default_factory=SceneSettings)
    policy: Policy = field(default_factory=Policy)
    lit: bool | None = None
    shape: Shape = "round"
    overlay: PointsOverlay = "simplified"

    def __post_init__(self) -> None:
        if self.settings.stereo != "none":
            raise InputError("a cloud of points is drawn for one eye: leave out --stereo")
        if self.settings.animate == "ripple":
            raise InputError("a cloud of points does not ripple: --animate turn, or none")

    @property
    def name(self) -> str:
        return self.points.name

    def renderer(self, device: Device, display: Display) -> PointsRenderer:
        """The cloud on a display; the caller closes it."""
        return PointsRenderer(
            device, display, self.points, room_from_file=self.settings.room_from_mesh(self.points, display),
            lit=self.lit, shape=self.shape, background=self.settings.background,
        )  # fmt: skip

    def pose(self, renderer: PointsRenderer, time_s: float, *, paused: bool = False) -> None:
        """Put the cloud where it is at a time that passes or is paused."""
        renderer.room_from_file = self.settings.room_from_mesh(self.points, renderer.display, time_s)
        renderer.motion = self.settings.motion(self.points, renderer.display, time_s, paused=paused)

    def on(self, device: Device, display: Display) -> PointsStage:
        return PointsStage(self.renderer(device, display), self)


class PointsStage:
    """A cloud on a display: a `limen.show.stage.Stage`."""

    def __init__(self, renderer: PointsRenderer, exhibit: PointsExhibit) -> None:
        self._renderer, self._exhibit = renderer, exhibit
        self.quilts, self.guard_px = renderer.quilts, renderer.guard_px

    def pose(self, time_s: float, turn: Turn = STILL, *, paused: bool = False) -> None:
        self._exhibit.pose(self._renderer, time_s, paused=paused)
        if turn != STILL:
            stood = self._renderer.room_from_file
            self._renderer.room_from_file = about_middle(stood, self._exhibit.points.bounds, turn)

    def frame(
        self, viewers: Sequence[Viewer], *, quilt: Quilt, overlay: bool, target: Any, target_format: str
    ) -> PointsReport:
        return self._renderer.frame(
            viewers, self._exhibit.policy, quilt=quilt, overlay=self._overlay(overlay), target=target,
            target_format=target_format,
        )  # fmt: skip

    def textures(self, viewers: Sequence[Viewer], *, overlay: bool) -> tuple[list[Any], PointsReport]:
        return self._renderer.textures(viewers, self._exhibit.policy, overlay=self._overlay(overlay))

    def close(self) -> None:
        self._renderer.close()

    def _overlay(self, shown: bool) -> PointsOverlay | None:
        return self._exhibit.overlay if shown else None
