"""One frame of a show: select -> ask -> resolve -> draw -> present, for all its layers together.

`Renderer` shows layers on one display. A live `Renderer.frame` never waits: what has not come yet is drawn from coarser
chunks. `Renderer.pictures` is for files and tests: it waits until all is there, and is a function of the message and
the data alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pack, pieces, quilt_names
from limen.errors import InputError
from limen.frame.painter import Drawn, Painter
from limen.frame.report import FrameReport, Picture
from limen.frame.shown import Piece, Shown
from limen.frame.simulator import DisplaySimulator
from limen.geometry import Vec3
from limen.gpu.device import Device
from limen.gpu.targets import QUILT_FORMAT, Rgb
from limen.layers.base import Layer
from limen.layers.registry import Kind, check_state, kind_of
from limen.viewing.camera import Camera
from limen.viewing.choices import STEREOS, Stereo
from limen.viewing.projection import QuiltPanels, QuiltView, check_quilt_sizes, guard_of
from limen.viewing.state import FrameState, LayerState

__all__ = ["BACKGROUND", "GPU_BYTES", "Chosen", "Renderer"]

BACKGROUND: Rgb = (0.006, 0.007, 0.01)
"""Linear light where nothing is drawn: a dark slate, from which the display's shape still shows."""

_RIM_PX = 0.01
"""A pixel whose centre is on its panel's outline is dimmed with the panel."""

GPU_BYTES = 512 << 20
"""Memory for chunks of all layers on the GPU, unless told otherwise."""


class Chosen(NamedTuple):
    """What a frame shows on some quilts, before it is drawn."""

    frame: FrameState
    views: tuple[QuiltView, ...]
    """One or, where eyes are drawn apart, two for each quilt."""
    pieces: tuple[Piece, ...]


