"""A terrain on a display, drawn live: dragging turns it, the wheel comes nearer, time flies over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.geometry import Vec3
from limen.gpu.device import Device
from limen.layers.terrain.draw.drawer import TerrainOverlay
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.renderer import TerrainRenderer, TerrainReport
from limen.layers.terrain.resources import Draped
from limen.layers.terrain.selector import TerrainSettings
from limen.show.stage import STILL, Turn
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.viewer import Pointer, Viewer, nobody_points

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain

__all__ = ["TerrainExhibit", "TerrainStage"]


@dataclass(frozen=True, slots=True)
class TerrainExhibit:
    """A terrain and how it is shown: an `limen.show.stage.Exhibit`.

    Parameters
    ----------
    policy
        How viewers decide about detail.
    reference_m
        The reference eye; see `limen.layers.terrain.look_at`. A window that is itself the display is looked at from its
        own.
    whole
        The installation that displays are parts of.
    pointers
        Who points where, by the viewers' clock.
    overlay
        What the overlay shows while it is on.
    """

    terrain: Terrain
    look: TerrainLook = field(default_factory=TerrainLook)
    settings: TerrainSettings = field(default_factory=TerrainSettings)
    policy: Policy = field(default_factory=Policy)
    reference_m: Vec3 = (0.0, 0.0, 0.0)
    whole: Display | None = None
    draped: Draped | None = None
    pointers: Callable[[float], Sequence[Pointer]] = nobody_points
    overlay: TerrainOverlay = "panels"

    @property
    def name(self) -> str:
        return self.terrain.name

    def renderer(self, device: Device, display: Display) -> TerrainRenderer:
        """The terrain on a display; the caller closes it."""
        return TerrainRenderer(
            device, display, self.terrain, look=self.look, settings=self.settings, reference_m=self.reference_m,
            whole=self.whole, draped=self.draped,
        )  # fmt: skip

    def on(self, device: Device, display: Display) -> TerrainStage:
        return TerrainStage(self.renderer(device, display), self)


class TerrainStage:
    """A terrain on a display: a `limen.show.stage.Stage`."""

    def __init__(self, renderer: TerrainRenderer, exhibit: TerrainExhibit) -> None:
        self._renderer, self._exhibit = renderer, exhibit
        self.quilts, self.guard_px = renderer.quilts, renderer.guard_px

    def pose(self, time_s: float, turn: Turn = STILL, *, paused: bool = False) -> None:
        self._renderer.pose(time_s, turned(self._exhibit.settings.look_at, turn, self._renderer))

    def frame(
        self, viewers: Sequence[Viewer], *, quilt: Quilt, overlay: bool, target: Any, target_format: str
    ) -> TerrainReport:
        return self._renderer.frame(
            viewers, self._exhibit.policy, pointers=self._exhibit.pointers(viewers[0].time_s), quilt=quilt,
            overlay=self._overlay(overlay), target=target, target_format=target_format,
        )  # fmt: skip

    def textures(self, viewers: Sequence[Viewer], *, overlay: bool) -> tuple[list[Any], TerrainReport]:
        return self._renderer.textures(
            viewers,
            self._exhibit.policy,
            pointers=self._exhibit.pointers(viewers[0].time_s),
            overlay=self._overlay(overlay),
        )

    def close(self) -> None:
        self._renderer.close()

    def _overlay(self, shown: bool) -> TerrainOverlay | None:
        return self._exhibit.overlay if shown else None


def turned(look: LookAt, turn: Turn, renderer: TerrainRenderer) -> LookAt:
    """Where the camera is after dragging (to the right: the land turns that way) and the wheel."""
    if turn == STILL:
        return look
    return replace(
        look,
        heading_deg=look.heading_deg - turn.yaw_deg,
        pitch_deg=min(max(look.pitch_deg + turn.pitch_deg, 1.0), 90.0),
        range_m=(look.range_m or renderer.range_m) * turn.nearer,
    )
