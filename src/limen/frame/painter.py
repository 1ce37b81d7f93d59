"""From what layers show in a quilt to its picture: all of them in one target, matched panels, both eyes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.frame.matching import PanelMatching
from limen.frame.shown import Piece
from limen.frame.stereo import Anaglyph
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.gpu.targets import QUILT_FORMAT, Rgb, Target, Targets
from limen.viewing.choices import Stereo
from limen.viewing.projection import QuiltView

__all__ = ["Drawn", "Painter"]


class Drawn(NamedTuple):
    """A quilt of a frame that was submitted."""

    texture: Any  # None where a target was given
    ms: float
    of_layers: tuple[tuple[float, int], ...]
    """Of each layer: its share of the milliseconds, and triangles that its cut does not tell of."""


class Painter:
    """Draws quilts, into textures that it keeps or into targets.

    Parameters
    ----------
    stereo
        See `limen.frame.renderer.Renderer`.
    background
        Linear light (red, green, blue) where nothing is drawn.
    """

    def __init__(self, device: Device, stereo: Stereo, background: Rgb) -> None:
        self._device, self._background = device, background
        self._matching, self._targets, self._reader = PanelMatching(device), Targets(device), TextureReader(device)
        self._anaglyph = Anaglyph(device) if stereo == "anaglyph" else None

    def draw(
        self,
        pieces: Sequence[Piece],
        views: Sequence[QuiltView],
        first: int,
        *,
        target: Any = None,
        target_format: str = QUILT_FORMAT,
        slot: int = 0,
        wait: bool = False,
    ) -> Drawn:
        """One quilt.

        Parameters
        ----------
        views
            Of the quilt: one with all its eyes, or one for each eye.
        first
            Which of the pieces' parts is the first view's.
        target
            A texture view to draw into (a window's), of ``target_format`` and the size of what is shown.
        slot
            Quilts of one size are drawn over each other, unless they are given numbers of their own.
        wait
            For the GPU, to know how many triangles all layers had.
        """
        begin = time.perf_counter()
        direct = target if self._anaglyph is None and len(views) == 1 else None
        canvas_slot = slot if len(views) == 1 else _EYE_SLOT
        spent, triangles = np.zeros(len(pieces)), np.zeros(len(pieces), np.int64)
        texture = None
        for number, view in enumerate(views):
            texture = self._view(pieces, view, first + number, (direct, target_format, canvas_slot), spent)
            triangles += np.array([piece.shown.drawer.triangles(wait=wait) for piece in pieces], np.int64)
            if len(views) == 2:
                texture = self._beside(texture, number, target_format, slot)
        if self._anaglyph is not None:
            texture = self._anaglyph.draw(texture, target=target, target_format=target_format, slot=slot)
        total_ms = (time.perf_counter() - begin) * 1e3
        shares = spent + (total_ms - spent.sum()) / max(len(pieces), 1)
        return Drawn(texture, total_ms, tuple(zip(shares.tolist(), triangles.tolist(), strict=True)))

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A drawn quilt's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._reader.read(texture)

    def destroy(self) -> None:
        """Free everything."""
        for part in (self._matching, self._targets, self._reader, self._anaglyph):
            if part is not None:
                part.destroy()

    def _view(
        self,
        pieces: Sequence[Piece],
        view: QuiltView,
        part: int,
        into: tuple[Any, str, int],
        spent_ms: NDArray[np.float64],
    ) -> Any:
        """Submit one view with all layers: by their depth, and what lies on panels where nothing else is seen."""
        target, target_format, slot = into
        texture, alone = None, len(pieces) == 1
        if target is None:
            texture, canvas = self._targets.target(
                view.size_px, target_format, slot=slot, background=self._background, alone=alone
            )
        else:
            canvas = Target(self._targets, target, target_format, view.size_px, self._background, alone=alone)
        in_order = sorted(range(len(pieces)), key=lambda number: pieces[number].shown.kind.on_panels)
        for number in in_order:
            begin, piece = time.perf_counter(), pieces[number]
            piece.shown.drawer.prepare(view, piece.cut.parts[part], piece.state.overlay)
            spent_ms[number] += (time.perf_counter() - begin) * 1e3
        encoder = self._device.wgpu.create_command_encoder(label="frame")
        for number in in_order:
            begin, piece = time.perf_counter(), pieces[number]
            piece.shown.drawer.draw(encoder, canvas, view, piece.cut.parts[part], piece.state.overlay)
            spent_ms[number] += (time.perf_counter() - begin) * 1e3
        canvas.finish(encoder)
        self._matching.record(encoder, view.panels, view.eyes_m, canvas.view, target_format)
        self._device.wgpu.queue.submit([encoder.finish()])
        return texture

    def _beside(self, texture: Any, number: int, target_format: str, slot: int) -> Any:
        """One eye's picture in that of both, which is twice as wide."""
        width, height = texture.size[0], texture.size[1]
        both = self._targets.texture((2 * width, height), target_format, slot)
        encoder = self._device.wgpu.create_command_encoder(label="one of two eyes")
        encoder.copy_texture_to_texture(
            {"texture": texture}, {"texture": both, "origin": (number * width, 0, 0)}, (width, height, 1)
        )
        self._device.wgpu.queue.submit([encoder.finish()])
        return both


_EYE_SLOT = -1
"""Of the texture that one eye of two is drawn into, before it is copied beside the other's."""
