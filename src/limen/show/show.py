"""What is shown, on whatever display: layers, and what all of them have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec

from limen.data.opening import open_content
from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport
from limen.geometry import Vec3
from limen.gpu.device import Device
from limen.gpu.targets import Rgb
from limen.layers.base import STILL, Layer, Turn
from limen.layers.registry import layer_of
from limen.viewing.choices import Stereo
from limen.viewing.standing import standing_viewer
from limen.viewing.state import FrameState, LayerState
from limen.viewing.viewer import Pointer, Viewer, nobody_points

if TYPE_CHECKING:
    from limen.data.image.file import Image
    from limen.data.mesh.mesh import Mesh
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

    Showable: TypeAlias = Layer | Image | Mesh | Points | Terrain | str | Path

__all__ = ["Show", "Tour", "summary"]

Tour: TypeAlias = Callable[[float], Sequence[Viewer]]
"""Who looks, and from where, at a time in seconds."""


class Show:
    """Layers, and how they are shown: live in windows, or frame by frame.

    Parameters
    ----------
    layers
        What is shown: an opened content or a file's path, a layer, or several of these. Images on panels lie over each
        other in this order; all else is in front or behind by where it stands.
    display
        The installation that it is shown on, or that the displays are parts of that it is shown on; without one, the
        window is the display.
    stereo, background, eye_m
        See `limen.frame.renderer.Renderer`.
    pointers
        Who points where, by the viewers' clock.
    title
        What it is called; by default after its contents.

    Raises
    ------
    InputError, FormatError
        For what cannot be opened, or shown.
    """

    def __init__(
        self,
        layers: Showable | Sequence[Showable],
        display: Display | None = None,
        *,
        stereo: Stereo = "none",
        background: Rgb | None = None,
        eye_m: Vec3 | None = None,
        pointers: Callable[[float], Sequence[Pointer]] = nobody_points,
        title: str = "",
    ) -> None:
        self.display, self.stereo, self.background, self.eye_m = display, stereo, background, eye_m
        self.pointers, self.title = pointers, title
        self._opened = ExitStack()
        several: Sequence[Showable] = layers if isinstance(layers, list | tuple) else [layers]  # type: ignore[list-item]
        try:
            self.layers: tuple[Layer, ...] = tuple(self._layer(each) for each in several)
        except BaseException:
            self.close()
            raise

    @classmethod
    def open(cls, path: str | Path, display: Display | None = None) -> Show:
        """The show of a show file; see docs/shows.md.

        Raises
        ------
        MissingFileError, FormatError, InputError
            If there is no such file, or what it says cannot be: with line and field.
        """
        from limen.show.show_file import open_show  # which makes shows

        with ExitStack() as stack:
            show = open_show(Path(path), display, stack)
            show._opened = stack.pop_all()
        return show

    def close(self) -> None:
        """Close contents that were opened by their paths."""
        self._opened.close()

    def __enter__(self) -> Show:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(
        self,
        viewers: Viewer | Tour | None = None,
        *,
        window: Literal["eye", "outputs"] = "eye",
        overlay: bool = False,
        seconds: float | None = None,
        say: Callable[[str], None] = print,
    ) -> FrameReport | None:
        """Show it live until its windows are closed; the last frame's report.

        Parameters
        ----------
        viewers
            Who looks at a time, or who stands where at first and is led around by dragging; by default somebody who
            stands before the display.
        window
            ``eye``: what the first viewer's eye sees of the simulated display, or without a display the window is one.
            ``outputs``: a window for every quilt of the display, on the screen that it is named after.
        overlay
            Whether overlays are shown at first.
        seconds
            Close it after this long.
        say
            Told once what keys do.

        Raises
        ------
        DeviceError
            If there is no screen.
        """
        from limen.show.live_outputs import run_live_outputs  # which show shows
        from limen.show.live_scene import run_live_scene

        stands = standing_viewer(self.display) if self.display else Viewer((0.0, 0.0, 0.0))
        who = stands if viewers is None else viewers
        if window == "outputs":
            if self.display is None:
                raise InputError("outputs are a display's: give Show a display")
            return run_live_outputs(self, self.display, who, say, overlay=overlay, seconds=seconds)
        return run_live_scene(self, self.display, who, say, overlay=overlay, seconds=seconds)

    @property
    def name(self) -> str:
        return self.title or ", ".join(layer.name for layer in self.layers)

    def check_one_picture(self) -> None:
        """Raises
        ------
        InputError
            For two eyes that are not mixed into one picture.
        """
        if self.stereo not in ("none", "anaglyph"):
            raise InputError(
                f"a window shows one picture at a time, not '{self.stereo}': give --stereo none or anaglyph, or --out "
                "FOLDER to write both"
            )

    def renderer(self, device: Device, display: Display, quilts: Sequence[Quilt] | None = None) -> Renderer:
        """The layers on a display; the caller closes it."""
        return Renderer(
            device, display, self.layers, whole=self.display, eye_m=self.eye_m, stereo=self.stereo,
            background=self.background, quilts=quilts,
        )  # fmt: skip

    def frame(
        self,
        display: Display,
        time_s: float,
        viewers: Sequence[Viewer],
        *,
        number: int = 0,
        turn: Turn = STILL,
        overlay: bool | None = None,
        paused: bool = False,
    ) -> FrameState:
        """The message of a frame.

        Parameters
        ----------
        display
            That it is drawn on, unless this is a part of a whole.
        turn
            What hands have done to what stands behind the display.
        overlay
            Whether overlays are shown, whatever the layers say.
        paused
            Whether time stands still: then nothing moves.
        """
        whole = self.display or display
        states = tuple(
            self._state(layer, layer.turned(layer.state(time_s, whole), turn, whole), overlay, paused)
            for layer in self.layers
        )
        pointers = tuple(self.pointers(viewers[0].time_s if viewers else time_s))
        people = tuple(viewer.at_rest for viewer in viewers) if paused else tuple(viewers)
        return FrameState(number=number, time_s=time_s, viewers=people, pointers=pointers, layers=states)

    def _layer(self, shown: Showable) -> Layer:
        """A layer as it is, or one of content, which is closed with the show if it was opened for it."""
        content: Any = open_content(shown) if isinstance(shown, str | Path) else shown
        if content is not shown and hasattr(content, "close"):
            self._opened.callback(content.close)
        return layer_of(content)

    def _state(self, layer: Layer, state: LayerState, overlay: bool | None, paused: bool) -> LayerState:
        if overlay is not None:
            state = msgspec.structs.replace(state, overlay=layer.overlay_word if overlay else "")
        return msgspec.structs.replace(state, motion=None) if paused else state


def summary(report: FrameReport) -> str:
    """What a frame shows, for people: how many panels, and of what how much."""
    parts = [f"{max(row.panels_active for row in report.layers)} panels"] if report.layers else []
    for row in report.layers:
        if row.kind == "image":
            parts.append(f"{row.items:,} pages")
        else:
            parts.append(f"{row.drawn:,} {'splats' if row.kind == 'points' else 'triangles'}")
    return ", ".join(parts) + (f", {report.missing} coming" if report.missing else "")