class Renderer:
    """Layers on a display: one frame after another.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, layers
        What is shown, and on what.
    whole
        The installation that ``display`` is a part of, which says where things lie; by default itself.
    eye_m
        The eye that pictures are drawn for, whoever stands where; by default the first viewer's.
    stereo
        ``none``: one eye, midway between the two. ``anaglyph``: red of the left eye, cyan of the right.
        ``side-by-side``: pictures of twice the width. ``sequential``: two pictures, the left eye's first.
    background
        Linear light (red, green, blue) where nothing is drawn; by default `BACKGROUND`, and black beside images alone.
    quilts
        How panels are arranged in images; by default as the display's file says, else packed.
    gpu_bytes
        Memory for chunks of all layers on the GPU.
    threads
        Reading threads of every source of chunks; by default one a core, two at least.
    max_quilt_px
        Most pixels drawn at once; a display that has more is drawn in several quilts.

    Raises
    ------
    InputError
        For a stereo or a placement that cannot be.
    DeviceLimitError, DisplayError
        If the adapter cannot hold what is asked for or draw a panel.
    FormatError
        If a content's coarsest chunks cannot be read.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        layers: Sequence[Layer],
        *,
        whole: Display | None = None,
        eye_m: Vec3 | None = None,
        stereo: Stereo = "none",
        background: Rgb | None = None,
        quilts: Sequence[Quilt] | None = None,
        gpu_bytes: int = GPU_BYTES,
        threads: int | None = None,
        max_quilt_px: int | None = None,
    ) -> None:
        self._device, self.display, self.whole = device, display, whole or display
        self.layers, self.stereo, self._eye_m = tuple(layers), stereo, eye_m
        kinds = [kind_of(layer) for layer in layers]
        _check_together(self.layers, kinds, stereo)
        # Kinds that cannot draw both eyes at once are drawn for one after the other, and all others with them.
        self._apart = stereo != "none" and not all(kind.both_eyes for kind in kinds)
        self._eyes = 1 if stereo == "none" else 2
        self._max_quilt_px = max_quilt_px or min(kind.max_quilt_px for kind in kinds)
        # What lies on panels ends at their outlines: they may touch in quilts, for nothing is drawn beyond.
        self._touching = on_panels = all(kind.on_panels for kind in kinds)
        self._rim_px = _RIM_PX if on_panels else 0.0
        self.quilts: Sequence[Quilt] = quilts or display.quilts or self._packed(display)
        check_quilt_sizes(self.quilts, device.max_texture_px, self._eyes)
        self._panels: dict[Quilt, QuiltPanels] = {}
        # On a surface that is unrolled, what lies between panels is no part of any.
        apart = not (on_panels and quilts)
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts) if apart else 0.0
        self._painter = Painter(device, stereo, background or ((0.0, 0.0, 0.0) if on_panels else BACKGROUND))
        self._shown: list[Shown] = []
        shares = max(sum(kind.memory_share for kind in kinds), 1.0)
        try:
            for layer, kind in zip(layers, kinds, strict=True):
                self._shown.append(
                    Shown.of(
                        device, layer, display, self.whole, gpu_bytes=int(gpu_bytes * kind.memory_share / shares),
                        threads=threads, quilts=len(self.quilts),
                    )
                )  # fmt: skip
        except BaseException:
            self.close()
            raise

    # ------------------------------------------------------------------ live

    def state(self, time_s: float, **more: Any) -> FrameState:
        """The message of a frame in which all layers are where they are at a time; ``more``: its other fields."""
        states = tuple(layer.state(time_s, self.whole) for layer in self.layers)
        return FrameState(time_s=time_s, layers=states, **more)

    def frame(
        self, frame: FrameState, *, target: Any = None, target_format: str = QUILT_FORMAT, now_s: float | None = None
    ) -> FrameReport:
        """Draw what is there, ask for what is missing, and return at once.

        Parameters
        ----------
        target
            A texture view to draw the one quilt into (a window's), of ``target_format`` and its size; by default
            quilts are drawn into textures that nobody sees.
        now_s
            The time that chunks fade in by; by default the computer's clock.
        """
        chosen = self.choose(frame, now_s=now_s)
        drawn = [
            self._draw(chosen, number, target=target, target_format=target_format) for number in range(len(self.quilts))
        ]
        return self.report(chosen, drawn)

    def choose(self, frame: FrameState, *, now_s: float | None = None) -> Chosen:
        """The first half of a live frame: what all quilts show, of what is there; what is missing is asked for."""
        now_s = time.perf_counter() if now_s is None else now_s
        return self._chosen(frame, self.quilts, now_s)

    def draw(self, chosen: Chosen, number: int, *, target: Any = None, target_format: str = QUILT_FORMAT) -> Drawn:
        """The second half: one of the quilts, by its number."""
        return self._draw(chosen, number, target=target, target_format=target_format)

    def textures(self, frame: FrameState, *, now_s: float | None = None) -> tuple[list[Any], FrameReport]:
        """The textures of all quilts as they are lit live; valid until the next frame.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        """
        self._check_one_picture()
        chosen = self.choose(frame, now_s=now_s)
        drawn = [self._draw(chosen, number, slot=number) for number in range(len(self.quilts))]
        return [each.texture for each in drawn], self.report(chosen, drawn)

    # ------------------------------------------------------------------ complete

    def pictures(
        self, frame: FrameState, *, panels: Sequence[int] | None = None, by: Literal["panels", "quilts"] = "panels"
    ) -> Iterator[Picture]:
        """Finished pictures, quilt by quilt: of every panel, or of every quilt as it is drawn.

        Waits for all that is wanted; pixels are only valid until the next picture is asked for. With the stereo
        ``side-by-side`` a panel's picture is of twice the width; with ``sequential`` there are two, ``name@left`` and
        ``name@right``. Quilts are named by their output or their number; two eyes that are not mixed lie side by side.

        Parameters
        ----------
        panels
            Only those of these numbers, in quilts of their own.
        """
        quilts = self.quilts if panels is None else self._packed(self.display, panels)
        for name, quilt in zip(quilt_names(quilts), quilts, strict=True):
            texture, report = self._finished(frame, quilt)
            pixels = self._painter.read(texture)
            if by == "quilts":
                yield Picture(name, pixels, report)
            else:
                yield from (Picture(part, picture, report) for part, picture in self._cut_up(quilt, pixels))

    def seen(self, frame: FrameState, cameras: Sequence[Camera]) -> list[NDArray[np.uint8]]:
        """What cameras in the room see of the lit display: uint8 (H, W, 4), sRGB, each.

        A camera at the viewer's eye sees what stands behind panels; from anywhere else it sees it bent.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        DeviceLimitError
            If the quilts do not fit the adapter's memory at once.
        """
        self._check_one_picture()
        textures = [self._finished(frame, quilt, slot)[0] for slot, quilt in enumerate(self.quilts)]
        lit = DisplaySimulator(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def report(self, chosen: Chosen, drawn: Sequence[Drawn]) -> FrameReport:
        """What a frame took whose quilts were drawn like this."""
        eyes, rows = 2 if self._apart else 1, []
        for number, piece in enumerate(chosen.pieces):
            shares = [each.of_layers[number] for each in drawn]
            rows.append(piece.report(sum(ms for ms, _ in shares), sum(count for _, count in shares), eyes))
        return FrameReport(chosen.frame.number, chosen.frame.time_s, self.display.scale, tuple(rows))

    def close(self) -> None:
        """Stop reading and free the GPU memory; the device and the contents stay open."""
        for shown in self._shown:
            shown.close()
        self._shown.clear()
        self._painter.destroy()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of a frame

    def _packed(self, display: Display, panels: Sequence[int] | None = None) -> Sequence[Quilt]:
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        max_size_px, max_px = self._device.max_texture_px // self._eyes, self._max_quilt_px // self._eyes
        if self._touching:
            return pack(display, max_size_px=max_size_px, max_px=max(max_px, widest), panels=panels)
        return pack_outlines(display, max_size_px=max_size_px, max_px=max(max_px, 2 * widest), panels=panels)

    def _panels_of(self, quilt: Quilt) -> QuiltPanels:
        if quilt not in self._panels:
            guard_px = self.guard_px if quilt in self.quilts else guard_of(self.display, quilt)
            copies = 1 if self._apart else self._eyes
            self._panels[quilt] = QuiltPanels(self.display, quilt, copies, max(guard_px, self._rim_px))
        return self._panels[quilt]

    def _visible(self, frame: FrameState) -> list[tuple[Shown, LayerState]]:
        """Layers that are drawn, with their states.

        Raises
        ------
        InputError
            If there are more or fewer states than layers, or one that its kind cannot be in.
        """
        if len(frame.layers) != len(self._shown):
            raise InputError(f"a frame of {len(frame.layers)} layers is drawn by a renderer of {len(self._shown)}")
        visible = [(shown, state) for shown, state in zip(self._shown, frame.layers, strict=True) if state.visible]
        for shown, state in visible:
            check_state(shown.kind, state)
            if not shown.kind.on_panels and not frame.viewers and self._eye_m is None:
                raise InputError(f"{shown.kind.noun} is drawn for somebody's eyes: give a viewer")
        return visible

    def _views(self, frame: FrameState, quilts: Sequence[Quilt]) -> tuple[QuiltView, ...]:
        """Quilts as the eyes that they are drawn for see them."""
        first = frame.viewers[0] if frame.viewers else None
        eyes_m: list[Any] = []
        if self._eye_m is not None:
            eyes_m = [self._eye_m] * self._eyes
        elif first is not None:
            eyes_m = [first.position_m] if self._eyes == 1 else list(first.eyes_m)
            eyes_m *= self._eyes // len(eyes_m)
        looking = first.direction if first is not None else (0.0, 0.0, -1.0)
        seen_by = [[eye_m] for eye_m in eyes_m] if self._apart else [eyes_m]
        return tuple(QuiltView.of(self._panels_of(quilt), eyes, looking) for quilt in quilts for eyes in seen_by)

    def _chosen(self, frame: FrameState, quilts: Sequence[Quilt], now_s: float | None) -> Chosen:
        """What quilts show: of what is there at a time, or of all, waiting for it."""
        views, pieces = self._views(frame, quilts), []
        for shown, state in self._visible(frame):
            begin, live = time.perf_counter(), now_s is not None
            policy = shown.throttle.within(state.policy) if live else state.policy.timeless
            if not live:
                shown.selector.complete(state)
            timed = msgspec.structs.replace(state, policy=policy)
            cut = shown.selector.select(views, timed, frame, shown.resident, live=live)
            selected = time.perf_counter()
            missing, uploads = shown.complete(cut.wanted) if now_s is None else shown.ask(cut, now_s)
            cut = shown.resolve(cut)
            clock = (selected - begin) * 1e3, (time.perf_counter() - selected) * 1e3
            pieces.append(Piece(shown, state, cut, missing, uploads, *clock))
        # Depth means the same to all layers: each view begins where the nearest of them does.
        begins = [min((piece.cut.near_m[number] for piece in pieces), default=np.inf) for number in range(len(views))]
        begun = [
            view if near_m == np.inf else view.beginning_at(near_m) for view, near_m in zip(views, begins, strict=True)
        ]
        return Chosen(frame, tuple(begun), tuple(pieces))

    def _finished(self, frame: FrameState, quilt: Quilt, slot: int = 0) -> tuple[Any, FrameReport]:
        """One quilt with all there that it wants and that can be read: its texture, and what it took."""
        chosen = self._chosen(frame, [quilt], None)
        drawn = self._draw(chosen, 0, slot=slot, wait=True)
        return drawn.texture, self.report(chosen, [drawn])

    def _draw(self, chosen: Chosen, number: int, **into: Any) -> Drawn:
        """One quilt, into a target or a texture of its own: see `Painter.draw`."""
        if into.get("target") is not None and self._apart:
            self._check_one_picture()
        eyes = 2 if self._apart else 1
        begin = time.perf_counter()
        views = chosen.views[number * eyes : (number + 1) * eyes]
        drawn = self._painter.draw(chosen.pieces, views, number * eyes, **into)
        timed = [piece for piece in chosen.pieces if piece.state.policy.max_ms is not None]
        if timed:  # what drawing took, to the end, for policies that spend a frame's time
            self._device.wait()
            spent_ms = (time.perf_counter() - begin) * 1e3
            for piece in timed:
                chosen_ms = piece.select_ms * eyes / len(chosen.views)
                piece.shown.throttle.spent(piece.state.policy, spent_ms + chosen_ms)
        return drawn

    def _cut_up(self, quilt: Quilt, image: NDArray[np.uint8]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
        """Every panel's picture in that of a quilt."""
        if self.stereo in ("none", "anaglyph"):
            yield from pieces(self.display, quilt, image).items()
            return
        width = quilt.size_px[0]
        lefts, rights = (pieces(self.display, quilt, half) for half in (image[:, :width], image[:, width:]))
        for name, left in lefts.items():
            if self.stereo == "side-by-side":
                yield name, np.concatenate([left, rights[name]], axis=1)
            else:
                yield f"{name}@left", left
                yield f"{name}@right", rights[name]

    def _check_one_picture(self) -> None:
        if self.stereo not in ("none", "anaglyph"):
            raise InputError(f"'{self.stereo}' shows two pictures at once; simulate it with 'none' or 'anaglyph'")


def _check_together(layers: Sequence[Layer], kinds: Sequence[Kind], stereo: Stereo) -> None:
    """Raises InputError for what layers cannot be shown as, or not together."""
    if not layers:
        raise InputError("nothing is to be shown: give a layer")
    if stereo not in STEREOS:
        raise InputError(f"no stereo is named '{stereo}': there are {', '.join(STEREOS)}")
    if stereo != "none" and all(kind.on_panels for kind in kinds):
        raise InputError(f"{kinds[0].noun} lies on the panels, alike for both eyes: leave out the stereo '{stereo}'")
    for layer, kind in zip(layers, kinds, strict=True):
        alone = layer.alone_because
        if alone and len(layers) > 1:
            raise InputError(f"{kind.noun} beside other layers {alone}")
