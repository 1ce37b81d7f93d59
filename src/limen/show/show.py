"""What is shown, on whatever display: layers, and what all of them have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

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
from limen.layers.image.layer import ImageLayer
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
    from limen.show.canvas import Backend
    from limen.show.views import ViewName

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
        """The show of a show file; see docs/guide/shows.md.

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
        view: ViewName | None = None,
        backend: Backend = "window",
        overlay: bool | None = None,
        seconds: float | None = None,
        port: int = 0,
        say: Callable[[str], None] = print,
    ) -> FrameReport | None:
        """Show it live until its windows are closed; the last frame's report.

        Parameters
        ----------
        viewers
            Who looks at a time, or who stands where at first and is led around by dragging; by default somebody who
            stands before the display.
        view
            ``eye``: what the first viewer's eye sees of the simulated display. ``unrolled``: its panels side by side.
            ``outputs``: every quilt of the display on the screen that it is named after. By default images alone are
            unrolled. Without a display, the window is one.
        backend
            ``window``; ``browser``: a page for browsers on this machine, whose address is said; ``offscreen``: nothing
            that is seen.
        overlay
            Whether overlays are shown at first; by default as the layers say.
        seconds
            Close it after this long.
        port
            Of the page; 0 takes a free one.
        say
            Told once what keys do.

        Raises
        ------
        DeviceError
            If there is no screen.
        InputError
            For what cannot be shown in this way.
        """
        from limen.show.app import run_show  # which runs shows

        if view == "outputs" and self.display is None:
            raise InputError("outputs are a display's: give Show a display")
        return run_show(
            self, self.display, self._who(viewers), say, view=view, backend=backend, overlay=overlay, seconds=seconds,
            port=port,
        )  # fmt: skip

    def widget(
        self,
        viewers: Viewer | Tour | None = None,
        *,
        view: ViewName | None = None,
        size_px: tuple[int, int] = (960, 540),
    ) -> Any:
        """A widget that shows it live in a Jupyter notebook; leave it as a cell's last line.

        Parameters
        ----------
        viewers, view
            As of `run`.
        size_px
            Of the cell, in its pixels.

        Raises
        ------
        DeviceError
            If the package jupyter_rfb is missing.
        InputError
            For what cannot be shown in this way.
        """
        from limen.show.app import show_widget

        return show_widget(self, self.display, self._who(viewers), view=view, size_px=size_px)

    @property
    def name(self) -> str:
        return self.title or ", ".join(layer.name for layer in self.layers)

    @property
    def stands(self) -> Viewer:
        """Where somebody stands who is not tracked: before the display, or the window."""
        return standing_viewer(self.display) if self.display else Viewer((0.0, 0.0, 0.0))

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

    def renderer(
        self, device: Device, display: Display, quilts: Sequence[Quilt] | None = None, *, quick: bool = False
    ) -> Renderer:
        """The layers on a display; the caller closes it.

        ``quick``: without a GPU, images are sampled more quickly, if not as well.
        """
        layers = [_quickly(layer) for layer in self.layers] if quick and device.is_software else self.layers
        return Renderer(
            device, display, layers, whole=self.display, eye_m=self.eye_m, stereo=self.stereo,
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

    def _who(self, viewers: Viewer | Tour | None) -> Viewer | Tour:
        return self.stands if viewers is None else viewers

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


def _quickly(layer: Layer) -> Layer:
    """The same layer with bilinear sampling, if it is one that is sampled."""
    return replace(layer, sampling="fast") if isinstance(layer, ImageLayer) else layer


def summary(report: FrameReport) -> str:
    """What a frame shows, for people: how many panels, and of what how much."""
    parts = [f"{max(row.panels_active for row in report.layers)} panels"] if report.layers else []
    for row in report.layers:
        if row.kind == "image":
            parts.append(f"{row.items:,} pages")
        else:
            parts.append(f"{row.drawn:,} {'splats' if row.kind == 'points' else 'triangles'}")
    return ", ".join(parts) + (f", {report.missing} coming" if report.missing else "")
