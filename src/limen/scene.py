"""One frame of a three-dimensional scene: view -> sort -> draw -> present.

`SceneRenderer` shows one mesh, as through windows, on all panels of a display to one viewer. A plain window is a
display with one panel.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limen.camera import Camera
from limen.data.mesh import Mesh
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pieces
from limen.draw.eyes import Anaglyph
from limen.draw.lit import LitDisplay
from limen.draw.scene import Depth, SceneLayer, SceneOverlay
from limen.errors import DeviceLimitError, InputError
from limen.geometry import Floats
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.placement import mesh_in_room
from limen.view import Windows, guard_of
from limen.viewer import Viewer

__all__ = ["BACKGROUND", "STEREOS", "SceneRenderer", "SceneReport", "Stereo"]

Stereo: TypeAlias = Literal["none", "anaglyph", "side-by-side", "sequential"]
STEREOS: tuple[Stereo, ...] = get_args(Stereo)

BACKGROUND = (0.006, 0.007, 0.01)
"""Linear light of an empty scene: a dark slate, from which the display's shape still shows."""

_QUILT_PX = 1 << 26
"""Pixels of one offscreen quilt: 268 MB, and as much for depth."""


@dataclass(frozen=True, slots=True)
class SceneReport:
    """What one frame took."""

    time_s: float
    panels_active: int
    triangles: int
    sort_ms: float
    draw_ms: float

    @property
    def drawn(self) -> str:
        return f"{self.triangles:,} triangles"

    @classmethod
    def of(cls, quilts: Sequence[SceneReport]) -> SceneReport:
        """One report for all quilts of a frame."""
        parts = ("panels_active", "triangles", "sort_ms", "draw_ms")
        return cls(quilts[0].time_s, *(sum(getattr(report, part) for report in quilts) for part in parts))


class _Drawn(NamedTuple):
    quilt: Quilt
    texture: Any  # None where a target was given
    report: SceneReport


