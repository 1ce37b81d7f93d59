"""A live picture in a window: an image as a viewer browses it, or a whole display unrolled while people walk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport
from limen.gpu.device import Device, open_device
from limen.layers.image.layer import ImageLayer
from limen.show.show import Tour
from limen.show.window import Surface, open_canvas, run_together
from limen.viewing.lens import Lens
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import FrameState
from limen.viewing.viewer import Pointer, Viewer, nobody_points

__all__ = ["run_live", "unrolled_quilt"]

_SIZE = (1440, 810)
_ZOOM_STEP = 1.2
_LENS_STEP = 1.25
_LENS_SHARE = 0.25
_HELP = "o overlay   p policy   l lens, + - [ ] its power and size   space pause   0 fit   q close"


def unrolled_quilt(display: Display, size_px: tuple[int, int]) -> tuple[Display, Quilt]:
    """A display scaled to a window, and a quilt with its panels where they lie on the unrolled surface."""
    surface = display.surface
    pitch = display.panels[0].pitch_m[0]
    px_per_m = min(size_px[0] / surface.width, size_px[1] / surface.height)
    shown = display.scaled(min(1.0, px_per_m * pitch))
    arrays = shown.arrays
    corner = (arrays.surface_m - [surface.left, surface.top]) * px_per_m
    margin = (np.array(size_px) - np.array([surface.width, surface.height]) * px_per_m) / 2
    offsets = np.maximum(np.round(corner + margin), 0).astype(int)
    offsets = np.minimum(offsets, np.maximum(np.array(size_px) - arrays.size_px, 0))
    return shown, Quilt(size_px, tuple(range(len(shown.panels))), tuple((int(x), int(y)) for x, y in offsets))


@dataclass(frozen=True, slots=True)
class _HandLens:
    """A lens carried by the pointer; its radius is a share of the window's smaller side."""

    magnification: float = 4.0
    share: float = _LENS_SHARE

    def stronger(self, factor: float) -> _HandLens:
        return replace(self, magnification=min(max(self.magnification * factor, 1.0), 256.0))

    def wider(self, factor: float) -> _HandLens:
        return replace(self, share=min(max(self.share * factor, 0.02), 1.0))


