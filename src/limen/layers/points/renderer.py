"""One frame of a cloud of points: tolerance -> select -> stream -> draw -> present.

`PointsRenderer` shows one cloud on all panels of a display, as through windows, to the first viewer; all viewers
together decide how fine it is drawn.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.points.file import Points
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pieces, quilt_names
from limen.errors import InputError
from limen.geometry import Floats
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.common.frame_time import FrameTimeBudget
from limen.layers.common.room_placement import mesh_in_room
from limen.layers.common.simulator import DisplaySimulator
from limen.layers.points.draw.drawer import PointsLayer, PointsOverlay, Shape, SplatMethod
from limen.layers.points.select import PointCut, PointsRequest, PointTree, select_points
from limen.layers.points.stream import CHUNK_BYTES, PointStream
from limen.stream.chunks import Update, completed
from limen.viewing.camera import Camera
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, check_quilt_sizes, guard_of
from limen.viewing.tolerance import STANDS, tolerance_of
from limen.viewing.viewer import Viewer

__all__ = ["BACKGROUND", "PointsRenderer", "PointsReport"]

BACKGROUND = (0.006, 0.007, 0.01)
"""Linear light where there is no point, as of empty scenes."""

GPU_BYTES = 1 << 27
"""Memory for chunks, as much on the GPU as beside it."""

_UNCOLOURED = ("none",)

_QUILT_PX = 1 << 23
"""Pixels drawn at once: eight bytes each hold what is nearest."""


@dataclass(frozen=True, slots=True)
class PointsReport:
    """What one frame took, and what it could not have."""

    time_s: float
    policy: str
    panels_active: int
    splats: int
    chunks: int
    """Chunks whose insides are wanted."""
    missing: int
    """Of these, how many are not there (yet) and drawn as one splat."""
    max_error_px: float
    """Diameter of the largest splat that stands for more than one point, in pixels of its panel."""
    distance_factor: float
    """How many times farther away all viewers would have to be for nobody to see what is left out: 1 or less, where
    they are nobody can."""
    select_ms: float
    stream_ms: float
    draw_ms: float
    scale: float = 1.0
    """Panels were drawn with so many times their true pixels along each side."""

    @property
    def drawn(self) -> str:
        return f"{self.splats:,} splats"

    @classmethod
    def of(cls, quilts: Sequence[PointsReport]) -> PointsReport:
        """One report for all quilts of a frame."""
        sums = ("panels_active", "splats", "chunks", "missing", "select_ms", "stream_ms", "draw_ms")
        return replace(
            quilts[0],
            max_error_px=max(report.max_error_px for report in quilts),
            distance_factor=max(report.distance_factor for report in quilts),
            **{part: sum(getattr(report, part) for report in quilts) for part in sums},
        )


class _Chosen(NamedTuple):
    quilt: Quilt
    windows: QuiltPanels
    sight: PointsRequest
    cut: PointCut
    select_s: float
    generation: int  # of what was resident


class PointsRenderer:
    """One cloud of points on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, points
        What is shown, and on what.
    room_from_file
        A rotation, one scale and a move from the file's coordinates to the room, metres: shape (4, 4). By default the
        cloud stands where `limen.layers.common.room_placement.mesh_in_room` puts it.
    lit
        Whether splats that have normals are lit; by default where the file has no colours.
    shape, method
        See `limen.layers.points.draw.drawer.PointsLayer`.
    background
        Linear light (red, green, blue) where there is no point.
    gpu_bytes
        Memory for chunks.
    threads
        Reading threads.
    max_quilt_px
        Most pixels drawn at once.

    Raises
    ------
    InputError
        For a ``room_from_file`` that stretches or shears, or if not one chunk fits into ``gpu_bytes``.
    DeviceLimitError, DisplayError
        If the adapter cannot hold what is asked for or draw a panel.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        points: Points,
        *,
        room_from_file: Floats | None = None,
        lit: bool | None = None,
        shape: Shape = "round",
        method: SplatMethod | None = None,
        background: tuple[float, float, float] = BACKGROUND,
        gpu_bytes: int = GPU_BYTES,
        threads: int = 2,
        max_quilt_px: int = _QUILT_PX,
    ) -> None:
        self.display, self.points = display, points
        stands = (
            mesh_in_room(points.bounds, display, up=points.up, tilt_deg=points.tilt_deg)
            if room_from_file is None
            else room_from_file
        )
        self.room_from_file: Floats = stands
        self.motion: Floats = STANDS
        """How places of the room move with the cloud, (3, 4): what policies with ``+motion`` ask for."""
        self.lit = points.header.colours in _UNCOLOURED if lit is None else lit
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self.quilts: Sequence[Quilt] = display.quilts or pack_outlines(
            display, max_size_px=device.max_texture_px, max_px=max(max_quilt_px, 2 * widest)
        )
        check_quilt_sizes(self.quilts, device.max_texture_px)
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts)
        self._windows: dict[Quilt, QuiltPanels] = {}
        self._device, self._tree = device, PointTree.of(points)
        self._whites = [panel.luminance_cd_m2 for panel in display.panels]
        room = min(gpu_bytes, device.max_binding_bytes) // CHUNK_BYTES
        self._stream = PointStream(points, slots=room, threads=threads)
        self._layer = PointsLayer(
            device, np.concatenate(points.tops), self._stream.slots, background=background, shape=shape, method=method
        )
        self._throttle = FrameTimeBudget(len(self.quilts))
        self._reader = TextureReader(device)

    # ------------------------------------------------------------------ live

    def frame(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        *,
        quilt: Quilt | None = None,
        overlay: PointsOverlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
    ) -> PointsReport:
        """Draw what is there, ask for what is missing, and return at once.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface); with ``target``, a
        texture view of its size, they are drawn there.
        """
        chosen = [self._choose(each, viewers, policy) for each in ([quilt] if quilt else self.quilts)]
        streamed_s = self._ask(chosen)
        drawn = [self._draw(each, viewers, policy, overlay, target, target_format) for each in chosen]
        return PointsReport.of([replace(report, stream_ms=streamed_s * 1e3 / len(drawn)) for _, report in drawn])

    def textures(
        self, viewers: Sequence[Viewer], policy: Policy, *, overlay: PointsOverlay | None = None
    ) -> tuple[list[Any], PointsReport]:
        """The textures of all quilts as they are lit live; valid until the next frame."""
        chosen = [self._choose(each, viewers, policy) for each in self.quilts]
        self._ask(chosen)
        drawn = [self._draw(each, viewers, policy, overlay, slot=slot) for slot, each in enumerate(chosen)]
        return [texture for texture, _ in drawn], PointsReport.of([report for _, report in drawn])

    # ------------------------------------------------------------------ complete

    def pictures(
        self, viewers: Sequence[Viewer], policy: Policy, *, overlay: PointsOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], PointsReport]]:
        """Every panel's finished picture, quilt by quilt: (name, uint8 (h, w, 4) sRGB, the quilt's report).

        Waits for chunks; an array is only valid until the next is asked for.
        """
        for _, image, report, quilt in self._finished(viewers, policy, overlay):
            for panel, picture in pieces(self.display, quilt, image).items():
                yield panel, picture, report

    def quilt_pictures(
        self, viewers: Sequence[Viewer], policy: Policy, *, overlay: PointsOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], PointsReport]]:
        """Every quilt as it is drawn, named by its output or its number: (name, uint8 (H, W, 4) sRGB, report)."""
        for name, image, report, _ in self._finished(viewers, policy, overlay):
            yield name, image, report

    def seen(
        self,
        viewers: Sequence[Viewer],
        policy: Policy,
        cameras: Sequence[Camera],
        *,
        overlay: PointsOverlay | None = None,
    ) -> list[NDArray[np.uint8]]:
        """What cameras in the room see of the lit display: uint8 (H, W, 4), sRGB, each."""
        textures = [self._complete(quilt, viewers, policy, overlay, slot)[0] for slot, quilt in enumerate(self.quilts)]
        lit = DisplaySimulator(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def choose(self, viewers: Sequence[Viewer], policy: Policy) -> list[PointCut]:
        """What each quilt would draw with all chunks that it wants; waits for them and draws nothing."""
        return [self._settled(quilt, viewers, policy).cut for quilt in self.quilts]

    def close(self) -> None:
        """Stop reading and free the GPU memory; the device and the cloud stay open."""
        self._stream.close()
        self._layer.destroy()
        self._reader.destroy()

    def __enter__(self) -> PointsRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of a frame

    @property
    def _room_from_cloud(self) -> Floats:
        """From coordinates relative to the cloud's origin: those of the file may be millions of metres."""
        moved = np.array(self.room_from_file, dtype=float)
        moved[:3, 3] += moved[:3, :3] @ self.points.origin
        return moved

    def _choose(self, quilt: Quilt, viewers: Sequence[Viewer], policy: Policy) -> _Chosen:
        if not viewers:
            raise InputError("a cloud of points is drawn for somebody's eyes: give a viewer")
        begin = time.perf_counter()
        windows = self._windows.get(quilt)
        if windows is None:
            windows = self._windows[quilt] = QuiltPanels(self.display, quilt, guard_px=guard_of(self.display, quilt))
        sight = PointsRequest(
            windows.seen_from(viewers[0].position_m), self._room_from_cloud,
            tolerance_of(viewers, policy.eyesight, self.motion), self._throttle.within(policy),
            acuity_scale(policy, self._whites), self.lit,
        )  # fmt: skip
        cut = select_points(self._tree, self._stream.nodes, sight)
        return _Chosen(quilt, windows, sight, cut, time.perf_counter() - begin, self._stream.resident.generation)

    def _ask(self, chosen: Sequence[_Chosen]) -> float:
        """Ask for chunks, take those that have been read; seconds that took."""
        begin = time.perf_counter()
        wanted = np.concatenate([each.cut.wanted for each in chosen])
        _, first = np.unique(wanted, return_index=True)
        self._take(self._stream.update(wanted[np.sort(first)]))
        return time.perf_counter() - begin

    def _take(self, update: Update[NDArray[Any]]) -> None:
        """Copy what has come to where it is drawn from."""
        frames = self.points.frames
        for chunk, (slot,), nodes in update.arrived:
            self._layer.upload(
                slot, nodes, frames.origin[chunk], float(frames.step[chunk]), float(frames.radius[chunk])
            )

    def _settled(self, quilt: Quilt, viewers: Sequence[Viewer], policy: Policy) -> _Chosen:
        """A choice with all chunks there that it wants and that can be read and kept."""
        chosen = self._choose(quilt, viewers, policy)
        for _, update in completed([(self._stream, chosen.cut.wanted)]):
            self._take(update)
        return self._choose(quilt, viewers, policy)

    def _complete(
        self, quilt: Quilt, viewers: Sequence[Viewer], policy: Policy, overlay: PointsOverlay | None, slot: int = 0
    ) -> tuple[Any, PointsReport]:
        begin = time.perf_counter()
        chosen = self._settled(quilt, viewers, policy)
        streamed_s = time.perf_counter() - begin - chosen.select_s
        texture, report = self._draw(chosen, viewers, policy, overlay, slot=slot)
        return texture, replace(report, stream_ms=streamed_s * 1e3)

    def _finished(
        self, viewers: Sequence[Viewer], policy: Policy, overlay: PointsOverlay | None
    ) -> Iterator[tuple[str, NDArray[np.uint8], PointsReport, Quilt]]:
        for name, quilt in zip(quilt_names(self.quilts), self.quilts, strict=True):
            texture, report = self._complete(quilt, viewers, policy, overlay)
            yield name, self._reader.read(texture), report, quilt

    def _draw(
        self,
        chosen: _Chosen,
        viewers: Sequence[Viewer],
        policy: Policy,
        overlay: PointsOverlay | None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        slot: int = 0,
    ) -> tuple[Any, PointsReport]:
        begin = time.perf_counter()
        cut, views = chosen.cut, chosen.sight.views
        # What was chosen before this frame's chunks came may lie in slots that they took.
        if chosen.generation != self._stream.resident.generation:
            cut = select_points(self._tree, self._stream.nodes, chosen.sight)
        texture = self._layer.draw(
            chosen.windows, views.eye_m, self._room_from_cloud, cut.pairs, lit=self.lit, overlay=overlay,
            target=target, target_format=target_format, slot=slot,
        )  # fmt: skip
        if policy.max_ms is not None:
            self._device.wait()
            self._throttle.spent(policy, (chosen.select_s + time.perf_counter() - begin) * 1e3)
        return texture, PointsReport(
            time_s=viewers[0].time_s,
            policy=policy.label,
            panels_active=int(views.facing.sum()),
            splats=len(cut),
            chunks=len(cut.wanted),
            missing=int((~self._stream.resident.mask[cut.wanted]).sum()),
            max_error_px=cut.largest_px,
            distance_factor=cut.reached,
            select_ms=chosen.select_s * 1e3,
            stream_ms=0.0,
            draw_ms=(time.perf_counter() - begin) * 1e3,
            scale=self.display.scale,
        )