class SceneRenderer:
    """One mesh on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, mesh
        What is shown, and on what.
    room_from_mesh
        Affine map from the mesh's coordinates to the room, metres: shape (4, 4). By default it stands where
        `limen.placement.mesh_in_room` puts it.
    stereo
        ``none``: one eye, midway between the two. ``anaglyph``: red of the left eye, cyan of the right.
        ``side-by-side``: pictures of twice the width. ``sequential``: two pictures, the left eye's first.
    depth
        See `limen.draw.scene.SceneLayer.draw`.
    background
        Linear light (red, green, blue) where nothing is drawn.
    max_quilt_px
        Most pixels drawn at once; a display that has more is drawn in several quilts.

    Raises
    ------
    InputError
        For a ``room_from_mesh`` or a stereo that cannot be.
    DeviceLimitError, DisplayError
        If the adapter cannot hold the mesh or draw a panel.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        mesh: Mesh,
        *,
        room_from_mesh: Floats | None = None,
        stereo: Stereo = "none",
        depth: Depth = "panel",
        background: tuple[float, float, float] = BACKGROUND,
        max_quilt_px: int = _QUILT_PX,
        clip: bool = True,
    ) -> None:
        if stereo not in STEREOS:
            raise InputError(f"no stereo is named '{stereo}': there are {', '.join(STEREOS)}")
        self.display, self.stereo, self._depth = display, stereo, depth
        stands = (
            mesh_in_room(mesh.bounds, display) if room_from_mesh is None else np.asarray(room_from_mesh, dtype=float)
        )
        if stands.shape != (4, 4) or not np.isfinite(stands).all():
            raise InputError(f"a mesh is placed by finite numbers of the shape (4, 4), not {stands.shape}")
        self.room_from_mesh: Floats = stands
        self._copies = copies = 1 if stereo == "none" else 2
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self.quilts: Sequence[Quilt] = display.quilts or pack_outlines(
            display, max_size_px=device.max_texture_px // copies, max_px=max(max_quilt_px // copies, 2 * widest)
        )
        _check_sizes(self.quilts, copies, device.max_texture_px)
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts)
        self._windows = {quilt: Windows(display, quilt, copies, self.guard_px) for quilt in self.quilts}
        self._device = device
        self._layer = SceneLayer(device, mesh, background=background, clip=clip)
        self._anaglyph = Anaglyph(device) if stereo == "anaglyph" else None
        self._reader = TextureReader(device)

    def move(self, mesh: Mesh) -> None:
        """The same triangles with other places and normals: what the next frames show."""
        self._layer.move(mesh)

    def frame(
        self,
        viewer: Viewer,
        *,
        quilt: Quilt | None = None,
        overlay: SceneOverlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
    ) -> SceneReport:
        """Draw what the viewer is to see, into the renderer's own textures or into ``target``.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface).
        """
        chosen = [quilt] if quilt else self.quilts
        drawn = [self._draw(each, viewer, overlay, target, target_format) for each in chosen]
        return SceneReport.of([each.report for each in drawn])

    def pictures(
        self, viewer: Viewer, *, overlay: SceneOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], SceneReport]]:
        """Every panel's picture, quilt by quilt: (name, uint8 (h, w, 4) sRGB, the quilt's report).

        With ``side-by-side`` a picture is (h, 2 w, 4); with ``sequential`` there are two, named ``name@left`` and
        ``name@right``. An array is only valid until the next is asked for.
        """
        for quilt in self.quilts:
            drawn = self._draw(quilt, viewer, overlay)
            image = self._reader.read(drawn.texture)
            if self.stereo in ("none", "anaglyph"):
                for name, picture in pieces(self.display, quilt, image).items():
                    yield name, picture, drawn.report
                continue
            width = quilt.size_px[0]
            lefts, rights = (pieces(self.display, quilt, half) for half in (image[:, :width], image[:, width:]))
            for name, left in lefts.items():
                if self.stereo == "side-by-side":
                    yield name, np.concatenate([left, rights[name]], axis=1), drawn.report
                else:
                    yield f"{name}@left", left, drawn.report
                    yield f"{name}@right", rights[name], drawn.report

    def quilt_pictures(
        self, viewer: Viewer, *, overlay: SceneOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], SceneReport]]:
        """Every quilt as it is drawn, named by its output or its number: (name, uint8 (H, W, 4) sRGB, report).

        Two eyes that are not mixed lie side by side. An array is only valid until the next is asked for.
        """
        for number, quilt in enumerate(self.quilts):
            drawn = self._draw(quilt, viewer, overlay)
            yield quilt.output or f"quilt-{number}", self._reader.read(drawn.texture), drawn.report

    def seen(
        self, viewer: Viewer, cameras: Sequence[Camera], *, overlay: SceneOverlay | None = None
    ) -> list[NDArray[np.uint8]]:
        """What cameras in the room see of the display while it is lit for a viewer: uint8 (H, W, 4), sRGB, each.

        A camera at the viewer's eye sees the scene; from anywhere else it sees the scene bent.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        """
        textures, _ = self.lit_for(viewer, overlay=overlay)
        lit = LitDisplay(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def lit_for(self, viewer: Viewer, *, overlay: SceneOverlay | None = None) -> tuple[list[Any], SceneReport]:
        """The textures of all quilts as they are lit for a viewer; valid until the next frame.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        DeviceLimitError
            If the quilts do not fit the adapter's memory at once.
        """
        if self.stereo not in ("none", "anaglyph"):
            raise InputError(f"'{self.stereo}' shows two pictures at once; simulate it with 'none' or 'anaglyph'")
        drawn = [self._draw(quilt, viewer, overlay, keep=True) for quilt in self.quilts]
        return [each.texture for each in drawn], SceneReport.of([each.report for each in drawn])

    def close(self) -> None:
        """Free the GPU memory; the device stays open."""
        self._layer.destroy()
        self._reader.destroy()
        if self._anaglyph is not None:
            self._anaglyph.destroy()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of a frame

    def _draw(
        self,
        quilt: Quilt,
        viewer: Viewer,
        overlay: SceneOverlay | None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        *,
        keep: bool = False,
    ) -> _Drawn:
        """``keep``: in a texture of its own, that other quilts of the same size do not draw over."""
        begin = time.perf_counter()
        windows = self._windows.get(quilt)
        if windows is None:
            windows = self._windows[quilt] = Windows(self.display, quilt, self._copies, guard_of(self.display, quilt))
        eyes_m = self._eyes(viewer)
        forward = np.repeat(np.array([viewer.direction]), len(eyes_m), axis=0)
        triangles = self._layer.sort(windows, eyes_m, self.room_from_mesh, forward=forward)
        sorted_at = time.perf_counter()
        direct = target if self._anaglyph is None else None
        slot = list(self.quilts).index(quilt) if keep else 0
        texture = self._layer.draw(
            windows, depth=self._depth, overlay=overlay, target=direct, target_format=target_format, slot=slot
        )
        if self._anaglyph is not None:
            texture = self._anaglyph.draw(texture, target=target, target_format=target_format, slot=slot)
        active = int(windows.facing(eyes_m[0]).sum())
        clock = (sorted_at - begin, time.perf_counter() - sorted_at)
        return _Drawn(quilt, texture, SceneReport(viewer.time_s, active, triangles, clock[0] * 1e3, clock[1] * 1e3))

    def _eyes(self, viewer: Viewer) -> Floats:
        if self.stereo == "none":
            return np.array([viewer.position_m])
        eyes = viewer.eyes_m
        return eyes if len(eyes) == 2 else np.repeat(eyes, 2, axis=0)


def _check_sizes(quilts: Sequence[Quilt], copies: int, max_texture_px: int) -> None:
    """Quilts that limen packs fit the adapter; those of a display's own mapping may not."""
    for number, quilt in enumerate(quilts):
        width, height = quilt.size_px[0] * copies, quilt.size_px[1]
        if max(width, height) > max_texture_px:
            raise DeviceLimitError(
                f"quilt '{quilt.output or number}' of the display's own mapping is {width} x {height} px for {copies} "
                f"eye(s), this adapter holds {max_texture_px} px a side: map its panels to several quilts, or to none"
            )