class Live:
    """The state of a window, changed by events and drawn frame by frame."""

    def __init__(
        self,
        device: Device,
        layer: ImageLayer,
        display: Display | None,
        tour: Tour | None,
        pointers: Callable[[float], Sequence[Pointer]] = nobody_points,
    ) -> None:
        placement = layer.placement
        assert isinstance(placement, OnSurface)
        self._device, self._display, self._pointers = device, display, pointers
        self._layer = layer = replace(layer, sampling="fast") if device.is_software else layer
        self._image = layer.image
        self._placement: OnSurface = placement
        self._tour = tour or (lambda _time_s: (Viewer((0.0, 0.0, 0.0)),))
        self._policy, self._overlay = layer.policy, layer.overlay
        self._other = Policy() if self._policy.name == "full" else Policy("full")
        self._toured = tour is not None
        self._hand: _HandLens | None = None
        self._last_hand = _HandLens()
        self._pointer = (0.0, 0.0)
        self._renderer: Renderer | None = None
        self._quilt: Quilt | None = None
        self._size_px = (0, 0)
        self._drag_from: tuple[float, float] | None = None
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.pixel_ratio = 1.0
        self.closed = False
        self.last: FrameReport | None = None

    def draw(self, surface: Surface) -> str:
        """Draw one frame; returns the window's title."""
        if surface.size_px != self._size_px:
            self._resize(surface.size_px)
        assert self._renderer is not None
        if not self._paused:
            self._clock_s += surface.time_s - self._last_s
        self._last_s = surface.time_s
        viewers = list(self._tour(self._clock_s))
        now_s = viewers[0].time_s if self._toured else self._clock_s
        placement = msgspec.structs.replace(self._placement, lenses=self._placement.lenses + self._held())
        shown = replace(self._layer, placement=placement, policy=self._policy, overlay=self._overlay)
        frame = FrameState(
            time_s=now_s, viewers=tuple(viewers), pointers=tuple(self._pointers(now_s)),
            layers=(shown.state(now_s, self._renderer.display),),
        )  # fmt: skip
        self.last = self._renderer.frame(
            frame, target=surface.target, target_format=surface.target_format, now_s=surface.time_s
        )
        (report,) = self.last.layers
        return f"{self._layer.name}   {report.policy}   {report.items} pages, {report.missing} coming   {_HELP}"

    def handle(self, event: dict[str, Any]) -> None:
        match event["event_type"]:
            case "key_down":
                self._key(event["key"])
            case "wheel":
                self._zoom(_ZOOM_STEP ** (-event["dy"] / 100), (event["x"], event["y"]))
            case "pointer_down":
                self._drag_from = (event["x"], event["y"])
            case "pointer_up":
                self._drag_from = None
            case "pointer_move":
                self._point((event["x"], event["y"]))

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _key(self, key: str) -> None:
        match key:
            case "o":
                self._overlay = "" if self._overlay else self._layer.overlay_word
            case "p":
                self._policy, self._other = self._other, self._policy
            case " ":
                self._paused = not self._paused
            case "l":
                self._hold(self._last_hand if self._hand is None else None)
            case "+" | "=" | "-" if self._hand is not None:
                self._hold(self._hand.stronger(_LENS_STEP if key != "-" else 1 / _LENS_STEP))
            case "[" | "]" if self._hand is not None:
                self._hold(self._hand.wider(_LENS_STEP if key == "]" else 1 / _LENS_STEP))
            case "0":
                self._placement = msgspec.structs.replace(self._placement, zoom=1.0, centre=(0.5, 0.5))
            case "q" | "Escape":
                self.closed = True

    def _resize(self, size_px: tuple[int, int]) -> None:
        self.close()
        self._size_px = size_px
        if self._display is None:
            shown = Display.window(size_px)
            self._quilt = Quilt(size_px, (0,), ((0, 0),))
        else:
            shown, self._quilt = unrolled_quilt(self._display, size_px)
        self._renderer = Renderer(self._device, shown, [self._layer], quilts=[self._quilt])

    def _texels_per_pixel(self) -> float:
        assert self._renderer is not None
        return float(self._placement.panel_maps(self._renderer.display, self._image.size_px).scale[0, 0])

    def _point(self, at: tuple[float, float]) -> None:
        """The pointer has moved: it drags the image, or carries the lens."""
        self._pointer = at
        if self._drag_from is not None:
            x, y = self._drag_from
            self._drag_from = at
            self._move(x - at[0], y - at[1])

    def _hold(self, hand: _HandLens | None) -> None:
        self._hand, self._last_hand = hand, hand or self._hand or self._last_hand

    def _from_middle(self, at: tuple[float, float]) -> tuple[float, float]:
        """A place of the window from its middle, in the pixels that events are told in."""
        x, y = (at[axis] - self._size_px[axis] / self.pixel_ratio / 2 for axis in (0, 1))
        return x, y

    def _held(self) -> tuple[Lens, ...]:
        """The lens in the hand, over the pointer."""
        if self._hand is None:
            return ()
        step = self._texels_per_pixel() * self.pixel_ratio
        x, y = (
            share * side + step * away
            for share, side, away in zip(
                self._placement.centre, self._image.size_px, self._from_middle(self._pointer), strict=True
            )
        )
        radius = self._hand.share * min(self._size_px) / self.pixel_ratio * step
        return (Lens((x, y), radius, self._hand.magnification),)

    def _move(self, dx: float, dy: float) -> None:
        """Move the image by a drag, in the pixels that events are told in."""
        step = self._texels_per_pixel() * self.pixel_ratio
        x, y = self._placement.centre
        width, height = self._image.size_px
        centre = (min(max(x + dx * step / width, 0.0), 1.0), min(max(y + dy * step / height, 0.0), 1.0))
        self._placement = msgspec.structs.replace(self._placement, centre=centre)

    def _zoom(self, factor: float, at: tuple[float, float]) -> None:
        """Zoom so that the texel under the pointer stays there."""
        zoom = min(max(self._placement.zoom * factor, 0.5), 4096.0)
        ratio = 1 - self._placement.zoom / zoom
        x, y = self._from_middle(at)
        self._move(x * ratio, y * ratio)
        self._placement = msgspec.structs.replace(self._placement, zoom=zoom)


def run_live(
    layer: ImageLayer,
    display: Display | None,
    tour: Tour | None,
    say: Callable[[str], None],
    *,
    pointers: Callable[[float], Sequence[Pointer]] = nobody_points,
    seconds: float | None = None,
) -> FrameReport | None:
    """Open a window and draw until it is closed; returns the last frame's report.

    Parameters
    ----------
    display
        Shown unrolled; ``None`` makes the window itself the display.
    tour
        Who looks at what time.
    say
        Told once what the keys do.
    pointers
        Who points where, by the viewers' clock.
    seconds
        Close the window after this long.
    """
    with open_device() as device:
        canvas = open_canvas(device.wgpu, _SIZE, layer.name)
        live = Live(device, layer, display, tour, pointers)
        live.pixel_ratio = canvas.pixel_ratio
        say(f"keys: {_HELP}; drag to move, wheel to zoom")
        run_together([canvas], [live.draw], live, seconds=seconds)
        return live.last
