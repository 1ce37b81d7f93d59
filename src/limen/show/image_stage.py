"""An image on a display whose panels are real screens: lenses move, and all quilts of a frame show one choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from limen.data.image.file import Image
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.gpu.device import Device
from limen.layers.image.draw.drawer import Overlay
from limen.layers.image.renderer import Chosen, FrameReport, LensMoves, Renderer, active_panels
from limen.show.stage import STILL, Turn
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

__all__ = ["ImageExhibit", "ImageStage", "ShownImage"]


class ShownImage(NamedTuple):
    """A frame's report, as the window of one quilt tells it."""

    report: FrameReport
    panels_active: int

    @property
    def drawn(self) -> str:
        return f"{self.report.pages} pages, {self.report.missing} coming"


_STILL = LensMoves()


@dataclass(frozen=True, slots=True)
class ImageExhibit:
    """An image as it is shown: a `limen.show.stage.Exhibit`.

    Parameters
    ----------
    moves
        Lenses that are elsewhere from frame to frame, or carried by pointers.
    overlay
        What is shown over it when asked for one.
    """

    image: Image
    policy: Policy
    placement: OnSurface
    moves: LensMoves = _STILL
    overlay: Overlay = "levels"

    @property
    def name(self) -> str:
        return self.image.path.name

    def on(self, device: Device, display: Display) -> ImageStage:
        return ImageStage(Renderer(device, display, self.image, self.placement), self)


class ImageStage:
    """An image on a display: a `limen.show.stage.Stage`."""

    def __init__(self, renderer: Renderer, exhibit: ImageExhibit) -> None:
        self._renderer, self._exhibit = renderer, exhibit
        self.quilts, self.guard_px = renderer.quilts, renderer.guard_px
        self._chosen: Chosen | None = None

    def pose(self, time_s: float, turn: Turn = STILL, *, paused: bool = False) -> None:
        """From now on another frame is shown: all its quilts show what the first of them chose."""
        self._chosen = None

    def frame(
        self, viewers: Sequence[Viewer], *, quilt: Quilt, overlay: bool, target: Any, target_format: str
    ) -> ShownImage:
        if self._chosen is None:
            if self._exhibit.moves.any:
                self._exhibit.moves.place(self._renderer, self._exhibit.placement, viewers[0].time_s)
            self._chosen = self._renderer.choose(viewers, self._exhibit.policy)
        self._renderer.draw(
            self._chosen, quilt, overlay=self._exhibit.overlay if overlay else None, target=target,
            target_format=target_format,
        )  # fmt: skip
        return ShownImage(self._chosen.report, active_panels(self._chosen.cut, self._renderer.view, quilt))

    def textures(self, viewers: Sequence[Viewer], *, overlay: bool) -> tuple[list[Any], ShownImage]:
        raise InputError("what an eye sees of a lit display is not built of images: show the outputs, or the surface")

    def close(self) -> None:
        self._renderer.close()
